"""Speed against accuracy of a single solve: the main chart, and the same close to singularities."""

from __future__ import annotations

from pathlib import Path

from invariantqp.compare.charts.scatter import Point, front, positive, scatter
from invariantqp.compare.charts.style import chart
from invariantqp.compare.invariant import OURS
from invariantqp.compare.results import Results
from invariantqp.compare.tables import across

# Errors below this are drawn there: less than the rounding of one number.
FLOOR = 1e-17
TITLES = {
    "limited": "Limits met: clipping, or a QP",
    "free": "No limit met: linear algebra",
    "singular": "Close to a singularity",
}


def points(results: Results, sort: str) -> list[Point]:
    """Every method with a time and an error, medians over the tasks."""
    found = []
    for method in results["methods"]:
        name = method["name"]
        time = across(results, "time", name, sort, "median_us")
        error = positive(across(results, "error", name, sort, "error"), FLOOR)
        if time is not None and error is not None:
            found.append(Point(name, time, error))
    return found


def _draw(results: Results, file: Path, sorts: tuple[str, ...], height: float) -> None:
    drawn = {sort: points(results, sort) for sort in sorts}
    drawn = {sort: found for sort, found in drawn.items() if found}
    with chart(file, max(1, len(drawn)), height=height * max(1, len(drawn))) as (figure, panels):
        for axes, sort in zip(panels[:, 0], drawn, strict=False):
            axes.set_title(TITLES[sort])
            axes.set_ylabel("error against the exact answer")
        panels[-1, 0].set_xlabel("time of one solve, median [us]")
        scatter(figure, panels[: len(drawn), 0], list(drawn.values()), results)


def main_chart(results: Results, file: Path) -> None:
    """Time of a solve against its error, with limits met and without."""
    _draw(results, file, ("limited", "free"), 4.4)


def singular_chart(results: Results, file: Path) -> None:
    """The same near singularities."""
    _draw(results, file, ("singular",), 4.6)
