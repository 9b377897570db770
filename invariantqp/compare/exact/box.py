"""Box QPs solved exactly in two ways: minimise 1/2 x'Hx - c'x over lower <= x <= upper, with H positive definite.

    active_set       a primal active-set method in 50 digits; the optimality conditions certify its answer
    least_index      principal pivoting by Murty's least-index rule in rational numbers, without any rounding

The two share neither the algorithm nor the arithmetic.

Reference: Nocedal & Wright 2006, Algorithm 16.3; Murty 1974 (least-index pivoting), Judice & Pires 1992 (with bounds).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import mpmath as mp

from invariantqp.compare.exact import NoReference, ReferenceFailure

# Multipliers and steps below this are zero: they are rounding errors of a computation in 50 digits.
EXACT_ZERO = mp.mpf("1e-38")
# The slope of a free joint, relative to the largest entry of c, up to which the answer is certified as optimal.
FLAT = mp.mpf("1e-30")
# Seven joints have 3^7 = 2187 active sets and about a dozen are visited: after this many the method does not terminate.
MOST_PIVOTS = 5000

Numbers = Sequence[Any]
Rows = Sequence[Sequence[Any]]


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


def least_index(H: Rows, c: Numbers, lower: Numbers, upper: Numbers) -> list[Fraction]:
    """The minimiser in rational numbers: the first joint in the wrong place changes it, until every joint is right.

    A free joint outside its bounds moves to the bound; a joint at a bound whose slope points inwards becomes free.

    Raises:
        ReferenceFailure: the pivoting does not terminate.
    """
    low, high = [Fraction(v) for v in lower], [Fraction(v) for v in upper]
    side = [0] * len(low)  # 0 free, 1 at the upper bound, -1 at the lower
    for _ in range(MOST_PIVOTS):
        x = _minimum(H, c, [high[i] if s > 0 else low[i] if s < 0 else None for i, s in enumerate(side)])
        wrong = _first_wrong(H, c, x, low, high, side)
        if wrong is None:
            return x
        side[wrong[0]] = wrong[1]
    raise ReferenceFailure("least-index pivoting did not terminate")


def _minimum(H: Rows, c: Numbers, held: Sequence[Fraction | None]) -> list[Fraction]:
    """The minimum over the free joints, those whose held value is None, with the other joints at their values."""
    free = [i for i, value in enumerate(held) if value is None]
    x = [Fraction(0) if value is None else value for value in held]
    rhs = [c[i] - _product(H[i], x) for i in free]
    for i, value in zip(free, rational_solve([[H[i][j] for j in free] for i in free], rhs), strict=True):
        x[i] = value
    return x


def _product(row: Numbers, x: Numbers) -> Fraction:
    return sum((a * b for a, b in zip(row, x, strict=True)), Fraction(0))


def _first_wrong(
    H: Rows, c: Numbers, x: Numbers, low: Numbers, high: Numbers, side: Sequence[int]
) -> tuple[int, int] | None:
    """The first joint that is in the wrong place, and the right one: free (0), or at a bound (1, -1)."""
    for i, here in enumerate(side):
        if here == 0:
            there = 1 if x[i] > high[i] else -1 if x[i] < low[i] else 0
        else:
            there = 0 if here * (c[i] - _product(H[i], x)) < 0 else here
        if there != here:
            return i, there
    return None


def rational_solve(A: Rows, b: Numbers) -> list[Fraction]:
    """A^-1 b by Gaussian elimination in rational numbers.

    Raises:
        NoReference: A is singular.
    """
    n = len(b)
    rows = [[*map(Fraction, row), Fraction(v)] for row, v in zip(A, b, strict=True)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k] != 0), None)
        if pivot is None:
            raise NoReference("a singular system has no unique exact answer")
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(k + 1, n):
            if rows[i][k] != 0:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [a - factor * p for a, p in zip(rows[i], rows[k], strict=True)]
    x = [Fraction(0)] * n
    for k in reversed(range(n)):
        x[k] = (rows[k][n] - _product(rows[k][k + 1 : n], x[k + 1 :])) / rows[k][k]
    return x
