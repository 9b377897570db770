"""The report: a verdict, the chart and the rows to begin with on the first screen; everything else folded below.

The chart: time of a tick against the largest error of a run, a panel a task.

Every sentence with a figure or a winner is computed from the results, one arm at a time: where Moore-Penrose and a
plain QP are enough, who sees the frame, who is better.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.compare import tables
from invariantqp.compare.method import HAND_WRITTEN, OURS, OURS_PYTHON, PENROSE, SCALED_LEAST_SQUARES
from invariantqp.compare.results import Results, kinds_in, results_of
from invariantqp.compare.tables import Table, depends, figure, shown, title, worst_frame
from invariantqp.pictures.figure import figure_file
from invariantqp.template import fill_template

CAPTION = (
    "A marker is a method, ours with its name. Its colour says whether another tool frame changes the motion by more "
    "than a start moved by 1e-12 does."
)
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


# Errors within this factor of the least, or below a micrometre and a thousandth of a degree, are as good.
AS_GOOD, AS_NONE = 1.1, 1e-3


class OfTask(NamedTuple):
    """What was measured of the rows of the first table on one task."""

    task: str
    runs: dict[str, dict[str, Any]]  # the figures of each row's run
    times: dict[str, float]  # the median of each row's ticks [us]

    def nearest(self) -> list[str]:
        """The rows whose largest position error is as good as the least of all."""
        have = {name: run["position_mm"] for name, run in self.runs.items() if run["position_mm"] is not None}
        least = min(have.values(), default=0.0)
        return [name for name, mm in have.items() if mm <= max(AS_GOOD * least, AS_NONE)]


def by_task(results: Results) -> list[OfTask]:
    """Each task with what was measured on it."""
    runs, ticks, names = results_of(results, "loop"), results_of(results, "tick"), shown(results)
    return [
        OfTask(
            task,
            {name: runs[task, name] for name in names if (task, name) in runs},
            {name: ticks[task, name]["median_us"] for name in names if (task, name) in ticks},
        )
        for task in results["tasks"]
    ]


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
    # Inches at 100 dots: two panels are 850 pixels wide, as a README is, one as wide as a phone; drawn at twice that.
    with figure_file(file, (4.25 * columns, 3.2 * rows + 0.25 * legend), style, dots=200) as figure:
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        drawn = [points(measured, names, colours) for measured in by_task(results)]
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


def points(measured: OfTask, names: Sequence[str], colours: Colours) -> list[Point]:
    """The points of a panel: the methods that have a time and an error."""
    return [
        Point(name, measured.times[name], run["position_mm"], colour(run, colours), marker_of(name, names))
        for name, run in measured.runs.items()
        if run["position_mm"] and measured.times.get(name)
    ]


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


ABOUT = {
    "loop": "Runs: errors, frame dependence beside its control, joint acceleration, settling time, failed ticks",
    "everyday": "What users meet first",
    "beyond": "A target out of reach",
    "calibration": "Joints not where the model says, each turned by 5 mrad and shifted by 5 mm (standard deviations), "
    "and a camera that sees the tool",
    "tick": "Time of a tick [us]",
}


def write_report(results: Results, out: Path) -> list[Path]:
    """Write report.html and the chart into a folder that exists: the files, the report first, then the chart if any."""
    report, chart, svg = out / "report.html", out / "speed_and_accuracy.svg", ""
    if {"loop", "tick"} <= kinds_in(results).keys():
        draw(results, chart)
        svg = inline_svg(chart)
    report.write_text(html(results, svg), encoding="utf-8")
    return [report, chart] if svg else [report]


def html(results: Results, svg: str) -> str:
    """The page as one HTML file that needs no other file; `svg` is the chart by `inline_svg`, "" without one."""
    quick = " --quick" if results["quick"] else ""
    values = {
        "opening": _opening(results),
        "verdict": verdict(results),
        "chart": svg,
        "light": LIGHT._asdict(),
        "dark": DARK._asdict(),
        "caption": CAPTION,
        "summary": tables.summary(results),
        "everyday": tables.everyday(results),
        "cells": tables.EVERYDAY_CELLS,
        "folded": folded(results),
        "machine": machine(results),
        "command": f"invariantqp compare {' '.join(results['tasks'])}{quick} --seed {results['seed']} --out comparison",
    }
    return fill_template("invariantqp.compare", "page.html", values)


def folded(results: Results) -> list[tuple[str, Table]]:
    """Tables that a reader opens, with their titles."""
    names = [m["name"] for m in results["methods"]]
    cells = [cell for cell in results["cells"] if "failed" in cell["result"]]
    failed = [(cell["method"], cell["kind"], cell["task"], cell["result"]["failed"]) for cell in cells]
    found = [
        (tables.MOTION_CELLS, tables.motion(results)),
        (tables.STABILITY_CELLS, tables.stability(results)),
        ("Every method", tables.summary(results, [] if names == shown(results) else names)),
        ("What each method is, and what it makes of what every row is given", tables.information(results)),
        *((about, tables.listed(results, kind)) for kind, about in ABOUT.items()),
        ("What could not be measured", Table(("method", "measurement", "task", "why"), failed)),
    ]
    return [(about, table) for about, table in found if table.rows]


def _opening(results: Results) -> str:
    """What was measured."""
    rough = " This was a quick run: few states, and ticks ten times as long, but in what users meet first."
    quick = rough if results["quick"] else ""
    equal = "Every method is given the same posture, exact rows, limits, gain and feedforward."
    counts = f"{len(results['methods'])} methods on {len(results['tasks'])} tasks; seed {results['seed']}."
    own = results["kinematics"] == OURS
    seen = f" Pinocchio was not installed: the loops of other methods read the arm from {OURS}." if own else ""
    return f"{counts} {equal}{seen}{quick}"


def machine(results: Results) -> str:
    """The machine and the versions."""
    m = results["machine"]
    releases = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    return f"{m['processor']}, {m['cores']} cores, {m['system']}, Python {m['python']}. {releases}."


def inline_svg(file: Path) -> str:
    """A chart in light colours as an element of the page, in the page's own: dark where the reader's are."""
    text = file.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for name, colour in LIGHT._asdict().items():
        text = text.replace(colour.lower(), f"var(--{name})")
    return text


def verdict(results: Results) -> list[str]:
    """Where Moore-Penrose is enough, where a plain QP is, whose answer is one, where we lose."""
    measured = by_task(results)
    found = (_penrose(measured), _plain_qp(measured), _one_answer(results))
    return [*filter(None, found), *(f"Where {OURS} loses: {sentence}" for sentence in losses(results))]


def losses(results: Results) -> list[str]:
    """Where ours is slower or further off than another row, or more tilted."""
    sentences = []
    for measured in by_task(results):
        task, runs, times = measured
        if OURS not in runs or OURS not in times:
            continue
        mine = runs[OURS]
        faster = [f"{n} ({figure(times[n])} us)" for n in measured.nearest() if n in times and times[n] < times[OURS]]
        nearer, straighter = (
            [name for name, run in runs.items() if _better(run[key], mine[key])]
            for key in ("position_mm", "orientation_deg")
        )
        parts = [f"{what} are {', '.join(names)}" for what, names in (("faster", faster), ("nearer", nearer)) if names]
        if straighter:
            theirs = _largest_errors([runs[name] for name in straighter])
            parts.append(f"it tilts by {_largest_errors([mine])}; {', '.join(straighter)} by {theirs}")
        if parts:
            sentences.append(f"{title(task)}: {'; '.join(parts)}.")
    return sentences


def _better(theirs: float | None, mine: float | None) -> bool:
    """Whether an error is less by more than nothing; one that was not measured is not."""
    return theirs is not None and mine is not None and theirs * AS_GOOD < mine > AS_NONE


def _largest_errors(runs: list[dict[str, Any]]) -> str:
    """The largest errors of some runs, from the least to the largest."""
    deg, mm = (sorted(run[key] or 0.0 for run in runs) for key in ("orientation_deg", "position_mm"))
    return f"{_span(deg)} deg, at {_span(mm)} mm"


def _span(values: list[float]) -> str:
    least, most = figure(values[0]), figure(values[-1])
    return least if least == most else f"{least} to {most}"


def _penrose(measured: list[OfTask]) -> str:
    have = [m for m in measured if PENROSE in m.runs]
    good = [title(m.task) for m in have if PENROSE in m.nearest()]
    off = [f"{title(m.task)} {figure(m.runs[PENROSE]['position_mm'])}" for m in have if PENROSE not in m.nearest()]
    text = f"as near as any here: {' and '.join(good)}; there it needs nothing else. It is off elsewhere"
    return f"{PENROSE} is {text} [mm]: {', '.join(off)}." if good and off else ""


def _plain_qp(measured: list[OfTask]) -> str:
    good = [HAND_WRITTEN in m.nearest() for m in measured if HAND_WRITTEN in m.runs]
    ratios, alone = (
        sorted(m.times[HAND_WRITTEN] / m.times[name] for m in measured if {name, HAND_WRITTEN} <= m.times.keys())
        for name in (OURS, OURS_PYTHON)
    )
    if not any(good) or not ratios:
        return ""
    where = "here" if len(good) == 1 else f"in {'all' if all(good) else f'{sum(good)} of'} {len(good)} tasks"
    text = f"A {HAND_WRITTEN} of Pinocchio and DAQP is as near {where}; it takes {_span(ratios)} times our time."
    if alone:
        text += f" Without the compiled core ours takes {_span(sorted(1.0 / r for r in alone))} times its time."
    return text


def _one_answer(results: Results) -> str:
    parts = []
    for name in (OURS, SCALED_LEAST_SQUARES, HAND_WRITTEN, PENROSE):
        worst = [worst_frame(results, name, kind) for kind in ("loop", "beyond")]
        if any(change is not None for change in worst):
            parts.append(f"{name} {' · '.join(figure(change, '{:.0e}') for change in worst)}")
    what = "Another tool frame for the same motion moves joints at most [rad], in these tasks · out of reach"
    return f"{what}: {', '.join(parts)}." if parts else ""
