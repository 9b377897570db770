"""Screw systems as subspaces: basis, reciprocal, annihilator, sum and meet, each from any spanning twists.

    S^{perp h} = {t : t'Q_h s = 0 for all s in S},   S* = {W : W's = 0 for all s in S},   Q_h S^{perp h} = S*

Every function returns a basis, twists or wrenches as columns, in the caller's unit of length; (6, 0) is the zero
system. Dimensions follow from the rank that `span` decides.

Reference: [DS] (2.9), (2.10), Theorem 3.1 (ii), Sect. 6.3.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.span import RANK_TOLERANCE, Span, lengths, orthogonal, span


def screw_system(J: ArrayLike, tolerance: float = RANK_TOLERANCE) -> Array:
    """A basis of the screw system that (6, m) twists span: (6, k), orthonormal up to the unit of length.

    Raises:
        BadInput: J is not finite (6, m), or a tolerance that is not between 0 and 1.

    Reference: [DS] Sect. 2.2.
    """
    system = span(J, arrays.tolerance(tolerance))
    return system.twists(np.eye(system.rank))


def reciprocal(S: ArrayLike, h: float = 0.0) -> Array:
    """The h-reciprocal system S^{perp h}: all twists t with t'Q_h s = 0 for every s in S.

    Args:
        S: (6, m) spanning twists of a k-system, dependent or not.
        h: finite pitch [length/rad]; 0 is reciprocity in the ordinary sense.

    Returns:
        (6, 6-k) basis.

    Raises:
        BadInput: S is not finite (6, m), or h is not finite.

    Reference: [DS] (2.9), (2.10).
    """
    pitch = finite_pitch(h)
    system = span(arrays.columns(S, "S"))
    return orthogonal(pitch_form(pitch / system.unit).dot(system.basis)) * lengths(system.unit)


def annihilator(S: ArrayLike) -> Array:
    """The wrenches that do no work on any twist of S, S* = Q_0 S^{perp 0}; given wrenches, the twists they leave free.

    Args:
        S: (6, m) spanning twists of a k-system.

    Returns:
        (6, 6-k) basis, wrenches (m; f).

    Raises:
        BadInput: S is not finite (6, m).

    Reference: [DS] Sect. 6.2 (before (6.5)), Sect. 6.3.
    """
    system = span(arrays.columns(S, "S"))
    return orthogonal(system.basis) / lengths(system.unit)


def system_sum(first: ArrayLike, second: ArrayLike, tolerance: float = RANK_TOLERANCE) -> Array:
    """A basis (6, k) of S1 + S2, all twists s1 + s2.

    Args:
        first: (6, m1) spanning twists.
        second: (6, m2) spanning twists.
        tolerance: angle below which two directions count as one.

    Raises:
        BadInput: either is not finite (6, m), or a tolerance that is not between 0 and 1.
    """
    joined, _, unit = _join(first, second, tolerance)
    return joined.basis * lengths(unit)


def system_meet(first: ArrayLike, second: ArrayLike, tolerance: float = RANK_TOLERANCE) -> Array:
    """A basis (6, k) of S1 meet S2, the twists in both; dim meet = dim S1 + dim S2 - dim sum.

    Args:
        first: (6, m1) spanning twists.
        second: (6, m2) spanning twists.
        tolerance: angle below which two directions count as one.

    Raises:
        BadInput: either is not finite (6, m), or a tolerance that is not between 0 and 1.
    """
    joined, bases, unit = _join(first, second, tolerance)
    # U1 a + U2 b = 0 means that U1 a lies in both systems; those (a; b) are the null space of (U1 U2).
    still, k = joined.still, bases[0].shape[1]
    shared = bases[0].dot(still[:k]) - bases[1].dot(still[k:])
    return np.linalg.qr(shared)[0] * lengths(unit) if still.shape[1] else np.empty((6, 0))


def _join(first: ArrayLike, second: ArrayLike, tolerance: float) -> tuple[Span, tuple[Array, Array], float]:
    """The span of the orthonormal bases of two systems, those bases, and their common unit of length."""
    limit = arrays.tolerance(tolerance)
    one, other = arrays.columns(first, "first"), arrays.columns(second, "second")
    unit = span(np.hstack((one, other))).unit
    bases = span(one, unit=unit).basis, span(other, unit=unit).basis
    return span(np.hstack(bases), limit, unit=1.0), bases, unit


def self_reciprocal(S: ArrayLike, h: float = 0.0, tolerance: float = RANK_TOLERANCE) -> Array:
    """A basis (6, k) of S meet S^{perp h}: the twists of S that are h-reciprocal to all of S.

    In exact arithmetic it is the zero system iff S has an h-pseudoinverse; with rounding, ask `has_pseudoinverse`.

    Args:
        S: (6, m) spanning twists.
        h: finite pitch [length/rad].
        tolerance: angle between S and S^{perp h} below which they meet.

    Raises:
        BadInput: S is not finite (6, m), h is not finite, or a tolerance that is not between 0 and 1.

    Reference: [DS] Theorem 3.1 (ii).
    """
    limit = arrays.tolerance(tolerance)
    other = reciprocal(S, h)
    return system_meet(S, other, limit) if other.shape[1] else np.empty((6, 0))
