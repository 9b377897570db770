"""The twist error Phi_h(x) = (s - Jx)'Q_h(s - Jx) that J^{+h} s makes stationary, and whether that is a minimum.

    grad Phi_h = -2 J'Q_h(s - Jx),   Hessian = 2 J'Q_h J,   Phi_h(J^{+h}s) = det([J s]'Q_h[J s]) / det(J'Q_h J)

Q_h has signature (3, 3), so with rank J >= 4 the stationary point is always a saddle. The factor 1/2 of [DS] (2.6) is
left out, as in its Example 4.

Reference: [DS] Theorem 6.1, Example 4; the formula for Phi_h(J^{+h}s), and with it the h of zero error, is ours.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.gram import principal_pitches
from invariantqp.systems.pseudoinverse import pseudoinverse
from invariantqp.systems.span import span


@frozen(eq=False, repr=False, slots=False)
class StationaryPoint(Value):
    """The stationary point J^{+h} s and the error there.

    Attributes:
        velocity: (m,) x = J^{+h} s.
        value: Phi_h(x) [length].
        gradient: (m,) of Phi_h at x, zero up to rounding.
        signature: numbers of positive, negative and zero eigenvalues of J'Q_h J; zeros belong to self-motions.
    """

    velocity: Array = field(converter=own)
    value: float
    gradient: Array = field(converter=own)
    signature: tuple[int, int, int]

    @property
    def kind(self) -> str:
        """One of "minimum", "maximum" and "saddle", self-motions left aside; "flat" where J = 0."""
        up, down, _ = self.signature
        if up and down:
            return "saddle"
        return "minimum" if up else "maximum" if down else "flat"


def error_form(J: ArrayLike, twist: ArrayLike, h: float, velocity: ArrayLike) -> tuple[float, Array]:
    """Phi_h(x) = (s - Jx)'Q_h(s - Jx) and its gradient -2 J'Q_h(s - Jx).

    Args:
        J: (6, m) joint twists.
        twist: (6,) the twist s wanted.
        h: pitch [length/rad].
        velocity: (m,) joint velocity x.

    Returns:
        The value [length] and the (m,) gradient.

    Raises:
        BadInput: shapes, NaN.

    Reference: [DS] (6.3), and (6.4) with m, not 6, entries in the gradient.
    """
    twists, s = arrays.columns(J), arrays.twist(twist)
    x = arrays.vector(velocity, twists.shape[1], "velocity")
    left = s - twists.dot(x)
    Q = pitch_form(h)
    return float(left.dot(Q).dot(left)), np.asarray(-2.0 * twists.T.dot(Q.dot(left)))


def stationary_point(J: ArrayLike, twist: ArrayLike, h: float) -> StationaryPoint:
    """The stationary point J^{+h} s of Phi_h, its value and its kind.

    Args:
        J: (6, m) joint twists.
        twist: (6,) the twist s wanted.
        h: finite pitch [length/rad].

    Raises:
        NoPseudoinverse: h is a principal pitch, or no h works.
        BadInput: shapes, NaN.

    Reference: [DS] Theorem 6.1.
    """
    twists = arrays.columns(J)
    pitch = finite_pitch(h)
    velocity = pseudoinverse(twists, pitch).dot(arrays.twist(twist))
    value, gradient = error_form(twists, twist, pitch, velocity)
    system = span(twists)
    # The inertia of J'Q_h J is that of U'Q_h U (J = U C, C of full row rank) and m - r zeros.
    mu = np.linalg.eigvalsh(system.basis.T.dot(pitch_form(pitch / system.unit)).dot(system.basis))
    up = int(np.count_nonzero(mu > 0.0))
    return StationaryPoint(velocity, value, gradient, (up, system.rank - up, twists.shape[1] - system.rank))


def vanishing_pitches(J: ArrayLike, twist: ArrayLike) -> Array:
    """The pitches h at which the stationary error Phi_h(J^{+h} s) is zero although J cannot achieve s.

    They are the principal pitches of the system that J and s span together. If one of them is also a principal pitch of
    J, there is no J^{+h} at that h.

    Args:
        J: (6, m) joint twists.
        twist: (6,) the twist s wanted, not in the span of J.

    Returns:
        (n,) ascending pitches [length/rad].

    Raises:
        BlindSystem: the error is zero for every h, since a translation is reciprocal to J and s together.
        BadInput: s is in the span of J, where the error is zero for every h; shapes, NaN.

    Reference: [DS] Example 4 ("two values of h where the error vanishes").
    """
    twists, s = arrays.columns(J), arrays.twist(twist)
    joined = np.hstack((twists, s[:, None]))
    if span(joined).rank == span(twists).rank:
        raise BadInput("twist", "a twist in the span of J", "one outside it", "The error is zero for every h.")
    return principal_pitches(joined)
