"""Subspaces of twists, each with a point and a length of its own; reciprocal, annihilator, sum and meet.

    own coordinates of a twist:   (omega; (v + omega x p) / L)
    S^{perp h} = {t : t'Q_h s = 0 for all s in S},   S* = {W : W's = 0 for all s in S},   Q_h S^{perp h} = S*

p is the point that the turning twists move least, and L = |v + omega x p| / |omega| of all of them together. A rigid
motion carries p along and leaves L as it is; another unit of length scales both. Every decision of this package
is made in own coordinates, so it depends on neither, but for `angular_share`. Where all axes are parallel p may lie
anywhere along them, and is taken nearest to the origin. One tolerance, the relative error of the given twists, 1e-7 by
default, decides

    rank    singular values up to `tolerance` times the largest are zero
    type    numbers up to `tolerance` are zero: angular parts, couplings, differences of pitches over L

What is computed from the columns themselves (pseudoinverses, singular values, projectors) takes them as they are, to
rounding: of twists that are dependent but for the tolerance it has the full rank, and its condition number says so.
Twists far from the origin have fewer digits of v + omega x p. Where those left do not decide, an error says so.

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
from invariantqp.geometry.screws import resting_point
from invariantqp.geometry.se3 import cross_matrix, norm, velocity_at
from invariantqp.geometry.sizes import LENGTH_LIMIT, usual_twists

if TYPE_CHECKING:
    from typing_extensions import Self

# Robot files have eight digits or more; 1.5707963 for a right angle is off by 2.7e-8.
TOLERANCE = 1e-7
# Relative error of a twist that was computed in float64, and of what is computed from it.
ROUNDING_ERROR = 2e-15
# Below this a singular value is rounding whatever was computed.
LEAST_INDEPENDENCE = 1e-13
# Axes that pass a point at less than this share of their distance from the origin meet in it.
MEETING = 3e-14


class Span(NamedTuple):
    """Twists in own coordinates, T = basis diag(singular) right', up to the singular values `cut` that count as zero.

    basis (6, k) orthonormal, singular (k,) descending, right (m, k) orthonormal.
    """

    basis: Array
    singular: Array
    right: Array
    cut: Array


@frozen(init=False, eq=False, repr=False, slots=False)
class Subspace(Value):
    """What twists span, in coordinates of its own.

    Attributes:
        twists: (6, m) as given, as columns, dependent or not; (6, 0) is the zero system.
        point: (3,) the own point [length].
        length: the own length L, or the one given; where the axes meet in the own point, the speed of what slides over
            that of what turns, or else their distance from the origin, or 1: no decision depends on it there.
        tolerance: relative error of the twists.
        angular_share: size of the angular parts over that of the linear parts, or over 1 where that is less; no twist
            turns if it is within the tolerance. This is the one decision in the caller's units.
        given_length: the length given instead of the own one, None if none was.
        concurrent: whether the axes meet in the own point, so that there is no own length.
        error_factors: (m,) relative error of each twist in own coordinates, as a multiple of its error as given.
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
            length: the length that counts as 1 in decisions instead of the own length, such as that of the arm.
            argument: what messages call the twists.
        """
        own_length = None if length is None else arrays.number(length, "length", "a length", positive=True)
        self._fill(usual_twists(twists, argument), arrays.tolerance(tolerance), own_length)

    def _fill(self, J: Array, tolerance: float, length: float | None) -> None:
        point, own_length, turning = _own_point_and_length(J, tolerance)
        L = length or own_length or _substitute_length(J, tolerance)
        here = np.hypot(*(np.linalg.norm(a, axis=0) for a in (J[:3], velocity_at(J, point) / L)))
        given = np.hypot(*(np.linalg.norm(a, axis=0) for a in (J[:3], J[3:] / L)))
        errors = np.maximum(1.0, given / np.maximum(here, TINY))
        self.__attrs_init__(J, point, L, tolerance, turning, length, not own_length, errors)

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
        """The factorisation that everything is computed from.

        Raises:
            BadInput: rounding leaves the rank open.
        """
        U, sigma, Vt = np.linalg.svd(self.coordinates, full_matrices=False)
        k = max(rank_of(sigma, self.tolerance), int(sigma.any()))  # some twist is not zero, at whatever tolerance
        if self.rounding > self.tolerance and rank_of(sigma, self.rounding) < len(sigma):
            raise undecided("a rank", self)
        return Span(U[:, :k], sigma[:k], Vt[:k].T, sigma[k:])

    @property
    def dimension(self) -> int:
        """k: how many of the twists are independent."""
        return len(self.span.singular)

    @cached_property
    def basis(self) -> Array:
        """(6, k) twists that span it, orthonormal in own coordinates."""
        return np.asarray(self.from_own.dot(self.span.basis))

    @property
    def independence(self) -> float:
        """Smallest over largest singular value of the twists in own coordinates; 1 for the zero system."""
        sigma = self.span.singular
        return float(sigma[-1] / sigma[0]) if len(sigma) else 1.0

    def with_tolerance(self, tolerance: float) -> Self:
        """The same twists at another tolerance, 1 or more included."""
        new = type(self).__new__(type(self))
        new._fill(  # noqa: SLF001
            self.twists, tolerance, self.given_length
        )
        return new

    @cached_property
    def exact(self) -> Self:
        """The same twists taken as they are, to rounding: this system unless a singular value is within tolerance."""
        least = LEAST_INDEPENDENCE * float(self.error_factors.max(initial=1.0))
        largest = float(self.span.singular.max(initial=0.0))
        if least >= self.tolerance or not (self.span.cut > least * largest).any():
            return self
        return self.with_tolerance(least)

    @property
    def joint_condition(self) -> float:
        """Condition number of the joint velocities that make a twist of the system, for errors of the twists."""
        V, sigma = self.span.right, self.span.singular
        sizes, rows = (np.sqrt((a * a).sum(axis=1)) for a in (V * sigma, V / sigma))
        return max(1.0, float((self.error_factors * sizes).dot(rows)))

    @property
    def null_space(self) -> Array:
        """(m, m - k) orthonormal joint velocities that move nothing."""
        return orthogonal(self.span.right)

    def joint_velocities(self, twists: Array) -> Array:
        """(m, n) joint velocities that make (6, n) twists of the system; of dependent joints, one of many."""
        s = self.span
        return np.asarray(s.right.dot(s.basis.T.dot(self.to_own.dot(twists)) / s.singular[:, None]))

    def form(self, h: float) -> Array:
        """Q_h (6, 6) in own coordinates, over the own length."""
        return pitch_form(h / self.length)

    def derived(self, basis: Array) -> Self:
        """The system of an orthonormal basis (6, n) in these own coordinates, with the errors of this one."""
        errors = np.full(basis.shape[1], float(self.error_factors.max(initial=1.0)) / self.independence)
        new = type(self).__new__(type(self))
        passed_on = (self.point, self.length, self.tolerance, self.angular_share, self.given_length, self.concurrent)
        new.__attrs_init__(self.from_own.dot(basis), *passed_on, errors)
        ones = np.ones(basis.shape[1])
        vars(new).update(coordinates=basis, span=Span(basis, ones, np.diag(ones), np.empty(0)))
        return new

    def reciprocal(self, h: float = 0.0) -> Self:
        """The h-reciprocal system S^{perp h}, all twists t with t'Q_h s = 0; h = 0 is reciprocity without a pitch.

        Reference: [DS] (2.9), (2.10).
        """
        return self.derived(orthogonal(self.form(finite_pitch(h)).dot(self.span.basis)))

    def annihilator(self) -> Array:
        """(6, 6-k) wrenches (m; f) that do no work on the system, S* = Q_0 S^{perp 0}.

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
        """All twists s1 + s2 of this system and another."""
        both, bases = self._joined(other)
        return both.derived(_span_of(np.hstack(bases), both.tolerance)[0])

    def meet(self, other: Subspace | ArrayLike) -> Self:
        """The twists that this system shares with another; dim meet = dim S1 + dim S2 - dim sum."""
        both, bases = self._joined(other)
        # U1 a = U2 b lies in both systems; (a; -b) are the null space of (U1 U2).
        right, k = _span_of(np.hstack(bases), both.tolerance)[1], self.dimension
        null = orthogonal(right)
        return both.derived(np.linalg.qr(bases[0].dot(null[:k]) - bases[1].dot(null[k:]))[0])

    def _joined(self, given: Subspace | ArrayLike) -> tuple[Self, tuple[Array, Array]]:
        """The sum as a system, in whose own coordinates the two orthonormal bases are."""
        other = given if isinstance(given, Subspace) else type(self)(given, argument="other")
        tolerance = max(self.tolerance, other.tolerance)
        both = type(self)(np.hstack((self.basis, other.basis)), tolerance=tolerance)
        first, second = (np.linalg.qr(both.to_own.dot(s.basis))[0] for s in (self, other))
        return both, (first, second)

    def self_reciprocal(self, h: float = 0.0) -> Self:
        """The twists of the system that are h-reciprocal to all of it, S meet S^{perp h}.

        In exact arithmetic the zero system iff there is an h-pseudoinverse; with rounding, ask `has_pseudoinverse`.

        Reference: [DS] Theorem 3.1 (ii).
        """
        U = self.span.basis
        K = orthogonal(orthogonal(self.form(finite_pitch(h)).dot(U)))
        _, sines, Vt = np.linalg.svd(K.T.dot(U))
        return self.derived(U.dot(Vt.T[:, sines <= self.tolerance]))


