"""The chart: time of a tick against the largest error of a run, a panel a task.

A point is a method, and a thin line leads to its name where that is not beside it. Its colour says whether another tool
frame changes the motion by more than a start moved by 1e-12 does.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from invariantqp.compare.method import OURS
from invariantqp.compare.results import Results, results_of
from invariantqp.compare.tables import depends, shown, title
from invariantqp.geometry.arrays import Array
from invariantqp.pictures.figure import figure_file

# Inches at 100 dots: two panels are 850 pixels wide, as a README is, one is as wide as a phone; drawn at twice that.
WIDTH, ROW, LEGEND, DOTS = 4.25, 3.2, 0.25, 200
FONT, NAME, DIAMETER = 12.0, 10.0, 7.0
# Room beside the fastest and the slowest; beyond the nearest and the furthest off.
ROOM, HEADROOM = 1.5, 12.0
# From this change of a joint position on a frame matters to a user [rad].
VISIBLE = 1e-4
# What is never worth it, and what is only where nothing else is left [line heights].
COVERED, CROSSED = 1000.0, 15.0
# How far from its point a name may be, and the steps of its places [line heights].
FARTHEST, STEP = 5.0, 0.5
# Orders in which names are moved, and rounds of moving them in each.
ORDERS, ROUNDS = 4, 20
# Room between two names beside and above each other, and the length of a line that is seen [line heights].
MARGIN, SEEN = (0.5, 0.15), 0.8

Mask = NDArray[np.bool_]


class Colours(NamedTuple):
    """Colours on light paper or on a dark page."""

    paper: str
    text: str
    rule: str
    same: str
    slightly: str
    other: str


LIGHT = Colours("#ffffff", "#24292f", "#d0d7de", "#0072B2", "#B07A00", "#D55E00")
DARK = Colours("#0d1117", "#e6edf3", "#30363d", "#56B4E9", "#E6C229", "#FF8A5B")


class Point(NamedTuple):
    """A method in a panel: the median of its ticks [us], its largest error [mm]."""

    name: str
    time: float
    error: float
    colour: str
    ours: bool


def draw(results: Results, file: Path, colours: Colours = LIGHT, columns: int = 2) -> None:
    """Draw the chart with at most so many panels in a row; the ending of the file tells the format."""
    names, tasks = shown(results), results["tasks"]
    columns = min(columns, len(tasks))
    rows = -(-len(tasks) // columns)
    legend = 1 if columns > 1 else 3
    style = {
        "font.size": FONT,
        "axes.titlesize": FONT,
        "axes.titlelocation": "left",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "svg.hashsalt": "invariantqp",
        **{f"{part}color": colours.text for part in ("text.", "axes.label", "axes.edge", "xtick.", "ytick.")},
        **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), colours.paper),
    }
    with figure_file(file, (WIDTH * columns, ROW * rows + LEGEND * legend), style, dots=DOTS) as figure:
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        drawn = [points(results, task, names, colours) for task in tasks]
        times = [p.time for found in drawn for p in found]
        span = (min(times) / ROOM, max(times) * ROOM * ROOM) if times else (1.0, 10.0)
        for axes, task, found in zip(panels, tasks, drawn, strict=False):
            _panel(axes, title(task), found, span, colours)
        for axes in panels[len(tasks) :]:
            axes.set_visible(False)
        for k in range(0, len(tasks), columns):
            panels[k].set_ylabel("largest error, mm")
        for axes in panels[len(tasks) - columns : len(tasks)]:
            axes.set_xlabel("time of a tick, us")
        _legend(figure, colours, legend)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
        figure.set_layout_engine("none")
        for axes, found in zip(panels, drawn, strict=False):
            _names(axes, found, colours)


def points(results: Results, task: str, names: Sequence[str], colours: Colours) -> list[Point]:
    """The points of a panel, those methods that have a time and an error."""
    loops, ticks = results_of(results, "loop"), results_of(results, "tick")
    found = []
    for name in names:
        loop, tick = loops.get((task, name), {}), ticks.get((task, name), {})
        error, time = loop.get("position_mm"), tick.get("median_us")
        if error and time:
            found.append(Point(name, time, error, colour(loop, colours), name == OURS))
    return found


def colour(loop: dict[str, Any], colours: Colours) -> str:
    """The colour that says what another tool frame changes."""
    if not depends(loop):
        return colours.same
    return colours.slightly if (loop["frame"] or 1.0) < VISIBLE else colours.other


def _panel(axes: Axes, name: str, found: Sequence[Point], span: tuple[float, float], colours: Colours) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_title(name if "limits" in name else f"{name}, no limit met", fontweight="bold")
    axes.grid(visible=True, which="major", color=colours.rule, linewidth=0.7)
    axes.set_axisbelow(True)
    if not found:
        return
    low, high = min(p.error for p in found), max(p.error for p in found)
    axes.set_xlim(*span)
    axes.set_ylim(low / HEADROOM, max(high * HEADROOM, low * HEADROOM**3))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=9))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    for p in found:
        size, edge = (1.3 * DIAMETER, colours.text) if p.ours else (DIAMETER, p.colour)
        axes.plot(p.time, p.error, "o", color=p.colour, markersize=size, markeredgecolor=edge, zorder=3)


def _names(axes: Axes, found: Sequence[Point], colours: Colours) -> None:
    """The names, each beside its point or, where others are, further off with a line to it."""
    if not found:
        return
    texts = [
        axes.text(
            0.0, 0.0, p.name, color=colours.text, fontsize=NAME, fontweight="bold" if p.ours else "normal", zorder=5
        )
        for p in found
    ]
    sizes = np.array([text.get_window_extent().size for text in texts])
    points = axes.transData.transform([(p.time, p.error) for p in found])
    radius = 0.65 * DIAMETER * DOTS / 72.0
    to_data = axes.transData.inverted().transform
    places = placed(points, sizes, Area(*axes.bbox.extents), radius)
    for p, at, text, place in zip(found, points, texts, places, strict=True):
        centre = 0.5 * (place[:2] + place[2:])
        text.set(position=to_data(centre), horizontalalignment="center", verticalalignment="center")
        (end,) = nearest(place[None], at)
        axes.plot(*to_data((at, end)).T, color=p.colour, linewidth=0.8, zorder=2)


def _legend(figure: Figure, colours: Colours, rows: int) -> None:
    """Below the panels: what the colours say."""
    kinds = (
        (colours.same, "no change in another tool frame"),
        (colours.slightly, f"by less than {VISIBLE:g} rad"),
        (colours.other, "by more"),
    )
    coloured = [Line2D([], [], marker="o", color=c, linestyle="", markersize=8.0, label=label) for c, label in kinds]
    look = {"frameon": False, "fontsize": FONT, "handletextpad": 0.2}
    figure.legend(handles=coloured, loc="outside lower center", ncols=-(-len(kinds) // rows), **look)


class Area(NamedTuple):
    """A rectangle that names have to be in."""

    left: float
    bottom: float
    right: float
    top: float


def placed(points: Array, sizes: Array, room: Area, radius: float) -> Array:
    """(n, 4) left, bottom, right, top of names of (n, 2) sizes beside (n, 2) points, discs of a radius, in a room.

    Each is as near to its point as the others leave room for; the points stay where they are:

        minimise the distances of names to their points, in line heights,
                 + COVERED for each name on a name or a point
                 + CROSSED for each line to a name across another name, line or point, and for each point beside a name
                   that is not its own, where the line to its own is too short to see

    Names are moved one at a time to the best place beside all others, until none moves; in several orders.
    """
    n, rng = len(points), np.random.default_rng(0)
    choices = [_places(i, points, size, room, radius) for i, size in enumerate(sizes)]
    found = []
    for _ in range(ORDERS):
        names, costs = np.array([places[cost.argmin()] for places, cost in choices]), np.full(n, np.inf)
        for _ in range(ROUNDS):
            before = names.copy()
            for i in rng.permutation(n):
                (places, alone), rest = choices[i], np.arange(n) != i
                cost = alone + _beside(points[i], places, sizes[i], points[rest], names[rest])
                names[i], costs[i] = places[cost.argmin()], cost.min()
            if np.array_equal(names, before):
                break
        found.append((costs.sum(), names))
    return min(found, key=lambda one: one[0])[1]


def nearest(names: Array, point: Array) -> Array:
    """(k, 2) the places of (k, 4) names that are nearest to a point (2,), or each to its own (k, 2)."""
    return np.asarray(np.clip(point, names[..., :2], names[..., 2:]))


def _places(i: int, points: Array, size: Array, room: Area, radius: float) -> tuple[Array, Array]:
    """Where the name of a point may be (k, 4), and what each place costs by itself (k,)."""
    point, (width, height) = points[i], size
    along, up = np.arange(0.0, FARTHEST, 2.0 * STEP), np.arange(-FARTHEST, FARTHEST + STEP, STEP)
    right = 1.5 * radius + along * height
    left = point[0] + np.concatenate((right, -right - width, -0.5 * width + right, -0.5 * width - right))
    x, y = (grid.ravel() for grid in np.meshgrid(left, point[1] + (up - 0.5) * height))
    places = np.column_stack((x, y, x + width, y + height))
    inside = (x >= room.left) & (places[:, 2] <= room.right) & (y >= room.bottom) & (places[:, 3] <= room.top)
    places = places[inside] if inside.any() else places[:1]
    ends = nearest(places, point)
    own = np.linalg.norm(ends - point, axis=1)
    cost = own / height
    for j, other in enumerate(points):
        disc = np.concatenate((other - radius, other + radius))
        cost += COVERED * _covered(places, disc, np.zeros(2))
        if j != i:
            theirs = np.linalg.norm(nearest(places, other) - other, axis=1)
            ambiguous = (own < radius + SEEN * height) & (theirs < own + SEEN * height)
            cost += CROSSED * (ambiguous | _through(point, ends, disc))
    return places, cost


def _beside(point: Array, places: Array, size: Array, points: Array, names: Array) -> Array:
    """(k,) what places (k, 4) of a name cost beside other names (n, 4) with their points (n, 2)."""
    places, ends, tips = places[:, None], nearest(places, point)[:, None], nearest(names, points)
    across = _through(point, ends, names) | _crossed(point, ends, points, tips) | _through(points, tips, places)
    margin = np.array(MARGIN) * size[1]
    return np.asarray((COVERED * _covered(places, names, margin) + CROSSED * across).sum(axis=1))


def _covered(names: Array, others: Array, margin: Array) -> Mask:
    """Whether names (..., 4) are on other rectangles (..., 4), or nearer to them than a margin (2,)."""
    above, below = names[..., :2] < others[..., 2:] + margin, names[..., 2:] > others[..., :2] - margin
    return np.asarray((above & below).all(axis=-1))


def _through(starts: Array, ends: Array, rectangles: Array) -> Mask:
    """Whether lines from (..., 2) to (..., 2) go through rectangles (..., 4)."""
    low, high, step = rectangles[..., :2], rectangles[..., 2:], ends - starts
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - starts) / step, (high - starts) / step
    still, between = step == 0.0, (low < starts) & (starts < high)
    first = np.where(still, np.where(between, 0.0, np.inf), np.minimum(one, other))
    last = np.where(still, 1.0, np.maximum(one, other))
    return np.asarray(np.maximum(first.max(axis=-1), 0.0) < np.minimum(last.min(axis=-1), 1.0))


def _crossed(starts: Array, ends: Array, others: Array, tips: Array) -> Mask:
    """Whether lines from (..., 2) to (..., 2) cross those from others to their tips."""

    def side(a: Array, b: Array, p: Array) -> Array:
        along, off = b - a, p - a
        return np.asarray(along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0])

    apart = side(starts, ends, others) * side(starts, ends, tips) < 0.0
    return np.asarray(apart & (side(others, tips, starts) * side(others, tips, ends) < 0.0))
