"""One figure of every method against another, as named points, with the Pareto front.

A method is on the front if no other method is at least as good in both figures and better in one.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log10
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from invariantqp.compare.report.charts.labels import Named, name_points
from invariantqp.compare.report.charts.style import (
    FamilyStyle,
    families_legend,
    grid,
    is_ours,
    lay_out,
    plain_ticks,
    short,
    style_of,
)
from invariantqp.compare.results import Results
from invariantqp.pictures.palette import RULE, TEXT

# Room beyond the outermost points, as a share of an axis.
ROOM = 0.09
# Shortest span of the data on a logarithmic axis, in powers of ten, for which that share is taken.
SPAN = 0.5
# Lower end of the grey band on a logarithmic axis, below anything that is drawn.
NOTHING = 1e-300


class Point(NamedTuple):
    """Two figures of a method, of which smaller is better, and the other end of a line drawn through y, if any."""

    method: str
    x: float
    y: float
    reach: float | None = None


def front(points: Sequence[Point], alike: float = 0.0) -> list[Point]:
    """The points that no other point dominates, by ascending x; values of y up to `alike` count as equal."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.x, p.y)):
        if not best or max(point.y, alike) < max(best[-1].y, alike):
            best.append(point)
    return best


def scatter(
    figure: Figure, panels: Sequence[Axes], drawn: Sequence[Sequence[Point]], results: Results, alike: float = 0.0
) -> None:
    """Draw each list of points on a panel with logarithmic axes, with their names and their front; and a legend."""
    corners = [_points(axes, points, results, alike) for axes, points in zip(panels, drawn, strict=True)]
    edge = Line2D([], [], color=TEXT, linewidth=1.0, linestyle="--", label="Pareto front")
    families_legend(figure, results, {p.method for points in drawn for p in points}, [edge])
    lay_out(figure)
    for axes, points, line in zip(panels, drawn, corners, strict=True):
        name_points(axes, [Named(p.x, p.y, short(p.method), is_ours(p.method)) for p in points], lines=line)


def _points(axes: Axes, points: Sequence[Point], results: Results, alike: float) -> list[tuple[float, float]]:
    """Draw a panel; returns the corners of its front."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    if not points:
        return []
    axes.set_xlim(*_limits([p.x for p in points]))
    axes.set_ylim(*_limits([v for p in points for v in (p.y, p.reach) if v is not None]))
    edge = front(points, alike)
    for p in points:
        _point(axes, p, style_of(results, p.method), on_front=p in edge)
    corners = _corners(axes, edge)
    axes.plot(*zip(*corners, strict=True), color=TEXT, linewidth=1.0, linestyle="--", zorder=1)
    plain_ticks(axes.xaxis, axes.get_xlim())
    plain_ticks(axes.yaxis, axes.get_ylim())
    grid(axes)
    return corners


def _point(axes: Axes, point: Point, style: FamilyStyle, *, on_front: bool) -> None:
    ours = is_ours(point.method)
    if point.reach is not None:
        axes.plot((point.x, point.x), (point.y, point.reach), color=style.colour, linewidth=1.0, alpha=0.3, zorder=1)
    axes.plot(
        point.x,
        point.y,
        style.marker,
        color=style.colour,
        markersize=8.0 if ours else 6.0,
        markeredgecolor="black" if on_front else "white",
        markeredgewidth=0.9 if on_front else 0.5,
        zorder=4 if ours else 3,
    )


def _corners(axes: Axes, edge: Sequence[Point]) -> list[tuple[float, float]]:
    """The corners of the front, as steps from the upper end of the panel to its right end."""
    corners = [(edge[0].x, axes.get_ylim()[1]), (edge[0].x, edge[0].y)]
    for p in edge[1:]:
        corners += [(p.x, corners[-1][1]), (p.x, p.y)]
    return [*corners, (axes.get_xlim()[1], corners[-1][1])]


def band(axes: Axes, level: float) -> None:
    """Mark the values below a level as rounding, by a grey band with a label."""
    axes.axhspan(NOTHING, level, color="#f3f3f3", zorder=0)
    across = axes.get_yaxis_transform()
    label = axes.text(
        0.995, level, "exact to rounding", transform=across, ha="right", va="top", color=RULE, fontsize=8.0
    )
    # Where the level is outside the axis, the label is neither drawn nor given room.
    label.set_clip_on(True)


def _limits(values: Sequence[float]) -> tuple[float, float]:
    low, high = log10(min(values)), log10(max(values))
    room = ROOM * max(high - low, SPAN)
    return float(10.0 ** (low - room)), float(10.0 ** (high + room))


def positive(value: float | None, floor: float) -> float | None:
    """A figure for a logarithmic axis: at least `floor`; None if it is None or not finite."""
    return None if value is None or not np.isfinite(value) else max(float(value), floor)
