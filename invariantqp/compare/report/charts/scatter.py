"""One figure against another, every method a named point, the Pareto front drawn: nothing is faster and better too.

A method is on the front when no other is at least as good in both and better in one.
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
from invariantqp.compare.report.charts.style import families_legend, grid, is_ours, laid_out, look, plain_ticks, short
from invariantqp.compare.results import Results

FRONT = "#555555"
# Room beyond the outermost points, as a share of an axis.
ROOM = 0.09
# Where a band starts that has no lower end, on a logarithmic axis.
NOTHING = 1e-300


class Point(NamedTuple):
    """A method's two figures, both the better the smaller, and how far its second one reaches."""

    method: str
    x: float
    y: float
    reach: float | None = None


def front(points: Sequence[Point], alike: float = 0.0) -> list[Point]:
    """The points that no other dominates, the fastest first; second figures up to `alike` count as equal."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.x, p.y)):
        if not best or max(point.y, alike) < max(best[-1].y, alike):
            best.append(point)
    return best


def scatter(
    figure: Figure, panels: Sequence[Axes], drawn: Sequence[Sequence[Point]], results: Results, alike: float = 0.0
) -> None:
    """Panels of points on doubly logarithmic axes, with fronts, names and a legend of families."""
    corners = [_points(axes, points, results, alike) for axes, points in zip(panels, drawn, strict=True)]
    edge = Line2D([], [], color=FRONT, linewidth=1.0, linestyle="--", label="Pareto front")
    families_legend(figure, results, {p.method for points in drawn for p in points}, [edge])
    laid_out(figure)
    for axes, points, line in zip(panels, drawn, corners, strict=True):
        name_points(axes, [Named(p.x, p.y, short(p.method), is_ours(p.method)) for p in points], lines=line)


def _points(axes: Axes, points: Sequence[Point], results: Results, alike: float) -> list[tuple[float, float]]:
    """Draw a panel; returns the corners of its front."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*_limits([p.x for p in points]))
    axes.set_ylim(*_limits([v for p in points for v in (p.y, p.reach) if v is not None]))
    edge = front(points, alike)
    corners = [(edge[0].x, axes.get_ylim()[1])]
    for p in edge:
        corners += [(p.x, corners[-1][1]), (p.x, p.y)]
    corners = [corners[0], *corners[2:], (axes.get_xlim()[1], corners[-1][1])]
    axes.plot(*zip(*corners, strict=True), color=FRONT, linewidth=1.0, linestyle="--", zorder=1)
    for p in points:
        style = look(results, p.method)
        if p.reach is not None:
            axes.plot((p.x, p.x), (p.y, p.reach), color=style.colour, linewidth=1.0, alpha=0.3, zorder=1)
        axes.plot(
            p.x,
            p.y,
            style.marker,
            color=style.colour,
            markersize=8.0 if is_ours(p.method) else 6.0,
            markeredgecolor="black" if p in edge else "white",
            markeredgewidth=0.9 if p in edge else 0.5,
            zorder=4 if is_ours(p.method) else 3,
        )
    plain_ticks(axes.xaxis, axes.get_xlim())
    plain_ticks(axes.yaxis, axes.get_ylim())
    grid(axes)
    return corners


def band(axes: Axes, level: float) -> None:
    """What lies below a level is rounding: in grey, and said so."""
    axes.axhspan(NOTHING, level, color="#f3f3f3", zorder=0)
    across = axes.get_yaxis_transform()
    axes.text(0.995, level, "exact to rounding", transform=across, ha="right", va="top", color="#666666", fontsize=8.0)


def _limits(values: Sequence[float]) -> tuple[float, float]:
    low, high = log10(min(values)), log10(max(values))
    room = ROOM * max(high - low, 0.5)
    return float(10.0 ** (low - room)), float(10.0 ** (high + room))


def positive(value: float | None, floor: float) -> float | None:
    """A figure for a logarithmic axis: what is smaller than the floor is drawn there; None stays None."""
    return None if value is None or not np.isfinite(value) else max(float(value), floor)
