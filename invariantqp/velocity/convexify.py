"""From a saddle to a convex problem with the same answer: the spectrum of G, filtered, and the QP it is optimal for.

    G = V diag(mu) V',   z* = V (mu / (mu^2 + lambda^2) V'g + lambda^2 / (mu^2 + lambda^2) V'z_p)
    minimise 1/2 (z - z*)'H (z - z*),   H = V diag(sqrt(mu^2 + lambda^2) + w p) V'

G has both signs for every arm of rank 4 or more, so no convex solver may see it. H is positive definite with about the
condition of G and has z* as its unconstrained optimum, so the law is continuous as bounds come and go. What the
filter leaves of a direction, p = lambda^2 / (mu^2 + lambda^2), goes to the posture z_p; a redundant arm's null space is
left to it whole.

Reference: [DS] Sect. 6.2 with Lambda = lambda^2 G^-1; H is the fundamental-symmetry majorant of Krein-space theory.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import SINGULAR_RATIO, Damping, Selective

# What a null direction costs in the QP, relative to max|mu|: small beside any direction the task needs (those are
# damped below 1e-4), so that a limit is paid for in the null space first; large enough to keep H well inside float64.
NULL_WEIGHT = 1e-6


class Convexified(NamedTuple):
    """The spectrum of G and the filtered optimum in its coordinates.

    Attributes:
        mu: (n,) eigenvalues.
        V: (n, n) eigenvectors.
        null: indices of the directions that the twist cannot determine, left to the posture.
        optimum: (n,) V'z*, the unconstrained optimum in eigenvector coordinates.
        squared: lambda^2 [unit of G squared]; (n,) where each direction has its own.
        smallest: the smallest |mu| outside `null`, 0 where there is none.
        largest: max|mu|, 0 where G is rounding.
    """

    mu: Array
    V: Array
    null: list[int]
    optimum: Array
    squared: float | Array
    smallest: float
    largest: float

    @property
    def damping(self) -> float:
        """The largest lambda in use [unit of G]; 0 where nothing is damped."""
        return sqrt(self.squared) if isinstance(self.squared, float) else sqrt(float(self.squared.max()))

    def solution(self) -> Array:
        """The unconstrained optimum z*."""
        z: Array = self.V.dot(self.optimum)
        return z

    def given_up(self) -> Array:
        """(n,) p, the fraction of each direction left to the posture; without damping 1 on `null` and 0 elsewhere."""
        return _left_over(self.mu, self.squared, self.null)

    def qp(self, null_weight: float = NULL_WEIGHT) -> tuple[Array, Array]:
        """H (n, n) positive definite and c (n,), of minimise 1/2 z'Hz - c'z; w = null_weight max|mu|."""
        weight = np.sqrt(self.mu * self.mu + self.squared) + null_weight * (self.largest or 1.0) * self.given_up()
        return (self.V * weight).dot(self.V.T), self.V.dot(weight * self.optimum)


def _left_over(mu: Array, squared: float | Array, null: list[int]) -> Array:
    divisor = mu * mu + squared
    divisor[divisor == 0.0] = 1.0  # undamped null directions, which are set below
    p: Array = squared / divisor
    p[null] = 1.0
    return p


def convexify(
    G: Array, g: Array, rank: int, damping: Damping, posture: Array | None, noise: float = 0.0
) -> Convexified:
    """Filter the spectrum of G.

    Args:
        G: (n, n) symmetric, of any signature.
        g: (n,).
        rank: how many directions the twist can determine at all; the n - rank smallest |mu| are the null space.
        damping: the policy.
        posture: (n,) z_p, the velocity wanted where the task leaves one free; None is zero.
        noise: the size below which all of G is rounding.
    """
    if not len(g):  # exact rows leave nothing free
        return Convexified(np.empty(0), np.empty((0, 0)), [], np.empty(0), 0.0, 0.0, 0.0)
    mu, V, info = lapack.dsyev(G)
    if info != 0:
        raise np.linalg.LinAlgError(f"dsyev returned {info}")
    magnitude = [abs(x) for x in mu.tolist()]
    order = sorted(range(len(magnitude)), key=magnitude.__getitem__)
    largest = magnitude[order[-1]]
    if largest <= noise:
        largest, rank = 0.0, 0
    null = order[: len(order) - rank]
    smallest = magnitude[order[-rank]] if rank else 0.0
    optimum = g.dot(V)
    squared: float | Array = 0.0
    if isinstance(damping, Selective):
        squared = damping.squares(mu, optimum, largest) if rank else 0.0
    elif rank:
        squared = damping(smallest, largest) ** 2
    if isinstance(squared, float) and squared == 0.0:
        for i in null:
            mu[i] = inf  # nothing to divide by: the posture takes these over
        optimum /= mu
        for i in null:
            mu[i] = 0.0
            optimum[i] = 0.0 if posture is None else posture.dot(V[:, i])
        return Convexified(mu, V, null, optimum, squared, smallest, largest)
    divisor = mu * mu + squared
    divisor[null] = 1.0
    optimum *= mu / divisor
    optimum[null] = 0.0
    if posture is not None:
        optimum += _left_over(mu, squared, null) * posture.dot(V)
    return Convexified(mu, V, null, optimum, squared, smallest, largest)


def is_singular(problem: Convexified) -> bool:
    """Whether the smallest |mu| is rounding: the form sees nothing of some direction that may move."""
    return problem.smallest <= SINGULAR_RATIO * problem.largest
