"""How the time of a solve grows with the number of joints, tasks and limit rows, and with the size of a batch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from invariantqp.compare.names import DAQP, GRAM, LEAST_SQUARES, LU, OURS, PINV, SNS
from invariantqp.compare.report.charts.ends import name_ends
from invariantqp.compare.report.charts.style import (
    chart_file,
    families_legend,
    grid,
    is_ours,
    lay_out,
    plain_ticks,
    short,
    style_of,
)
from invariantqp.compare.results import Results, results_of

TITLES = {
    "joints": ("joints, no limit active", "joints"),
    "joints, limits active": ("joints, limits active", "joints"),
    "tasks": ("tasks of 6 rows, 30 joints", "tasks"),
    "rows": ("limit rows, 7 joints", "rows"),
    "batch": ("batch of twists, 7 joints", "twists"),
}
# In a panel with more than FEW lines these have names and the others are grey.
NAMED = (
    OURS,
    GRAM,
    LU,
    PINV,
    SNS,
    LEAST_SQUARES,
    DAQP,
    "QP, OSQP 1e-5, warm",
    "QP, ProxQP",
    "QP, PIQP",
    "QP, Clarabel",
    "QP, CVXPY",
)
FEW = 8
# Width of the room for names, relative to the width of the lines.
ROOM = 1.1
GREY = "#cccccc"
# Lines whose slopes are in the caption.
TOLD = NAMED[:7]
NOTE = "beside a name: slope in time ~ size^slope,\nfitted to the larger half of the sizes;\ngrey: all other methods"


def growth_chart(results: Results, file: Path) -> None:
    """One panel for each quantity that grows."""
    found = results_of(results, "growth")
    there = [axis for axis in TITLES if any(task == axis for task, _ in found)]
    rows = (len(there) + 1) // 2
    with chart_file(file, rows, 2, height=3.6 * rows) as (figure, panels):
        flat = panels.ravel().tolist()
        for axes in flat[len(there) :]:
            axes.set_axis_off()
            axes.text(0.0, 0.9, NOTE, va="top", transform=axes.transAxes, color="#555555")
        families_legend(figure, results, NAMED)
        ends = [_panel(axes, results, axis) for axes, axis in zip(flat, there, strict=False)]
        lay_out(figure)
        for axes, names in zip(flat, ends, strict=False):
            name_ends(axes, names)


def _panel(axes: Axes, results: Results, axis: str) -> list[tuple[float, float, str, bool]]:
    """Draw one panel; returns the ends of its lines, with their names and whether these are bold."""
    lines = {name: run for (task, name), run in results_of(results, "growth").items() if task == axis}
    title, unit = TITLES[axis]
    axes.set_title(title)
    axes.set_xlabel(unit)
    axes.set_ylabel("us for a twist, median" if axis == "batch" else "us for a solve, median")
    axes.set_xscale("log")
    axes.set_yscale("log")
    named = [name for name in lines if len(lines) <= FEW or name in NAMED]
    for name, run in lines.items():
        _line(axes, results, name, run, named=name in named)
    _sizes(axes, sorted({size for run in lines.values() for size in run["size"]}))
    plain_ticks(axes.yaxis, axes.get_ylim())
    grid(axes)
    return [_end(name, lines[name]) for name in named]


def _line(axes: Axes, results: Results, name: str, run: dict[str, Any], *, named: bool) -> None:
    """Draw the line of one method: coloured if it has a name beside it, else grey."""
    size, cost = run["size"], run["median_us"]
    if not named:
        axes.plot(size, cost, linewidth=0.7, color=GREY, zorder=1)
        return
    style = style_of(results, name if name in {m["name"] for m in results["methods"]} else _owner(name))
    width = 2.2 if is_ours(name) else 1.3
    axes.plot(size, cost, marker=style.marker, markersize=3.5, linewidth=width, color=style.colour, zorder=3)


def _end(name: str, run: dict[str, Any]) -> tuple[float, float, str, bool]:
    slope = "" if run["slope"] is None else f"  {run['slope']:.2f}"
    return float(run["size"][-1]), float(run["median_us"][-1]), f"{short(name)}{slope}", is_ours(name)


def _sizes(axes: Axes, sizes: list[int]) -> None:
    """Label the sizes, and make room for names to the right of the lines."""
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * (high / low) ** ROOM)
    axes.set_xticks(_spaced(sizes), minor=False)
    axes.set_xticks([], minor=True)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _spaced(sizes: list[int]) -> list[int]:
    """The sizes whose labels fit beside each other below a logarithmic axis."""
    kept = [sizes[-1]]
    for size in reversed(sizes[:-1]):
        if kept[-1] / size >= (sizes[-1] / sizes[0]) ** 0.2:
            kept.append(size)
    return kept


def _owner(name: str) -> str:
    """The method to which a line belongs that has a name of its own: "numpy pinv, stacked" is Moore-Penrose."""
    return PINV if "pinv" in name else OURS


def growth_caption(results: Results) -> str:
    """The slopes of the lines."""
    found = results_of(results, "growth")
    sentences = ["The number beside a name is the slope in time ~ size^slope, fitted to the larger half of the sizes."]
    for axis, (title, _) in TITLES.items():
        slopes = [
            f"{name} {run['slope']:.2f}"
            for (task, name), run in found.items()
            if task == axis
            and run["slope"] is not None
            and (name in TOLD or name.startswith(f"{OURS}, ") or "joints" not in axis)
        ]
        if slopes:
            sentences.append(f"Slopes, {title}: {'; '.join(slopes)}.")
    return " ".join(sentences)
