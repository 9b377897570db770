"""The picture of a run: its charts and joint accelerations, or in contact the path of the tool point.

The view of that path is along the contact's normal, or along the axis of a hinge; its origin is the start.
"""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.workbench.pictures.charts import (
    COLOURS,
    RULE,
    SHADE,
    VERMILION,
    CurveChart,
    charts_of,
    colours,
    extremes,
    frame_ends,
)
from invariantqp.workbench.pictures.figure import figure_file
from invariantqp.workbench.runs.trace import ContactTrace, PathTrace, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Least width of the path of the tool point [mm]: rounding of a tool that stays is not magnified.
MIN_WIDTH_MM = 1e-2


def picture(trace: Trace, path: Path | str) -> Path:
    """Draw a run from `run_task` to a .png, .svg or .pdf file, which is returned.

    Curves over time: errors, joint positions, velocities and accelerations; with obstacles the least distance; with an
    elastic path its speed; in contact the force instead of accelerations, and the path of the tool point.

    Raises:
        BadInput: not a trace, or another ending.
    """
    arrays.instance(trace, Trace, "trace", "a Trace from run_task")
    ends, contact = frame_ends(len(trace.velocity)), trace.contact
    charts = charts_of(trace, ends)
    if contact is None:
        charts.append(_accelerations(trace, ends))
    rows = len(charts) + (trace.along is not None)
    with figure_file(path, (7.5 if contact is None else 11.5, 2.3 * rows)) as figure:
        grid = figure.add_gridspec(rows, 1 if contact is None else 2)
        panels = [figure.add_subplot(grid[i, 0]) for i in range(rows)]
        names: tuple[str, ...] = ()
        for axes, chart in zip(panels, charts, strict=False):
            axes.sharex(panels[-1])
            axes.tick_params(labelbottom=axes is panels[-1])
            _chart(axes, trace.time[ends], chart, legend=chart.names != names)
            _shade_ticks(axes, trace)
            names = chart.names
        if trace.along is not None:
            _progress(panels[-1], trace.time[1:], trace.along)
        panels[-1].set_xlabel("time [s]")
        if contact is not None:
            _curve(figure.add_subplot(grid[:, 1]), trace, contact)
        figure.suptitle(_title(trace))
    return Path(path)


def _title(trace: Trace) -> str:
    error, active = trace.summary()["position_error_mm"], 100.0 * np.mean(trace.limit_active)
    plant = ", MuJoCo" if trace.physics == "mujoco" else ""
    force = "" if trace.force_error is None else f", force error {100.0 * trace.force_error:.2g} % rms"
    limits = f"; limits active in {active:.2g} % of ticks{'' if trace.contact else ' (shaded)'}" if active else ""
    return f"{trace.task.name}{plant}: error median {error['median']:.2g} mm, max {error['max']:.2g} mm{force}{limits}"


def _accelerations(trace: Trace, ends: Array) -> CurveChart:
    """Joint accelerations as shares of the task's limit, or as they are if it has none."""
    limit, values = trace.task.law.acceleration_limit, extremes(trace.acceleration, ends)
    hues = colours(len(trace.names))
    if limit is None:
        return CurveChart("joint acceleration [rad/s², m/s²]", trace.names, values.T, hues)
    shares = (values / np.asarray(limit)).T
    return CurveChart("joint acceleration / limit", trace.names, shares, hues, (-1.0, 1.0), (-1.1, 1.1))


def _chart(axes: Axes, time: Array, chart: CurveChart, *, legend: bool) -> None:
    for name, values, colour in zip(chart.names, chart.values, chart.colours, strict=True):
        axes.plot(time, values, label=name, color=colour)
    for level in chart.levels:
        axes.axhline(level, color=RULE, linestyle="--")
    if chart.log:
        axes.set_yscale("log")
    if chart.span is not None:
        axes.set_ylim(*chart.span)
    axes.set_ylabel(chart.title)
    if legend:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _shade_ticks(axes: Axes, trace: Trace) -> None:
    """Shade the ticks in which a limit was active; in contact the settling time, which errors leave out."""
    settling = np.arange(len(trace.velocity)) < trace.counted_from
    where = trace.limit_active if trace.contact is None else settling
    if np.any(where):
        inside = axes.get_xaxis_transform()
        axes.fill_between(trace.time[1:], 0, 1, where=where, transform=inside, color=SHADE, alpha=0.18, lw=0)


def _progress(axes: Axes, time: Array, along: PathTrace) -> None:
    """Speed along the path over that of its timing, shaded in the colour of the limit that determines it."""
    inside = axes.get_xaxis_transform()
    ruling = np.array(along.ruling)
    for name, colour in zip(along.slowdowns, cycle(COLOURS[1:]), strict=False):
        axes.fill_between(
            time, 0, 1, where=ruling == name, transform=inside, color=colour, alpha=0.3, lw=0, step="pre", label=name
        )
    axes.plot(time, along.speed, color=COLOURS[0])
    axes.axhline(1.0, color=RULE, linestyle="--")
    axes.set_ylabel("path speed / timing")
    if along.slowdowns:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _curve(axes: Axes, trace: Trace, contact: ContactTrace) -> None:
    across = np.stack(se3.perpendicular_axes(contact.normal))
    first = trace.counted_from
    desired = 1e3 * (contact.desired[first:] - contact.desired[0]).dot(across.T)
    actual = 1e3 * (contact.position[first:] - contact.desired[0]).dot(across.T)
    axes.plot(*desired.T, color=SHADE, linewidth=5.0, alpha=0.5, solid_capstyle="round", label="wanted")
    axes.plot(*actual.T, color=VERMILION, label="drawn")
    axes.plot(*actual[-1], color=VERMILION, marker="o")
    middle = 0.5 * (desired.min(axis=0) + desired.max(axis=0))
    axes.plot(*(middle + 0.5 * MIN_WIDTH_MM * np.array([[-1.0, -1.0], [1.0, 1.0]])).T, linestyle="none")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel(f"{_axis_name(across[0])} [mm]")
    axes.set_ylabel(f"{_axis_name(across[1])} [mm]")
    axes.legend(loc="upper right")
    axes.set_title("path of the tool point in the plane of contact")


def _axis_name(axis: Array) -> str:
    """A direction as "x", "-y", "z", or as its components."""
    i = int(np.abs(axis).argmax())
    along = abs(axis[i]) > 1.0 - NEGLIGIBLE
    return f"{'-' if axis[i] < 0.0 else ''}{'xyz'[i]}" if along else f"({', '.join(f'{a:.2f}' for a in axis)})"
