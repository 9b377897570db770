"""Subspaces of twists, each with its own point and length; reciprocal, annihilator, sum and meet.

    own coordinates of a twist:   (omega; (v + omega x p) / L)
    S^{perp h} = {t : t'Q_h s = 0 for all s in S},   S* = {W : W's = 0 for all s in S},   Q_h S^{perp h} = S*

p is the point that the rotating twists move least, and L = |v + omega x p| / |omega| over all of them. A rigid motion
moves p and keeps L; another unit of length scales both. Every decision is made in own coordinates, so it depends on
neither frame nor unit, except `angular_share`. If all axes are parallel, p is their point nearest to the origin. One
tolerance, the relative error of the given twists, 1e-7 by default, decides

    rank    singular values up to `tolerance` times the largest are zero
    type    numbers up to `tolerance` are zero: angular parts, couplings, differences of pitches over L

Pseudoinverses, singular values and projectors are computed from the columns to rounding, at `Subspace.exact`; their
condition number reports near-dependence. Twists far from the origin have fewer digits of v + omega x p; if rounding
decides, `BadInput` is raised.

Reference: [DS] Sect. 2.2, (2.9), (2.10), Theorem 3.1 (ii), Sect. 6.3. Own point, length and tolerances are ours.
"""

from __future__ import annotations

from functools import cached_property
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.linear import TINY, orthogonal, rank_of
from invariantqp.geometry.screws import least_moving_point
from invariantqp.geometry.se3 import cross_matrix, norm, velocity_at
from invariantqp.geometry.sizes import LENGTH_LIMIT, bounded_system

if TYPE_CHECKING:
    from typing_extensions import Self

# Robot files have eight digits or more; 1.5707963 for a right angle is off by 2.7e-8.
TOLERANCE = 1e-7
# Relative error of a twist computed in float64, and of results computed from it.
ROUNDING_ERROR = 2e-15
# A singular value below this share of the largest is rounding.
LEAST_INDEPENDENCE = 1e-13
# Axes meet in a point that they pass at less than this share of their distance from the origin.
CONCURRENCE_TOLERANCE = 3e-14


class Span(NamedTuple):
    """Singular value decomposition of twists in own coordinates, T = basis diag(singular) right'.

    basis (6, k) orthonormal, singular (k,) descending, right (m, k) orthonormal; `cut` singular values count as zero.
    """

    basis: Array
    singular: Array
    right: Array
    cut: Array


