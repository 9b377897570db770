"""Exact answers of the laws whose damping follows the spectrum, inside the limits: by eigenvalues, and without them.

    measured      minimise |A x - b|^2 + x'L^2 x,   A = root J,  b = root s,  L^2 from S = A'A
    law           the same with mu |x|^2 added, mu from the residual of the first answer (`velocity.calm`)
    convexified   minimise (x - x*)'H (x - x*),   H^2 = S + L^2,   (S + L^2) x* = G g,   S = G^2,  G = J'QJ,  g = J'Qs
    filter        (G^2 + lambda^2) x = G g

                with eigenvalues                               |   without
    L^2         V diag(c^2 e max(0, 1 - e_i / (t^2 e))^2) V'   |   c^2 e ((X + |X|) / 2)^2,  X = 1 - S / (t^2 e)
    H           V diag(sqrt(mu^2 + lambda^2)) V'               |   Denman and Beavers' iteration
    box         active-set method in 50 digits                 |   least-index pivoting in rational numbers

e_i are the eigenvalues of S, e the largest; |X| = X sign(X), sign(X) by Newton's iteration.

Reference: `velocity.damping.Adaptive`, `velocity.objective`, `velocity.stationary`.
"""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np

from invariantqp.compare.exact.box import active_set, least_index, rational_solve
from invariantqp.compare.exact.failure import NoReference, ReferenceFailure
from invariantqp.compare.exact.linear import Numbers, Way, fraction, matrix, number
from invariantqp.compare.laws.invariant import FIXED_DAMPING
from invariantqp.compare.method import Question, Setting
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.velocity.calm import CALM, DEVIATION_SHARE, QUIET_SHARE
from invariantqp.velocity.damping import DEFAULT_CEILING, DEFAULT_THRESHOLD
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.objective import NULL_RATIO

# Matrix iterations stop at this relative error of the square, and fail after this many steps.
ROOT_ACCURACY = 1e-40
ROOT_STEPS = 100


def measured(*, inertia: bool = False, calmed: bool = False) -> tuple[Way, Way]:
    """The two ways to damped least squares in the limits.

    Args:
        inertia: whether twists are measured by the tool's inertia, and not at the point.
        calmed: whether the damping of `velocity.calm` is included, as in a loop with ticks of `setting.dt`.
    """

    def first(question: Question, setting: Setting) -> Numbers:
        A, b = _measured(question, setting, inertia)
        e, V = mp.eigsy(A.T * A)
        largest = max(e)
        H = V * mp.diag([v + w for v, w in zip(e, _squares(list(e), largest), strict=True)]) * V.T
        x = active_set(H, A.T * b, question.lower.tolist(), question.upper.tolist())
        if not calmed:
            return x
        seen = V.T * x
        moving = [v for v, size in zip(seen, e, strict=True) if size > (NULL_RATIO**2) * largest]
        mu = _calm(A, b, x, mp.norm(moving), setting.dt)
        H += mu * mp.eye(setting.m)
        return active_set(H, A.T * b, question.lower.tolist(), question.upper.tolist())

    def second(question: Question, setting: Setting) -> Numbers:
        A, b = _measured(question, setting, inertia)
        S, c = A.T * A, A.T * b
        H = S + _left(S, max(mp.eigsy(A * A.T, eigvals_only=True)))
        x = _by_pivots(H, c, question)
        if not calmed:
            return x
        found = mp.matrix([number(v) for v in x])
        moving = found if setting.m <= 6 else A.T * mp.lu_solve(A * A.T, A * found)
        H += _calm(A, b, found, mp.norm(moving), setting.dt) * mp.eye(setting.m)
        return _by_pivots(H, c, question)

    return first, second


def convexified() -> tuple[Way, Way]:
    """The two ways to [DS]'s own problem made convex, in the limits."""

    def first(question: Question, setting: Setting) -> Numbers:
        G, g = _gram(question, setting)
        mu, V = mp.eigsy(G)
        e = [v * v for v in mu]
        total = [v + w for v, w in zip(e, _squares(e, max(e)), strict=True)]
        seen = V.T * g
        centre = [mu[i] * seen[i] / total[i] for i in range(setting.m)]
        H = V * mp.diag([mp.sqrt(v) for v in total]) * V.T
        return active_set(H, H * (V * mp.matrix(centre)), question.lower.tolist(), question.upper.tolist())

    def second(question: Question, setting: Setting) -> Numbers:
        G, g = _gram(question, setting)
        J, Q = matrix(question.J), matrix(pitch_form(setting.pitch))
        largest = max(abs(v) for v in mp.eig(Q * J * J.T, left=False, right=False))
        total = G * G + _left(G * G, largest**2)
        H = _square_root(total)
        return _by_pivots(H, H * mp.lu_solve(total, G * g), question)

    return first, second


def filtered() -> tuple[Way, Way]:
    """The two ways to the stationary point with the same damping in every state; without limits."""

    def first(question: Question, setting: Setting) -> Numbers:
        G, g = _gram(question, setting)
        mu, V = mp.eigsy(G)
        seen, squared = V.T * g, mp.mpf(FIXED_DAMPING * setting.unit) ** 2
        return V * mp.matrix([mu[i] / (mu[i] ** 2 + squared) * seen[i] for i in range(setting.m)])

    def second(question: Question, setting: Setting) -> Numbers:
        G, g = _gram(question, setting)
        A = G * G + mp.mpf(FIXED_DAMPING * setting.unit) ** 2 * mp.eye(setting.m)
        return rational_solve(_fractions(A), [fraction(v) for v in G * g])

    return first, second


def _measured(question: Question, setting: Setting, inertia: bool) -> tuple[Any, Any]:
    """A and b.

    Raises:
        NoReference: the arm has slides; the references know no joint metric.
    """
    if setting.joint_metric is not None:
        raise NoReference("an arm with slides beside joints that turn")
    root: Array = np.diag(np.sqrt(setting.inertia)) if inertia else root_at(setting.point, setting.length)
    W = matrix(root)
    return W * matrix(question.J), W * mp.matrix(question.s.tolist())


def _gram(question: Question, setting: Setting) -> tuple[Any, Any]:
    """G and g."""
    J, s, Q = matrix(question.J), mp.matrix(question.s.tolist()), matrix(pitch_form(setting.pitch))
    return J.T * Q * J, J.T * Q * s


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


def _square_root(A: Any) -> Any:
    """The square root of a positive-definite matrix by Denman and Beavers' scaled iteration."""
    n = A.rows
    X, Y = A.copy(), mp.eye(n)
    for _ in range(ROOT_STEPS):
        scale = (abs(mp.det(X)) * abs(mp.det(Y))) ** (mp.mpf(-1) / (2 * n))
        X, Y = (scale * X + mp.inverse(scale * Y)) / 2, (scale * Y + mp.inverse(scale * X)) / 2
        if mp.mnorm(X * X - A, "f") < ROOT_ACCURACY * mp.mnorm(A, "f"):
            return X
    raise ReferenceFailure("the iteration for the matrix square root did not converge")


def _by_pivots(H: Any, c: Any, question: Question) -> Numbers:
    return least_index(_fractions(H), [fraction(v) for v in c], question.lower.tolist(), question.upper.tolist())


def _fractions(A: Any) -> list[list[Any]]:
    return [[fraction(v) for v in row] for row in A.tolist()]
