"""What the results say in sentences: which method is fastest, which is most accurate, where Moore-Penrose is better.

Each sentence compares figures of the results; a sentence for which the results have no figures is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from invariantqp.compare.names import FACTORED, GRAM, LU, OURS, OURS_PITCH, PINV
from invariantqp.compare.report.tables import across
from invariantqp.compare.results import Results, results_of

# Two residuals are told apart if one is at least this many times the other.
APART = 1.05
# A relative error that makes no difference to a robot.
EXACT = 1e-6
# A relative residual up to this means that the twist was achieved.
ACHIEVED = 1e-6
PLACES = {"free": "While no limit is active", "limited": "While limits are active", "singular": "Near singularities"}


def findings(results: Results) -> list[str]:
    """The sentences for which the results have figures."""
    makers: tuple[Callable[[Results], list[str]], ...] = (_speed, _accuracy, residual, _clipping, _batch)
    return [sentence for make in makers for sentence in make(results)]


def _names(results: Results) -> list[str]:
    return [m["name"] for m in results["methods"]]


def _exact(results: Results, sort: str) -> list[str]:
    """The methods whose median error is negligible."""
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
    sentences = []
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
            text += f", the fastest with an error below {EXACT:.0e} is {exact[0]} ({exact[1]:.1f} us)"
        sentences.append(f"{text}; {OURS} takes {ours:.1f} us.")
    return sentences


def _accuracy(results: Results) -> list[str]:
    sentences = []
    for sort in ("free", "singular"):
        figures = {name: across(results, "error", name, sort, "error") for name in (FACTORED, GRAM, PINV, LU, OURS)}
        have = [f"{name} {value:.0e}" for name, value in figures.items() if value is not None]
        if len(have) > 1:
            sentences.append(f"{PLACES[sort]} the median error against the exact answer is: {'; '.join(have)}.")
    return sentences


def residual(results: Results) -> list[str]:
    """Sentences about the Euclidean residual in the tool frame, which Moore-Penrose minimises."""
    sentences = []
    errors = results_of(results, "error")
    for task in results["tasks"]:
        missed = {name: errors.get((task, name), {}).get("free", {}).get("missed") for name in (PINV, OURS, OURS_PITCH)}
        have = {name: share for name, share in missed.items() if share is not None}
        if len(have) < 2 or max(have.values()) < ACHIEVED or max(have.values()) <= APART * min(have.values()):
            continue
        listed = "; ".join(f"{name} {have[name]:.2f}" for name in sorted(have, key=lambda name: have[name]))
        sentences.append(
            f"The arm of {task} cannot achieve every twist. Left of it in the tool frame, with metres and radians "
            f"alike, is: {listed}."
        )
    return sentences


def _clipping(results: Results) -> list[str]:
    clipped = across(results, "error", PINV, "limited", "error")
    inside = across(results, "error", OURS, "limited", "error")
    if clipped is None or inside is None:
        return []
    text = f"{PLACES['limited']} the error of clipped Moore-Penrose against least squares inside the limits is"
    return [f"{text} {clipped:.0%}; {OURS} has an error of {inside:.0e} against its own problem inside the limits."]


def _batch(results: Results) -> list[str]:
    table = {name: r for (axis, name), r in results_of(results, "growth").items() if axis == "batch"}
    together, loop = table.get(f"{OURS}, solve_velocities"), table.get(f"{OURS}, in a loop")
    if together is None or loop is None:
        return []
    size, a, b = together["size"][-1], together["median_us"][-1], loop["median_us"][-1]
    return [f"For each twist of a batch of {size}, solve_velocities takes {a:.1f} us and a loop {b:.1f} us."]
