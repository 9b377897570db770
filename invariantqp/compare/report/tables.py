"""The comparison as tables: the summary that the command prints, the tables of the report, and the README's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from invariantqp.compare.names import DAQP, DLS, GRAM, LEAST_SQUARES, LU, OURS, PINK, PINV, SDLS, SNS
from invariantqp.compare.report.page import Table, table_markdown
from invariantqp.compare.results import Results, results_of
from invariantqp.errors import BadInput

NOTHING = "-"
# The rows of the README: our law, and the best-known methods of each family.
README_METHODS = (
    OURS,
    GRAM,
    DAQP,
    LU,
    PINV,
    DLS,
    SDLS,
    SNS,
    LEAST_SQUARES,
    PINK,
)
BEGIN, END = "<!-- comparison -->", "<!-- end of comparison -->"


def figure(value: float | None, style: str = "{:.3g}") -> str:
    """A figure as text; a dash for None."""
    return NOTHING if value is None else style.format(value)


def across(results: Results, kind: str, method: str, *path: str) -> float | None:
    """The median over all tasks of one figure of a method; None if the method has no such figure."""
    found = []
    for (_, name), result in results_of(results, kind).items():
        value: Any = result if name == method else None
        for key in path:
            value = value.get(key) if isinstance(value, dict) else None
        if isinstance(value, (int, float)):
            found.append(float(value))
    return median(found) if found else None


class Column(NamedTuple):
    """A column of the summary: its heading, the measurement, the place of the figure in its result, and its format."""

    heading: str
    kind: str
    path: tuple[str, ...]
    style: str = "{:.3g}"


ERROR = "{:.0e}"
FREE = (Column("free, us", "time", ("free", "median_us")), Column("error", "error", ("free", "error"), ERROR))
LIMITED = (
    Column("limits active, us", "time", ("limited", "median_us")),
    Column("error", "error", ("limited", "error"), ERROR),
)
SINGULAR = (
    Column("near-singular, us", "time", ("singular", "median_us")),
    Column("error", "error", ("singular", "error"), ERROR),
)
RESIDUAL = Column("residual", "error", ("limited", "missed"), "{:.2f}")
LOOPS = (
    Column("tick, us", "tick", ("median_us",)),
    Column("tracking, mm", "closed_loop", ("position_mm", "max"), "{:.2g}"),
    Column("frame", "dependence", ("frame", "worst"), ERROR),
)
FAILED = Column("failed ticks", "closed_loop", ("failed_ticks",), "{:.1%}")
SUMMARY = (*FREE, *LIMITED, *SINGULAR, RESIDUAL, *LOOPS, FAILED)
README = (*FREE, *LIMITED, *LOOPS)


def summary(results: Results, methods: Sequence[str] | None = None, columns: Sequence[Column] = SUMMARY) -> Table:
    """One row for each method, with medians over the tasks; a column without any figure is left out."""
    names = [m["name"] for m in results["methods"]] if methods is None else list(methods)
    found = {c: [across(results, c.kind, name, *c.path) for name in names] for c in columns}
    kept = {c: values for c, values in found.items() if values.count(None) < len(values)}
    rows = [[name, *(figure(values[k], c.style) for c, values in kept.items())] for k, name in enumerate(names)]
    return Table(["method", *(c.heading for c in kept)], rows)


def solves(results: Results, task: str) -> Table:
    """Single solves of the arm of one task: times, errors, residual, and share of failures."""
    errors, times = results_of(results, "error"), results_of(results, "time")
    columns = ["method"]
    for sort in ("free", "limited", "singular"):
        columns += [f"{sort}: us", "p99", "error", "largest", "residual", "failed"]
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
            row += [figure(e.get("error"), ERROR), figure(e.get("error_max"), ERROR)]
            row += [figure(e.get("missed"), "{:.2g}"), figure(e.get("failed"), "{:.0%}")]
        rows.append(row)
    return Table(columns, rows)


def growth(results: Results) -> Table:
    """The time at the smallest and at the largest size, and the slope over the larger half of the sizes."""
    rows = []
    for (axis, name), result in results_of(results, "growth").items():
        size, cost = result["size"], result["median_us"]
        ends = [f"{size[0]} to {size[-1]}", figure(cost[0]), figure(cost[-1]), figure(result["slope"], "{:.2f}")]
        rows.append([name, axis, *ends])
    return Table(("method", "grows with", "sizes", "first, us", "last, us", "slope"), rows)


def listed(results: Results, kind: str) -> Table:
    """Every number that a measurement found, one row for each task and method."""
    found = results_of(results, kind)
    keys = list(dict.fromkeys(key for result in found.values() for key, _ in _numbers(result)))
    rows = []
    for (task, method), result in found.items():
        have = dict(_numbers(result))
        rows.append([method, task, *(figure(have.get(key)) for key in keys)])
    return Table(("method", "task", *keys), rows)


def _numbers(result: dict[str, Any], before: str = "") -> list[tuple[str, float | None]]:
    """(name, number) of every figure of a result; names of inner results come first in the name."""
    found: list[tuple[str, float | None]] = []
    for key, value in result.items():
        if isinstance(value, dict):
            found += _numbers(value, f"{before}{key} ")
        elif value is None or (isinstance(value, (int, float)) and not isinstance(value, bool)):
            found.append((before + key, value))
    return found


def readme_table(results: Results) -> str:
    """The table of the README as Markdown: at most ten rows of the summary."""
    names = [m["name"] for m in results["methods"]]
    return table_markdown(summary(results, [name for name in README_METHODS if name in names], README))


def with_table(readme: str, table: str) -> str:
    """The README with a new table between its markers.

    Raises:
        BadInput: the README has no markers.
    """
    before, begin, rest = readme.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise BadInput("README", "no place for the table", f"the lines {BEGIN} and {END}")
    return f"{before}{begin}\n{table}\n{end}{after}"


def write_readme(results: Results, readme: Path) -> None:
    """Write the table of the results into a README, between its markers."""
    readme.write_text(with_table(readme.read_text("utf-8"), readme_table(results)), encoding="utf-8")
