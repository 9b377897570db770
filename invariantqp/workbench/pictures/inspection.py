"""Of an inspected arm its principal pitches and the pitch that serves for splits, or the bodies of its clearance.

Pitches are drawn over the joint range, a column for each joint. Lines: this joint moves through its range and the
others stay where the arm was inspected. Dots: states spread over the whole joint range. The lower row shows how far
each state is from a singularity. Bodies are seen from the front and from the side; the two nearest stand out.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from invariantqp.errors import BadInput, written
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Placed, corners
from invariantqp.geometry.shapes import Core
from invariantqp.robots.bodies import PRISM_SIDES
from invariantqp.robots.kinematics import Robot, joint_ranges
from invariantqp.workbench.analysis.inspection import MULTIPLES, Inspection
from invariantqp.workbench.analysis.survey import Survey, survey
from invariantqp.workbench.pictures.charts import BLUE, RULE, SKY, TEXT, VERMILION
from invariantqp.workbench.pictures.figure import figure_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from invariantqp.control.clearance import Clearance

# Points of a line: enough for a smooth curve at the width of a panel.
SWEEP = 121
RANGE, ALONE = "states of the range", "this joint alone"


def pitch_picture(inspection: Inspection, robot: Robot, path: Path | str) -> Path:
    """Write principal pitches and distance from a singularity over the range of each joint to a .png, .svg or .pdf.

    `inspection` is of `robot`. Returns the file.
    """
    m = len(inspection.joints)
    low, high = joint_ranges(robot)
    size = (max(6.0, 1.9 * m + 1.2), 5.4)
    with figure_file(path, size, {"font.size": 9, "axes.titlesize": 9}) as figure:
        axes = figure.subplots(2, m, sharex="col", sharey="row", squeeze=False)
        for i, name in enumerate(inspection.joints):
            states = np.repeat(inspection.q[None, :], SWEEP, axis=0)
            states[:, i] = np.linspace(low[i], high[i], SWEEP)
            swept = survey(robot, states)
            upper, lower = axes[0, i], axes[1, i]
            _pitches(upper, i, swept, inspection)
            seen = inspection.survey
            lower.plot(seen.q[:, i], seen.distance, ".", color=SKY, markersize=3, alpha=0.5, label=RANGE)
            lower.plot(swept.q[:, i], swept.distance, color=BLUE, linewidth=1.4, label=ALONE)
            for panel in (upper, lower):
                panel.axvline(inspection.q[i], color=RULE, linewidth=0.7, linestyle=":")
                panel.grid(alpha=0.25)
            upper.set_title(name)
            lower.set_xlabel("position [rad, m]")
        axes[0, 0].set_ylabel("principal pitches [m/rad]")
        axes[1, 0].set_ylabel("distance from a singularity")
        axes[1, 0].set_ylim(bottom=0.0)
        _absent(axes[0], inspection)
        h, rank = inspection.recommended.h, inspection.survey.attainable_rank
        use = "no pitch" if h is None else f"pitch h = {written(h, 3)}"
        title = f"{Path(inspection.robot).name} to {inspection.tool}: rank {rank}; recommended: {use}"
        figure.suptitle(title, fontsize=10)
        marks = {
            label: handle for a in axes.ravel() for handle, label in zip(*a.get_legend_handles_labels(), strict=True)
        }
        figure.legend(marks.values(), marks.keys(), loc="outside lower center", ncols=len(marks), frameon=False)
    return Path(path)


def _pitches(axes: Axes, joint: int, swept: Survey, inspection: Inspection) -> None:
    seen, h = inspection.survey, inspection.recommended.h
    if seen.attainable_rank < 6:
        dots = _regular(seen, seen.attainable_rank)
        if np.isfinite(dots).any():
            x = np.repeat(seen.q[:, joint], dots.shape[1])
            axes.plot(x, dots.ravel(), ".", color=SKY, markersize=3, alpha=0.5, label=RANGE)
        lines = _regular(swept, seen.attainable_rank)
        for k in np.flatnonzero(np.isfinite(lines).any(axis=0)).tolist():
            axes.plot(swept.q[:, joint], lines[:, k], color=BLUE, linewidth=1.4, label=ALONE)
    if h is not None:
        axes.axhline(h, color=VERMILION, linestyle="--", linewidth=1.2, label=f"recommended h = {written(h, 3)}")
    # Near states where no pitch works, principal pitches go to infinity: the axis ends at the largest that is tried.
    most = MULTIPLES[-1] * (inspection.recommended.length if h is None else abs(h))
    axes.set_ylim(-most, most)


def _regular(states: Survey, rank: int) -> Array:
    """(n, 6) the pitches of states with this rank; NaN in other states, whose pitches are those of another system."""
    return np.where((states.rank == rank)[:, None], states.pitches, np.nan)


def _absent(row: Array, inspection: Inspection) -> None:
    """Say why the panels of pitches are empty, where they are."""
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
    """Write what a clearance keeps apart, at joint positions q (m,), to a .png, .svg or .pdf file."""
    shapes = [one for one in clearance.shapes(q) if one[2].core is not Core.HALF_SPACE]
    if not shapes:
        raise BadInput("clearance", "no bodies", "a robot with collision geometry, or bodies=")
    near = clearance.at(q)
    with figure_file(path, (9.0, 4.8), {"font.size": 9, "svg.fonttype": "none"}) as figure:
        for panel, axis, title in zip(figure.subplots(1, 2), (1, 0), ("along y", "along x"), strict=True):
            seen = [i for i in range(3) if i != axis]
            for name, body, placed in shapes:
                hue = RULE if body is None else VERMILION if name in near[:2] else BLUE if body % 2 else SKY
                panel.fill(*_outline(placed, seen).T, facecolor=hue, edgecolor=TEXT, alpha=0.45, linewidth=0.8)
            panel.set_aspect("equal", "datalim")
            panel.set_xlabel("xyz"[seen[0]])
            panel.set_ylabel("xyz"[seen[1]])
            panel.set_title(f"seen {title}")
        figure.suptitle(f"nearest: {near}" if near.first else "no two bodies can touch")
    return Path(path)


def _outline(placed: Placed, seen: list[int]) -> Array:
    """(n, 2) corners of a shape's shadow."""
    turn = np.linspace(0.0, 2.0 * np.pi, PRISM_SIDES, endpoint=False)
    if placed.solid is not None:
        flat = placed.solid.drawn().reshape(-1, 3).dot(placed.pose[:3, :3].T)[:, seen] + placed.pose[seen, 3]
        return np.asarray(flat[ConvexHull(flat).vertices])
    ends = np.array(corners(placed.half)).dot(placed.pose[:3, :3].T) + placed.pose[:3, 3]
    circle = placed.radius * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    points = (ends[:, None, seen] + circle[None]).reshape(-1, 2)
    return np.asarray(points[ConvexHull(points).vertices])
