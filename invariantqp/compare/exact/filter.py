"""Exact answers of the damped law, without limits (filter) and with them (box): by eigenvalues, and without them.

             with the eigenvalues of G = J'QJ                            |   without
    filter   V diag(mu / (mu^2 + lambda^2)) V'g                          |   (G^2 + lambda^2) x = G g
    box      H = V diag(sqrt(mu^2 + lambda^2) + w p) V'                  |   H from the square root of G^2 + lambda^2
    lambda   from the eigenvalues of J'QJ                                |   from those of QJJ'

Reference: `invariantqp.velocity.convexify`, `invariantqp.velocity.damping`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mpmath as mp

from invariantqp.compare.exact.box import active_set, least_index, rational_solve
from invariantqp.compare.exact.failure import ReferenceFailure
from invariantqp.compare.exact.linear import Numbers, Way, form_matrix, fraction, matrix, number, stationary
from invariantqp.compare.laws.invariant import FIXED_DAMPING
from invariantqp.compare.method import Question, Setting
from invariantqp.velocity.convexify import NULL_WEIGHT
from invariantqp.velocity.damping import DEFAULT_CEILING, DEFAULT_THRESHOLD

# The iteration for a matrix square root stops at this relative error of the square, and fails after this many steps.
ROOT_ACCURACY = 1e-40
ROOT_STEPS = 60


class _Gram(NamedTuple):
    """G = J'QJ, g = J'Qs, lambda and the largest |mu|, in 50 digits."""

    G: Any
    g: Any
    damping: Any
    largest: Any


def _adaptive(smallest: Any, largest: Any) -> Any:
    """lambda of `velocity.damping.Adaptive` for the smallest and the largest |mu|."""
    ratio = smallest / (largest * mp.mpf(DEFAULT_THRESHOLD))
    return mp.mpf(0) if ratio >= 1 else mp.mpf(DEFAULT_CEILING) * largest * (1 - ratio * ratio)


def _gram(problem: str, question: Question, setting: Setting, mu: list[Any] | None = None) -> _Gram:
    """The Gram matrix and its damping, from the eigenvalues mu of G if they are given, else from those of QJJ'."""
    J, s, Q = matrix(question.J), mp.matrix(question.s.tolist()), matrix(form_matrix(problem, setting))
    G, g = J.T * Q * J, J.T * Q * s
    if mu is None:
        mu = [abs(v) for v in mp.eig(Q * J * J.T, left=False, right=False)]
    sizes = sorted((abs(v) for v in mu), reverse=True)[: min(setting.m, 6)]
    damping = mp.mpf(FIXED_DAMPING) if problem == "filter" else _adaptive(sizes[-1], sizes[0])
    return _Gram(G, g, damping, sizes[0])


class _Spectrum(NamedTuple):
    """G = V diag(mu) V', the optimum V'x without limits, and the indices of the null space of J."""

    mu: Any
    V: Any
    optimum: list[Any]
    gram: _Gram
    null: list[int]


def _spectrum(problem: str, question: Question, setting: Setting) -> _Spectrum:
    J, Q = matrix(question.J), matrix(form_matrix(problem, setting))
    mu, V = mp.eigsy(J.T * Q * J)
    gram = _gram(problem, question, setting, list(mu))
    null = sorted(range(setting.m), key=lambda i: abs(mu[i]))[: max(0, setting.m - 6)]
    seen = V.T * gram.g
    squared = gram.damping**2
    optimum = [mp.mpf(0) if i in null else mu[i] / (mu[i] ** 2 + squared) * seen[i] for i in range(setting.m)]
    return _Spectrum(mu, V, optimum, gram, null)


def filtered(problem: str) -> tuple[Way, Way]:
    """The two ways to the filtered stationary point, while no limit is active."""
    undamped = stationary("inertia" if problem == "inertia" else "pitch")

    def first(question: Question, setting: Setting) -> Numbers:
        spectrum = _spectrum(problem, question, setting)
        return spectrum.V * mp.matrix(spectrum.optimum)

    def second(question: Question, setting: Setting) -> Numbers:
        G, g, damping, _ = _gram(problem, question, setting)
        if damping == 0:
            return undamped[1](question, setting)
        squared = fraction(damping) ** 2
        A = [[fraction(v) for v in row] for row in (G * G).tolist()]
        for i, row in enumerate(A):
            row[i] += squared
        return rational_solve(A, [fraction(v) for v in G * g])

    return first, second


def _root(A: Any) -> Any:
    """The square root of a positive-definite matrix by Denman and Beavers' scaled iteration, without eigenvalues."""
    n = A.rows
    X, Y = A.copy(), mp.eye(n)
    for _ in range(ROOT_STEPS):
        scale = (abs(mp.det(X)) * abs(mp.det(Y))) ** (mp.mpf(-1) / (2 * n))
        X, Y = (scale * X + mp.inverse(scale * Y)) / 2, (scale * Y + mp.inverse(scale * X)) / 2
        if mp.mnorm(X * X - A, "f") < ROOT_ACCURACY * mp.mnorm(A, "f"):
            return X
    raise ReferenceFailure("the iteration for the matrix square root did not converge")


def filtered_box(problem: str) -> tuple[Way, Way]:
    """The two ways to the solution of the law's convex QP inside the bounds."""
    optimum = filtered("inertia" if problem.startswith("inertia") else "adaptive")

    def first(question: Question, setting: Setting) -> Numbers:
        mu, V, z, gram, null = _spectrum(problem, question, setting)
        squared = gram.damping**2
        left = [mp.mpf(1) if i in null else squared / (mu[i] ** 2 + squared) for i in range(setting.m)]
        weight = [
            mp.sqrt((0 if i in null else mu[i] ** 2) + squared) + mp.mpf(NULL_WEIGHT) * gram.largest * left[i]
            for i in range(setting.m)
        ]
        H = V * mp.diag(weight) * V.T
        return active_set(H, H * (V * mp.matrix(z)), question.lower.tolist(), question.upper.tolist())

    def second(question: Question, setting: Setting) -> Numbers:
        G, _, damping, largest = _gram(problem, question, setting)
        squared, one = damping**2, mp.eye(setting.m)
        if damping > 0:
            A = G * G + squared * one
            left = squared * A**-1
            root = _root(A)
        else:
            J = matrix(question.J)
            left = one - J.T * mp.inverse(J * J.T) * J if setting.m > 6 else mp.zeros(setting.m)
            root = _root(G * G + largest**2 * left) - largest * left
        H = root + mp.mpf(NULL_WEIGHT) * largest * left
        z = mp.matrix([number(v) for v in optimum[1](question, setting)])
        c = [fraction(v) for v in H * z]
        exact = [[fraction(v) for v in row] for row in H.tolist()]
        return least_index(exact, c, question.lower.tolist(), question.upper.tolist())

    return first, second
