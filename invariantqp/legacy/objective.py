"""What one tick minimises, over the velocities z that exact rows leave free: a convex quadratic known by its root.

    1/2 |A z - b|^2 + 1/2 sum of lambda_i^2 (v_i'(z - z_p))^2  =  1/2 |K (z - z*)|^2 + constant
    A = U diag(sigma) V',   K = diag(sqrt(sigma^2 + lambda^2)) V'
    z* = V (sigma U'b + lambda^2 V'z_p) / (sigma^2 + lambda^2)

A damped direction follows the posture z_p in part, and a direction that moves nothing follows it entirely. z* is the
answer where no limit is active; where one is, the answer minimises |K (z - z*)|, so the law is continuous as limits
become active. Answers are computed from K^-1, whose condition number is the square root of that of the Hessian K'K.

[DS]'s own problem made convex is another objective of the same shape, kept to compare with:

    G = J'Q_h J = V diag(mu) V',  g = J'Q_h s,  K = diag(mu^2 + lambda^2)^(1/4) V',  z* = V mu / (mu^2 + lambda^2) V'g

G is indefinite for every arm of rank 4 or more, so it is no Hessian of a QP; K'K is positive definite with about the
condition of G, and z* is [DS]'s damped formula with Lambda = lambda^2 G^-1, whose gains mu^2 / (mu^2 + lambda^2) lie in
[0, 1): the map from a twist to the twist it gets is J V f(mu) V'J'Q, f = mu / (mu^2 + lambda^2), and AB and BA share
their eigenvalues other than zero. K has no physical meaning for joint velocities, so where limits bind or a singularity
is near, least squares at a point is far more accurate.

Reference: [DS] Sect. 6.2 and 6.3; K'K is the fundamental-symmetry majorant of Krein-space theory.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.legacy.damping import Adaptive, Damping, asked_share
from invariantqp.legacy.qp import EPSILON, Quadratic

# A singular value below this share of the largest is rounding: its direction moves nothing.
NULL_RATIO = 1e-12
# Weight of directions that move nothing where the policy damps nothing, relative to the largest squared singular value.
NULL_WEIGHT = 1e-8


class Objective(NamedTuple):
    """1/2 |K (z - z*)|^2 in the coordinates of V."""

    V: Array  # (n, n) orthonormal, the directions
    weights: Array  # (n,) sigma^2 + lambda^2, all positive: how much each direction counts
    optimum: Array  # (n,) V'z*
    damping: float = 0.0  # the largest lambda on a direction that moves something; 0 where nothing is damped
    rank: int = 0  # how many directions, the first of V, move something
    ratio: float = 1.0  # smallest singular value over the largest, among the min(n, 6) that may move something
    still: Array | None = None  # (n,) V'z* of the twist without its chase, where it has one

    def paced(self, pace: float) -> Objective:
        """The same for a pace of the chase in [0, 1]."""
        if self.still is None or pace == 1.0:
            return self
        return self._replace(optimum=self.still + pace * (self.optimum - self.still))

    def centre(self) -> Array:
        """z*, the optimum where no limit is met."""
        z: Array = self.V.dot(self.optimum)
        return z

    def speed(self, z: Array) -> float:
        """|z| without its part that moves nothing."""
        moving = z.dot(self.V[:, : self.rank])
        return sqrt(float(moving.dot(moving)))

    def quadratic(self) -> Quadratic:
        """The same by the inverse of K."""
        root = np.sqrt(self.weights)
        return Quadratic(root[:, None] * self.V.T, self.V / root, self.centre())

    def calmed(self, mu: float) -> Objective:
        """The same with 1/2 mu |z|^2 added."""
        share = self.weights / (self.weights + mu)
        still = None if self.still is None else share * self.still
        return self._replace(weights=self.weights + mu, optimum=share * self.optimum, still=still)


class Spectrum(NamedTuple):
    """A = U diag(sigma) V', A (6, n)."""

    U: Array  # (6, 6)
    sigma: Array  # (k,) k = min(n, 6)
    Vt: Array  # (n, n)
    largest: float  # singular value that all are compared with

    def damped(self, damping: Damping, wanted: Array) -> tuple[Array, Array, Array]:
        """(n,) sigma, lambda^2, and 1 for directions that move something, 0 for others.

        Sigma and that fade in, so that the law has no jump. `wanted` (n,) is U'b.
        """
        moving, sigma, k = np.zeros(len(self.Vt)), np.zeros(len(self.Vt)), len(self.sigma)
        moving[:k] = np.clip(self.sigma / (NULL_RATIO * self.largest) - 1.0, 0.0, 1.0)
        sigma[:k] = moving[:k] * self.sigma
        return sigma, damping.squares(sigma, wanted, self.largest), moving

    def led(self, damping: Damping) -> Array:
        """(n,) the share of a posture that each direction follows, whatever twist is wanted."""
        share = np.ones(len(self.Vt))
        if self.largest == 0.0:
            return share
        sigma, squares, _ = self.damped(damping, np.zeros(len(share)))
        total = sigma * sigma + squares
        return np.divide(squares, total, out=share, where=total > 0.0)

    def of(self, b: Array) -> Array:
        """(n,) U'b of a measured twist b (6,), 0 for directions that move nothing."""
        found, k = np.zeros(len(self.Vt)), len(self.sigma)
        found[:k] = b.dot(self.U[:, :k])
        return found


