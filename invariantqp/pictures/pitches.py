"""The principal pitches of an arm over its joint range: one column a joint, with the recommended pitch among them.

Lines: one joint moves through its range, the others stay where the inspection was made. Dots: the states of its survey.
Below, how far each state is from a singularity.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")  # files only; no display is needed or opened

from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from invariantqp.analysis.inspection import Inspection
from invariantqp.analysis.survey import Survey, joint_ranges, survey
from invariantqp.errors import written
from invariantqp.geometry.arrays import Array
from invariantqp.pictures.run import COLOURS
from invariantqp.robots.kinematics import Robot

# Points of a line: enough for a curve without corners at the width of a panel.
SWEEP = 121
# Pitches go to infinity towards states in which no pitch works; drawn is what is within this many recommended pitches.
VIEW = 4.0
RANGE, ALONE = "states of the range", "this joint alone"
LINE, DOT, ADVICE, STATE = COLOURS[0], COLOURS[4], COLOURS[5], "#777777"


def pitch_picture(inspection: Inspection, robot: Robot, path: Path | str) -> Path:
    """Write principal pitches and distance from a singularity over the range of each joint to a PNG, SVG or PDF.

    Args:
        inspection: of `robot`.
        robot: the arm.
        path: the file.

    Raises:
        ValueError: Matplotlib does not know the file's ending.
    """
    m = len(inspection.joints)
    low, high = joint_ranges(robot)
    with mpl.rc_context({"font.size": 9, "axes.titlesize": 9}):
        size = (max(6.0, 1.9 * m + 1.2), 5.4)
        figure, axes = plt.subplots(2, m, sharex="col", sharey="row", figsize=size, layout="constrained", squeeze=False)
        for i, name in enumerate(inspection.joints):
            states = np.repeat(inspection.q[None, :], SWEEP, axis=0)
            states[:, i] = np.linspace(low[i], high[i], SWEEP)
            swept = survey(robot, states)
            upper, lower = axes[0, i], axes[1, i]
            _pitches(upper, i, swept, inspection)
            _distance(lower, i, swept, inspection.survey)
            for panel in (upper, lower):
                panel.axvline(inspection.q[i], color=STATE, linewidth=0.7, linestyle=":")
                panel.grid(alpha=0.25)
            upper.set_title(name)
            lower.set_xlabel("position [rad, m]")
        axes[0, 0].set_ylabel("principal pitches [m/rad]")
        axes[1, 0].set_ylabel("distance from a singularity")
        axes[1, 0].set_ylim(bottom=0.0)
        _absent(axes[0], inspection)
        figure.suptitle(_title(inspection), fontsize=10)
        marks = {
            label: handle for a in axes.ravel() for handle, label in zip(*a.get_legend_handles_labels(), strict=True)
        }
        figure.legend(marks.values(), marks.keys(), loc="outside lower center", ncols=len(marks), frameon=False)
        figure.savefig(path, dpi=120)
        plt.close(figure)
    return Path(path)


def _pitches(axes: Axes, joint: int, swept: Survey, inspection: Inspection) -> None:
    seen, h = inspection.survey, inspection.recommended.h
    if seen.attainable_rank < 6:
        dots = _regular(seen, seen.attainable_rank)
        if np.isfinite(dots).any():
            x = np.repeat(seen.q[:, joint], dots.shape[1])
            axes.plot(x, dots.ravel(), ".", color=DOT, markersize=3, alpha=0.5, label=RANGE)
        lines = _regular(swept, seen.attainable_rank)
        for k in np.flatnonzero(np.isfinite(lines).any(axis=0)).tolist():
            axes.plot(swept.q[:, joint], lines[:, k], color=LINE, linewidth=1.4, label=ALONE)
    if h is not None:
        axes.axhline(h, color=ADVICE, linestyle="--", linewidth=1.2, label=f"recommended h = {written(h, 3)}")
        axes.set_ylim(-VIEW * abs(h), VIEW * abs(h))


def _regular(states: Survey, rank: int) -> Array:
    """(n, 6) pitches where the arm has its rank; NaN elsewhere, where they belong to another system."""
    return np.where((states.rank == rank)[:, None], states.pitches, np.nan)


def _distance(axes: Axes, joint: int, swept: Survey, seen: Survey) -> None:
    axes.plot(seen.q[:, joint], seen.distance, ".", color=DOT, markersize=3, alpha=0.5, label=RANGE)
    axes.plot(swept.q[:, joint], swept.distance, color=LINE, linewidth=1.4, label=ALONE)


def _absent(row: Array, inspection: Inspection) -> None:
    """Say why there is nothing to see where there is nothing to see."""
    if inspection.recommended.form == "tool":
        said = "no pitch works"
        row[0].set_yticks([])
    elif inspection.survey.attainable_rank == 6:
        said = "every pitch works"
    else:
        return
    for axes in row:
        axes.text(0.5, 0.75, said, transform=axes.transAxes, ha="center", va="center", color="#444444")


def _title(inspection: Inspection) -> str:
    advice = inspection.recommended
    use = f"pitch form, h = {written(advice.h, 3)}" if advice.h is not None else "metric carried by the tool"
    seen = inspection.survey
    return f"{Path(inspection.robot).name} to {inspection.tool}: rank {seen.attainable_rank}; recommended: {use}"
