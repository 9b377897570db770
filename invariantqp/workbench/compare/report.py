"""The report: the chart and the tables to begin with on the first screen; everything else folded below.

The chart: time of a tick against what differs, a panel a kind of task.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.workbench.compare import tables
from invariantqp.workbench.compare.method import OURS
from invariantqp.workbench.compare.results import Measured, Results, failures, measured, tick_us
from invariantqp.workbench.compare.tables import Table, frame_change
from invariantqp.workbench.pictures.figure import figure_file
from invariantqp.workbench.template import fill_template

CAPTION = (
    "A marker is a method, ours with its name; times are medians, the other axis has geometric means over arms, no "
    "value below 0.001 mm and 1 rad/s^2. Its colour says whether another tool frame changes the motion at limits."
)
FONT, DIAMETER = 12.0, 8.0
# A change of a joint position by another tool frame that is less is rounding [rad].
ROUNDING = 1e-8
# Of the methods in their order, again from the first on where there are more; ours has the disc.
MARKERS = "os^vDPX<>ph*dH8+x123"
# What the panels show of which kind, and the least value that is told apart.
ERROR = ("mm", 1e-3, "largest error, mm")
PANELS = {
    "free": ERROR,
    "limits": ERROR,
    "turn": ERROR,
    "singular": ("acceleration", 1.0, "largest acceleration, rad/s$^2$"),
}


class Colours(NamedTuple):
    """Colours on light paper or on a dark page: of methods that another tool frame does not change, and of others."""

    paper: str
    text: str
    rule: str
    same: str
    other: str


LIGHT = Colours("#ffffff", "#24292f", "#d0d7de", "#0072B2", "#D55E00")
DARK = Colours("#0d1117", "#e6edf3", "#30363d", "#56B4E9", "#FF8A5B")


def draw(results: Results, file: Path, colours: Colours = LIGHT, columns: int = 2) -> None:
    """Draw the chart with at most so many panels in a row; the ending of the file tells the format."""
    kinds = {task["kind"] for task in results["tasks"]}
    panels = {kind: panel for kind, panel in PANELS.items() if kind in kinds} or {min(kinds): ERROR}
    names = tables.names_of(results)
    tasks = measured(results)
    looks = {name: (marker_of(name, names), colour_of(frame_change(tasks, name), colours)) for name in names}
    columns = min(columns, len(panels))
    rows, across = -(-len(panels) // columns), 4 if columns > 1 else 2
    height = 3.2 * rows + 0.3 * -(-(len(names) + 2) // across)
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
    with figure_file(file, (4.25 * columns, height), style, dots=200) as page:
        grid = page.subplots(rows, columns, squeeze=False, sharex=True).ravel()
        for axes, (kind, (key, least, label)) in zip(grid, panels.items(), strict=False):
            axes.set(xscale="log", yscale="log", ylabel=label, axisbelow=True)
            axes.set_title(kind, fontweight="bold")
            axes.grid(visible=True, which="major", color=colours.rule, linewidth=0.7)
            axes.tick_params(labelbottom=True)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(LogLocator(numticks=9))
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axis.set_minor_formatter(NullFormatter())
            axes.margins(x=0.08, y=0.15)
            for name, (marker, colour) in looks.items():
                at = point([task for task in tasks if task.kind == kind], name, key, least)
                if at is not None:
                    _mark(axes, name, at, marker, colour, colours)
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        for axes in grid[len(panels) - columns : len(panels)]:
            axes.set_xlabel("time of a tick, us")
        shapes = [(colours.text, marker, name) for name, (marker, _) in looks.items()]
        shapes += [(colours.same, "o", "same in any frame"), (colours.other, "o", "not the same")]
        handles = [
            Line2D([], [], color=c, marker=marker, linestyle="", markersize=DIAMETER, label=label)
            for c, marker, label in shapes
        ]
        look = {"frameon": False, "fontsize": FONT, "handletextpad": 0.2, "columnspacing": 1.0}
        page.legend(handles=handles, loc="outside lower center", ncols=across, **look)


def point(tasks: Sequence[Measured], name: str, key: str, least: float) -> tuple[float, float] | None:
    """The median of a method's ticks [us], and the geometric mean of a figure over tasks; None without a run."""
    values = [task.runs[name][key] for task in tasks if name in task.runs]
    return (tick_us(tasks, name)[0], tables.geometric_mean(values, least)) if values else None


def _mark(axes: Axes, name: str, at: tuple[float, float], marker: str, colour: str, colours: Colours) -> None:
    """The marker of a method in a panel; ours is larger, and has its name."""
    size, edge = (1.3 * DIAMETER, colours.text) if name == OURS else (DIAMETER, colour)
    axes.plot(*at, marker, color=colour, markersize=size, markeredgecolor=edge, zorder=3)
    if name == OURS:
        axes.annotate(name, at, (-size, size), textcoords="offset points", fontweight="bold", color=colours.text)


def marker_of(name: str, names: Sequence[str]) -> str:
    """The marker of one of the methods that are shown."""
    return MARKERS[list(names).index(name) % len(MARKERS)]


def colour_of(change: float | None, colours: Colours) -> str:
    """The colour of what another tool frame changes [rad]; None was not measured."""
    return colours.text if change is None else colours.same if change < ROUNDING else colours.other


def write_report(results: Results, out: Path) -> list[Path]:
    """Write report.html and the chart into a folder that exists: the files, the report first."""
    report, chart = out / "report.html", out / "speed_and_accuracy.svg"
    draw(results, chart)
    report.write_text(html(results, inline_svg(chart)), encoding="utf-8")
    return [report, chart]


def html(results: Results, svg: str) -> str:
    """The page as one HTML file that needs no other file; `svg` is the chart by `inline_svg`."""
    values = {
        "opening": _opening(results),
        "chart": svg,
        "light": LIGHT._asdict(),
        "dark": DARK._asdict(),
        "caption": CAPTION,
        "summary": tables.summary(results),
        "rule": tables.RULE,
        "lost": tables.lost_kinds(results),
        "folded": folded(results),
        "machine": machine(results),
    }
    return fill_template("invariantqp.workbench.compare", "page.html", values)


def folded(results: Results) -> list[tuple[str, Table]]:
    """Tables that a reader opens, with their titles."""
    found = [
        (f"Where a method dominates {OURS}", tables.losses(results)),
        ("What each kind of task is", tables.kinds(results)),
        (f"Kind by kind. {tables.CELLS}", tables.by_kind(results)),
        ("What each method makes of what all are given", tables.settings(results)),
        ("Every run", tables.listed(results)),
        ("What could not be measured", Table(("method", "task", "why"), failures(results))),
    ]
    return [(about, table) for about, table in found if table.rows]


def _opening(results: Results) -> str:
    """What was measured."""
    quick = " This was the quick form: two arms, without slow methods." if results["quick"] else ""
    counts = f"{len(results['methods'])} methods on {len(results['tasks'])} tasks; seed {results['seed']}."
    own = results["kinematics"] == OURS
    seen = f" Pinocchio was not installed: methods by hand read the arm by {OURS}." if own else ""
    return f"{counts} All are given the same gain, feedforward, limits, posture and point.{seen}{quick}"


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
