"""The page and the chart of a comparison. The chart has tick times against errors, a panel for each kind of task."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from invariantqp.workbench.compare import tables
from invariantqp.workbench.compare.figures import has_failed
from invariantqp.workbench.compare.method import OURS
from invariantqp.workbench.compare.results import Results, TaskRuns, failures, measured, tick_us
from invariantqp.workbench.compare.tables import Table, change
from invariantqp.workbench.pictures.figure import figure_file
from invariantqp.workbench.template import fill_template
from invariantqp.workbench.writing import write_text

CAPTION = (
    "A marker is a method; ours is the large disc. Times are medians of single ticks; errors and accelerations are the "
    "largest of each run, geometric means over arms. The colour says whether the motion is the same in another tool "
    "frame; grey is a method that, in one of these runs, raised, violated a limit or stood still off its target."
)
SHEET = Path(__file__).with_name("report.mplstyle")
# Tolerance of a joint position in another tool frame [rad].
FRAME_TOLERANCE = 1e-8
# An axis whose ends have a smaller ratio is labelled at 1, 2 and 5.
FEW = 50.0
# A marker has the same meaning in every chart, whatever was measured; methods in other settings have OTHER_MARKER.
MARKERS = {
    OURS: "o", "Moore-Penrose": "s", "J^{+h}": "$h$", "DLS": "^", "LM": "v", "SNS": "D", "task priority": "P",
    "scaling": "X", "QP": "<", "QP with length": ">", "QP with |e|^2": "p", "QP with both": "h", "Pink": "*",
    "mink": "d", "placo": "H", "placo scaled": "8", "OInK": "+", "EmbodiK": "x", "ElastiQP": "1", "Drake": "2",
    "RTB": "3",
}  # fmt: skip
OTHER_MARKER = "."


class Panel(NamedTuple):
    """A panel of the chart: a figure of the runs on one kind of task, none below `least`."""

    kind: str
    key: str
    least: float
    label: str


def mm(kind: str) -> Panel:
    """A panel of position errors."""
    return Panel(kind, "mm", 1e-3, "position error, mm")


def deg(kind: str) -> Panel:
    """A panel of orientation errors."""
    return Panel(kind, "deg", 1e-3, "orientation error, deg")


def acceleration(kind: str) -> Panel:
    """A panel of joint accelerations."""
    return Panel(kind, "acceleration", 1.0, "acceleration, rad/s$^2$")


# The kinds of tasks in which methods differ, each by the figures in which they do.
PANELS = (
    mm("free"),
    mm("limits"),
    deg("limits"),
    acceleration("singular"),
    mm("turn"),
    deg("accelerations"),
    acceleration("out of reach"),
    acceleration("jump"),
    Panel("stay", "joints_deg", 1e-4, "joint motion, deg"),
)


class Colours(NamedTuple):
    """Colours of a light or dark page.

    Those of methods are `same` where no tool frame changes the motion, `other` where one does, `failed` where a run of
    the panel failed.
    """

    paper: str
    text: str
    rule: str
    same: str
    other: str
    failed: str


LIGHT = Colours("#ffffff", "#24292f", "#d0d7de", "#0072B2", "#D55E00", "#9aa4ae")
DARK = Colours("#0d1117", "#e6edf3", "#30363d", "#56B4E9", "#FF8A5B", "#6e7781")


def draw(results: Results, file: Path, colours: Colours = LIGHT, columns: int = 3) -> None:
    """Draw the chart, with at most `columns` panels in a row, to a .png, .svg or .pdf file."""
    kinds = {task["kind"] for task in results["tasks"]}
    panels = [panel for panel in PANELS if panel.kind in kinds] or [mm(min(kinds))]
    tasks = measured(results)
    names = [name for name in tables.names_of(results) if any(point(tasks, panel, name) for panel in panels)]
    looks = {name: (marker_of(name), colour_of(change(tasks, name), colours)) for name in names}
    columns = min(columns, len(panels))
    rows, across = -(-len(panels) // columns), 2 * columns - 1 if columns > 2 else 2
    height = 2.75 * rows + 0.3 * -(-(len(names) + 2) // across)
    style = {
        "grid.color": colours.rule,
        **{f"{part}color": colours.text for part in ("text.", "axes.label", "axes.edge", "xtick.", "ytick.")},
        **dict.fromkeys(("figure.facecolor", "axes.facecolor", "savefig.facecolor"), colours.paper),
    }
    width = (3.5 if columns > 2 else 2.7) * columns
    with figure_file(file, (width, height), SHEET, style) as page:
        grid = page.subplots(rows, columns, squeeze=False, sharex=True).ravel()
        for axes, panel in zip(grid, panels, strict=False):
            axes.set(xscale="log", yscale="log", ylabel=panel.label, title=panel.kind)
            axes.tick_params(labelbottom=True)
            points = {name: at for name in names if (at := point(tasks, panel, name))}
            for name, at in points.items():
                marker, colour = looks[name]
                _mark(axes, name, at, marker, colours.failed if fails(tasks, panel, name) else colour, colours)
            for axis in (axes.xaxis, axes.yaxis):
                low, high = axis.get_view_interval()
                subs = (1.0, 2.0, 5.0) if high < FEW * low else (1.0,)
                axis.set_major_locator(LogLocator(subs=subs, numticks=9))
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axis.set_minor_formatter(NullFormatter())
        for axes in grid[len(panels) :]:
            axes.set_visible(False)
        for axes in grid[len(panels) - columns : len(panels)]:
            axes.set_xlabel("time of a tick, us")
        entries = [(colours.text, marker, name) for name, (marker, _) in looks.items()]
        entries += [
            (colours.same, "o", "same in any frame"),
            (colours.other, "o", "not the same"),
            (colours.failed, "o", "fails in a run"),
        ]
        handles = [Line2D([], [], color=c, marker=marker, linestyle="", label=label) for c, marker, label in entries]
        page.legend(handles=handles, loc="outside lower center", ncols=across)


def point(tasks: Sequence[TaskRuns], panel: Panel, name: str) -> tuple[float, float] | None:
    """The median tick time of a method [us] and the geometric mean of the panel's figure; None without a run."""
    here = [task for task in tasks if task.kind == panel.kind and name in task.runs]
    values = [task.runs[name][panel.key] for task in here]
    return (tick_us(here, name)[0], tables.geometric_mean(values, panel.least)) if here else None


