"""Pictures of an arm before it moves: principal pitches over its joint range, and the bodies of its clearance."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from invariantqp.errors import BadInput, written
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import CollisionObject, corners
from invariantqp.geometry.shapes import Core
from invariantqp.robots.bodies import PRISM_SIDES
from invariantqp.robots.kinematics import Robot, joint_ranges
from invariantqp.workbench.analysis.inspection import Inspection
from invariantqp.workbench.analysis.recommendation import MULTIPLES
from invariantqp.workbench.analysis.survey import Survey, survey
from invariantqp.workbench.pictures.charts import BLUE, RULE, SKY, TEXT, VERMILION
from invariantqp.workbench.pictures.figure import figure_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from invariantqp.control.clearance import Clearance

# Points of a line: a smooth curve at the width of a panel.
SWEEP = 121
RANGE, ALONE = "states of the range", "this joint alone"


def pitch_picture(inspection: Inspection, robot: Robot, path: Path | str) -> Path:
    """Draw principal pitches and distances from a singularity to a .png, .svg or .pdf file, which is returned.

    A column for each joint. Lines: this joint moves through its range, the others stay where the arm was inspected.
    Dots: states spread over the whole joint range.

    Args:
        inspection: from `inspect(robot)`.
        robot: the arm.
        path: the file.
    """
    m = len(inspection.joints)
    low, high = joint_ranges(robot)
    with figure_file(path, (max(6.0, 1.9 * m + 1.2), 5.4)) as figure:
        axes = figure.subplots(2, m, sharex="col", sharey="row", squeeze=False)
        for i, name in enumerate(inspection.joints):
            states = np.repeat(inspection.q[None, :], SWEEP, axis=0)
            states[:, i] = np.linspace(low[i], high[i], SWEEP)
            swept = survey(robot, states)
            upper, lower = axes[0, i], axes[1, i]
            _pitches(upper, i, swept, inspection)
            sampled = inspection.survey
            lower.plot(sampled.q[:, i], sampled.distance, ".", color=SKY, alpha=0.5, label=RANGE)
            lower.plot(swept.q[:, i], swept.distance, color=BLUE, label=ALONE)
            for panel in (upper, lower):
                panel.axvline(inspection.q[i], color=RULE, linestyle=":")
            upper.set_title(name)
            lower.set_xlabel("position [rad, m]")
        axes[0, 0].set_ylabel("principal pitches [m/rad]")
        axes[1, 0].set_ylabel("distance from a singularity")
        axes[1, 0].set_ylim(bottom=0.0)
        _explain_empty(axes[0], inspection)
        h, rank = inspection.recommended.h, inspection.survey.attainable_rank
        use = "no pitch" if h is None else f"pitch h = {written(h, 3)}"
        figure.suptitle(f"{Path(inspection.robot).name} to {inspection.tool}: rank {rank}; recommended: {use}")
        entries = {
            label: handle for a in axes.ravel() for handle, label in zip(*a.get_legend_handles_labels(), strict=True)
        }
        figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=len(entries), frameon=False)
    return Path(path)


def _pitches(axes: Axes, joint: int, swept: Survey, inspection: Inspection) -> None:
    sampled, h = inspection.survey, inspection.recommended.h
    if sampled.attainable_rank < 6:
        dots = _regular(sampled, sampled.attainable_rank)
        if np.isfinite(dots).any():
            x = np.repeat(sampled.q[:, joint], dots.shape[1])
            axes.plot(x, dots.ravel(), ".", color=SKY, alpha=0.5, label=RANGE)
        lines = _regular(swept, sampled.attainable_rank)
        for k in np.flatnonzero(np.isfinite(lines).any(axis=0)).tolist():
            axes.plot(swept.q[:, joint], lines[:, k], color=BLUE, label=ALONE)
    if h is not None:
        axes.axhline(h, color=VERMILION, linestyle="--", label=f"recommended h = {written(h, 3)}")
    # Principal pitches go to infinity near states where no pitch works: the axis ends at the largest candidate.
    largest = MULTIPLES[-1] * (inspection.recommended.length if h is None else abs(h))
    axes.set_ylim(-largest, largest)


def _regular(states: Survey, rank: int) -> Array:
    """(n, 6) principal pitches of the states with this rank, NaN in the others."""
    return np.where((states.rank == rank)[:, None], states.pitches, np.nan)


def _explain_empty(row: Array, inspection: Inspection) -> None:
    """Write into empty panels of pitches why they are empty."""
    if inspection.survey.blind_share == 1.0:
        reason = "no pitch works"
        row[0].set_yticks([])
    elif inspection.survey.attainable_rank == 6:
        reason = "every pitch works"
    else:
        return
    for axes in row:
        axes.text(0.5, 0.75, reason, transform=axes.transAxes, ha="center", va="center", color=TEXT)


def bodies_picture(clearance: Clearance, q: ArrayLike, path: Path | str) -> Path:
    """Draw a clearance's bodies at joint positions q (m,) to a .png, .svg or .pdf file, which is returned.

    Front and side view; the two nearest bodies stand out. Half spaces are left out.
    """
    shapes = [shape for shape in clearance.shapes(q) if shape[2].core is not Core.HALF_SPACE]
    if not shapes:
        raise BadInput("clearance", "no bodies", "a robot with collision geometry, or bodies=")
    nearest = clearance.at(q)
    with figure_file(path, (9.0, 4.8)) as figure:
        for panel, axis, title in zip(figure.subplots(1, 2), (1, 0), ("along y", "along x"), strict=True):
            plane = [i for i in range(3) if i != axis]
            for name, body, placed in shapes:
                hue = RULE if body is None else VERMILION if name in nearest[:2] else BLUE if body % 2 else SKY
                panel.fill(*_outline(placed, plane).T, facecolor=hue, edgecolor=TEXT, alpha=0.5)
            panel.set_aspect("equal", "datalim")
            panel.set_xlabel("xyz"[plane[0]])
            panel.set_ylabel("xyz"[plane[1]])
            panel.set_title(f"seen {title}")
        figure.suptitle(f"nearest: {nearest}" if nearest.first else "no two bodies can touch")
    return Path(path)


def _outline(placed: CollisionObject, plane: list[int]) -> Array:
    """(n, 2) corners of a shape's projection onto a plane of two axes."""
    angles = np.linspace(0.0, 2.0 * np.pi, PRISM_SIDES, endpoint=False)
    if placed.mesh is not None:
        flat = (
            placed.mesh.display_triangles().reshape(-1, 3).dot(placed.pose[:3, :3].T)[:, plane] + placed.pose[plane, 3]
        )
        return np.asarray(flat[ConvexHull(flat).vertices])
    ends = np.array(corners(placed.half)).dot(placed.pose[:3, :3].T) + placed.pose[:3, 3]
    circle = placed.radius * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    points = (ends[:, None, plane] + circle[None]).reshape(-1, 2)
    return np.asarray(points[ConvexHull(points).vertices])
