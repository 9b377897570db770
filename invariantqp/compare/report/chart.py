"""The chart: time of a tick against the largest error of a run, a row an arm, without limits met and with.

A number is a method. Its colour says whether another tool frame changes the motion by more than a start moved by 1e-12
does. The line to the right of a point ends at the 99th percentile of its time, or at the edge.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.compare.names import OURS
from invariantqp.compare.report.tables import depends, shown, title
from invariantqp.compare.results import Results, results_of
from invariantqp.pictures.figure import figure_file

# Inches at 100 dots: 850 pixels, the width of a README; drawn at twice that.
WIDTH, ROW, LEGEND, DOTS = 8.5, 3.0, 1.6, 200
FONT, NUMBER, DIAMETER = 12.0, 10.5, 17.0
# Room beside the fastest and the slowest; beyond the nearest and the furthest off.
ROOM, HEADROOM = 1.5, 12.0
# From this change of a joint position on a frame matters to a user [rad].
VISIBLE = 1e-4


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
    """A method in a panel: its number, the median and the 99th percentile of its ticks [us], its error [mm]."""

    number: int
    time: float
    late: float
    error: float
    colour: str
    ours: bool


def draw(results: Results, file: Path, colours: Colours = LIGHT) -> None:
    """Draw the chart; the ending of the file tells the format."""
    names, tasks = shown(results), results["tasks"]
    rows = (len(tasks) + 1) // 2
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
    with figure_file(file, (WIDTH, ROW * rows + LEGEND), style, dots=DOTS) as figure:
        panels = figure.subplots(rows, min(2, len(tasks)), squeeze=False).ravel()
        drawn = [points(results, task, names, colours) for task in tasks]
        times = [p.time for found in drawn for p in found]
        span = (min(times) / ROOM, max(times) * ROOM * ROOM) if times else (1.0, 10.0)
        for axes, task, found in zip(panels, tasks, drawn, strict=False):
            _panel(axes, title(task), found, span, colours)
        for axes in panels[len(tasks) :]:
            axes.set_visible(False)
        for k in range(0, len(tasks), 2):
            panels[k].set_ylabel("largest error, mm")
        for axes in panels[max(0, len(tasks) - 2) : len(tasks)]:
            axes.set_xlabel("time of a tick, us")
        _legend(figure, names, colours)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
        figure.set_layout_engine("none")
        for axes, found in zip(panels, drawn, strict=False):
            _numbers(axes, found, colours)


def points(results: Results, task: str, names: Sequence[str], colours: Colours) -> list[Point]:
    """The points of a panel, those methods that have a time and an error."""
    loops, ticks = results_of(results, "loop"), results_of(results, "tick")
    found = []
    for number, name in enumerate(names, 1):
        loop, tick = loops.get((task, name), {}), ticks.get((task, name), {})
        error, time = loop.get("position_mm"), tick.get("median_us")
        if error and time:
            found.append(Point(number, time, tick["p99_us"], error, colour(loop, colours), name == OURS))
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
        axes.plot((p.time, p.late), (p.error, p.error), color=p.colour, linewidth=1.0, alpha=0.45, zorder=2)
        axes.plot(p.time, p.error, "o", color=p.colour, markersize=4.0, zorder=3)


def _numbers(axes: Axes, found: Sequence[Point], colours: Colours) -> None:
    """The numbers, each in a disc at its point or, where another one is, above or below it with a line to it."""
    size = DIAMETER * DOTS / 72.0
    placed: list[tuple[float, float]] = []
    to_data = axes.transData.inverted()
    low, high = axes.bbox.y0 + 0.6 * size, axes.bbox.y1 - 0.6 * size
    for p in sorted(found, key=lambda p: (not p.ours, p.time)):
        x, y = axes.transData.transform((p.time, p.error)).tolist()
        for step in (0, 1, -1, 2, -2, 3, -3, 4, 5, 6):
            here = (x, y + step * size)
            free = all(max(abs(here[0] - a), abs(here[1] - b)) > 0.92 * size for a, b in placed)
            if free and low < here[1] < high:
                break
        placed.append(here)
        data = to_data.transform(here).tolist()
        axes.plot((p.time, data[0]), (p.error, data[1]), color=p.colour, linewidth=0.9, zorder=3)
        axes.plot(
            *data,
            "o",
            color=p.colour,
            markersize=DIAMETER * (1.15 if p.ours else 1.0),
            markeredgecolor=colours.text if p.ours else colours.paper,
            markeredgewidth=1.4 if p.ours else 0.8,
            zorder=5 if p.ours else 4,
        )
        axes.annotate(
            f"{p.number}",
            data,
            ha="center",
            va="center_baseline",
            color=colours.paper,
            fontsize=NUMBER,
            fontweight="bold",
            zorder=6,
        )


def _legend(figure: Figure, names: Sequence[str], colours: Colours) -> None:
    """Below the panels: the names of the numbers, and what the colours say."""
    numbered = [Line2D([], [], linestyle="", label=f"{k}  {name}") for k, name in enumerate(names, 1)]
    kinds = (
        (colours.same, "no change in another tool frame"),
        (colours.slightly, f"by less than {VISIBLE:g} rad"),
        (colours.other, "by more"),
    )
    coloured = [Line2D([], [], marker="o", color=c, linestyle="", markersize=10.0, label=label) for c, label in kinds]
    look = {"frameon": False, "fontsize": FONT, "borderaxespad": 0.2}
    figure.legend(handles=numbered, loc="outside lower left", ncols=2, handlelength=0.0, handletextpad=0.0, **look)
    figure.legend(handles=coloured, loc="lower right", handletextpad=0.2, **look)
