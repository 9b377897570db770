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


def _saddle(B: list[list[Fraction]], top: list[Fraction], bottom: list[Fraction]) -> list[Fraction]:
    """(y; x) of [[I, B], [B', 0]] (y; x) = (top; bottom)."""
    zero, one, n = Fraction(0), Fraction(1), len(B)
    rows = [[*(one if i == j else zero for j in range(n)), *row] for i, row in enumerate(B)]
    rows += [[*column, *[zero] * len(bottom)] for column in zip(*B, strict=True)]
    return rational_solve(rows, [*top, *bottom])


def shortest() -> tuple[Way, Way]:
    """The two ways to the least-squares velocity, the shortest one for more than six joints."""

    def first(question: Question, setting: Setting) -> Numbers:
        J, s = matrix(question.J), mp.matrix(question.s.tolist())
        if setting.m >= 6:
            return J.T * mp.lu_solve(J * J.T, s)
        return mp.lu_solve(J.T * J, J.T * s)

    def second(question: Question, setting: Setting) -> Numbers:
        s, none = [Fraction(v) for v in question.s.tolist()], [Fraction(0)] * setting.m
        if setting.m >= 6:
            return _saddle(_rational(question.J.T), none, s)[: setting.m]
        return _saddle(_rational(question.J), s, none)[6:]

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
