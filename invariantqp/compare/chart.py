"""The chart: time of a tick against the largest error of a run, a panel a task.

A marker is a method, ours with its name. Its colour says whether another tool frame changes the motion by more than a
start moved by 1e-12 does.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.compare.method import OURS
from invariantqp.compare.results import Results, results_of
from invariantqp.compare.tables import depends, shown, title
from invariantqp.pictures.figure import figure_file

# Inches at 100 dots: two panels are 850 pixels wide, as a README is, one is as wide as a phone; drawn at twice that.
WIDTH, ROW, LEGEND, DOTS = 4.25, 3.2, 0.25, 200
FONT, DIAMETER = 12.0, 8.0
# Room beside the fastest and the slowest, and beyond the nearest and the furthest off.
ROOM = 1.5
# From this change of a joint position on a frame matters to a user [rad].
VISIBLE = 1e-4
# Of the methods in their order, again from the first on where there are more; ours has the disc.
MARKERS = "os^vDPX<>ph*d"


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
    marker: str


def draw(results: Results, file: Path, colours: Colours = LIGHT, columns: int = 2) -> None:
    """Draw the chart with at most so many panels in a row; the ending of the file tells the format."""
    names, tasks = shown(results), results["tasks"]
    columns = min(columns, len(tasks))
    rows = -(-len(tasks) // columns)
    across = 3 if columns > 1 else 1
    legend = -(-(len(names) + 3) // across)
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
        span = (min(times) / ROOM, max(times) * ROOM) if times else (1.0, 10.0)
        for axes, task, found in zip(panels, tasks, drawn, strict=False):
            _panel(axes, title(task), found, span, colours)
        for axes in panels[len(tasks) :]:
            axes.set_visible(False)
        for k in range(0, len(tasks), columns):
            panels[k].set_ylabel("largest error, mm")
        for axes in panels[len(tasks) - columns : len(tasks)]:
            axes.set_xlabel("time of a tick, us")
        _legend(figure, names, colours, across)


def points(results: Results, task: str, names: Sequence[str], colours: Colours) -> list[Point]:
    """The points of a panel, those methods that have a time and an error."""
    loops, ticks = results_of(results, "loop"), results_of(results, "tick")
    found = []
    for name in names:
        loop, tick = loops.get((task, name), {}), ticks.get((task, name), {})
        error, time = loop.get("position_mm"), tick.get("median_us")
        if error and time:
            found.append(Point(name, time, error, colour(loop, colours), marker_of(name, names)))
    return found


def marker_of(name: str, names: Sequence[str]) -> str:
    """The marker of one of the methods that are shown."""
    return MARKERS[list(names).index(name) % len(MARKERS)]


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
    axes.set_ylim(low / ROOM**2, max(high * ROOM**2, low * ROOM**6))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(numticks=9))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    for p in found:
        size, edge = (1.3 * DIAMETER, colours.text) if p.name == OURS else (DIAMETER, p.colour)
        axes.plot(p.time, p.error, p.marker, color=p.colour, markersize=size, markeredgecolor=edge, zorder=3)
        if p.name == OURS:
            at, over = (p.time, p.error), (-size, size)
            axes.annotate(p.name, at, over, textcoords="offset points", fontweight="bold", color=colours.text)


def _legend(figure: Figure, names: Sequence[str], colours: Colours, columns: int) -> None:
    """Below the panels: whose the markers are, and what the colours say."""
    kinds = (
        (colours.same, "no change in another tool frame"),
        (colours.slightly, f"by less than {VISIBLE:g} rad"),
        (colours.other, "by more"),
    )
    shapes = [(colours.text, marker_of(name, names), name) for name in names]
    handles = [
        Line2D([], [], marker=marker, color=c, linestyle="", markersize=DIAMETER, label=label)
        for c, marker, label in [*shapes, *((c, "o", label) for c, label in kinds)]
    ]
    look = {"frameon": False, "fontsize": FONT, "handletextpad": 0.2, "columnspacing": 1.0}
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, **look)
