"""Whether S has an h-pseudoinverse, asked in three independent ways, and the twist z that proves that it has none.

    (i) rank(J'Q_h J) < rank(J)     (ii) S meets S^{perp h}     (iii) S is tangent to q_h at a point z of S

(i) is a value of the form on S, (ii) the angle between two subspaces that are computed apart, (iii) a critical value
of the pitch on S (or a translation that no form sees). They are equivalent; each is computed without the others, and
each number counts as zero below what an error of the twists that costs three digits could make of zero.
[DS] prints (iii) with "at some non-zero point" but proves it for a point of S, and needs that: every 1- and 2-system
lies in the tangent space at some null twist outside it, whether or not it has a pseudoinverse.

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
from invariantqp.systems.span import Span, span
from invariantqp.systems.subspaces import reciprocal


@frozen(eq=False, repr=False, slots=False)
class Existence(Value):
    """The three conditions of Theorem 3.1, each with the number that vanishes where it holds.

    Attributes:
        h: the pitch asked for [length/rad].
        rank: rank of J.
        condition: the condition number of J^{+h}: how many times larger than the relative error of the twists its own
            can be.
        gram_rank: (i) rank of J'Q_h J, as far as rounding lets it be told.
        gram_eigenvalue: (i) least |eigenvalue| of U'Q_h U over |Q_h|, U an orthonormal basis of S.
        angle: (ii) least angle between S and S^{perp h} [rad].
        pitch_distance: (iii) |h - h_i| to the nearest principal pitch, in units of |h| + the system's length; 0 where
            some translation is reciprocal to all of S, inf where nothing ever fails.
        degenerate: (i), (ii), (iii) as they came out.
        certificate: (6,) z in S, h-reciprocal to all of S; None where (i) does not hold.
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
        """Whether there is an h-pseudoinverse that rounding leaves three digits, as `has_pseudoinverse` says."""
        return self.condition <= LARGEST_CONDITION

    @property
    def agree(self) -> bool:
        """Whether the three say the same; they may differ only where all three numbers are at their tolerances."""
        return len(set(self.degenerate)) == 1


def existence(J: ArrayLike, h: float) -> Existence:
    """Ask Theorem 3.1 whether (6, m) twists have an h-pseudoinverse.

    Args:
        J: (6, m) twists, dependent or not: rank(J) takes the place of m.
        h: finite pitch [length/rad].

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Theorem 3.1; the certificate is the z of its proof.
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
    """The system with lengths measured in `length`, its own or |h| where that is longer.

    Attributes:
        system: the span, in its own unit of length.
        sizes: (m,) of the columns there.
        basis: (6, r) orthonormal.
        form: (6, 6) Q_h.
        length: the length that counts as 1 in `basis` and `form`.
    """

    system: Span
    sizes: Array
    basis: Array
    form: Array
    length: float

    def scaled(self, z: Array) -> Array:
        """A unit twist along z (6,), which is measured in the caller's unit of length."""
        result = z.copy()
        result[3:] /= self.length
        return np.asarray(result / np.linalg.norm(result))

    def resolution(self, z: Array) -> float:
        """How far off a unit twist z of the system may be: by the error of the twists that costs three digits."""
        own = z.copy()
        own[3:] *= self.length / self.system.unit
        velocity = self.system.right.dot(self.system.basis.T.dot(own) / self.system.singular)
        return float(self.sizes.dot(np.abs(velocity))) / LARGEST_CONDITION


def _view(twists: Array, h: float, found: Factors) -> _View:
    system = span(twists)
    length = max(system.unit, abs(h))
    screws = found.screws.copy()
    screws[3:] /= length
    sizes = np.linalg.norm(system.scaled_rows(twists.T), axis=1)
    return _View(system, sizes, np.linalg.qr(screws)[0], pitch_form(h / length), length)


def _gram_eigenvalue(system: Span, h: float) -> float:
    Q = pitch_form(h / system.unit)
    mu = np.linalg.eigvalsh(system.basis.T.dot(Q).dot(system.basis))
    return float(np.abs(mu).min() / np.abs(Q).max())


def _least_angle(view: _View) -> tuple[float, bool]:
    """Between S and S^{perp h}, from the two bases side by side, 2 arcsin(sigma_min / sqrt 2); whether it is zero."""
    r = view.basis.shape[1]
    other = np.linalg.qr(view.form.dot(view.basis), mode="complete")[0][:, r:]
    _, sigma, Vt = np.linalg.svd(np.hstack((view.basis, other)))
    z = view.basis.dot(Vt[-1, :r])
    angle = float(2.0 * np.arcsin(min(1.0, sigma[-1] / np.sqrt(2.0))))
    # An error of S moves S^{perp h} likewise, so it counts twice.
    return angle, angle <= 2.0 * view.resolution(z / np.linalg.norm(z))


def _pitch_distance(twists: Array, h: float, view: _View) -> tuple[float, bool]:
    """From h to the nearest pitch whose hyperquadric S is tangent to; whether S is tangent to that of h."""
    try:
        pitches, screws = principal_screws(twists)
    except BlindSystem:
        return 0.0, True
    if not len(pitches):
        return inf, False
    i = int(np.abs(pitches - h).argmin())
    z = view.scaled(screws[:, i])
    # z'Q_h z = 2 (h_i - h) |omega|^2, against what an error of z makes of it.
    value = 2.0 * abs(pitches[i] - h) / view.length * z[:3].dot(z[:3])
    tangent = value <= 2.0 * float(np.linalg.norm(view.form.dot(z))) * view.resolution(z)
    return float(abs(pitches[i] - h)) / (abs(h) + view.system.unit), bool(tangent)


def reciprocal_has_pseudoinverse(J: ArrayLike, h: float) -> bool:
    """Whether S^{perp h} has an h-pseudoinverse: it has exactly if S has, which is a check on both.

    S^{perp h} is as well known as S is: an error of a twist of J counts as often here as it moves the screws of both.

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Corollary 3.2.
    """
    twists, pitch = arrays.columns(J), finite_pitch(h)
    other = factors(reciprocal(twists, pitch), pitch)
    view = _view(twists, pitch, factors(twists, pitch))
    moved = [LARGEST_CONDITION * view.resolution(view.scaled(z)) for z in other.screws.T]
    return bool((other.shares * np.maximum(1.0, moved) <= LARGEST_CONDITION).all())