def _turning(J: Array, tolerance: float) -> tuple[NDArray[np.bool_], float]:
    """Which of the twists turn, and the angular parts over the linear parts, or over 1 where that is less."""
    w, v = np.linalg.norm(J[:3], axis=0), np.linalg.norm(J[3:], axis=0)
    share = norm(w) / min(1.0, max(norm(v), TINY))
    turns = ((w * LENGTH_LIMIT > v) | (w > tolerance)) & (share > tolerance)
    return turns, share


def _own_point_and_length(J: Array, tolerance: float) -> tuple[Array, float, float]:
    """p; L, or 0 where the axes meet in p or nothing turns; the angular share."""
    turns, share = _turning(J, tolerance)
    if not turns.any():
        return np.zeros(3), 0.0, share
    lines = J[:, turns]
    point = resting_point(lines, longest=inf).point
    moved, far, turned, slides = (
        float(np.linalg.norm(a)) for a in (velocity_at(lines, point), lines[3:], lines[:3], J[3:, ~turns])
    )
    meets = moved <= max(MEETING * far, NEGLIGIBLE * slides, turned / LENGTH_LIMIT)
    return point, 0.0 if meets else moved / turned, share


def _substitute_length(J: Array, tolerance: float) -> float:
    """A length where there is no own one: the speed of what slides, or the distance of what turns, over its speed."""
    turns, _ = _turning(J, tolerance)
    far, turned, slides = (float(np.linalg.norm(a)) for a in (J[3:, turns], J[:3, turns], J[3:, ~turns]))
    other = slides or far
    return other / turned if turned and other * LENGTH_LIMIT > turned else 1.0


