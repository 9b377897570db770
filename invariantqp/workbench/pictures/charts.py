"""The charts of a run, for its picture and its page: curves over the times of frames, and the colours of all pictures.

A frame has the worst values of the ticks since the frame before. The colours are those of Okabe and Ito (2008), which
colour-blind readers can tell apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.workbench.runs.trace import Trace

BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
VERMILION = "#D55E00"
BLACK = "#000000"
YELLOW = "#F0E442"

# Of curves on white paper, in order.
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, BLACK, YELLOW)
# Of curves on a page that may be dark or light: grey and olive, because either would hide black or yellow.
SCREEN_COLOURS = (*COLOURS[:6], "#7F7F7F", "#B8A900")

# Greys of text beside the data, reference lines and shaded areas.
TEXT, RULE, SHADE = "#444444", "#777777", "#999999"
# The most frames of a run; players interpolate.
FRAMES = 600
# Title of the chart of errors, by which a page finds it.
ERROR = "tracking error"


class CurveChart(NamedTuple):
    """Curves over the times of k frames."""

    title: str  # with its unit
    names: tuple[str, ...]  # of the c curves
    values: Array  # (c, k)
    colours: tuple[str, ...]  # of the curves
    levels: tuple[float, ...] = ()  # of horizontal lines at limits or desired values
    span: tuple[float, float] | None = None  # ends of the vertical axis; None fits the curves
    log: bool = False  # whether that axis is logarithmic


def frame_ends(n: int) -> Array:
    """(k,) the number of ticks before each frame of a run of n ticks."""
    return np.unique(np.linspace(0, n, min(n + 1, FRAMES)).round().astype(int))


def ticks_of(ends: Array) -> list[tuple[int, int]]:
    """The range of ticks of each frame: those since the frame before; for the first frame, the first tick."""
    return [(0, 1), *pairwise(ends.tolist())]


def extremes(values: Array, ends: Array) -> Array:
    """(k, ...) the values farthest from zero in each frame's ticks, of (n, ...) values a tick."""
    blocks = (values[a:b] for a, b in ticks_of(ends))
    return np.array([np.take_along_axis(v, np.abs(v).argmax(axis=0)[None], axis=0)[0] for v in blocks])


def colours(joints: int) -> tuple[str, ...]:
    """A colour for each joint."""
    return tuple(SCREEN_COLOURS[i % len(SCREEN_COLOURS)] for i in range(joints))


def charts_of(trace: Trace, ends: Array) -> list[CurveChart]:
    """The charts of a run: errors, least distance, contact force, joint positions and velocities by their limits."""
    errors = np.column_stack((1e3 * trace.position_error, np.degrees(trace.orientation_error)))
    names, hues = ("position [mm]", "orientation [deg]"), (BLUE, ORANGE)
    charts = [CurveChart(ERROR, names, np.maximum(extremes(errors, ends), NEGLIGIBLE).T, hues, log=True)]
    if trace.clearance is not None:
        distance, largest = trace.clearance.chart_range
        required = 1e3 * trace.clearance.required
        least = 1e3 * np.array([distance[a : b + 1].min() for a, b in ticks_of(ends)])
        span = (min(0.0, float(least.min())), 1e3 * largest)
        charts.append(CurveChart("least distance [mm]", ("of bodies",), least[None], (BLUE,), (required,), span))
    if trace.contact is not None:
        desired = trace.contact.wanted
        press = extremes(np.column_stack((trace.contact.measured_press, trace.contact.press)) - desired, ends)
        hues = (SKY, VERMILION)
        charts.append(CurveChart("contact force [N]", ("as read", "true"), press.T + desired, hues, (desired,)))
    speed = extremes(trace.velocity, ends)
    return charts + limit_charts(trace.names, trace.q[ends], trace.position_limits, speed, trace.velocity_limit)


def limit_charts(joints: Sequence[str], q: Array, limits: Array, speed: Array, speed_limit: Array) -> list[CurveChart]:
    """Joint positions (k, m) over their ranges and velocities over their limits, of the joints that have these."""
    lower, upper = limits
    ranged, limited = np.isfinite(upper - lower) & (upper > lower), np.isfinite(speed_limit)
    place = (q[:, ranged] - lower[ranged]) / (upper - lower)[ranged]
    rate = speed[:, limited] / speed_limit[limited]
    names, hues = np.array(joints), np.array(colours(len(joints)))
    ends = (0.0, 1.0), (-0.05, 1.05)
    positions = CurveChart("joint position / range", tuple(names[ranged]), place.T, tuple(hues[ranged]), *ends)
    ends = (-1.0, 1.0), (-1.1, 1.1)
    velocities = CurveChart("joint velocity / limit", tuple(names[limited]), rate.T, tuple(hues[limited]), *ends)
    return [chart for chart in (positions, velocities) if chart.names]
