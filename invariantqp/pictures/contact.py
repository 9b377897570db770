"""A run in contact in one picture: force and path error over time, and the curve drawn beside the curve wanted.

The view of the curves is along the contact's normal, or along the axis of a hinge. The point where the tool started is
the origin.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.pictures.errors import plot_errors
from invariantqp.pictures.figure import figure_file
from invariantqp.pictures.palette import BLACK, BLUE, RULE, SHADE, SKY, VERMILION
from invariantqp.runs.trace import ContactTrace, Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# A direction whose largest component is this close to 1 is called x, y or z.
ALONG = 1e-9
# The force axis ends at this multiple of the wanted force, so that noisy readings do not hide the force.
SHOWN = 2.0


def contact_picture(trace: Trace, contact: ContactTrace, path: Path | str) -> Path:
    """Write force, path error and the curve drawn in a run to a .png, .svg or .pdf file.

    Raises:
        BadInput: Matplotlib cannot write a file with this ending, or the file cannot be written.
    """
    with figure_file(path, (9.5, 5.4), {"font.size": 9}) as figure:
        grid = figure.add_gridspec(2, 2, width_ratios=(1.15, 1.0))
        force = figure.add_subplot(grid[0, 0])
        error = figure.add_subplot(grid[1, 0], sharex=force)
        curve = figure.add_subplot(grid[:, 1])
        _force(force, trace, contact)
        _errors(error, trace)
        _curve(curve, trace, contact)
        for axes in (force, error, curve):
            axes.grid(alpha=0.25)
        figure.suptitle(_title(trace), fontsize=10)
    return Path(path)


def _title(trace: Trace) -> str:
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


def _errors(axes: Axes, trace: Trace) -> None:
    plot_errors(axes, trace)
    axes.set_ylabel("error in the free directions")
    axes.set_xlabel("time [s]")
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
    asked = 1e3 * (contact.asked[first:] - contact.asked[0]).dot(across.T)
    drawn = 1e3 * (contact.drawn[first:] - contact.asked[0]).dot(across.T)
    axes.plot(*asked.T, color=SHADE, linewidth=5.0, alpha=0.5, solid_capstyle="round", label="wanted")
    axes.plot(*drawn.T, color=VERMILION, linewidth=1.2, label="drawn")
    axes.set_aspect("equal", adjustable="datalim")
    names = [_named(a) for a in across]
    axes.set_xlabel(f"{names[0]} [mm]")
    axes.set_ylabel(f"{names[1]} [mm]")
    axes.legend(loc="upper right", fontsize=8)
    axes.set_title("path of the tool point in the plane of contact", fontsize=9)


def _named(axis: Array) -> str:
    """A direction as "x", "-y", "z", or by its components."""
    i = int(np.abs(axis).argmax())
    along = abs(axis[i]) > 1.0 - ALONG
    return f"{'-' if axis[i] < 0.0 else ''}{'xyz'[i]}" if along else f"({', '.join(f'{a:.2f}' for a in axis)})"
