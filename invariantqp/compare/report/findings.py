"""What the results say, in sentences: who is fastest, who is most accurate, where Moore-Penrose wins and where not.

Each sentence is a comparison of figures in the results; one that its figures do not allow is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from invariantqp.compare.laws.invariant import OURS
from invariantqp.compare.report.tables import across
from invariantqp.compare.results import Results, picked

MP, LU = "Moore-Penrose, pinv", "Moore-Penrose, LU"
UNGUARDED, GRAM, FACTORED = "invariantqp, no guard", "h, Gram + LDL'", "h, factored"
# A figure this many times another is worth a sentence; less is noise.
APART = 1.05
# A relative error that no robot can tell from none.
EXACT = 1e-6
PLACES = {"free": "Where no limit is met", "limited": "Where limits are met", "singular": "Near singularities"}


def findings(results: Results) -> list[str]:
    """The sentences that the results allow."""
    makers: tuple[Callable[[Results], list[str]], ...] = (_speed, _accuracy, residual, _clipping, _batch)
    return [sentence for make in makers for sentence in make(results)]


def _names(results: Results) -> list[str]:
    return [m["name"] for m in results["methods"]]


def _exact(results: Results, sort: str) -> list[str]:
    """The methods whose median error is rounding."""
    errors = {name: across(results, "error", name, sort, "error") for name in _names(results)}
    return [name for name, error in errors.items() if error is not None and error <= EXACT]


def _least(results: Results, kind: str, *path: str, among: Sequence[str] | None = None) -> tuple[str, float] | None:
    """The method with the smallest figure, and the figure."""
    names = _names(results) if among is None else among
    found = {name: across(results, kind, name, *path) for name in names}
    have = {name: value for name, value in found.items() if value is not None}
    if not have:
        return None
    best = min(have, key=lambda name: have[name])
    return best, have[best]


def _speed(results: Results) -> list[str]:
    said = []
    for sort, where in PLACES.items():
        fastest, ours = _least(results, "time", sort, "median_us"), across(results, "time", OURS, sort, "median_us")
        plain = across(results, "time", LU, sort, "median_us")
        if fastest is None or ours is None:
            continue
        text = f"{where} the fastest solve is {fastest[0]} ({fastest[1]:.1f} us)"
        if plain is not None and fastest[0] != LU:
            text += f", Moore-Penrose by plain LU takes {plain:.1f} us"
        exact = _least(results, "time", sort, "median_us", among=_exact(results, sort))
        if exact is not None and exact[0] != fastest[0]:
            text += f", the fastest within {EXACT:.0e} of its exact answer is {exact[0]} ({exact[1]:.1f} us)"
        said.append(f"{text}; {OURS} takes {ours:.1f} us.")
    return said


def _accuracy(results: Results) -> list[str]:
    said = []
    for sort in ("free", "singular"):
        figures = {name: across(results, "error", name, sort, "error") for name in (FACTORED, GRAM, MP, LU, UNGUARDED)}
        have = [f"{name} {value:.0e}" for name, value in figures.items() if value is not None]
        if len(have) > 1:
            said.append(f"{PLACES[sort]} the median error against the exact answer is: {'; '.join(have)}.")
    return said


def residual(results: Results) -> list[str]:
    """The Euclidean residual in the tool's own frame: what Moore-Penrose minimises."""
    said = []
    errors = picked(results, "error")
    for task in results["tasks"]:
        ours, theirs = (errors.get((task, name), {}).get("free", {}).get("missed") for name in (UNGUARDED, MP))
        if ours is None or theirs is None or max(ours, theirs) < 1e-6:
            continue  # both meet the twist
        better, worse = (MP, "the pitch form") if theirs < ours else ("the pitch form", MP)
        low, high = sorted((ours, theirs))
        if high > APART * low:
            said.append(
                f"On the arm of {task}, which cannot meet every twist, {better} leaves less of it in the tool's frame: "
                f"{low:.2f} of its size against {high:.2f} for {worse}."
            )
    return said


def _clipping(results: Results) -> list[str]:
    clipped = across(results, "error", MP, "limited", "error")
    inside = across(results, "error", UNGUARDED, "limited", "error")
    if clipped is None or inside is None:
        return []
    verb = "is" if clipped > inside else "is no more than"
    theirs = f"Moore-Penrose clipped {verb} {clipped:.0%} off the exact limited least squares"
    return [f"Where limits are met, {theirs}; {UNGUARDED} is {inside:.0e} off the optimum of its own limited problem."]


def _batch(results: Results) -> list[str]:
    table = {name: r for (axis, name), r in picked(results, "growth").items() if axis == "batch"}
    together, loop = table.get(f"{OURS}, solve_velocities"), table.get(f"{OURS}, in a loop")
    if together is None or loop is None:
        return []
    a, b = together["median_us"][-1], loop["median_us"][-1]
    return [f"In a batch of {together['size'][-1]} solve_velocities takes {a:.1f} us a row, a loop {b:.1f}."]
