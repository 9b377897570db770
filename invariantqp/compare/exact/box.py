"""Box QPs solved exactly: minimise 1/2 x'Hx - c'x over lower <= x <= upper, with H positive definite.

A primal active-set method in 50 digits; the optimality conditions certify its answer.

Reference: Nocedal & Wright 2006, Algorithm 16.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath as mp

from invariantqp.compare.exact import ReferenceFailure

# Multipliers and steps below this are zero: they are rounding errors of a computation in 50 digits.
EXACT_ZERO = mp.mpf("1e-38")
# The slope of a free joint, relative to the largest entry of c, up to which the answer is certified as optimal.
FLAT = mp.mpf("1e-30")
# Seven joints have 3^7 = 2187 active sets and about a dozen are visited: after this many the method does not terminate.
MOST_PIVOTS = 5000

Numbers = Sequence[Any]


def active_set(H: Any, c: Any, lower: Numbers, upper: Numbers) -> Any:
    """The (m, 1) minimiser in mpmath's numbers, by a primal active-set method that starts at zero or the bounds.

    Raises:
        ReferenceFailure: the optimality conditions do not hold, or the method does not terminate.
    """
    low, high = [mp.mpf(v) for v in lower], [mp.mpf(v) for v in upper]
    x = mp.matrix([min(max(mp.mpf(0), a), b) for a, b in zip(low, high, strict=True)])
    fixed: dict[int, int] = {}  # joints at a bound: 1 at the upper, -1 at the lower
    for _ in range(MOST_PIVOTS):
        step = _free_step(H, c, x, fixed)
        length, blocking = _longest(step, x, low, high, fixed)
        x += length * step
        if blocking >= 0:
            fixed[blocking] = 1 if step[blocking] > 0 else -1
            x[blocking] = high[blocking] if fixed[blocking] > 0 else low[blocking]
            continue
        leaving = _wrong_sign(c - H * x, fixed)
        if leaving < 0:
            _certify(H, c, low, high, x)
            return x
        del fixed[leaving]
    raise ReferenceFailure("the active-set method did not terminate")


def _free_step(H: Any, c: Any, x: Any, fixed: dict[int, int]) -> Any:
    """The step from x to the minimum over the joints that are not fixed."""
    free = [i for i in range(len(x)) if i not in fixed]
    step = mp.zeros(len(x), 1)
    if free:
        slope = c - H * x
        block = mp.matrix([[H[i, j] for j in free] for i in free])
        solved = mp.lu_solve(block, mp.matrix([slope[i] for i in free]))
        for k, i in enumerate(free):
            step[i] = solved[k]
    return step


def _longest(step: Any, x: Any, low: Numbers, high: Numbers, fixed: dict[int, int]) -> tuple[Any, int]:
    """The part of a step, up to 1, that stays inside the bounds, and the joint that limits it; -1 for none."""
    length, blocking = mp.mpf(1), -1
    for i in range(len(x)):
        if i in fixed or abs(step[i]) <= EXACT_ZERO:
            continue
        room = (high[i] if step[i] > 0 else low[i]) - x[i]
        if room / step[i] < length:
            length, blocking = room / step[i], i
    return length, blocking


def _wrong_sign(slope: Any, fixed: dict[int, int]) -> int:
    """The fixed joint with the most negative multiplier, which has to leave its bound; -1 for none."""
    wrong = {i: slope[i] * side for i, side in fixed.items() if slope[i] * side < -EXACT_ZERO}
    return min(wrong, key=lambda i: wrong[i]) if wrong else -1


def _certify(H: Any, c: Any, low: Numbers, high: Numbers, x: Any) -> None:
    """Check the optimality conditions: x is inside, and a slope that is not zero pushes against a bound."""
    slope = c - H * x
    size = max(abs(v) for v in c) + EXACT_ZERO
    for i, (a, b) in enumerate(zip(low, high, strict=True)):
        push = slope[i] / size
        optimal = abs(push) < FLAT or (push > 0 and x[i] == b) or (push < 0 and x[i] == a)
        if not (a <= x[i] <= b and optimal):
            raise ReferenceFailure(f"joint {i}: x = {mp.nstr(x[i])} with slope {mp.nstr(slope[i])} is not optimal")