@frozen(init=False, eq=False, repr=False, slots=False)
class Subspace(Value):
    """The span of (6, m) twists, with its own point and length.

    Attributes:
        twists: (6, m) as given, as columns, dependent or not; (6, 0) is the zero system.
        point: (3,) the own point [length].
        length: the own length L, or the one given. If the axes meet in the own point, the ratio of linear to angular
            speed, or else their distance from the origin, or 1: no decision depends on it there.
        tolerance: relative error of the twists.
        angular_share: norm of the angular parts over that of the linear parts, or over 1 if that is less; no twist
            rotates if it is within the tolerance. This is the one decision in the caller's units.
        given_length: the length given instead of the own one, None if none was.
        concurrent: whether the axes meet in the own point, so that there is no own length.
        error_factors: (m,) relative error of each twist in own coordinates over its relative error as given.
    """

    twists: Array = field(converter=own)
    point: Array = field(converter=own)
    length: float
    tolerance: float
    angular_share: float = field(eq=False, repr=False)
    given_length: float | None = field(eq=False, repr=False)
    concurrent: bool = field(eq=False, repr=False)
    error_factors: Array = field(converter=own, eq=False, repr=False)

    def __init__(
        self,
        twists: ArrayLike,
        *,
        tolerance: float = TOLERANCE,
        length: float | None = None,
        argument: str = "J",
    ) -> None:
        """The span of (6, m) twists.

        Args:
            twists: (6, m), as columns (omega; v).
            tolerance: relative error of the twists, between 0 and 1: 1e-13 takes them as exact in float64.
            length: the unit of length of decisions instead of the own length, such as that of the arm.
            argument: name of the twists in messages.
        """
        own_length = None if length is None else arrays.number(length, "length", "a length", positive=True)
        self._fill(bounded_system(twists, argument), arrays.tolerance(tolerance), own_length)

    def _fill(self, J: Array, tolerance: float, length: float | None) -> None:
        point, own_length, angular_share = _own_point_and_length(J, tolerance)
        L = length or own_length or _substitute_length(J, tolerance)
        here = np.hypot(*(np.linalg.norm(a, axis=0) for a in (J[:3], velocity_at(J, point) / L)))
        given = np.hypot(*(np.linalg.norm(a, axis=0) for a in (J[:3], J[3:] / L)))
        errors = np.maximum(1.0, given / np.maximum(here, TINY))
        self.__attrs_init__(J, point, L, tolerance, angular_share, length, not own_length, errors)

    @cached_property
    def to_own(self) -> Array:
        """(6, 6) from twists to own coordinates; its transpose takes wrenches from own coordinates to the caller's."""
        A = np.diag(np.repeat([1.0, 1.0 / self.length], 3))
        A[3:, :3] = -cross_matrix(self.point) / self.length
        return A

    @cached_property
    def from_own(self) -> Array:
        """(6, 6) from own coordinates to twists; its transpose takes wrenches to own coordinates."""
        A = np.diag(np.repeat([1.0, self.length], 3))
        A[3:, :3] = cross_matrix(self.point)
        return A

    @cached_property
    def coordinates(self) -> Array:
        """(6, m) the twists in own coordinates."""
        T = self.twists.copy()
        T[3:] = velocity_at(self.twists, self.point) / self.length  # exact where `to_own` would round twice
        return T

    @cached_property
    def rounding(self) -> float:
        """Rounding error in own coordinates, relative to the twists."""
        return ROUNDING_ERROR * float(self.error_factors.max(initial=1.0))

    @cached_property
    def span(self) -> Span:
        """The singular value decomposition, to the tolerance.

        Raises:
            BadInput: rounding decides the rank.
        """
        U, sigma, Vt = np.linalg.svd(self.coordinates, full_matrices=False)
        k = max(rank_of(sigma, self.tolerance), int(sigma.any()))  # a twist that is not zero spans, at any tolerance
        if self.rounding > self.tolerance and rank_of(sigma, self.rounding) < len(sigma):
            raise rounding_error("a rank", self)
        return Span(U[:, :k], sigma[:k], Vt[:k].T, sigma[k:])

    @property
    def dimension(self) -> int:
        """k, the number of independent twists."""
        return len(self.span.singular)

    @cached_property
    def basis(self) -> Array:
        """(6, k) twists that span the system, orthonormal in own coordinates."""
        return np.asarray(self.from_own.dot(self.span.basis))

    @property
    def independence(self) -> float:
        """Smallest over largest singular value of the twists in own coordinates; 1 for the zero system."""
        sigma = self.span.singular
        return float(sigma[-1] / sigma[0]) if len(sigma) else 1.0

    def with_tolerance(self, tolerance: float) -> Self:
        """The same twists at another tolerance, 1 or more included."""
        new = type(self).__new__(type(self))
        new._fill(self.twists, tolerance, self.given_length)  # noqa: SLF001
        return new

    @cached_property
    def exact(self) -> Self:
        """The system of the same twists at the tolerance of rounding; this one if no singular value was cut."""
        least = LEAST_INDEPENDENCE * float(self.error_factors.max(initial=1.0))
        largest = float(self.span.singular.max(initial=0.0))
        if least >= self.tolerance or not (self.span.cut > least * largest).any():
            return self
        return self.with_tolerance(least)

    @property
    def joint_condition(self) -> float:
        """Condition number of the joint velocities for a twist of the system, with respect to the joint twists."""
        V, sigma = self.span.right, self.span.singular
        sizes, rows = (np.sqrt((a * a).sum(axis=1)) for a in (V * sigma, V / sigma))
        return max(1.0, float((self.error_factors * sizes).dot(rows)))

    @property
    def null_space(self) -> Array:
        """(m, m - k) orthonormal basis of the joint velocities with zero twist."""
        return orthogonal(self.span.right)

    def joint_velocities(self, twists: Array) -> Array:
        """(m, n) joint velocities of least norm for (6, n) twists of the system."""
        s = self.span
        return np.asarray(s.right.dot(s.basis.T.dot(self.to_own.dot(twists)) / s.singular[:, None]))

    def form(self, h: float) -> Array:
        """Q_h (6, 6) in own coordinates, divided by the own length."""
        return pitch_form(h / self.length)

    def derived(self, basis: Array) -> Self:
        """The system of an orthonormal basis (6, n) in these own coordinates; it inherits the errors of this one."""
        errors = np.full(basis.shape[1], float(self.error_factors.max(initial=1.0)) / self.independence)
        new = type(self).__new__(type(self))
        inherited = (self.point, self.length, self.tolerance, self.angular_share, self.given_length, self.concurrent)
        new.__attrs_init__(self.from_own.dot(basis), *inherited, errors)
        ones = np.ones(basis.shape[1])
        vars(new).update(coordinates=basis, span=Span(basis, ones, np.diag(ones), np.empty(0)))
        return new

    def reciprocal(self, h: float = 0.0) -> Self:
        """The h-reciprocal system S^{perp h}, all twists t with t'Q_h s = 0; h = 0 is ordinary reciprocity.

        Reference: [DS] (2.9), (2.10).
        """
        return self.derived(orthogonal(self.form(finite_pitch(h)).dot(self.span.basis)))

    def annihilator(self) -> Array:
        """Basis (6, 6-k) of the wrenches (m; f) that do no work on the system, S* = Q_0 S^{perp 0}.

        Reference: [DS] Sect. 6.2, before (6.5); Sect. 6.3.
        """
        return np.asarray(self.to_own.T.dot(orthogonal(self.span.basis)))

    def contains(self, twists: ArrayLike) -> bool:
        """Whether (6, n) twists are in the system, to its tolerance."""
        T = self.to_own.dot(arrays.system(twists, "twists"))
        U = self.span.basis
        outside = np.linalg.norm(T - U.dot(U.T.dot(T)), axis=0)
        limit = max(self.tolerance, self.rounding / self.independence)
        return bool((outside <= limit * np.linalg.norm(T, axis=0)).all())

    def sum(self, other: Subspace | ArrayLike) -> Self:
        """The sum S1 + S2 with another system."""
        both, bases = self._joined(other)
        return both.derived(_range_and_row_space(np.hstack(bases), both.tolerance)[0])

    def meet(self, other: Subspace | ArrayLike) -> Self:
        """The intersection with another system; dim meet = dim S1 + dim S2 - dim sum."""
        both, bases = self._joined(other)
        # U1 a = U2 b lies in both systems; (a; -b) are the null space of (U1 U2).
        null, k = orthogonal(_range_and_row_space(np.hstack(bases), both.tolerance)[1]), self.dimension
        return both.derived(np.linalg.qr(bases[0].dot(null[:k]) - bases[1].dot(null[k:]))[0])

    def _joined(self, given: Subspace | ArrayLike) -> tuple[Self, tuple[Array, Array]]:
        """The system of both bases, and the two orthonormal bases in its own coordinates."""
        other = as_system(given, "other")
        both = type(self)(np.hstack((self.basis, other.basis)), tolerance=max(self.tolerance, other.tolerance))
        first, second = (np.linalg.qr(both.to_own.dot(s.basis))[0] for s in (self, other))
        return both, (first, second)

    def self_reciprocal(self, h: float = 0.0) -> Self:
        """The twists of the system that are h-reciprocal to all of it, S meet S^{perp h}.

        In exact arithmetic the zero system iff there is an h-pseudoinverse; with rounding, use `has_pseudoinverse`.

        Reference: [DS] Theorem 3.1 (ii).
        """
        U = self.span.basis
        K = orthogonal(orthogonal(self.form(finite_pitch(h)).dot(U)))
        _, sines, Vt = np.linalg.svd(K.T.dot(U))
        return self.derived(U.dot(Vt.T[:, sines <= self.tolerance]))


