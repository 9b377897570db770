"""J^{+h} by its factors, and its condition number: how much a relative error of the twists can change it.

    J = T C,   T'Q_h T = diag(mu),   X = J^{+h} = C^+ diag(1/mu) T'Q_h,   G^+ = C^+ diag(1/mu) C^+'

    dX = -X dJ X + G^+ dJ'Q_h(I - JX) + (I - XJ) dJ'X'X + ...

The condition number bounds these terms over |X|, for columns of J with errors of unit relative size. It grows as one
over the distance of h from a principal pitch, as one over the least singular value of J, and as the product of both
where the first hides what the second leaves. No unit of length, no size of a column, and no frame changes it by more
than a modest factor, unless a frame is so far away that the numbers given resolve the arm badly.

Two choices keep digits. Columns that are independent are measured in their own size, which cancels. And where |h| is
longer than the arm, lengths are measured in |h|: else the rounding of a rotation, times h, hides the translations.

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

# Above this an error of ROUNDING may change J^{+h} by more than a thousandth. What is singular by the structure of the
# arm comes out some hundred times larger.
LARGEST_CONDITION = 1e-3 / ROUNDING


class Factors(NamedTuple):
    """What the factors of J^{+h} tell.

    Attributes:
        inverse: (m, 6) J^{+h}; meaningless where `exists` is false.
        condition: how many times larger than the relative error of the twists that of J^{+h} can be.
        spread: the same for the joint velocities of a twist of the system, with which the form has nothing to do.
        screws: (6, r) twists of the system that the form pairs to zero with one another.
        shares: (r,) condition number of what each screw adds to J^{+h}.
    """

    inverse: Array
    condition: float
    spread: float
    screws: Array
    shares: Array

    @property
    def exists(self) -> bool:
        """Whether rounding leaves J^{+h} three digits."""
        return self.condition <= LARGEST_CONDITION

    @property
    def rank(self) -> int:
        """Rank of J."""
        return len(self.shares)

    @property
    def gram_rank(self) -> int:
        """Rank of J'Q_h J, as far as rounding lets it be told."""
        return int(np.count_nonzero(self.shares <= LARGEST_CONDITION))

    @property
    def dependent(self) -> bool:
        """Whether the twists, nearly dependent, have more part in a large condition number than the form."""
        return self.spread * self.spread >= self.condition

    @property
    def lost(self) -> Array:
        """(6,) the unit screw that the form comes nearest to pairing to zero with all of the system."""
        z = self.screws[:, int(self.shares.argmax())]
        return np.asarray(z / np.linalg.norm(z))


def factors(twists: Array, h: float, metric: Array | None = None) -> Factors:
    """J^{+h} and its condition number, for checked (6, m) twists, a finite h and a joint metric (m, m)."""
    system = span(twists)
    m, r = twists.shape[1], system.rank
    if r == 0:
        return Factors(np.zeros((m, 6)), 1.0, 1.0, np.empty((6, 0)), np.empty(0))
    units, magnified = _joint_units(system.scaled_rows(twists.T), r, metric)
    U, sigma, Vt = np.linalg.svd(system.scaled_rows(units.T.dot(twists.T)).T, full_matrices=False)
    U, velocities = U[:, :r], Vt[:r].T / sigma[:r]
    errors = np.full(m, sigma[0] * magnified)  # of the columns
    far = max(1.0, abs(h) / system.unit)
    length = far * system.unit
    # Ordered by how much they turn, so that what turns and what does not stay apart when lengths change their unit.
    turned = np.linalg.svd(U[:3])[2].T
    T = U.dot(turned)
    T[3:] /= far
    longest = np.linalg.norm(T, axis=0)
    Q = pitch_form(h / length)
    T, velocities = T / longest, velocities.dot(turned / longest)
    mu, E = np.linalg.eigh(T.T.dot(Q).dot(T))
    T, velocities = T.dot(E), velocities.dot(E)
    images = Q.dot(T)
    with np.errstate(all="ignore"):  # some mu may be zero
        inverse = (velocities / mu).dot(images.T)
        gram_inverse = (velocities / mu).dot(velocities.T)
        beyond = Q - (images / mu).dot(images.T)
        size = np.linalg.norm(inverse)
        rows = np.linalg.norm(inverse, axis=1) + np.linalg.norm(gram_inverse, axis=1) * np.linalg.norm(beyond) / size
        condition = float(errors.dot(rows) + (errors.sum() * size if r < m else 0.0))
        # The first two terms are alike in each z: (z'Q_h dJ C^+) / mu, and the same seen from S^{perp h}.
        shares = 2.0 * errors.dot(np.abs(velocities)) * np.linalg.norm(images, axis=0) / np.abs(mu)
        inverse = units.dot(inverse)
    inverse[:, 3:] /= length
    T[3:] *= length
    return Factors(inverse, condition if isfinite(condition) else inf, system.spread, T, shares)


def _joint_units(columns: Array, rank: int, metric: Array | None) -> tuple[Array, float]:
    """(m, m) units for joint velocities, and the factor by which they magnify errors.

    Each column's own size where columns are independent; where they are not, those in which the metric is I.
    """
    m = len(columns)
    if rank == m:
        return np.diag(1.0 / np.linalg.norm(columns, axis=1)), 1.0
    if metric is None:
        return np.eye(m), 1.0
    lower = np.linalg.cholesky(metric)
    magnified = np.linalg.cond(lower / np.linalg.norm(lower, axis=1)[:, None])
    return np.linalg.inv(lower).T, float(magnified)
