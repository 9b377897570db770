"""The three equivalent conditions under which a screw system S has no h-pseudoinverse, each computed by itself.

    (i) rank(J'Q_h J) < rank(J)     (ii) S meets S^{perp h}     (iii) S is tangent to q_h at a point z of S

(i) is an eigenvalue problem, (ii) an angle between two subspaces, (iii) the distance from h to a principal pitch (or
a translation that is reciprocal to all of S). Each gives a number that is zero in exact arithmetic. Here it counts as
zero if an error of the twists small enough to leave J^{+h} three correct digits could have made it zero.

[DS] prints (iii) with "at some non-zero point" where a point of S is meant and needed: every 1- and 2-system lies in
the tangent space at some null twist outside it, whether or not it has a pseudoinverse.

Reference: [DS] Theorem 3.1, Corollary 3.2.
"""

from __future__ import annotations

from math import inf, pi
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.factors import LARGEST_CONDITION, Factors, factors
from invariantqp.systems.gram import principal_screws
from invariantqp.systems.span import Span, lengths, orthogonal, span
from invariantqp.systems.subspaces import reciprocal


@frozen(eq=False, repr=False, slots=False)
class Existence(Value):
    """The three conditions of Theorem 3.1, each with the number that vanishes where it holds.

    Attributes:
        h: the pitch asked for [length/rad].
        rank: rank of J.
        condition: condition number of J^{+h}, the ratio of its relative error to that of the twists, at worst.
        gram_rank: (i) numerical rank of J'Q_h J.
        gram_eigenvalue: (i) least |eigenvalue| of U'Q_h U over |Q_h|, U an orthonormal basis of S.
        angle: (ii) least angle between S and S^{perp h} [rad].
        pitch_distance: (iii) |h - h_i| to the nearest principal pitch, in units of |h| + the system's length; 0 where
            some translation is reciprocal to all of S, inf where every pitch works.
        degenerate: whether (i), (ii) and (iii) hold; they can differ only where their numbers are at the tolerance.
        certificate: (6,) z in S, h-reciprocal to all of S, which proves that there is no h-pseudoinverse; None where
            (i) does not hold.
    """

    h: float
    rank: int
    condition: float
    gram_rank: int
    gram_eigenvalue: float
    angle: float
    pitch_distance: float
    degenerate: tuple[bool, bool, bool]
    certificate: Array | None = field(converter=optional(own))

    @property
    def exists(self) -> bool:
        """Whether S has an h-pseudoinverse that can be computed to three digits; the same as `has_pseudoinverse`."""
        return self.condition <= LARGEST_CONDITION


def existence(J: ArrayLike, h: float) -> Existence:
    """Evaluate the three conditions of Theorem 3.1 for (6, m) twists.

    Args:
        J: (6, m) twists. They may be dependent: rank(J) takes the place of m in the theorem.
        h: finite pitch [length/rad].

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Theorem 3.1; `certificate` is the z of its proof.
    """
    twists, pitch = arrays.columns(J), finite_pitch(h)
    found = factors(twists, pitch)
    if found.rank in (0, 6):
        never = (False, False, False)
        return Existence(pitch, found.rank, found.condition, found.rank, 1.0, 0.5 * pi, inf, never, None)
    view = _view(twists, pitch, found)
    angle, meets = _least_angle(view)
    distance, tangent = _pitch_distance(twists, pitch, view)
    singular = found.gram_rank < found.rank
    return Existence(
        h=pitch,
        rank=found.rank,
        condition=found.condition,
        gram_rank=found.gram_rank,
        gram_eigenvalue=_gram_eigenvalue(view.system, pitch),
        angle=angle,
        pitch_distance=distance,
        degenerate=(singular, meets, tangent),
        certificate=found.lost if singular else None,
    )


class _View(NamedTuple):
    """The system with lengths measured in its own unit, or in |h| where that is longer."""

    system: Span  # the span, in its own unit of length
    sizes: Array  # (m,) of the columns there
    basis: Array  # (6, r) orthonormal
    form: Array  # (6, 6) Q_h
    length: float  # the length that counts as 1 in `basis` and `form`

    def unit_twist(self, z: Array) -> Array:
        """The unit twist along z (6,), from the caller's unit of length."""
        result = z / lengths(self.length)[:, 0]
        return np.asarray(result / np.linalg.norm(result))

    def resolution(self, z: Array) -> float:
        """The error of a unit twist z of the system when J has the largest error that leaves J^{+h} three digits."""
        own = z * lengths(self.length / self.system.unit)[:, 0]
        velocity = self.system.right.dot(self.system.basis.T.dot(own) / self.system.singular)
        return float(self.sizes.dot(np.abs(velocity))) / LARGEST_CONDITION


def _view(twists: Array, h: float, found: Factors) -> _View:
    system = span(twists)
    length = max(system.unit, abs(h))
    sizes = np.linalg.norm(system.scaled(twists), axis=0)
    return _View(system, sizes, np.linalg.qr(found.screws / lengths(length))[0], pitch_form(h / length), length)


def _gram_eigenvalue(system: Span, h: float) -> float:
    Q = pitch_form(h / system.unit)
    mu = np.linalg.eigvalsh(system.basis.T.dot(Q).dot(system.basis))
    return float(np.abs(mu).min() / np.abs(Q).max())


def _least_angle(view: _View) -> tuple[float, bool]:
    """The angle between S and S^{perp h}, 2 arcsin(sigma_min / sqrt 2) of both bases; whether it counts as zero."""
    r = view.basis.shape[1]
    other = orthogonal(view.form.dot(view.basis))
    _, sigma, Vt = np.linalg.svd(np.hstack((view.basis, other)))
    z = view.basis.dot(Vt[-1, :r])
    angle = float(2.0 * np.arcsin(min(1.0, sigma[-1] / np.sqrt(2.0))))
    # An error in S moves S^{perp h} by as much, so it counts twice.
    return angle, angle <= 2.0 * view.resolution(z / np.linalg.norm(z))


def _pitch_distance(twists: Array, h: float, view: _View) -> tuple[float, bool]:
    """The distance from h to the nearest principal pitch, and whether it counts as zero."""
    try:
        pitches, screws = principal_screws(twists)
    except BlindSystem:
        return 0.0, True
    if not len(pitches):
        return inf, False
    i = int(np.abs(pitches - h).argmin())
    z = view.unit_twist(screws[:, i])
    # |z'Q_h z| = 2 |h_i - h| |omega|^2, compared with the change that an error of z makes.
    value = 2.0 * abs(pitches[i] - h) / view.length * z[:3].dot(z[:3])
    tangent = value <= 2.0 * float(np.linalg.norm(view.form.dot(z))) * view.resolution(z)
    return float(abs(pitches[i] - h)) / (abs(h) + view.system.unit), bool(tangent)


def reciprocal_has_pseudoinverse(J: ArrayLike, h: float) -> bool:
    """Whether S^{perp h} has an h-pseudoinverse: by the paper's corollary, iff S has.

    S^{perp h} is computed from J, so its twists have larger errors than those of J; that is taken into account.

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Corollary 3.2.
    """
    twists, pitch = arrays.columns(J), finite_pitch(h)
    other = factors(reciprocal(twists, pitch), pitch)
    view = _view(twists, pitch, factors(twists, pitch))
    errors = [LARGEST_CONDITION * view.resolution(view.unit_twist(z)) for z in other.screws.T]
    return bool((other.shares * np.maximum(1.0, errors) <= LARGEST_CONDITION).all())