def _span_of(columns: Array, tolerance: float) -> tuple[Array, Array]:
    """Orthonormal bases of the range and the row space."""
    U, sigma, Vt = np.linalg.svd(columns, full_matrices=False)
    k = rank_of(sigma, tolerance)
    return U[:, :k], Vt[:k].T


def screw_system(J: ArrayLike) -> Array:
    """A basis (6, k) of the screw system that (6, m) twists span.

    Reference: [DS] Sect. 2.2.
    """
    return Subspace(J).basis


def reciprocal(S: ArrayLike, h: float = 0.0) -> Array:
    """The h-reciprocal system S^{perp h}: a basis (6, 6-k) of all twists t with t'Q_h s = 0 for every s in S.

    S is (6, m) spanning twists of a k-system, h finite [length/rad]; 0 is reciprocity in the ordinary sense.

    Reference: [DS] (2.9), (2.10).
    """
    return Subspace(S, argument="S").reciprocal(h).basis


def annihilator(S: ArrayLike) -> Array:
    """A basis (6, 6-k) of the wrenches (m; f) that do no work on (6, m) twists of a k-system; or the other way round.

    Reference: [DS] Sect. 6.2 (before (6.5)), Sect. 6.3.
    """
    return Subspace(S, argument="S").annihilator()


def system_sum(first: ArrayLike, second: ArrayLike, tolerance: float = TOLERANCE) -> Array:
    """A basis (6, k) of S1 + S2 for (6, m1) and (6, m2) spanning twists; `tolerance` is their relative error."""
    one, other = _pair(first, second, tolerance)
    return one.sum(other).basis


def system_meet(first: ArrayLike, second: ArrayLike, tolerance: float = TOLERANCE) -> Array:
    """A basis (6, k) of the twists in both S1 and S2; as `system_sum`."""
    one, other = _pair(first, second, tolerance)
    return one.meet(other).basis


def _pair(first: ArrayLike, second: ArrayLike, tolerance: float) -> tuple[Subspace, Subspace]:
    return (
        Subspace(first, tolerance=tolerance, argument="first"),
        Subspace(second, tolerance=tolerance, argument="second"),
    )


def self_reciprocal(S: ArrayLike, h: float = 0.0, tolerance: float = TOLERANCE) -> Array:
    """A basis (6, k) of S meet S^{perp h}: the twists of S (6, m) that are h-reciprocal to all of S.

    `tolerance` is the relative error of the twists, h a finite pitch [length/rad].

    Reference: [DS] Theorem 3.1 (ii).
    """
    return Subspace(S, tolerance=tolerance, argument="S").self_reciprocal(h).basis


def undecided(what: str, system: Subspace) -> BadInput:
    """The error where rounding leaves a type open."""
    digits = (
        f"twists {float(system.error_factors.max()):.1g} of their own lengths ({system.length:.3g}) from the origin"
    )
    expected = f"{what} that rounding does not decide"
    remedy = "Give the twists about a nearer point, or with tolerance= or length= what may count as zero."
    return BadInput("J", digits, expected, remedy)
