"""How cost grows with joints, tasks, rows and batch size, each with its slope."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from invariantqp.compare.laws.invariant import OURS
from invariantqp.compare.report.charts.ends import name_ends
from invariantqp.compare.report.charts.style import (
    chart,
    families_legend,
    grid,
    is_ours,
    laid_out,
    look,
    plain_ticks,
    short,
)
from invariantqp.compare.results import Results, picked

TITLES = {
    "joints": ("joints, no limit met", "joints"),
    "joints, limits met": ("joints, limits met", "joints"),
    "tasks": ("tasks of 6 rows, 30 joints", "tasks"),
    "rows": ("limit rows, 7 joints", "rows"),
    "batch": ("batch of twists, 7 joints", "twists"),
}
# Lines that are named where there are more than a few; the others are drawn in grey.
NAMED = (
    OURS,
    "h, Gram + LDL'",
    "Moore-Penrose, LU",
    "Moore-Penrose, pinv",
    "SNS",
    "least-squares QP",
    "QP, DAQP",
    "QP, OSQP 1e-5, warm",
    "QP, ProxQP",
    "QP, PIQP",
    "QP, Clarabel",
    "QP, CVXPY",
)
FEW = 8
# Lines whose slopes the caption tells.
TOLD = NAMED[:7]
NOTE = "beside a name: its slope, cost ~ size^slope,\nfitted to the larger half of the sizes;\ngrey: every other method"


def growth_chart(results: Results, file: Path) -> None:
    """A panel for each axis of growth."""
    found = picked(results, "growth")
    there = [axis for axis in TITLES if any(task == axis for task, _ in found)]
    rows = (len(there) + 1) // 2
    with chart(file, rows, 2, height=3.6 * rows) as (figure, panels):
        flat = panels.ravel().tolist()
        for axes in flat[len(there) :]:
            axes.set_axis_off()
            axes.text(0.0, 0.9, NOTE, va="top", transform=axes.transAxes, color="#555555")
        families_legend(figure, results, NAMED)
        ends = [_panel(axes, results, axis) for axes, axis in zip(flat, there, strict=False)]
        laid_out(figure)
        for axes, names in zip(flat, ends, strict=False):
            name_ends(axes, names)


def _panel(axes: Axes, results: Results, axis: str) -> list[tuple[float, float, str, bool]]:
    """Draw one axis of growth; returns where lines end, and what they are called."""
    lines = {name: run for (task, name), run in picked(results, "growth").items() if task == axis}
    title, unit = TITLES[axis]
    axes.set_title(title)
    axes.set_xlabel(unit)
    axes.set_ylabel("us a twist, median" if axis == "batch" else "us a solve, median")
    axes.set_xscale("log")
    axes.set_yscale("log")
    ends = []
    for name, run in lines.items():
        chosen = len(lines) <= FEW or name in NAMED
        style = look(results, name if name in {m["name"] for m in results["methods"]} else _owner(name))
        axes.plot(
            run["size"],
            run["median_us"],
            marker=style.marker if chosen else "",
            markersize=3.5,
            linewidth=(2.2 if is_ours(name) else 1.3) if chosen else 0.7,
            color=style.colour if chosen else "#cccccc",
            zorder=3 if chosen else 1,
        )
        if chosen:
            slope = "" if run["slope"] is None else f"  {run['slope']:.2f}"
            ends.append((float(run["size"][-1]), float(run["median_us"][-1]), f"{short(name)}{slope}", is_ours(name)))
    sizes = sorted({size for run in lines.values() for size in run["size"]})
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * (high / low) ** 1.1)  # names stand where no line is
    axes.set_xticks(_spaced(sizes), minor=False)
    axes.set_xticks([], minor=True)
    plain_ticks(axes.yaxis, axes.get_ylim())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    grid(axes)
    return ends


def _spaced(sizes: list[int]) -> list[int]:
    """The sizes that can stand beside each other under a logarithmic axis."""
    kept = [sizes[-1]]
    for size in reversed(sizes[:-1]):
        if kept[-1] / size >= (sizes[-1] / sizes[0]) ** 0.2:
            kept.append(size)
    return kept


def _owner(name: str) -> str:
    """The method that a line of its own kind belongs to: "numpy pinv, stacked" is Moore-Penrose."""
    return "Moore-Penrose, pinv" if "pinv" in name else OURS


def growth_caption(results: Results) -> str:
    """Slopes of our lines."""
    found = picked(results, "growth")
    said = ["Numbers beside names are slopes on doubly logarithmic axes, fitted to the larger half of the sizes."]
    for axis, (title, _) in TITLES.items():
        slopes = [
            f"{name} {run['slope']:.2f}"
            for (task, name), run in found.items()
            if task == axis
            and run["slope"] is not None
            and (name in TOLD or name.startswith(f"{OURS}, ") or "joints" not in axis)
        ]
        if slopes:
            said.append(f"{title}: {', '.join(slopes)}.")
    return " ".join(said)
