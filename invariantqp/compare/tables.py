"""The comparison in rows: what the command prints, what the report lists, and the README's ten lines."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from invariantqp.compare.invariant import OURS
from invariantqp.compare.page import Table, table_markdown
from invariantqp.compare.results import Results, picked
from invariantqp.errors import BadInput

NOTHING = "-"
# The README's rows: the law, the closest of each family, the systems people have.
README_METHODS = (
    OURS,
    "h, Gram + LDL'",
    "QP, DAQP",
    "Moore-Penrose, LU",
    "Moore-Penrose, pinv",
    "DLS",
    "SDLS",
    "SNS",
    "least-squares QP",
    "Pink",
)
BEGIN, END = "<!-- comparison -->", "<!-- end of comparison -->"


def figure(value: float | None, style: str = "{:.3g}") -> str:
    """A figure as text; a dash where there is none."""
    return NOTHING if value is None else style.format(value)


def error_figure(value: float | None) -> str:
    """An error as text: its order of magnitude is what matters."""
    return figure(value, "{:.0e}")


def across(results: Results, kind: str, method: str, *path: str) -> float | None:
    """The median over tasks of one figure of a method; None where it has none."""
    found = []
    for (_, name), result in picked(results, kind).items():
        value: Any = result if name == method else None
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if isinstance(value, (int, float)):
            found.append(float(value))
    return median(found) if found else None


def summary(results: Results, methods: Sequence[str] | None = None) -> Table:
    """One row a method, figures medians over the tasks."""
    columns = (
        "method",
        "free, us",
        "error",
        "limits met, us",
        "error",
        "near-singular, us",
        "error",
        "missed",
        "tick, us",
        "tracking, mm",
        "failed ticks",
    )
    names = [m["name"] for m in results["methods"]] if methods is None else list(methods)
    rows = []
    for name in names:
        row = [name]
        for sort in ("free", "limited", "singular"):
            row.append(figure(across(results, "time", name, sort, "median_us")))
            row.append(error_figure(across(results, "error", name, sort, "error")))
        row.append(figure(across(results, "error", name, "limited", "missed"), "{:.2f}"))
        row.append(figure(across(results, "tick", name, "median_us")))
        row.append(figure(across(results, "closed_loop", name, "position_mm", "max"), "{:.2g}"))
        row.append(figure(across(results, "closed_loop", name, "failed_ticks"), "{:.1%}"))
        rows.append(row)
    kept = [k for k in range(len(columns)) if k == 0 or any(row[k] != NOTHING for row in rows)]
    return Table([columns[k] for k in kept], [[row[k] for k in kept] for row in rows])


def solves(results: Results, task: str) -> Table:
    """Single solves on one task's arm: error, largest error, what of the twist is missed, time."""
    errors, times = picked(results, "error"), picked(results, "time")
    columns = ["method"]
    for sort in ("free", "limited", "singular"):
        columns += [f"{sort}: us", "p99", "error", "largest", "missed", "failed"]
    rows = []
    for method in results["methods"]:
        name = method["name"]
        error, time = errors.get((task, name)), times.get((task, name))
        if error is None and time is None:
            continue
        row = [name]
        for sort in ("free", "limited", "singular"):
            e, t = (error or {}).get(sort, {}), (time or {}).get(sort, {})
            row += [figure(t.get("median_us")), figure(t.get("p99_us"))]
            row += [error_figure(e.get("error")), error_figure(e.get("error_max"))]
            row += [figure(e.get("missed"), "{:.2g}"), figure(e.get("failed"), "{:.0%}")]
        rows.append(row)
    return Table(columns, rows)


def growth(results: Results) -> Table:
    """Cost at the smallest and at the largest size, and the slope between the larger half of the sizes."""
    rows = []
    for (axis, name), result in picked(results, "growth").items():
        size, cost = result["size"], result["median_us"]
        ends = [f"{size[0]} to {size[-1]}", figure(cost[0]), figure(cost[-1]), figure(result["slope"], "{:.2f}")]
        rows.append([name, axis, *ends])
    return Table(("method", "grows with", "sizes", "first, us", "last, us", "slope"), rows)


def listed(results: Results, kind: str) -> Table:
    """A kind of measurement as it is: every figure that is a number, one row a task and method."""
    found = picked(results, kind)
    keys = list(dict.fromkeys(key for result in found.values() for key, _ in _numbers(result)))
    rows = []
    for (task, method), result in found.items():
        have = dict(_numbers(result))
        rows.append([method, task, *(figure(have.get(key)) for key in keys)])
    return Table(("method", "task", *keys), rows)


def _numbers(result: dict[str, Any], before: str = "") -> list[tuple[str, float | None]]:
    found: list[tuple[str, float | None]] = []
    for key, value in result.items():
        if isinstance(value, dict):
            found += _numbers(value, f"{before}{key} ")
        elif value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)):
            found.append((before + key, value))
    return found


def readme_table(results: Results) -> str:
    """At most ten rows of the summary as Markdown: the README's."""
    names = [m["name"] for m in results["methods"]]
    return table_markdown(summary(results, [name for name in README_METHODS if name in names]))


def with_table(readme: str, table: str) -> str:
    """The README with its table between the markers replaced.

    Raises:
        BadInput: no markers.
    """
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise BadInput("README", "no place for the table", f"the lines {BEGIN} and {END}")
    return f"{before}{begin}\n{table}\n{end}{after}"


def write_readme(results: Results, readme: Path) -> None:
    """Put the table of the results into a README, between its markers."""
    readme.write_text(with_table(readme.read_text("utf-8"), readme_table(results)), encoding="utf-8")
