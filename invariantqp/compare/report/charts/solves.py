"""Speed against accuracy of a single solve: the main chart, and the same close to singularities."""

from __future__ import annotations

from pathlib import Path

from invariantqp.compare.laws.invariant import OURS
from invariantqp.compare.report.charts.scatter import Point, band, front, positive, scatter
from invariantqp.compare.report.charts.style import chart
from invariantqp.compare.report.findings import residual
from invariantqp.compare.report.tables import across
from invariantqp.compare.results import Results, picked

# Errors below this are drawn there: less than the rounding of one number.
FLOOR = 1e-17
# Errors up to this are rounding: which is smaller says nothing.
ROUNDING = 1e-12
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
            band(axes, ROUNDING)
            axes.set_ylabel("relative error against the exact answer")
        panels[-1, 0].set_xlabel("time of one solve, median [us]")
        scatter(figure, panels[: len(drawn), 0], list(drawn.values()), results, ROUNDING)


def main_chart(results: Results, file: Path) -> None:
    """Time of a solve against its error, with limits met and without."""
    _draw(results, file, ("limited", "free"), 4.4)


def singular_chart(results: Results, file: Path) -> None:
    """The same near singularities."""
    _draw(results, file, ("singular",), 4.6)


def main_caption(results: Results) -> str:
    """Where plain Moore-Penrose is the fastest, where clipping it costs accuracy, and what it minimises best."""
    said = ["Medians over states and tasks, against references in 50 digits."]
    free = points(results, "free")
    if free:
        exact = [p for p in free if p.y <= ROUNDING]
        first = min(exact or free, key=lambda p: p.x)
        mine = next((p for p in free if p.method == OURS), None)
        text = f"Without limits the fastest solve that is exact to rounding is {first.method}, {first.x:.1f} us"
        said.append(f"{text}; {OURS} takes {mine.x:.1f} us." if mine else f"{text}.")
    limited = {p.method: p for p in points(results, "limited")}
    clipped = [p for p in limited.values() if p.method.startswith("Moore-Penrose")]
    if clipped:
        quick = min(clipped, key=lambda p: p.x)
        said.append(f"With limits met, {quick.method} clipped is {quick.y:.0%} off ({quick.x:.1f} us).")
    exact = sorted((p for p in limited.values() if p.y <= ROUNDING), key=lambda p: p.x)
    if exact:
        named = ", ".join(f"{p.method} {p.x:.0f} us" for p in exact[:3])
        said.append(f"Exact to rounding there, fastest first: {named}.")
    if OURS in limited:
        mine = limited[OURS]
        said.append(
            f"{OURS} as commanded takes {mine.x:.0f} us there with prices and guard, which leaves its own QP's optimum "
            f"by {mine.y:.0e} where the descent guard asks for it."
        )
    drawn = {p.method for sort in ("free", "limited") for p in points(results, sort)}
    timed = {name for _, name in picked(results, "time")}
    others = [m["name"] for m in results["methods"] if m["name"] in timed - drawn]
    if others:
        said.append(f"Not drawn, since they solve no problem that has an exact answer: {', '.join(others)}.")
    return " ".join([*said, *residual(results)])


def singular_caption(results: Results) -> str:
    """Which digits are lost where."""
    found = points(results, "singular")
    said = ["States 1e-4 to 3e-2 rad from a singularity."]
    for words, names in (
        ("Squaring cond(J) costs digits", ("Moore-Penrose, LU", "h, Gram + LDL'")),
        ("factoring first keeps them", ("Moore-Penrose, SVD", "h, factored")),
    ):
        listed = [f"{p.method} {p.y:.0e}" for p in found if p.method in names]
        if listed:
            said.append(f"{words}: {', '.join(listed)}.")
    edge = front(found, ROUNDING)
    if edge:
        said.append("On the front: " + ", ".join(f"{p.method} ({p.x:.1f} us, {p.y:.0e})" for p in edge) + ".")
    return " ".join(said)
