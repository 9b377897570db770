"""Exact answers of linear methods, in 50 digits.

shortest     (J'J)^-1 J's, or J'(JJ')^-1 s for m >= 6
ridge        J'(JJ' + lambda^2 I)^-1 s
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mpmath as mp

from invariantqp.compare.exact.box import active_set
from invariantqp.compare.method import Question, Setting
from invariantqp.geometry.arrays import Array

# The m numbers of an answer, of mpmath; and a way to compute them.
Numbers = Any
Way = Callable[[Question, Setting], Numbers]


def matrix(A: Array) -> Any:
    """A float64 matrix as a matrix of mpmath, without rounding."""
    return mp.matrix(A.tolist())


def shortest(question: Question, setting: Setting) -> Numbers:
    """The least-squares velocity, the shortest one for more than six joints."""
    J, s = matrix(question.J), mp.matrix(question.s.tolist())
    if setting.m >= 6:
        return J.T * mp.lu_solve(J * J.T, s)
    return mp.lu_solve(J.T * J, J.T * s)


def ridge(squared: float) -> Way:
    """The minimum of |s - Jx|^2 + lambda^2 |x|^2."""

    def way(question: Question, _: Setting) -> Numbers:
        J, s = matrix(question.J), mp.matrix(question.s.tolist())
        return J.T * mp.lu_solve(J * J.T + mp.mpf(squared) * mp.eye(6), s)

    return way


def ridge_box(squared: float) -> Way:
    """The same minimum inside the bounds."""

    def way(question: Question, setting: Setting) -> Numbers:
        J, s = matrix(question.J), mp.matrix(question.s.tolist())
        H = J.T * J + mp.mpf(squared) * mp.eye(setting.m)
        return active_set(H, J.T * s, question.lower.tolist(), question.upper.tolist())

    return way
