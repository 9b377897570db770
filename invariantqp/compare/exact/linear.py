"""Exact answers of linear methods, in 50 digits by one formula and in rational numbers by another.

shortest     (J'J)^-1 J's, or J'(JJ')^-1 s for m >= 6    |   [[I, J], [J', 0]] or [[I, J'], [J, 0]], eliminated
ridge        J'(JJ' + lambda^2 I)^-1 s                   |   (J'J + lambda^2 I) x = J's
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import mpmath as mp

from invariantqp.compare.exact.box import active_set, least_index, rational_solve
from invariantqp.compare.method import Question, Setting
from invariantqp.geometry.arrays import Array

# The m numbers of an answer, of mpmath or rational; and one way to compute them.
Numbers = Any
Way = Callable[[Question, Setting], Numbers]


def number(x: Any) -> Any:
    """A rational or mpmath number as a number of mpmath."""
    return mp.mpf(x.numerator) / x.denominator if isinstance(x, Fraction) else mp.mpf(x)


def fraction(x: Any) -> Fraction:
    """The rational number that is exactly x."""
    if isinstance(x, mp.mpf):
        sign, mantissa, exponent, _ = x._mpf_
        value = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
        return -value if sign else value
    return Fraction(float(x))


def matrix(A: Array) -> Any:
    """A float64 matrix as a matrix of mpmath, without rounding."""
    return mp.matrix(A.tolist())


def _rational(A: Array) -> list[list[Fraction]]:
    return [[Fraction(v) for v in row] for row in A.tolist()]


def _eye(n: int, scale: Fraction = Fraction(1)) -> list[list[Fraction]]:
    return [[scale if i == j else Fraction(0) for j in range(n)] for i in range(n)]


def _augmented(metric_inverse: list[list[Fraction]], J: list[list[Fraction]], rhs: list[Fraction]) -> list[Fraction]:
    """[[M^-1, J], [J', 0]] [y; x] = [rhs; 0], for x."""
    n, m = len(J), len(J[0])
    rows = [[*metric_inverse[i], *J[i]] for i in range(n)]
    rows += [[*(J[i][j] for i in range(n)), *[Fraction(0)] * m] for j in range(m)]
    return rational_solve(rows, [*rhs, *[Fraction(0)] * m])[n:]


def _shortest(J: list[list[Fraction]], s: list[Fraction]) -> list[Fraction]:
    """The shortest x with Jx = s, from [[I, J'], [J, 0]] [x; y] = [0; s]."""
    m = len(J[0])
    rows = [[*row, *(J[k][i] for k in range(6))] for i, row in enumerate(_eye(m))]
    rows += [[*J[k], *[Fraction(0)] * 6] for k in range(6)]
    return rational_solve(rows, [*[Fraction(0)] * m, *s])[:m]


def shortest() -> tuple[Way, Way]:
    """The two ways to the least-squares velocity, the shortest one for more than six joints."""

    def first(question: Question, setting: Setting) -> Numbers:
        J, s = matrix(question.J), mp.matrix(question.s.tolist())
        if setting.m >= 6:
            return J.T * mp.lu_solve(J * J.T, s)
        return mp.lu_solve(J.T * J, J.T * s)

    def second(question: Question, setting: Setting) -> Numbers:
        J, s = _rational(question.J), [Fraction(v) for v in question.s.tolist()]
        return _shortest(J, s) if setting.m >= 6 else _augmented(_eye(6), J, s)

    return first, second


def ridge(squared: float) -> tuple[Way, Way]:
    """The two ways to the minimum of |s - Jx|^2 + lambda^2 |x|^2."""

    def first(question: Question, _: Setting) -> Numbers:
        J, s = matrix(question.J), mp.matrix(question.s.tolist())
        return J.T * mp.lu_solve(J * J.T + mp.mpf(squared) * mp.eye(6), s)

    def second(question: Question, _: Setting) -> Numbers:
        H, c = _least_squares_qp(question, squared)
        return rational_solve(H, c)

    return first, second


def _least_squares_qp(question: Question, squared: float) -> tuple[list[list[Fraction]], list[Fraction]]:
    J, s = _rational(question.J), [Fraction(v) for v in question.s.tolist()]
    m = len(J[0])
    H = [
        [sum((row[i] * row[j] for row in J), Fraction(squared if i == j else 0.0)) for j in range(m)] for i in range(m)
    ]
    return H, [sum((row[i] * v for row, v in zip(J, s, strict=True)), Fraction(0)) for i in range(m)]


def ridge_box(squared: float) -> tuple[Way, Way]:
    """The two ways to the same minimum inside the bounds."""

    def first(question: Question, setting: Setting) -> Numbers:
        J, s = matrix(question.J), mp.matrix(question.s.tolist())
        H = J.T * J + mp.mpf(squared) * mp.eye(setting.m)
        return active_set(H, J.T * s, question.lower.tolist(), question.upper.tolist())

    def second(question: Question, _: Setting) -> Numbers:
        return least_index(*_least_squares_qp(question, squared), question.lower.tolist(), question.upper.tolist())

    return first, second
