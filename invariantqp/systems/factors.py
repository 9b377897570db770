"""J^{+h} from its factors, with its condition number: how much a relative error of the twists can change it.

    J = T C,   T'Q_h T = diag(mu),   X = J^{+h} = C^+ diag(1/mu) T'Q_h,   G^+ = C^+ diag(1/mu) C^+'

    dX = -X dJ X + G^+ dJ'Q_h(I - JX) + (I - XJ) dJ'X'X + ...

The condition number is a bound on the sum of these terms, over |X|, for columns of J with relative errors of size one.
It grows as one over the distance of h from a principal pitch, as one over the least singular value of J, and sometimes
as the product of the two. The unit of length, the size of a column and the frame change it by a modest factor only,
unless the frame is so far away that the given numbers resolve the arm badly.

Two choices keep digits. Independent columns are scaled to unit size; the scaling cancels. And where |h| is longer than
the arm, lengths are measured in |h|, since h times the rounding of a rotation would hide the translations.

Reference: [DS] Theorem 2.2; the condition number is ours, after Wedin's for the Moore-Penrose inverse.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.systems.span import span

# Relative error of a joint twist that forward kinematics in float64 leaves.
ROUNDING = 1e-15

# Above this an error of ROUNDING can change J^{+h} by more than a thousandth. Arms that are singular by structure (an
# SO-101 at h = 0, a SCARA at any h) have hundreds of times this number, in every state and frame.
LARGEST_CONDITION = 1e-3 / ROUNDING


class Factors(NamedTuple):
    """J^{+h} and how far it can be trusted."""

    inverse: Array  # (m, 6) J^{+h}; meaningless where `exists` is false
    condition: float  # ratio of the relative error of J^{+h} to that of the twists, at worst
    spread: float  # the same ratio for the joint velocities that make a twist of the system; the form has no part in it
    screws: Array  # (6, r) basis of the system, mutually h-reciprocal
    shares: Array  # (r,) condition number of the part of J^{+h} that belongs to each screw

    @property
    def exists(self) -> bool:
        """Whether at least three digits of J^{+h} are correct."""
        return self.condition <= LARGEST_CONDITION

    @property
    def rank(self) -> int:
        """Rank of J."""
        return len(self.shares)

    @property
    def gram_rank(self) -> int:
        """Numerical rank of J'Q_h J."""
        return int(np.count_nonzero(self.shares <= LARGEST_CONDITION))

    @property
    def dependent(self) -> bool:
        """Whether near-dependence of the twists, rather than the form, makes the condition number large."""
        return self.spread * self.spread >= self.condition

    @property
    def lost(self) -> Array:
        """(6,) the unit screw of the system that is nearest to being h-reciprocal to all of it."""
        z = self.screws[:, int(self.shares.argmax())]
        return np.asarray(z / np.linalg.norm(z))


def factors(twists: Array, h: float, metric: Array | None = None) -> Factors:
    """J^{+h} with its condition number, for checked (6, m) twists, a finite h and a joint metric (m, m)."""
    system = span(twists)
    m, r = twists.shape[1], system.rank
    if r == 0:
        return Factors(np.zeros((m, 6)), 1.0, 1.0, np.empty((6, 0)), np.empty(0))
    units, magnified = _joint_units(system.scaled(twists), r, metric)
    U, sigma, Vt = np.linalg.svd(system.scaled(twists.dot(units)), full_matrices=False)
    U, velocities = U[:, :r], Vt[:r].T / sigma[:r]
    errors = np.full(m, sigma[0] * magnified)  # of the columns
    far = max(1.0, abs(h) / system.unit)
    length = far * system.unit
    # Sorted by angular part, so that rotations and translations stay apart when the unit of length is changed.
    sorting = np.linalg.svd(U[:3])[2].T
    T = U.dot(sorting)
    T[3:] /= far
    longest = np.linalg.norm(T, axis=0)
    Q = pitch_form(h / length)
    T, velocities = T / longest, velocities.dot(sorting / longest)
    mu, E = np.linalg.eigh(T.T.dot(Q).dot(T))
    T, velocities = T.dot(E), velocities.dot(E)
    images = Q.dot(T)
    with np.errstate(all="ignore"):  # where some mu is zero the condition number comes out infinite
        inverse = (velocities / mu).dot(images.T)
        gram_inverse = (velocities / mu).dot(velocities.T)
        beyond = Q - (images / mu).dot(images.T)
        size = np.linalg.norm(inverse)
        rows = np.linalg.norm(inverse, axis=1) + np.linalg.norm(gram_inverse, axis=1) * np.linalg.norm(beyond) / size
        condition = float(errors.dot(rows) + (errors.sum() * size if r < m else 0.0))
        # For each screw z the first two terms are alike: z'Q_h dJ C^+ / mu, and the same seen from S^{perp h}.
        shares = 2.0 * errors.dot(np.abs(velocities)) * np.linalg.norm(images, axis=0) / np.abs(mu)
        inverse = units.dot(inverse)
    inverse[:, 3:] /= length
    T[3:] *= length
    return Factors(inverse, condition if isfinite(condition) else inf, system.spread, T, shares)


def _joint_units(columns: Array, rank: int, metric: Array | None) -> tuple[Array, float]:
    """A change (m, m) of joint coordinates, and the factor by which it magnifies errors.

    Independent columns get unit size; with dependent columns, the metric becomes the identity.
    """
    m = columns.shape[1]
    if rank == m:
        return np.diag(1.0 / np.linalg.norm(columns, axis=0)), 1.0
    if metric is None:
        return np.eye(m), 1.0
    lower = np.linalg.cholesky(metric)
    magnified = np.linalg.cond(lower / np.linalg.norm(lower, axis=1)[:, None])
    return np.linalg.inv(lower).T, float(magnified)
