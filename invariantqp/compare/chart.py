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
# How far from its point a name may be [line heights], by how many points its line is known, and orders that are tried.
FARTHEST, SEEN, ORDERS = 6.0, 12, 8


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
    places = placed(points, sizes, tuple(axes.bbox.extents), radius)
    for p, at, text, place in zip(found, points, texts, places, strict=True):
        centre = 0.5 * (place[:2] + place[2:])
        text.set(position=to_data(centre), horizontalalignment="center", verticalalignment="center")
        end = np.clip(at, place[:2], place[2:])
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


def placed(points: Array, sizes: Array, room: tuple[float, ...], radius: float) -> Array:
    """(n, 4) left, bottom, right, top of names of (n, 2) sizes beside (n, 2) points, discs of a radius, in a room.

    Each in turn takes the place nearest to its point that is inside, on no disc, name or line of another, and to which
    a line comes that crosses none; where there is none, the one that meets fewest. Of several orders the best is taken.
    """
    rng = np.random.default_rng(0)
    tried = [_in_order(rng.permutation(len(points)), points, sizes, room, radius) for _ in range(ORDERS)]
    return min(tried, key=lambda one: one[0])[1]


def _in_order(order: Any, points: Array, sizes: Array, room: tuple[float, ...], radius: float) -> tuple[float, Array]:
    """What places cost that are taken in an order, in line heights, and the places."""
    discs = np.hstack((points - radius, points + radius))
    names, lines = np.empty((len(points), 4)), np.empty((0, 2))
    cost = 0.0
    for done, i in enumerate(order):
        point, (width, height) = points[i], sizes[i]
        away = np.arange(0.0, FARTHEST, 0.5) * height
        right, over = 1.5 * radius + away, away - 0.5 * width
        left = point[0] + np.concatenate((right, -right - width, over, -over - width))
        x, y = (grid.ravel() for grid in np.meshgrid(left, point[1] - 0.5 * height + np.concatenate((away, -away))))
        places = np.column_stack((x, y, x + width, y + height))
        ends = np.clip(point, places[:, :2], places[:, 2:])
        way = point + np.linspace(0.0, 1.0, SEEN)[:, None, None] * (ends - point)  # (s, k, 2)
        taken, margin = np.vstack((discs, names[order[:done]])), height * np.array((0.4, 0.1))
        on = _meet(places, taken + np.concatenate((-margin, margin)))
        on_line = _meet(places, np.hstack((lines - margin, lines + margin)))
        across = _meet(np.concatenate((way, way), axis=-1), taken).any(axis=0)
        across[:, i] = False
        out = ((places[:, :2] < room[:2]) | (places[:, 2:] > room[2:])).any(axis=1)
        worst = 1000 * out + 100 * on.sum(axis=1) + 10 * across.sum(axis=1) + on_line.any(axis=1)
        costs = np.linalg.norm(ends - point, axis=1) / height + 10 * worst
        best = int(costs.argmin())
        cost += float(costs[best])
        names[i] = places[best]
        lines = np.vstack((lines, way[:, best]))
    return cost, names


def _meet(boxes: Array, others: Array) -> Any:
    """(..., n) which of (..., 4) boxes meet which of (n, 4) others; an axis at a time, as NumPy is slow over two."""
    across, up = ((boxes[..., None, k] < others[:, k + 2]) & (boxes[..., None, k + 2] > others[:, k]) for k in range(2))
    return across & up
