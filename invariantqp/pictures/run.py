"""A run in one picture: the tracking error, and the joints' positions, velocities and accelerations by their limits.

Positions are drawn as shares of the joint's range, (q - lower) / (upper - lower), so that 0 and 1 are the limits of
every joint; velocities are divided by the joint's velocity limit, accelerations by the task's acceleration limit, so
that -1 and 1 are. Without such limits they are drawn as they are.
"""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.geometry.arrays import Array
from invariantqp.pictures.contact import contact_picture
from invariantqp.pictures.errors import plot_errors
from invariantqp.pictures.figure import figure_file
from invariantqp.pictures.palette import COLOURS, RULE, SHADE
from invariantqp.runs.trace import PathTrace, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def picture(trace: Trace, path: Path | str) -> Path:
    """Write the picture of a run to a file.

    Without contact it shows errors, joint positions, velocities and accelerations over time; with contact it shows the
    force, the path error, and the curve that the tool drew.

    Args:
        trace: from `run_task`.
        path: a .png, .svg or .pdf file.

    Returns:
        The file.

    Raises:
        BadInput: Matplotlib cannot write a file with this ending, or the file cannot be written.
    """
    if trace.contact is not None:
        return contact_picture(trace, trace.contact, path)
    from cycler import cycler  # Matplotlib brings it

    style = {"axes.prop_cycle": cycler(color=COLOURS), "font.size": 9, "axes.grid": True}
    rows = 4 if trace.along is None else 5
    with figure_file(path, (7.5, 2.3 * rows), style) as figure:
        error, position, velocity, acceleration, *progress = figure.subplots(rows, 1, sharex=True)
        _errors(error, trace)
        _positions(position, trace)
        speeds = trace.velocity_limit if np.isfinite(trace.velocity_limit).all() else None
        _by_limit(velocity, trace, trace.velocity, speeds, "velocity", "rad/s, m/s")
        allowed = trace.task.law.acceleration_limit
        _by_limit(acceleration, trace, trace.acceleration, allowed, "acceleration", "rad/s², m/s²")
        for axes in (error, position, velocity, acceleration):
            axes.grid(alpha=0.25)
            _shade(axes, trace)
        if trace.along is not None:
            _progress(progress[0], trace.time[1:], trace.along)
        (progress or [acceleration])[-1].set_xlabel("time [s]")
        figure.suptitle(_title(trace), fontsize=10)
    return Path(path)


def _title(trace: Trace) -> str:
    mm = 1e3 * trace.position_error
    active = np.mean(trace.limit_active)
    limits = f"; limits active in {100.0 * active:.2g} % of ticks (shaded)" if active else ""
    return f"{trace.task.name}: error median {np.median(mm):.2g} mm, max {mm.max():.2g} mm{limits}"


def _errors(axes: Axes, trace: Trace) -> None:
    plot_errors(axes, trace)
    axes.set_ylabel("tracking error")
    _legend_beside(axes)


def _positions(axes: Axes, trace: Trace) -> None:
    lower, upper = trace.position_limits
    bounded = np.isfinite(lower) & np.isfinite(upper)
    for i, name in enumerate(trace.names):
        if bounded[i]:
            axes.plot(trace.time, (trace.q[:, i] - lower[i]) / (upper[i] - lower[i]), label=name, linewidth=1.1)
    for edge in (0.0, 1.0):
        axes.axhline(edge, color=RULE, linestyle="--", linewidth=0.8)
    axes.set_ylim(-0.05, 1.05)
    axes.set_ylabel("position / range")
    if bounded.any():
        _legend_beside(axes)


def _by_limit(axes: Axes, trace: Trace, values: Array, limit: ArrayLike | None, what: str, unit: str) -> None:
    """(n, m) values over the joints' limits, which are at -1 and 1; as they are where there is no limit."""
    axes.plot(trace.time[1:], values if limit is None else values / np.asarray(limit), linewidth=1.1)
    axes.set_ylabel(f"{what} [{unit}]" if limit is None else f"{what} / limit")
    if limit is not None:
        for edge in (-1.0, 1.0):
            axes.axhline(edge, color=RULE, linestyle="--", linewidth=0.8)
        axes.set_ylim(-1.1, 1.1)


def _progress(axes: Axes, time: Array, along: PathTrace) -> None:
    """The speed along the path over that of its timing, shaded in the colour of the limit that rules it."""
    inside = axes.get_xaxis_transform()
    ruling = np.array(along.ruling)
    for name, colour in zip(along.slowed, cycle(COLOURS[1:]), strict=False):
        axes.fill_between(
            time, 0, 1, where=ruling == name, transform=inside, color=colour, alpha=0.3, lw=0, step="pre", label=name
        )
    axes.plot(time, along.speed, color=COLOURS[0], linewidth=1.3)
    axes.axhline(1.0, color=RULE, linestyle="--", linewidth=0.8)
    axes.set_ylabel("path speed / timing")
    axes.grid(alpha=0.25)
    if along.slowed:
        _legend_beside(axes)


def _legend_beside(axes: Axes) -> None:
    """A legend that covers no curve."""
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)


def _shade(axes: Axes, trace: Trace) -> None:
    """Shade the ticks in which a limit was active."""
    if any(trace.limit_active):
        inside = axes.get_xaxis_transform()
        where = trace.limit_active
        axes.fill_between(trace.time[1:], 0, 1, where=where, transform=inside, color=SHADE, alpha=0.18, lw=0)
