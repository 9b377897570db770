"""A run in one picture: its charts, and joint accelerations; in contact the curve drawn beside the curve wanted.

That curve is seen along the contact's normal, or along the axis of a hinge, from where the tool started.
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

# What is drawn of a tool point that stays is this wide [mm]: rounding is not magnified.
NARROWEST = 1e-2


def picture(trace: Trace, path: Path | str) -> Path:
    """Write the picture of a run from `run_task` to a .png, .svg or .pdf file, which is returned.

    It shows errors, joint positions, velocities and accelerations over time, near obstacles the least distance, along
    an elastic path its speed; in contact the force, and the curve that the tool drew.

    Raises:
        BadInput: no trace, another ending.
    """
    arrays.instance(trace, Trace, "trace", "a Trace from run_task")
    ends, contact = frame_ends(len(trace.velocity)), trace.contact
    charts = charts_of(trace, ends)
    if contact is None:
        charts.append(_accelerations(trace, ends))
    rows = len(charts) + (trace.along is not None)
    size = (7.5 if contact is None else 11.5, 2.3 * rows)
    with figure_file(path, size, {"font.size": 9, "axes.grid": True, "grid.alpha": 0.25}) as figure:
        grid = figure.add_gridspec(rows, 1 if contact is None else 2)
        panels = [figure.add_subplot(grid[i, 0]) for i in range(rows)]
        named: tuple[str, ...] = ()
        for axes, chart in zip(panels, charts, strict=False):
            axes.sharex(panels[-1])
            axes.tick_params(labelbottom=axes is panels[-1])
            _chart(axes, trace.time[ends], chart, legend=chart.names != named)
            _shade(axes, trace)
            named = chart.names
        if trace.along is not None:
            _progress(panels[-1], trace.time[1:], trace.along)
        panels[-1].set_xlabel("time [s]")
        if contact is not None:
            _curve(figure.add_subplot(grid[:, 1]), trace, contact)
        figure.suptitle(_title(trace), fontsize=10)
    return Path(path)


def _title(trace: Trace) -> str:
    error, active = trace.summary()["position_error_mm"], 100.0 * np.mean(trace.limit_active)
    plant = ", MuJoCo" if trace.physics == "mujoco" else ""
    force = "" if trace.force_error is None else f", force error {100.0 * trace.force_error:.2g} % rms"
    limits = f"; limits active in {active:.2g} % of ticks{'' if trace.contact else ' (shaded)'}" if active else ""
    return f"{trace.task.name}{plant}: error median {error['median']:.2g} mm, max {error['max']:.2g} mm{force}{limits}"


def _accelerations(trace: Trace, ends: Array) -> CurveChart:
    """By the task's acceleration limit, which is at -1 and 1; as they are where it has none."""
    limit, values = trace.task.law.acceleration_limit, extremes(trace.acceleration, ends)
    hues = colours(len(trace.names))
    if limit is None:
        return CurveChart("joint acceleration [rad/s², m/s²]", trace.names, values.T, hues)
    shares = (values / np.asarray(limit)).T
    return CurveChart("joint acceleration / limit", trace.names, shares, hues, (-1.0, 1.0), (-1.1, 1.1))


def _chart(axes: Axes, time: Array, chart: CurveChart, *, legend: bool) -> None:
    for name, values, colour in zip(chart.names, chart.values, chart.colours, strict=True):
        axes.plot(time, values, label=name, color=colour, linewidth=1.1)
    for level in chart.levels:
        axes.axhline(level, color=RULE, linestyle="--", linewidth=0.8)
    if chart.log:
        axes.set_yscale("log")
    if chart.span is not None:
        axes.set_ylim(*chart.span)
    axes.set_ylabel(chart.title)
    if legend:
        _legend_beside(axes)


def _legend_beside(axes: Axes) -> None:
    """A legend that covers no curve."""
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)


def _shade(axes: Axes, trace: Trace) -> None:
    """Shade the ticks in which a limit was active; in contact the time in which it settles: errors count after it."""
    settling = np.arange(len(trace.velocity)) < trace.counted_from
    where = trace.limit_active if trace.contact is None else settling
    if np.any(where):
        inside = axes.get_xaxis_transform()
        axes.fill_between(trace.time[1:], 0, 1, where=where, transform=inside, color=SHADE, alpha=0.18, lw=0)


def _progress(axes: Axes, time: Array, along: PathTrace) -> None:
    """The speed along the path over that of its timing, shaded in the colour of the limit that rules it."""
    inside = axes.get_xaxis_transform()
    ruling = np.array(along.ruling)
    for name, colour in zip(along.slowdowns, cycle(COLOURS[1:]), strict=False):
        axes.fill_between(
            time, 0, 1, where=ruling == name, transform=inside, color=colour, alpha=0.3, lw=0, step="pre", label=name
        )
    axes.plot(time, along.speed, color=COLOURS[0], linewidth=1.3)
    axes.axhline(1.0, color=RULE, linestyle="--", linewidth=0.8)
    axes.set_ylabel("path speed / timing")
    if along.slowdowns:
        _legend_beside(axes)


def _curve(axes: Axes, trace: Trace, contact: ContactTrace) -> None:
    across = np.stack(se3.across(contact.normal))
    first = trace.counted_from
    desired = 1e3 * (contact.desired[first:] - contact.desired[0]).dot(across.T)
    drawn = 1e3 * (contact.position[first:] - contact.desired[0]).dot(across.T)
    axes.plot(*desired.T, color=SHADE, linewidth=5.0, alpha=0.5, solid_capstyle="round", label="wanted")
    axes.plot(*drawn.T, color=VERMILION, linewidth=1.2, label="drawn")
    axes.plot(*drawn[-1], color=VERMILION, marker="o", markersize=4.0)
    middle = 0.5 * (desired.min(axis=0) + desired.max(axis=0))
    axes.plot(*(middle + 0.5 * NARROWEST * np.array([[-1.0, -1.0], [1.0, 1.0]])).T, linestyle="none")
    axes.set_aspect("equal", adjustable="datalim")
    names = [_named(a) for a in across]
    axes.set_xlabel(f"{names[0]} [mm]")
    axes.set_ylabel(f"{names[1]} [mm]")
    axes.legend(loc="upper right", fontsize=8)
    axes.set_title("path of the tool point in the plane of contact", fontsize=9)


def _named(axis: Array) -> str:
    """A direction as "x", "-y", "z", or by its components."""
    i = int(np.abs(axis).argmax())
    along = abs(axis[i]) > 1.0 - NEGLIGIBLE
    return f"{'-' if axis[i] < 0.0 else ''}{'xyz'[i]}" if along else f"({', '.join(f'{a:.2f}' for a in axis)})"
