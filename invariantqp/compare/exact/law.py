"""Exact answers of the law that ships, inside the limits: by eigenvalues, and without them.

    minimise |A x - b|^2 + x'L^2 x + mu |x|^2,    A = root J,  b = root s,  L^2 from S = A'A
    mu from the residual of the answer for mu = 0 (`velocity.calm`)

                with eigenvalues                               |   without
    L^2         V diag(c^2 e max(0, 1 - e_i / (t^2 e))^2) V'   |   c^2 e ((X + |X|) / 2)^2,  X = 1 - S / (t^2 e)
    box         active-set method in 50 digits                 |   least-index pivoting in rational numbers

e_i are the eigenvalues of S, e the largest; |X| = X sign(X), sign(X) by Newton's iteration.

Reference: `velocity.damping.Adaptive`, `velocity.objective`.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp

from invariantqp.compare.exact import ReferenceFailure
from invariantqp.compare.exact.box import active_set, least_index
from invariantqp.compare.exact.linear import Numbers, Way, fraction, matrix, number
from invariantqp.compare.method import Question, Setting
from invariantqp.velocity.calm import CALM, DEVIATION_SHARE, QUIET_SHARE
from invariantqp.velocity.damping import DEFAULT_CEILING, DEFAULT_THRESHOLD
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.objective import NULL_RATIO

# The matrix iteration stops at this relative error of the square, and fails after this many steps.
ROOT_ACCURACY = 1e-40
ROOT_STEPS = 100


def shipped() -> tuple[Way, Way]:
    """The two ways."""

    def first(question: Question, setting: Setting) -> Numbers:
        A, b = _measured(question, setting)
        e, V = mp.eigsy(A.T * A)
        largest = max(e)
        H = V * mp.diag([v + w for v, w in zip(e, _squares(list(e), largest), strict=True)]) * V.T
        x = active_set(H, A.T * b, question.lower.tolist(), question.upper.tolist())
        seen = V.T * x
        moving = [v for v, size in zip(seen, e, strict=True) if size > (NULL_RATIO**2) * largest]
        H += _calm(A, b, x, mp.norm(moving), setting.dt) * mp.eye(setting.m)
        return active_set(H, A.T * b, question.lower.tolist(), question.upper.tolist())

    def second(question: Question, setting: Setting) -> Numbers:
        A, b = _measured(question, setting)
        S, c = A.T * A, A.T * b
        H = S + _left(S, max(mp.eigsy(A * A.T, eigvals_only=True)))
        found = mp.matrix([number(v) for v in _by_pivots(H, c, question)])
        moving = found if setting.m <= 6 else A.T * mp.lu_solve(A * A.T, A * found)
        H += _calm(A, b, found, mp.norm(moving), setting.dt) * mp.eye(setting.m)
        return _by_pivots(H, c, question)

    return first, second


def _measured(question: Question, setting: Setting) -> tuple[Any, Any]:
    """A and b."""
    W = matrix(root_at(setting.point, setting.length))
    return W * matrix(question.J), W * mp.matrix(question.s.tolist())


def _squares(e: list[Any], largest: Any) -> list[Any]:
    """lambda_i^2 for eigenvalues of S."""
    threshold = mp.mpf(DEFAULT_THRESHOLD) ** 2 * largest
    return [mp.mpf(DEFAULT_CEILING) ** 2 * largest * max(mp.mpf(0), 1 - v / threshold) ** 2 for v in e]


def _left(S: Any, largest: Any) -> Any:
    """L^2 without eigenvectors."""
    X = mp.eye(S.rows) - S / (mp.mpf(DEFAULT_THRESHOLD) ** 2 * largest)
    positive = (X + X * _sign(X)) / 2
    return mp.mpf(DEFAULT_CEILING) ** 2 * largest * positive * positive


def _calm(A: Any, b: Any, x: Any, speed: Any, dt: float) -> Any:
    """mu for an answer x."""
    size = mp.mnorm(A, "f")
    step = mp.mpf(dt)
    excess = max(mp.mpf(0), mp.mpf(DEVIATION_SHARE) * step * size * speed * speed - mp.norm(b))
    mu = mp.mpf(CALM) * step * (mp.norm(b - A * x) + excess) * size / 2
    return max(mp.mpf(0), mu - mp.mpf(QUIET_SHARE) * size * size)


def _sign(X: Any) -> Any:
    """The sign of a symmetric matrix by Newton's scaled iteration."""
    for _ in range(ROOT_STEPS):
        scale = abs(mp.det(X)) ** (mp.mpf(-1) / X.rows)
        X = (scale * X + mp.inverse(scale * X)) / 2
        if mp.mnorm(X * X - mp.eye(X.rows), "f") < ROOT_ACCURACY:
            return X
    raise ReferenceFailure("the iteration for the matrix sign did not converge")


def _by_pivots(H: Any, c: Any, question: Question) -> Numbers:
    return least_index(_fractions(H), [fraction(v) for v in c], question.lower.tolist(), question.upper.tolist())


def _fractions(A: Any) -> list[list[Any]]:
    return [[fraction(v) for v in row] for row in A.tolist()]