def fails(tasks: Sequence[TaskRuns], panel: Panel, name: str) -> bool:
    """Whether a method raises, violates a limit or stands still in one of the panel's runs."""
    return any(has_failed(task.runs[name]) for task in tasks if task.kind == panel.kind and name in task.runs)


def _mark(axes: Axes, name: str, at: tuple[float, float], marker: str, colour: str, colours: Colours) -> None:
    """The marker of a method in a panel; ours is larger."""
    (line,) = axes.plot(*at, marker, color=colour, zorder=3)
    if name == OURS:
        line.set(markersize=1.5 * line.get_markersize(), markeredgecolor=colours.text, zorder=4)


def marker_of(name: str) -> str:
    """The marker of a method."""
    return MARKERS.get(name, OTHER_MARKER)


def colour_of(moved: float | None, colours: Colours) -> str:
    """The colour of a change of joint positions in another tool frame [rad]; None if it was not measured."""
    return colours.text if moved is None else colours.same if moved < FRAME_TOLERANCE else colours.other


def write_report(results: Results, out: Path) -> list[Path]:
    """Write report.html and the chart into an existing folder; returns the files, the report first."""
    report, chart = out / "report.html", out / "speed_and_accuracy.svg"
    draw(results, chart)
    with TemporaryDirectory() as place:
        narrow = Path(place, chart.name)
        draw(results, narrow, columns=2)
        write_text(report, html(results, inline_svg(chart), inline_svg(narrow)))
    return [report, chart]


def html(results: Results, svg: str, narrow: str) -> str:
    """The page, which needs no other file, with the chart by `inline_svg`, and one for narrow screens."""
    values = {
        "opening": _opening(results),
        "chart": svg,
        "narrow": narrow,
        "light": LIGHT._asdict(),
        "dark": DARK._asdict(),
        "caption": CAPTION,
        "summary": tables.summary(results),
        "rule": tables.RULE,
        "lost": tables.losses(results),
        "columns": tables.COMPARED,
        "stability": tables.stability(results),
        "outcomes": tables.OUTCOMES,
        "folded": folded(results),
        "machine": machine(results),
    }
    return fill_template("invariantqp.workbench.compare", "page.html", values)


def folded(results: Results) -> list[tuple[str, Table]]:
    """The folded tables and their titles."""
    found = [
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
