"""The page and the chart of a comparison. The chart has tick times against errors, a panel for each kind of task."""

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
from invariantqp.workbench.compare.results import Results, TaskRuns, failures, measured, tick_us
from invariantqp.workbench.compare.tables import Table, frame_change
from invariantqp.workbench.pictures.figure import figure_file
from invariantqp.workbench.template import fill_template

CAPTION = (
    "A marker is a method, ours with its name; times are medians, the other axis has geometric means over arms, no "
    "value below 0.001 mm and 1 rad/s^2. Its colour says whether another tool frame changes the motion at limits."
)
SHEET = Path(__file__).with_name("report.mplstyle")
# Tolerance of a joint position in another tool frame [rad].
FRAME_TOLERANCE = 1e-8
# Of the methods in order, repeated if there are more; ours has the disc.
MARKERS = "os^vDPX<>ph*dH8+x123"
# The figure of each panel, its floor and label, by kind of task.
ERROR = ("mm", 1e-3, "largest error, mm")
PANELS = {
    "free": ERROR,
    "limits": ERROR,
    "turn": ERROR,
    "singular": ("acceleration", 1.0, "largest acceleration, rad/s$^2$"),
}


class Colours(NamedTuple):
    """Colours of a light or dark page: `same` of methods whose motion no tool frame changes, `other` of others."""

    paper: str
    text: str
    rule: str
    same: str
    other: str


LIGHT = Colours("#ffffff", "#24292f", "#d0d7de", "#0072B2", "#D55E00")
DARK = Colours("#0d1117", "#e6edf3", "#30363d", "#56B4E9", "#FF8A5B")


def draw(results: Results, file: Path, colours: Colours = LIGHT, columns: int = 2) -> None:
    """Draw the chart, with at most `columns` panels in a row, to a .png, .svg or .pdf file."""
    kinds = {task["kind"] for task in results["tasks"]}
    panels = {kind: panel for kind, panel in PANELS.items() if kind in kinds} or {min(kinds): ERROR}
    names = tables.names_of(results)
    tasks = measured(results)
    looks = {name: (marker_of(name, names), colour_of(frame_change(tasks, name), colours)) for name in names}
    columns = min(columns, len(panels))
    rows, across = -(-len(panels) // columns), 4 if columns > 1 else 2
    height = 3.2 * rows + 0.3 * -(-(len(names) + 2) // across)
    style = {
        "grid.color": colours.rule,
        **{f"{part}color": colours.text for part in ("text.", "axes.label", "axes.edge", "xtick.", "ytick.")},
        **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), colours.paper),
    }
    with figure_file(file, (4.25 * columns, height), SHEET, style) as page:
        grid = page.subplots(rows, columns, squeeze=False, sharex=True).ravel()
        for axes, (kind, (key, least, label)) in zip(grid, panels.items(), strict=False):
            axes.set(xscale="log", yscale="log", ylabel=label, title=kind)
            axes.tick_params(labelbottom=True)
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_locator(LogLocator(numticks=9))
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axis.set_minor_formatter(NullFormatter())
            for name, (marker, colour) in looks.items():
                at = point([task for task in tasks if task.kind == kind], name, key, least)
                if at is not None:
                    _mark(axes, name, at, marker, colour, colours)
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        for axes in grid[len(panels) - columns : len(panels)]:
            axes.set_xlabel("time of a tick, us")
        entries = [(colours.text, marker, name) for name, (marker, _) in looks.items()]
        entries += [(colours.same, "o", "same in any frame"), (colours.other, "o", "not the same")]
        handles = [Line2D([], [], color=c, marker=marker, linestyle="", label=label) for c, marker, label in entries]
        page.legend(handles=handles, loc="outside lower center", ncols=across)


def point(tasks: Sequence[TaskRuns], name: str, key: str, least: float) -> tuple[float, float] | None:
    """The median tick time of a method [us] and the geometric mean of a figure over tasks; None without a run."""
    values = [task.runs[name][key] for task in tasks if name in task.runs]
    return (tick_us(tasks, name)[0], tables.geometric_mean(values, least)) if values else None


def _mark(axes: Axes, name: str, at: tuple[float, float], marker: str, colour: str, colours: Colours) -> None:
    """The marker of a method in a panel; ours is larger and has its name."""
    (line,) = axes.plot(*at, marker, color=colour, zorder=3)
    if name == OURS:
        size = 1.3 * line.get_markersize()
        line.set(markersize=size, markeredgecolor=colours.text)
        axes.annotate(name, at, (-size, size), textcoords="offset points", fontweight="bold", color=colours.text)


def marker_of(name: str, names: Sequence[str]) -> str:
    """The marker of one of the methods."""
    return MARKERS[list(names).index(name) % len(MARKERS)]


def colour_of(change: float | None, colours: Colours) -> str:
    """The colour of a change in another tool frame [rad]; None if it was not measured."""
    return colours.text if change is None else colours.same if change < FRAME_TOLERANCE else colours.other


def write_report(results: Results, out: Path) -> list[Path]:
    """Write report.html and the chart into an existing folder; returns the files, the report first."""
    report, chart = out / "report.html", out / "speed_and_accuracy.svg"
    draw(results, chart)
    report.write_text(html(results, inline_svg(chart)), encoding="utf-8")
    return [report, chart]


def html(results: Results, svg: str) -> str:
    """The page, which needs no other file; `svg` is the chart by `inline_svg`."""
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
    """The folded tables and their titles."""
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
    """A light chart as an element of the page, in the page's colours: dark if the reader prefers dark."""
    text = file.read_text(encoding="utf-8")
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    for name, colour in LIGHT._asdict().items():
        text = text.replace(colour.lower(), f"var(--{name})")
    return text
