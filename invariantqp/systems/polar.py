"""The hyperbolic polar decomposition J = W S: S stretches joint velocities, W moves the tool with all gains one.

    G = M^-1 J'Q_h J,   G v_i = mu_i v_i,   v_i'M v_j = delta_ij          w_i = J v_i / g_i,   g_i = sqrt|mu_i|
    J = W S = R W       S = |G|^(1/2) = sum g_i v_i v_i'M                W'Q_h W = M sign(G),   W v_i = w_i

The g_i are the principal gains. R is S seen on the tool's side: it stretches w_i by g_i.

When it exists. Joint velocities are measured by a definite form M, twists by Q_h of signature (3, 3), and W has to
carry the one to the other.

- W an isometry, W'Q_h W = M on the joints that move (the canonical polar decomposition of Higham, Mehl and Tisseur):
  iff G has no negative eigenvalue and its kernel is that of J. This takes rank J <= 3 and an h below all principal
  pitches; with h above all of them it exists for -Q_h. With rank 4 or more there is none for any h. See `isometry`.
- W an isometry up to signs, W'Q_h W = M sign(G), which is computed here: iff the kernel of G is that of J, which is to
  say iff J has an h-pseudoinverse. At a principal pitch there is none: G, and with it S, is zero on a joint velocity
  that moves the tool by a screw z, so W S cannot be J. Blind systems have none for any h.

S and W are unique on the joint velocities that move the tool, given that W^{*h} W = sign(G) commutes with S; both are
zero on the others.

What it says about the arm. S and the gains are the same in every frame; a rigid change of frame takes W to Ad W and R
to Ad R Ad^-1. A joint velocity of unit size along v_i moves the tool by the twist g_i w_i. The product of the gains is
the manipulability, their ratio tells the distance from a singularity, and a small gain belongs to a screw of pitch near
h. Its sign is that of w_i'Q_h w_i = 2 |omega|^2 (pitch - h): positive for a screw w_i of pitch above h.

Reference: asked for in [DS] Sect. 7. Bolshakov, van der Mee, Ran, Reichstein and Rodman 1997; Higham, Mehl and Tisseur
2010.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import NoPolarDecomposition, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.hyperbolic import hyperbolic_singular_values
from invariantqp.systems.pseudoinverse import pseudoinverse

# Least over largest |mu| below which rounding of the largest leaves the least fewer than three digits.
LEAST_SHARE = 1e-12


@frozen(eq=False, repr=False, slots=False)
class HyperbolicPolar(Value):
    """The factors of J = W S = R W.

    Attributes:
        h: the pitch [length/rad].
        movement: (6, m) W, an isometry up to signs; zero on self-motions.
        stretch: (m, m) S, joint velocities to joint velocities; M S is symmetric, S >= 0.
        twist_stretch: (6, 6) R, twists to twists; Q_h R is symmetric.
        gains: (r,) principal gains sqrt|mu_i|, descending.
        signs: (r,) of mu_i, 1 or -1.
        joint_directions: (m, r) v_i as columns, M-orthonormal.
        screws: (6, r) w_i = J v_i / gain as columns, mutually h-reciprocal, of h-norm `signs`.
    """

    h: float
    movement: Array = field(converter=own)
    stretch: Array = field(converter=own)
    twist_stretch: Array = field(converter=own)
    gains: Array = field(converter=own)
    signs: Array = field(converter=own)
    joint_directions: Array = field(converter=own)
    screws: Array = field(converter=own)

    @property
    def isometry(self) -> int:
        """1 where W is an isometry of the joint metric into Q_h, -1 into -Q_h, 0 where signs are mixed."""
        least, most = int(self.signs.min(initial=1.0)), int(self.signs.max(initial=-1.0))
        return least if least == most else 0


def hyperbolic_polar(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> HyperbolicPolar:
    """The hyperbolic polar decomposition of (6, m) twists.

    Args:
        J: (6, m) joint twists as columns, dependent or not.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity. Where joints
            turn and slide, give one: else the answer depends on the unit of length.

    Returns:
        HyperbolicPolar, in the frame of J.

    Raises:
        NoPolarDecomposition: h is a principal pitch of the system, or too near one for three correct digits; or no h
            works; or gains differ by a factor above a million, so that the least is rounding. Carries the proof.
        BadInput: shapes, NaN, infinite h, a metric that is not positive definite.

    Reference: asked for in [DS] Sect. 7.
    """
    twists, pitch = arrays.columns(J), finite_pitch(h)
    spectrum = hyperbolic_singular_values(twists, pitch, joint_metric=joint_metric)
    r, m = spectrum.rank, twists.shape[1]
    mu, V, moved = spectrum.values[:r], spectrum.joint_directions[:, :r], spectrum.twists[:, :r]
    try:
        pseudoinverse(twists, pitch)
    except NoPseudoinverse as error:
        proof = (error.h, error.rank, error.gram_rank, error.self_reciprocal, error.principal_pitches)
        raise NoPolarDecomposition(*proof) from error
    if r and abs(mu[-1]) <= LEAST_SHARE * abs(mu[0]):
        z = moved[:, -1] / np.linalg.norm(moved[:, -1])
        raise NoPolarDecomposition(pitch, r, r, z, np.empty(0))
    gains, signs = np.sqrt(np.abs(mu)), np.sign(mu)
    screws = moved / gains
    M = np.eye(m) if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    covectors = V.T.dot(M)
    return HyperbolicPolar(
        h=pitch,
        movement=screws.dot(covectors),
        stretch=(V * gains).dot(covectors),
        twist_stretch=(screws * gains * signs).dot(pitch_form(pitch).dot(screws).T),
        gains=gains,
        signs=signs,
        joint_directions=V,
        screws=screws,
    )
