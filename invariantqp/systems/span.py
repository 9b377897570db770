"""The span of a set of twists, J = U C: one factorisation and one decision of rank, used everywhere.

    D J = U C,   U (6, r) orthonormal,   C = diag(sigma) V' (r, m),   D = diag(I, I / unit)

The unit of length is the power of two nearest |J_v| / |J_omega|: the rank is then the same in metres and in
millimetres, and the scaling is exact.
"""

from __future__ import annotations

from math import log2
from typing import Any

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike, NDArray

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared

# A singular value below this fraction of the largest counts as zero: forward kinematics in float64 leaves a few 1e-16
# where a joint axis is exactly dependent, and cond(J) = 1e7 must still count as full rank.
RANK_TOLERANCE = 1e-13

# A length above this many of the caller's units, or below one over it, is not that of a machine: it is rounding where a
# part of the twists should be zero, the rotation of a gantry or the moments of axes that meet in the origin.
LENGTH_LIMIT = 1e12
TINY = float(np.finfo(float).tiny)


@frozen(eq=False, repr=False, slots=False)
class Span(Compared):
    """An orthonormal basis of a screw system and the coordinates of the given twists in it."""

    basis: Array  # (6, r) U, orthonormal columns, lengths measured in `unit`
    singular: Array  # (r,) singular values sigma of the scaled twists, descending, all positive
    right: Array  # (m, r) V, orthonormal columns: the joint directions that move
    unit: float  # the length that counts as 1 in `basis`

    @property
    def rank(self) -> int:
        """Dimension of the system."""
        return len(self.singular)

    @property
    def spread(self) -> float:
        """Ratio of the relative error of joint velocities that make a twist to that of the given twists, at worst."""
        sizes, rows = (np.sqrt((a * a).sum(axis=1)) for a in (self.right * self.singular, self.right / self.singular))
        return max(1.0, float(sizes.dot(rows)))

    @property
    def still(self) -> Array:
        """(m, m - r) orthonormal columns: the joint directions that do not move."""
        return orthogonal(self.right)

    def scaled(self, twists: Array) -> Array:
        """(6, k) twists in the caller's unit of length, measured in `unit`."""
        return twists / lengths(self.unit)

    def twists(self, coordinates: Array) -> Array:
        """The (6, k) twists with the given basis coordinates, back in the caller's unit of length."""
        return np.asarray(self.basis.dot(coordinates) * lengths(self.unit))


def lengths(unit: float) -> Array:
    """(6, 1) what takes twists measured in a unit of length to the caller's."""
    return np.array([[1.0], [1.0], [1.0], [unit], [unit], [unit]])


def orthogonal(columns: Array) -> Array:
    """An orthonormal basis (n, n - k) of what is orthogonal to independent columns (n, k), 0 <= k <= n."""
    Q: Array = np.linalg.qr(columns, mode="complete")[0]
    return Q[:, columns.shape[1] :]


def length_unit(J: Array) -> float:
    """The power of two nearest |J_v|_F / |J_omega|_F; 1 where either part vanishes, exactly or but for rounding."""
    w, v = float(np.linalg.norm(J[:3])), float(np.linalg.norm(J[3:]))
    if v >= LENGTH_LIMIT * w or w >= LENGTH_LIMIT * v:
        return 1.0
    return float(2.0 ** round(log2(v) - log2(w)))


def rank_of(sigma: NDArray[np.floating[Any]], tolerance: float) -> int:
    """How many singular values, largest first, are not zero: above `tolerance` times the largest."""
    return int(np.count_nonzero(sigma > tolerance * max(float(sigma.max(initial=0.0)), TINY)))


def span(J: ArrayLike, tolerance: float = RANK_TOLERANCE, unit: float | None = None) -> Span:
    """Factorise (6, m) twists; singular values below `tolerance` times the largest are taken as zero.

    Args:
        J: (6, m) twists as columns.
        tolerance: relative size below which a singular value is zero.
        unit: the length that counts as 1; by default the twists' own. Two systems to be compared need the same.

    Raises:
        BadInput: not finite (6, m) columns.
    """
    twists = arrays.columns(J)
    unit = length_unit(twists) if unit is None else unit
    U, sigma, Vt = np.linalg.svd(twists / lengths(unit), full_matrices=False)
    r = rank_of(sigma, tolerance)
    return Span(basis=U[:, :r], singular=sigma[:r], right=Vt[:r].T, unit=unit)
