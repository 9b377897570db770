"""Tracking errors over time as every picture and page draws them, in millimetres and degrees on a logarithmic axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.pictures.palette import BLUE, ORANGE
from invariantqp.runs.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Curves and their colours.
CURVES = {"position [mm]": BLUE, "orientation [deg]": ORANGE}
# A logarithmic axis has no zero: smaller errors, below a picometre, are drawn as this [mm, deg].
SMALLEST = 1e-9


def errors_of(trace: Trace) -> Array:
    """(n, 2) of each tick, in the order of CURVES."""
    errors: Array = np.column_stack((1e3 * trace.position_error, np.degrees(trace.orientation_error)))
    return errors


def plot_errors(axes: Axes, trace: Trace) -> None:
    """Draw both curves."""
    for values, (label, colour) in zip(errors_of(trace).T, CURVES.items(), strict=True):
        axes.semilogy(trace.time[1:], np.maximum(values, SMALLEST), color=colour, linewidth=1.1, label=label)