def as_system(twists: ArrayLike | Subspace, argument: str = "J", tolerance: float = TOLERANCE) -> Subspace:
    """A system as it is, or the span of (6, m) twists."""
    return twists if isinstance(twists, Subspace) else Subspace(twists, tolerance=tolerance, argument=argument)


def _rotating(J: Array, tolerance: float) -> tuple[NDArray[np.bool_], float]:
    """Which of the twists rotate (m,), and the angular share."""
    w, v = np.linalg.norm(J[:3], axis=0), np.linalg.norm(J[3:], axis=0)
    share = norm(w) / min(1.0, max(norm(v), TINY))
    return ((w * LENGTH_LIMIT > v) | (w > tolerance)) & (share > tolerance), share


def _own_point_and_length(J: Array, tolerance: float) -> tuple[Array, float, float]:
    """p; L, or 0 if the axes meet in p or no twist rotates; the angular share."""
    rotates, share = _rotating(J, tolerance)
    if not rotates.any():
        return np.zeros(3), 0.0, share
    lines = J[:, rotates]
    point = least_moving_point(lines, longest=inf).point
    moved, moments, angular, linear = (
        float(np.linalg.norm(a)) for a in (velocity_at(lines, point), lines[3:], lines[:3], J[3:, ~rotates])
    )
    meets = moved <= max(CONCURRENCE_TOLERANCE * moments, NEGLIGIBLE * linear, angular / LENGTH_LIMIT)
    return point, 0.0 if meets else moved / angular, share