def spectrum_of(A: Array, largest: float | None = None) -> Spectrum:
    """The spectrum of the free directions' measured twists A (6, n).

    With exact rows `largest` is the largest singular value of all joints; None is the largest of A.
    """
    if A.shape[1] == 0:
        return Spectrum(np.eye(6), np.empty(0), np.empty((0, 0)), largest or 0.0)
    sigma, first, second, scale, _, info = lapack.dgejsv(A if A.shape[1] < 6 else A.T, joba=0, jobu=1)
    if info != 0:
        raise np.linalg.LinAlgError(f"dgejsv returned {info}")
    sigma = scale[0] / scale[1] * sigma
    U, Vt = (first, second.T) if A.shape[1] < 6 else (second, first.T)
    return Spectrum(U, sigma, Vt, float(sigma[0]) if largest is None else largest)


def least_squares(
    spectrum: Spectrum, b: Array, posture: Array | None, damping: Damping, ahead: Array | None = None
) -> Objective:
    """The damped least-squares objective.

    Args:
        spectrum: of A (6, n), the measured twists of the free directions.
        b: (6,) measured twist wanted of them.
        posture: (n,) z_p; None is zero.
        damping: the policy.
        ahead: (6,) of b, without its chase; None where it has none.
    """
    _, singular, Vt, largest = spectrum
    n = len(Vt)
    if n == 0:
        return Objective(np.empty((0, 0)), np.empty(0), np.empty(0))
    towards = np.zeros(n) if posture is None else Vt.dot(posture)
    if largest == 0.0:
        return Objective(Vt.T, np.ones(n), towards, ratio=0.0)
    wanted = spectrum.of(b)
    sigma, squares, moving = spectrum.damped(damping, wanted)
    null = moving == 0.0
    if ahead is not None and type(damping) is Adaptive:
        squares *= asked_share(damping, sigma, moving * (wanted - sigma * towards), largest)
    squares[null & (squares == 0.0)] = NULL_WEIGHT * largest * largest
    weights = sigma * sigma + squares
    return Objective(
        V=Vt.T,
        weights=weights,
        optimum=(sigma * wanted + squares * towards) / weights,
        damping=sqrt(float(np.where(null, 0.0, squares).max())),
        rank=n - int(np.count_nonzero(null)),
        ratio=float(singular[-1]) / largest if singular[-1] > NULL_RATIO * largest else 0.0,
        still=None if ahead is None else (sigma * spectrum.of(ahead) + squares * towards) / weights,
    )


def convexified(J: Array, s: Array, h: float, posture: Array | None, damping: Damping) -> Objective:
    """The convex objective whose optimum without limits is the filtered stationary point.

    Args:
        J: (6, n) twists of the free directions.
        s: (6,) twist wanted of them.
        h: pitch.
        posture: (n,) wanted where the form leaves directions free; None is zero.
        damping: the policy, given |mu| for singular values.
    """
    n = J.shape[1]
    if n == 0:
        return Objective(np.empty((0, 0)), np.empty(0), np.empty(0))
    QJ = pitch_form(h).dot(J)
    mu, V, info = lapack.dsyev(J.T.dot(QJ))
    if info != 0:
        raise np.linalg.LinAlgError(f"dsyev returned {info}")
    size = np.abs(mu)
    largest = float(size.max())
    noise = 6.0 * EPSILON * (1.0 + 2.0 * abs(h)) * float(np.vdot(J, J))  # what rounding leaves of zero in J'QJ
    towards = np.zeros(n) if posture is None else posture.dot(V)
    if largest <= noise:
        return Objective(V, np.ones(n), towards, ratio=0.0)
    pull = s.dot(QJ).dot(V)
    null = size <= max(NULL_RATIO * largest, noise)
    squares = damping.squares(size, np.abs(pull), largest)
    squares[null & (squares == 0.0)] = NULL_WEIGHT * largest * largest
    total = size * size + squares
    rank = min(n, 6)
    return Objective(
        V=V,
        weights=np.sqrt(total),
        optimum=(np.where(null, 0.0, mu * pull) + squares * towards) / total,
        damping=sqrt(float(np.where(null, 0.0, squares).max())),
        ratio=float(np.sort(size)[-rank]) / largest,
    )
