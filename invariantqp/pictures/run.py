"""A run in one picture: the tracking error, and the joints' positions, velocities and accelerations by their limits.

Positions are drawn as shares of the joint's range, (q - lower) / (upper - lower), so that 0 and 1 are the limits of
every joint; velocities are divided by the joint's velocity limit, accelerations by the task's acceleration limit, so
that -1 and 1 are. Without such limits they are drawn as they are. Beside a clearance there is the least distance too.

A run in contact shows force and path error over time, and the curve drawn beside the curve wanted, as seen along the
contact's normal, or along the axis of a hinge; the point where the tool started is the origin.
"""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.pictures.figure import figure_file
from invariantqp.pictures.palette import BLACK, BLUE, COLOURS, CURVES, RULE, SHADE, SKY, VERMILION, errors_of
from invariantqp.runs.trace import ClearanceTrace, ContactTrace, PathTrace, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# What is drawn of a tool point that stays is this wide [mm]: rounding is not magnified.
NARROWEST = 1e-2
# The force axis ends at this multiple of the wanted force, so that noisy readings do not hide the force.
SHOWN = 2.0


def picture(trace: Trace, path: Path | str) -> Path:
    """Write the picture of a run from `run_task` to a .png, .svg or .pdf file, which is returned.

    Without contact it shows errors, joint positions, velocities and accelerations over time; with contact it shows the
    force, the path error, and the curve that the tool drew.

    Raises:
        BadInput: no trace, another ending.
    """
    if not isinstance(trace, Trace):
        raise BadInput("trace", excerpt(trace), "a Trace from run_task")
    if trace.contact is not None:
        return _contact_picture(trace, trace.contact, path)
    from cycler import cycler  # Matplotlib brings it

    style = {"axes.prop_cycle": cycler(color=COLOURS), "font.size": 9, "axes.grid": True}
    rows = 4 + (trace.along is not None) + (trace.clearance is not None)
    with figure_file(path, (7.5, 2.3 * rows), style) as figure:
        error, position, velocity, acceleration, *more = panels = figure.subplots(rows, 1, sharex=True)
        _plot_errors(error, trace)
        error.set_ylabel("tracking error")
        _legend_beside(error)
        _positions(position, trace)
        speeds = trace.velocity_limit if np.isfinite(trace.velocity_limit).all() else None
        _by_limit(velocity, trace, trace.velocity, speeds, "velocity", "rad/s, m/s")
        allowed = trace.task.law.acceleration_limit
        _by_limit(acceleration, trace, trace.acceleration, allowed, "acceleration", "rad/s², m/s²")
        if trace.clearance is not None:
            _least_distance(more[0], trace.time, trace.clearance)
        for axes in panels[: 4 + (trace.clearance is not None)]:
            axes.grid(alpha=0.25)
            _shade(axes, trace)
        if trace.along is not None:
            _progress(more[-1], trace.time[1:], trace.along)
        panels[-1].set_xlabel("time [s]")
        figure.suptitle(_title(trace), fontsize=10)
    return Path(path)


def _title(trace: Trace) -> str:
    mm = 1e3 * trace.position_error
    active = np.mean(trace.limit_active)
    limits = f"; limits active in {100.0 * active:.2g} % of ticks (shaded)" if active else ""
    return f"{trace.task.name}: error median {np.median(mm):.2g} mm, max {mm.max():.2g} mm{limits}"


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


def _least_distance(axes: Axes, time: Array, clearance: ClearanceTrace) -> None:
    """The least distance of bodies, up to several times what is kept, which is dashed."""
    shown, most = clearance.shown
    axes.plot(time, 1e3 * shown, color=BLUE, linewidth=1.1)
    axes.axhline(1e3 * clearance.kept, color=RULE, linestyle="--", linewidth=0.8)
    axes.set_ylim(1e3 * min(0.0, float(shown.min())), 1.02e3 * most)
    axes.set_ylabel("least distance [mm]")


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


def _contact_picture(trace: Trace, contact: ContactTrace, path: Path | str) -> Path:
    """The picture of a run in contact."""
    rows = 2 if trace.clearance is None else 3
    with figure_file(path, (9.5, 2.7 * rows), {"font.size": 9}) as figure:
        grid = figure.add_gridspec(rows, 2, width_ratios=(1.15, 1.0))
        force = figure.add_subplot(grid[0, 0])
        error = figure.add_subplot(grid[1, 0], sharex=force)
        curve = figure.add_subplot(grid[:, 1])
        _force(force, trace, contact)
        _free_errors(error, trace)
        _curve(curve, trace, contact)
        if trace.clearance is not None:
            _least_distance(figure.add_subplot(grid[2, 0], sharex=force), trace.time, trace.clearance)
        for axes in figure.axes:
            axes.grid(alpha=0.25)
        figure.axes[-1 if rows == 3 else 1].set_xlabel("time [s]")
        figure.suptitle(_contact_title(trace), fontsize=10)
    return Path(path)


def _contact_title(trace: Trace) -> str:
    figures = trace.summary()
    plant = "MuJoCo" if trace.physics == "mujoco" else "ideal physics"
    error = f"path error at most {figures['position_error_mm']['max']:.2g} mm"
    force = "" if trace.force_error is None else f", force error {100.0 * trace.force_error:.2g} % rms"
    return f"{trace.task.name}, {plant}: {error}{force}"


def _force(axes: Axes, trace: Trace, contact: ContactTrace) -> None:
    t = trace.time[1:]
    axes.plot(t, contact.measured_press, color=SKY, linewidth=0.5, alpha=0.6, label="measured")
    axes.plot(t, contact.press, color=BLUE, linewidth=1.2, label="true")
    axes.axhline(contact.wanted, color=BLACK, linestyle="--", linewidth=0.9, label="wanted")
    axes.set_ylim(min(-0.1 * contact.wanted, 0.0), SHOWN * contact.wanted)
    axes.set_ylabel("force [N]")
    axes.legend(loc="upper right", fontsize=8, ncols=3)
    _settling(axes, trace, "")


def _free_errors(axes: Axes, trace: Trace) -> None:
    _plot_errors(axes, trace)
    axes.set_ylabel("error in the free directions")
    axes.set_ylim(bottom=0.05 * axes.get_ylim()[0])  # room for the legend
    axes.legend(loc="lower right", fontsize=8, ncols=2)
    _settling(axes, trace, "settling")


def _settling(axes: Axes, trace: Trace, label: str) -> None:
    """Shade the time in which the contact settles: errors count after it."""
    if trace.counted_from:
        until = float(trace.time[trace.counted_from])
        axes.axvspan(0.0, until, color=SHADE, alpha=0.18, linewidth=0)
        inside = axes.get_xaxis_transform()
        axes.text(0.5 * until, 0.03, label, transform=inside, ha="center", fontsize=8, color=RULE)


def _curve(axes: Axes, trace: Trace, contact: ContactTrace) -> None:
    across = np.stack(se3.across(contact.normal))
    first = trace.counted_from
    desired = 1e3 * (contact.desired[first:] - contact.desired[0]).dot(across.T)
    drawn = 1e3 * (contact.drawn[first:] - contact.desired[0]).dot(across.T)
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


def _plot_errors(axes: Axes, trace: Trace) -> None:
    """Draw both curves."""
    for values, (label, colour) in zip(errors_of(trace).T, CURVES.items(), strict=True):
        axes.semilogy(trace.time[1:], np.maximum(values, NEGLIGIBLE), color=colour, linewidth=1.1, label=label)