def _substitute_length(J: Array, tolerance: float) -> float:
    """The length of a system without an own one: linear over angular speed, or the distance of the axes, or 1."""
    rotates, _ = _rotating(J, tolerance)
    moments, angular, linear = (float(np.linalg.norm(a)) for a in (J[3:, rotates], J[:3, rotates], J[3:, ~rotates]))
    linear = linear or moments
    return linear / angular if angular and linear * LENGTH_LIMIT > angular else 1.0


def _range_and_row_space(columns: Array, tolerance: float) -> tuple[Array, Array]:
    """Orthonormal bases of the range and the row space."""
    U, sigma, Vt = np.linalg.svd(columns, full_matrices=False)
    k = rank_of(sigma, tolerance)
    return U[:, :k], Vt[:k].T


def screw_system(J: ArrayLike | Subspace) -> Array:
    """A basis (6, k) of the screw system that (6, m) twists span.

    Reference: [DS] Sect. 2.2.
    """
    return as_system(J).basis


def reciprocal(S: ArrayLike | Subspace, h: float = 0.0) -> Array:
    """The h-reciprocal system S^{perp h}: a basis (6, 6-k) of all twists t with t'Q_h s = 0 for every s in S.

    S is (6, m) spanning twists of a k-system, h finite [length/rad]; 0 is reciprocity in the ordinary sense.

    Reference: [DS] (2.9), (2.10).
    """
    return as_system(S, "S").reciprocal(h).basis


def annihilator(S: ArrayLike | Subspace) -> Array:
    """A basis (6, 6-k) of the wrenches (m; f) that do no work on (6, m) twists of a k-system; or the other way round.

    Reference: [DS] Sect. 6.2 (before (6.5)), Sect. 6.3.
    """
    return as_system(S, "S").annihilator()


def system_sum(first: ArrayLike | Subspace, second: ArrayLike | Subspace, tolerance: float = TOLERANCE) -> Array:
    """A basis (6, k) of S1 + S2 for (6, m1) and (6, m2) spanning twists; `tolerance` is their relative error."""
    return as_system(first, "first", tolerance).sum(as_system(second, "second", tolerance)).basis


def system_meet(first: ArrayLike | Subspace, second: ArrayLike | Subspace, tolerance: float = TOLERANCE) -> Array:
    """A basis (6, k) of the intersection of S1 and S2; arguments as of `system_sum`."""
    return as_system(first, "first", tolerance).meet(as_system(second, "second", tolerance)).basis


def self_reciprocal(S: ArrayLike | Subspace, h: float = 0.0, tolerance: float = TOLERANCE) -> Array:
    """A basis (6, k) of S meet S^{perp h}: the twists of S (6, m) that are h-reciprocal to all of S.

    `tolerance` is the relative error of the twists, h a finite pitch [length/rad].

    Reference: [DS] Theorem 3.1 (ii).
    """
    return as_system(S, "S", tolerance).self_reciprocal(h).basis


def rounding_error(quantity: str, system: Subspace) -> BadInput:
    """The error for a quantity that rounding of the twists decides."""
    distance = (
        f"twists {float(system.error_factors.max()):.1g} of their own lengths ({system.length:.3g}) from the origin"
    )
    expected = f"{quantity} that rounding does not decide"
    remedy = "Give the twists about a nearer point, or with tolerance= or length= what may count as zero."
    return BadInput("J", distance, expected, remedy)
