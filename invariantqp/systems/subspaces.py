"""Screw systems as subspaces: span, reciprocal, annihilator, sum and meet, each from any spanning twists.

    D J = U C,   U (6, r) orthonormal,   C = diag(sigma) V' (r, m),   D = diag(I, I / unit)
    S^{perp h} = {t : t'Q_h s = 0 for all s in S},   S* = {W : W's = 0 for all s in S},   Q_h S^{perp h} = S*

There is one factorisation and one decision of rank, `span`. Its unit of length is the power of two nearest
|J_v| / |J_omega|: the rank is then the same in metres and in millimetres, and the scaling is exact. The functions for
users return a basis, twists or wrenches as columns, in the caller's unit of length; (6, 0) is the zero system, which
they take as any other.

Reference: [DS] Sect. 2.2, (2.9), (2.10), Theorem 3.1 (ii), Sect. 6.3.
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
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.sizes import LENGTH_LIMIT

# A singular value below this fraction of the largest counts as zero: forward kinematics in float64 leaves a few 1e-16
# where a joint axis is exactly dependent, and cond(J) = 1e7 must still count as full rank.
RANK_TOLERANCE = 1e-13
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


def span(J: ArrayLike, tolerance: float = RANK_TOLERANCE, unit: float | None = None, argument: str = "J") -> Span:
    """Factorise (6, m) twists, m >= 0; singular values below `tolerance` times the largest are taken as zero.

    `unit` is the length that counts as 1, by default the twists' own. Two systems to be compared need the same.
    """
    twists = arrays.system(J, argument)
    unit = length_unit(twists) if unit is None else unit
    U, sigma, Vt = np.linalg.svd(twists / lengths(unit), full_matrices=False)
    r = rank_of(sigma, tolerance)
    return Span(basis=U[:, :r], singular=sigma[:r], right=Vt[:r].T, unit=unit)


def screw_system(J: ArrayLike) -> Array:
    """A basis of the screw system that (6, m) twists span: (6, k), orthonormal up to the unit of length.

    Reference: [DS] Sect. 2.2.
    """
    system = span(J)
    return system.basis * lengths(system.unit)


def reciprocal(S: ArrayLike, h: float = 0.0) -> Array:
    """The h-reciprocal system S^{perp h}: a basis (6, 6-k) of all twists t with t'Q_h s = 0 for every s in S.

    S is (6, m) spanning twists of a k-system, dependent or not, h finite [length/rad]; 0 is reciprocity in the ordinary
    sense.

    Reference: [DS] (2.9), (2.10).
    """
    pitch = finite_pitch(h)
    system = span(S, argument="S")
    return orthogonal(pitch_form(pitch / system.unit).dot(system.basis)) * lengths(system.unit)


def annihilator(S: ArrayLike) -> Array:
    """The wrenches (m; f) that do no work on S, S* = Q_0 S^{perp 0}: a basis (6, 6-k), for (6, m) twists of a k-system.

    Given wrenches, it is the twists that they leave free.

    Reference: [DS] Sect. 6.2 (before (6.5)), Sect. 6.3.
    """
    system = span(S, argument="S")
    return orthogonal(system.basis) / lengths(system.unit)


def system_sum(first: ArrayLike, second: ArrayLike, tolerance: float = RANK_TOLERANCE) -> Array:
    """A basis (6, k) of S1 + S2, all twists s1 + s2, for (6, m1) and (6, m2) spanning twists.

    `tolerance` is the angle below which two directions count as one.
    """
    joined, _, unit = _join(first, second, tolerance)
    return joined.basis * lengths(unit)


def system_meet(first: ArrayLike, second: ArrayLike, tolerance: float = RANK_TOLERANCE) -> Array:
    """A basis (6, k) of S1 meet S2, the twists in both; dim meet = dim S1 + dim S2 - dim sum. As `system_sum`."""
    joined, bases, unit = _join(first, second, tolerance)
    # U1 a + U2 b = 0 means that U1 a lies in both systems; those (a; b) are the null space of (U1 U2).
    still, k = joined.still, bases[0].shape[1]
    shared = bases[0].dot(still[:k]) - bases[1].dot(still[k:])
    return np.linalg.qr(shared)[0] * lengths(unit)


def _join(first: ArrayLike, second: ArrayLike, tolerance: float) -> tuple[Span, tuple[Array, Array], float]:
    """The span of the orthonormal bases of two systems, those bases, and their common unit of length."""
    limit = arrays.tolerance(tolerance)
    one, other = arrays.system(first, "first"), arrays.system(second, "second")
    unit = span(np.hstack((one, other))).unit
    bases = span(one, unit=unit).basis, span(other, unit=unit).basis
    return span(np.hstack(bases), limit, unit=1.0), bases, unit


def self_reciprocal(S: ArrayLike, h: float = 0.0, tolerance: float = RANK_TOLERANCE) -> Array:
    """A basis (6, k) of S meet S^{perp h}: the twists of S (6, m) that are h-reciprocal to all of S.

    In exact arithmetic it is the zero system iff S has an h-pseudoinverse; with rounding, ask `has_pseudoinverse`.
    `tolerance` is the angle between S and S^{perp h} below which they meet, h a finite pitch [length/rad].

    Reference: [DS] Theorem 3.1 (ii).
    """
    return system_meet(S, reciprocal(S, h), tolerance)
