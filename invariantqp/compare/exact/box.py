"""Box QPs solved exactly, twice: minimise 1/2 x'Hx - c'x over lower <= x <= upper, H positive definite.

    active_set       a primal active set in 50 digits; its answer is certified by the optimality conditions
    least_index      principal pivoting by Murty's least-index rule, in rational numbers: no rounding at all

They share neither an algorithm nor an arithmetic.

Reference: Nocedal & Wright 2006, Algorithm 16.3; Murty 1974 (least-index pivoting), Judice & Pires 1992 (with bounds).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import mpmath as mp

from invariantqp.compare.sweep import NoReference, ReferenceFailure

# Multipliers and steps below this are zero in 50 digits.
EXACT_ZERO = mp.mpf("1e-38")
# Pivots after which something is wrong: 3^7 active sets exist, a dozen are visited.
MOST_PIVOTS = 5000

Numbers = Sequence[Any]
Rows = Sequence[Sequence[Any]]


def active_set(H: Any, c: Any, lower: Numbers, upper: Numbers) -> Any:
    """The (m, 1) mpmath minimiser by a primal active set from the clipped centre.

    Raises:
        ReferenceFailure: the optimality conditions do not certify it.
    """
    m = len(lower)
    low, high = [mp.mpf(v) for v in lower], [mp.mpf(v) for v in upper]
    x = mp.matrix([min(max(mp.mpf(0), a), b) for a, b in zip(low, high, strict=True)])
    fixed: dict[int, int] = {}  # joint to side
    for _ in range(MOST_PIVOTS):
        free = [i for i in range(m) if i not in fixed]
        slope = c - H * x
        step = mp.zeros(m, 1)
        if free:
            solved = mp.lu_solve(
                mp.matrix([[H[i, j] for j in free] for i in free]), mp.matrix([slope[i] for i in free])
            )
            for k, i in enumerate(free):
                step[i] = solved[k]
        length, blocking = mp.mpf(1), -1
        for i in free:
            room = (high[i] if step[i] > 0 else low[i]) - x[i]
            if abs(step[i]) > EXACT_ZERO and room / step[i] < length:
                length, blocking = room / step[i], i
        x += length * step
        if blocking >= 0:
            fixed[blocking] = 1 if step[blocking] > 0 else -1
            x[blocking] = high[blocking] if fixed[blocking] > 0 else low[blocking]
            continue
        slope = c - H * x
        wrong = {i: slope[i] * side for i, side in fixed.items() if slope[i] * side < -EXACT_ZERO}
        if not wrong:
            _certify(H, c, low, high, x)
            return x
        del fixed[min(wrong, key=lambda i: wrong[i])]
    raise ReferenceFailure("the active set did not come to an end")


def _certify(H: Any, c: Any, low: Numbers, high: Numbers, x: Any) -> None:
    """The optimality conditions: inside, and no slope but against a bound."""
    slope = c - H * x
    size = max(abs(v) for v in c) + EXACT_ZERO
    for i, (a, b) in enumerate(zip(low, high, strict=True)):
        inside = a <= x[i] <= b
        push = slope[i] / size
        optimal = abs(push) < mp.mpf("1e-30") or (push > 0 and x[i] == b) or (push < 0 and x[i] == a)
        if not (inside and optimal):
            raise ReferenceFailure(f"joint {i}: x = {mp.nstr(x[i])}, slope {mp.nstr(slope[i])} is not optimal")


def least_index(H: Rows, c: Numbers, lower: Numbers, upper: Numbers) -> list[Fraction]:
    """The minimiser in rational numbers: the first joint that is wrong changes its place, until none is.

    A free joint outside its bounds goes to the bound; a joint at a bound whose slope points inwards becomes free.
    """
    m = len(lower)
    low, high = [Fraction(v) for v in lower], [Fraction(v) for v in upper]
    side = [0] * m
    for _ in range(MOST_PIVOTS):
        free = [i for i in range(m) if side[i] == 0]
        x = [high[i] if side[i] > 0 else low[i] for i in range(m)]
        for i in free:
            x[i] = Fraction(0)
        rhs = [c[i] - sum((H[i][j] * x[j] for j in range(m)), Fraction(0)) for i in range(m)]
        for i, value in zip(
            free, rational_solve([[H[i][j] for j in free] for i in free], [rhs[i] for i in free]), strict=True
        ):
            x[i] = value
        for i in range(m):
            slope = c[i] - sum((H[i][j] * x[j] for j in range(m)), Fraction(0))
            if side[i] == 0 and x[i] > high[i]:
                side[i] = 1
            elif side[i] == 0 and x[i] < low[i]:
                side[i] = -1
            elif side[i] * slope < 0:
                side[i] = 0
            else:
                continue
            break
        else:
            return x
    raise ReferenceFailure("least-index pivoting did not come to an end")


def rational_solve(A: Rows, b: Numbers) -> list[Fraction]:
    """A^-1 b by elimination in rational numbers."""
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
        x[k] = (rows[k][n] - sum((rows[k][j] * x[j] for j in range(k + 1, n)), Fraction(0))) / rows[k][k]
    return x
