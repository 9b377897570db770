"""The error Phi_h that J^{+h} s makes stationary, and psi, [DS]'s map from a commanded to the achieved twist.

    Phi_h(x) = (s - J x)'Q_h(s - J x),   grad = -2 J'Q_h(s - J x),   Hessian = 2 G,   G = J'Q_h J
    Phi_h(J^{+h} s) = det([J s]'Q_h[J s]) / det(J'Q_h J)

Q_h has signature (3, 3), so with rank J >= 4 the stationary point is always a saddle. With Lambda,

    Phi_h(x) + x'Lambda x is stationary at x = (G + Lambda)^-1 J'Q_h s;   psi = J (G + Lambda)^-1 J'Q_h,   s -> J x

The eigenvalues of psi are the gains of the closed loop: mu_i / (mu_i + 1) on J v_i, where G v_i = mu_i Lambda v_i, and
0 on every twist that is h-reciprocal to J. A positive definite Lambda therefore damps only where mu_i > 0:

    Lambda = lambda I, mu the eigenvalues of G     gain mu / (mu + lambda)
        mu > 0                                     between 0 and 1: damped
        -lambda < mu < 0                           negative: the tool is driven away
        mu = -lambda                               a pole
        mu < -lambda                               above 1: the tool overshoots
    Lambda = lambda^2 G^-1                         mu^2 / (mu^2 + lambda^2), in [0, 1) whatever the sign of mu

An arm of rank 4 or more has values mu of both signs for every h; the velocity law uses the last choice.

Reference: [DS] Theorem 6.1, (6.3), (6.4), Example 4; Sect. 6.2, the formulas after it, which have no number. The
formula for Phi_h(J^{+h}s), with it the h of zero error, and the eigenvalues of psi are ours.
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
from invariantqp.systems.gram import gram_matrix, principal_pitches
from invariantqp.systems.pseudoinverses import LARGEST_CONDITION, invert
from invariantqp.systems.subspaces import Subspace, as_system


def psi(J: ArrayLike, h: float, Lambda: ArrayLike) -> Array:
    """psi = J (J'Q_h J + Lambda)^-1 J'Q_h, (6, 6), [DS]'s "modified projection operator".

    It tends to the projector J J^{+h} as Lambda tends to 0, where that exists. Q_h psi is symmetric, so psi is its own
    h-adjoint; a rigid change of frame takes psi to Ad psi Ad^-1, so its eigenvalues are the same in every frame. It is
    a projector only for Lambda = 0.

    Args:
        J: (6, m) joint twists as columns.
        h: finite pitch [length/rad], or inf for half the Killing form.
        Lambda: (m, m) symmetric, definite or not; a (m,) vector is its diagonal, a number a multiple of I [unit of G].

    Raises:
        BadInput: Lambda is at a pole, where G + Lambda is singular.

    Reference: [DS] Sect. 6.2.
    """
    twists = arrays.columns(J)
    m = twists.shape[1]
    expected = f"a symmetric ({m}, {m}) matrix, its {m} diagonal entries, or a number"
    a = arrays.array(Lambda, "Lambda", expected)
    if a.ndim == 0 or a.shape == (m,):
        a = np.diag(np.broadcast_to(a, m))
    if a.shape != (m, m):
        raise BadInput("Lambda", f"shape {a.shape}", expected)
    total = gram_matrix(twists, h) + arrays.symmetric(a, m, "Lambda")
    scale = np.sqrt(np.abs(total).max(axis=0))
    scale[scale == 0.0] = 1.0
    scaled = total / np.outer(scale, scale)
    if not np.linalg.cond(scaled) <= LARGEST_CONDITION:
        found = "a pole: G + Lambda is singular"
        raise BadInput("Lambda", found, "one for which it is not", "Change Lambda or h a little.")
    right = twists.T.dot(pitch_form(h)) / scale[:, None]
    return np.asarray((twists / scale).dot(np.linalg.solve(scaled, right)))


@frozen(eq=False, repr=False, slots=False)
class StationaryPoint(Value):
    """The stationary point J^{+h} s and the error there.

    Attributes:
        velocity: (m,) x = J^{+h} s.
        value: Phi_h(x) [length].
        gradient: (m,) of Phi_h at x, zero up to rounding.
        signature: numbers of positive, negative and zero eigenvalues of J'Q_h J; zeros belong to self-motions.
        condition: condition number of J^{+h}, as `existence` has it.
    """

    velocity: Array = field(converter=own)
    value: float
    gradient: Array = field(converter=own)
    signature: tuple[int, int, int]
    condition: float

    @property
    def kind(self) -> str:
        """One of "minimum", "maximum" and "saddle", self-motions excluded; "flat" if J = 0."""
        up, down, _ = self.signature
        if up and down:
            return "saddle"
        return "minimum" if up else "maximum" if down else "flat"


def error_form(J: ArrayLike, twist: ArrayLike, h: float, velocity: ArrayLike) -> tuple[float, Array]:
    """Phi_h(x) = (s - Jx)'Q_h(s - Jx) [length] and its gradient -2 J'Q_h(s - Jx), (m,).

    For (6, m) joint twists, a commanded twist s (6,), a pitch h [length/rad] and a joint velocity x (m,).

    Reference: [DS] (6.3), and (6.4) with m, not 6, entries in the gradient.
    """
    twists, s = arrays.columns(J), arrays.twist(twist)
    x = arrays.vector(velocity, twists.shape[1], "velocity")
    residual = s - twists.dot(x)
    Q = pitch_form(h)
    return float(residual.dot(Q).dot(residual)), np.asarray(-2.0 * twists.T.dot(Q.dot(residual)))


def stationary_point(J: ArrayLike | Subspace, twist: ArrayLike, h: float) -> StationaryPoint:
    """The stationary point J^{+h} s of Phi_h, its value and its kind; (6, m) twists, s (6,), h finite [length/rad].

    Raises:
        NoPseudoinverse: h is a principal pitch, or no h works.

    Reference: [DS] Theorem 6.1.
    """
    system, s, pitch = as_system(J).exact, arrays.twist(twist), finite_pitch(h)
    factored = invert(system, pitch)
    velocity = factored.inverse.dot(s)
    value, gradient = error_form(system.twists, s, pitch, velocity)
    # The inertia of J'Q_h J is that of U'Q_h U (J = U C, C of full row rank) and m - r zeros.
    U, r = system.span.basis, system.dimension
    up = int(np.count_nonzero(np.linalg.eigvalsh(U.T.dot(system.form(pitch)).dot(U)) > 0.0))
    signature = (up, r - up, system.twists.shape[1] - r)
    return StationaryPoint(velocity, value, gradient, signature, factored.condition)


def vanishing_pitches(J: ArrayLike, twist: ArrayLike) -> Array:
    """The pitches h at which the stationary error Phi_h(J^{+h} s) is zero although J cannot achieve s: (n,) ascending.

    They are the principal pitches [length/rad] of the system that J (6, m) and s (6,) span together. If one of them is
    also a principal pitch of J, there is no J^{+h} at that h.

    Raises:
        BlindSystem: the error is zero for every h, since a translation is reciprocal to J and s together.
        BadInput: s is in the span of J, where the error is zero for every h.

    Reference: [DS] Example 4 ("two values of h where the error vanishes").
    """
    twists, s = arrays.columns(J), arrays.twist(twist)
    joined = np.hstack((twists, s[:, None]))
    if Subspace(joined).dimension == Subspace(twists).dimension:
        raise BadInput("twist", "a twist in the span of J", "one outside it", "The error is zero for every h.")
    return principal_pitches(joined)
