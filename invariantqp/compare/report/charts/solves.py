"""Time of a single solve against its error: with active limits, without, and close to singularities."""

from __future__ import annotations

from pathlib import Path

from invariantqp.compare.names import FACTORED, GRAM, LU, OURS, SVD
from invariantqp.compare.report.charts.scatter import Point, band, front, positive, scatter
from invariantqp.compare.report.charts.style import chart_file
from invariantqp.compare.report.findings import residual
from invariantqp.compare.report.tables import across
from invariantqp.compare.results import Results, results_of

# Smaller errors are drawn at this value, below the rounding error of one number: the axis is logarithmic.
FLOOR = 1e-17
# Errors up to this are rounding errors, of which none is better than another.
ROUNDING = 1e-12
TITLES = {
    "limited": "Limits active: clipping, or a QP",
    "free": "No limit active: linear algebra",
    "singular": "Close to a singularity",
}


def points(results: Results, sort: str) -> list[Point]:
    """For each method with both its time and its error, medians over the tasks."""
    found = []
    for method in results["methods"]:
        name = method["name"]
        time = across(results, "time", name, sort, "median_us")
        error = positive(across(results, "error", name, sort, "error"), FLOOR)
        if time is not None and error is not None:
            found.append(Point(name, time, error))
    return found


def _draw(results: Results, file: Path, sorts: tuple[str, ...], height: float) -> None:
    """One panel for each sort of states that the results have."""
    drawn = {sort: points(results, sort) for sort in sorts}
    drawn = {sort: found for sort, found in drawn.items() if found}
    with chart_file(file, max(1, len(drawn)), height=height * max(1, len(drawn))) as (figure, panels):
        for axes, sort in zip(panels[:, 0], drawn, strict=False):
            axes.set_title(TITLES[sort])
            band(axes, ROUNDING)
            axes.set_ylabel("relative error against the exact answer")
        panels[-1, 0].set_xlabel("time of one solve, median [us]")
        scatter(figure, panels[: len(drawn), 0], list(drawn.values()), results, ROUNDING)


def main_chart(results: Results, file: Path) -> None:
    """Time of a solve against its error, with active limits and without."""
    _draw(results, file, ("limited", "free"), 4.4)


def singular_chart(results: Results, file: Path) -> None:
    """Time of a solve against its error close to singularities."""
    _draw(results, file, ("singular",), 4.6)


def main_caption(results: Results) -> str:
    """The fastest exact method without limits, what clipping costs, and which methods are exact with limits."""
    limited = points(results, "limited")
    return " ".join(
        [
            "Medians over states and tasks, against references in 50 digits.",
            *_fastest_free(points(results, "free")),
            *_clipped(limited),
            *_exact_limited(limited),
            *_ours_limited(limited),
            *_without_reference(results),
            *residual(results),
        ]
    )


def _fastest_free(free: list[Point]) -> list[str]:
    """The fastest exact method while no limit is active."""
    if not free:
        return []
    first = min([p for p in free if p.y <= ROUNDING] or free, key=lambda p: p.x)
    ours = next((p for p in free if p.method == OURS), None)
    text = f"Without active limits the fastest solve that is exact to rounding is {first.method}, {first.x:.1f} us"
    return [f"{text}; {OURS} takes {ours.x:.1f} us." if ours else f"{text}."]


def _clipped(limited: list[Point]) -> list[str]:
    """The error of Moore-Penrose when it is clipped."""
    clipped = [p for p in limited if p.method.startswith("Moore-Penrose")]
    if not clipped:
        return []
    quick = min(clipped, key=lambda p: p.x)
    return [f"With active limits the error of {quick.method}, clipped, is {quick.y:.0%} ({quick.x:.1f} us)."]


def _exact_limited(limited: list[Point]) -> list[str]:
    """The fastest three exact methods while limits are active."""
    exact = sorted((p for p in limited if p.y <= ROUNDING), key=lambda p: p.x)
    if not exact:
        return []
    named = "; ".join(f"{p.method} {p.x:.0f} us" for p in exact[:3])
    return [f"Exact to rounding there, the fastest first: {named}."]


def _ours_limited(limited: list[Point]) -> list[str]:
    """The time and the error of our law while limits are active."""
    return [
        f"{OURS} as it is shipped takes {p.x:.0f} us there; its error against the exact answer of all of its law "
        f"is {p.y:.0e}."
        for p in limited
        if p.method == OURS
    ]


def _without_reference(results: Results) -> list[str]:
    """The methods with a time that are not drawn."""
    drawn = {p.method for sort in ("free", "limited") for p in points(results, sort)}
    timed = {name for _, name in results_of(results, "time")}
    others = [m["name"] for m in results["methods"] if m["name"] in timed - drawn]
    return [f"Not drawn, since their problem has no exact answer: {'; '.join(others)}."] if others else []


def singular_caption(results: Results) -> str:
    """Which methods lose digits, and which are on the front."""
    found = points(results, "singular")
    sentences = ["States 1e-4 to 3e-2 rad from a singularity."]
    for words, names in (
        ("Methods that square cond(J) lose digits", (LU, GRAM)),
        ("Methods that factor J first do not", (SVD, FACTORED)),
    ):
        listed = [f"{p.method} {p.y:.0e}" for p in found if p.method in names]
        if listed:
            sentences.append(f"{words}: {'; '.join(listed)}.")
    edge = front(found, ROUNDING)
    if edge:
        listed = [f"{p.method} ({p.x:.1f} us, {p.y:.0e})" for p in edge]
        sentences.append(f"On the Pareto front: {'; '.join(listed)}.")
    return " ".join(sentences)
