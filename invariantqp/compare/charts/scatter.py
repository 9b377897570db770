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
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.compare.charts.labels import Named, name_points
from invariantqp.compare.charts.style import families_legend, grid, is_ours, laid_out, look, short
from invariantqp.compare.results import Results

FRONT = "#555555"
# Room beyond the outermost points, as a share of an axis.
ROOM = 0.09


class Point(NamedTuple):
    """A method's two figures, both the better the smaller, and how far its second one reaches."""

    method: str
    x: float
    y: float
    reach: float | None = None


def front(points: Sequence[Point]) -> list[Point]:
    """The points that no other dominates, from the fastest to the most accurate."""
    best: list[Point] = []
    for point in sorted(points, key=lambda p: (p.x, p.y)):
        if not best or point.y < best[-1].y:
            best.append(point)
    return best


def scatter(
    figure: Figure, panels: Sequence[Axes], drawn: Sequence[Sequence[Point]], results: Results, size: float = 8.0
) -> None:
    """Panels of points on doubly logarithmic axes, with fronts, names and a legend of families."""
    for axes, points in zip(panels, drawn, strict=True):
        _points(axes, points, results)
    families_legend(figure, results, [Line2D([], [], color=FRONT, linewidth=1.0, linestyle="--", label="Pareto front")])
    laid_out(figure)
    for axes, points in zip(panels, drawn, strict=True):
        name_points(axes, [Named(p.x, p.y, short(p.method), is_ours(p.method)) for p in points], size)


def _points(axes: Axes, points: Sequence[Point], results: Results) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(*_limits([p.x for p in points]))
    axes.set_ylim(*_limits([v for p in points for v in (p.y, p.reach) if v is not None]))
    edge = front(points)
    left, top = axes.get_xlim(), axes.get_ylim()
    xs = [edge[0].x, *(p.x for p in edge), left[1]]
    ys = [top[1], *(p.y for p in edge), edge[-1].y]
    axes.plot(xs, ys, drawstyle="steps-post", color=FRONT, linewidth=1.0, linestyle="--", zorder=1)
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
    _ticks(axes)
    grid(axes)


def _limits(values: Sequence[float]) -> tuple[float, float]:
    low, high = log10(min(values)), log10(max(values))
    room = ROOM * max(high - low, 0.5)
    return float(10.0 ** (low - room)), float(10.0 ** (high + room))


def _ticks(axes: Axes) -> None:
    """Times as 5, 10, 20, ... and errors as powers of ten."""
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    low, high = axes.get_ylim()
    if high / low < 1e4:
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 1e2 else (1.0,), numticks=20))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def positive(value: float | None, floor: float) -> float | None:
    """A figure for a logarithmic axis: what is smaller than the floor is drawn there; None stays None."""
    return None if value is None or not np.isfinite(value) else max(float(value), floor)
