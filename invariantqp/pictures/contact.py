"""A run in contact in one picture: force and path error over time, and the curve drawn over the wanted one.

The curve is seen along the contact's normal, or along a hinge's axis, from where the tool started.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # files only; no display is needed or opened

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from invariantqp.geometry.arrays import Array
from invariantqp.pictures.run import COLOURS
from invariantqp.runs.log import ContactTrace
from invariantqp.runs.trace import Trace

# A normal this much along the base's x has the base's y as the picture's first axis.
NEARLY_ALONG = 0.9
# Readings are drawn this far beyond the wanted force at most, so that noise does not hide the force.
SHOWN = 2.0
# Path errors below this [mm] are drawn as this: the axis is logarithmic.
FLOOR = 1e-6


def contact_picture(trace: Trace, contact: ContactTrace, path: Path | str) -> Path:
    """Write force, path error and the curve drawn to a PNG, SVG or PDF.

    Raises:
        ValueError: Matplotlib does not know the file's ending.
    """
    with mpl.rc_context({"font.size": 9}):
        figure = plt.figure(figsize=(9.5, 5.4), layout="constrained")
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
        figure.savefig(path, dpi=120)
        plt.close(figure)
    return Path(path)


def _title(trace: Trace) -> str:
    figures = trace.summary()
    plant = "MuJoCo" if trace.physics == "mujoco" else "ideal physics"
    error = f"path error at most {figures['position_error_mm']['max']:.2g} mm"
    force = "" if trace.force_error is None else f", force error {100.0 * trace.force_error:.2g} % rms"
    return f"{trace.task.name}, {plant}: {error}{force}"


def _force(axes: Axes, trace: Trace, contact: ContactTrace) -> None:
    t = trace.time[1:]
    axes.plot(t, contact.measured_press, color=COLOURS[4], linewidth=0.5, alpha=0.6, label="read")
    axes.plot(t, contact.press, color=COLOURS[0], linewidth=1.2, label="true")
    axes.axhline(contact.wanted, color="#000000", linestyle="--", linewidth=0.9, label="wanted")
    axes.set_ylim(min(-0.1 * contact.wanted, 0.0), SHOWN * contact.wanted)
    axes.set_ylabel("force [N]")
    axes.legend(loc="upper right", fontsize=8, ncols=3)
    _settling(axes, trace, "")


def _errors(axes: Axes, trace: Trace) -> None:
    t = trace.time[1:]
    axes.semilogy(t, np.maximum(1e3 * trace.position_error, FLOOR), color=COLOURS[0], linewidth=1.1, label="path [mm]")
    deg = np.maximum(np.degrees(trace.orientation_error), FLOOR)
    axes.semilogy(t, deg, color=COLOURS[1], linewidth=1.1, label="orientation [deg]")
    axes.set_ylabel("error along the contact's freedoms")
    axes.set_xlabel("time [s]")
    axes.set_ylim(bottom=0.05 * axes.get_ylim()[0])  # room for the legend
    axes.legend(loc="lower right", fontsize=8, ncols=2)
    _settling(axes, trace, "settling")


def _settling(axes: Axes, trace: Trace, said: str) -> None:
    if trace.counted_from:
        until = float(trace.time[trace.counted_from])
        axes.axvspan(0.0, until, color="#999999", alpha=0.18, linewidth=0)
        inside = axes.get_xaxis_transform()
        axes.text(0.5 * until, 0.03, said, transform=inside, ha="center", fontsize=8, color="#555555")


def _curve(axes: Axes, trace: Trace, contact: ContactTrace) -> None:
    across = _axes_of(contact.normal)
    first = trace.counted_from
    asked = 1e3 * (contact.asked[first:] - contact.asked[0]).dot(across.T)
    drawn = 1e3 * (contact.drawn[first:] - contact.asked[0]).dot(across.T)
    axes.plot(*asked.T, color="#999999", linewidth=5.0, alpha=0.5, solid_capstyle="round", label="wanted")
    axes.plot(*drawn.T, color=COLOURS[5], linewidth=1.2, label="drawn")
    axes.set_aspect("equal", adjustable="datalim")
    names = [_named(a) for a in across]
    axes.set_xlabel(f"{names[0]} [mm]")
    axes.set_ylabel(f"{names[1]} [mm]")
    axes.legend(loc="upper right", fontsize=8)
    axes.set_title("the tool's point in the contact's plane", fontsize=9)


def _axes_of(normal: Array) -> Array:
    """(2, 3) the picture's axes: right-handed about the normal, the first along the base's x where it can be."""
    x = np.eye(3)[0 if abs(normal[0]) < NEARLY_ALONG else 1]
    x = x - normal * normal.dot(x)
    x /= np.linalg.norm(x)
    return np.stack((x, np.cross(normal, x)))


def _named(axis: Array) -> str:
    i = int(np.abs(axis).argmax())
    along = abs(axis[i]) > 1.0 - 1e-9
    return f"{'-' if axis[i] < 0.0 else ''}{'xyz'[i]}" if along else f"({', '.join(f'{a:.2f}' for a in axis)})"
