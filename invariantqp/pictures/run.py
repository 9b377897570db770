"""A run in one picture: how well the path was followed, and how near the limits the joints came.

Joints are drawn as shares of their ranges, so that arms of any kind read alike: 0 and 1 are the limits.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from cycler import cycler

mpl.use("Agg")  # files only; no display is needed or opened

from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from invariantqp.geometry.arrays import Array
from invariantqp.runs.trace import Trace

# Okabe and Ito's palette: told apart by colour-blind readers too.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000", "#F0E442")


def picture(trace: Trace, path: Path | str) -> Path:
    """Write a run to a PNG, SVG or PDF: errors, joint positions and velocities against their limits; or in contact,
    force and path error and the curve drawn.

    Raises:
        ValueError: Matplotlib does not know the file's ending.
    """
    if trace.contact is not None:
        from invariantqp.pictures.contact import contact_picture

        return contact_picture(trace, trace.contact, path)
    with mpl.rc_context({"axes.prop_cycle": cycler(color=COLOURS), "font.size": 9, "axes.grid": True}):
        figure, (error, position, velocity) = plt.subplots(3, 1, sharex=True, figsize=(7.5, 8.0), layout="constrained")
        _errors(error, trace)
        _positions(position, trace)
        _velocities(velocity, trace)
        for axes in (error, position, velocity):
            axes.grid(alpha=0.25)
            _shade(axes, trace)
        velocity.set_xlabel("time [s]")
        figure.suptitle(_title(trace), fontsize=10)
        figure.savefig(path, dpi=120)
        plt.close(figure)
    return Path(path)


def _title(trace: Trace) -> str:
    mm = 1e3 * trace.position_error
    limits = f"limits active in {100.0 * np.mean(trace.limit_active):.0f} % of ticks (shaded)"
    return f"{trace.task.name}: error median {np.median(mm):.2g} mm, max {mm.max():.2g} mm; {limits}"


def _errors(axes: Axes, trace: Trace) -> None:
    # A logarithmic axis has no zero: what is below a picometre is drawn there.
    t = trace.time[1:]
    axes.semilogy(t, np.maximum(1e3 * trace.position_error, 1e-9), label="position [mm]")
    axes.semilogy(t, np.maximum(np.degrees(trace.orientation_error), 1e-9), label="orientation [deg]")
    axes.set_ylabel("tracking error")
    axes.legend(loc="upper right", fontsize=8)


def _positions(axes: Axes, trace: Trace) -> None:
    lower, upper = trace.position_limits
    bounded = np.isfinite(lower) & np.isfinite(upper)
    for i, name in enumerate(trace.names):
        if bounded[i]:
            axes.plot(trace.time, (trace.q[:, i] - lower[i]) / (upper[i] - lower[i]), label=name, linewidth=1.1)
    for edge in (0.0, 1.0):
        axes.axhline(edge, color="#777777", linestyle="--", linewidth=0.8)
    axes.set_ylim(-0.05, 1.05)
    axes.set_ylabel("position / range")
    if bounded.any():
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)


def _velocities(axes: Axes, trace: Trace) -> None:
    limit: Array = np.where(np.isfinite(trace.velocity_limit), trace.velocity_limit, 1.0)
    for i in range(len(trace.names)):
        axes.plot(trace.time[1:], trace.velocity[:, i] / limit[i], linewidth=1.1)
    for edge in (-1.0, 1.0):
        axes.axhline(edge, color="#777777", linestyle="--", linewidth=0.8)
    axes.set_ylim(-1.1, 1.1)
    axes.set_ylabel("velocity / limit")


def _shade(axes: Axes, trace: Trace) -> None:
    """The ticks in which a limit was active."""
    if any(trace.limit_active):
        inside = axes.get_xaxis_transform()
        axes.fill_between(
            trace.time[1:], 0, 1, where=trace.limit_active, transform=inside, color="#999999", alpha=0.18, lw=0
        )
