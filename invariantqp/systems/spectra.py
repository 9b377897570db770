"""Hyperbolic singular values and polar decomposition, which [DS] asks for in its last section.

    J'Q_h J v_i = mu_i M v_i,   v_i'M v_j = delta_ij,   sigma_i = sign(mu_i) sqrt|mu_i|,   t_i = J v_i
    J = W S = R W,   S = |G|^(1/2) = sum g_i v_i v_i'M,   W v_i = w_i = J v_i / g_i,   g_i = sqrt|mu_i|

The mu_i and the gains depend on the joint positions, h and the joint metric M alone, where ordinary singular values
change with the origin of the frame; the twists t_i, w_i move with the arm. Q_h is indefinite, so mu_i can be negative:
the sign is that of w_i'Q_h w_i = 2 |omega|^2 (pitch - h), positive for a screw of pitch above h. At rank 6 the product
of the |sigma_i| is sqrt det(J M^-1 J'), for every h. A small gain belongs to a screw of pitch near h, or to joints that
are nearly dependent.

With G = M^-1 J'Q_h J, all gains of W are one, and R is S on twists. W is an isometry up to signs, W'Q_h W = M sign(G):
it exists iff the kernel of G is that of J, that is iff J has an h-pseudoinverse. It is an isometry (Higham, Mehl and
Tisseur) iff, in addition, G has no negative eigenvalue: for rank J <= 3 without translations and h below all principal
pitches, above all of them for -Q_h, and for rank 4 or more never. S and W are unique on the joint velocities that move
the tool, and zero on the others.

Reference: asked for in [DS] Sect. 7. Bolshakov, van der Mee, Ran, Reichstein and Rodman 1997; Higham, Mehl and Tisseur
2010.
"""

from __future__ import annotations

from math import inf

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import NoPolarDecomposition, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.pseudoinverses import LARGEST_CONDITION, invert, spectrum
from invariantqp.systems.subspaces import Subspace, as_system


@frozen(eq=False, repr=False, slots=False)
class HyperbolicSpectrum(Value):
    """Generalised eigenvalues of (J'Q_h J, M) and their directions, |mu| descending.

    Attributes:
        h: the pitch [length/rad].
        rank: rank of J; the last m - rank values are zero because joints are dependent.
        values: (m,) mu_i [length, over the metric's unit].
        joint_directions: (m, m) v_i as columns, M-orthonormal.
        twists: (6, m) t_i = J v_i, mutually h-reciprocal.
        condition: largest over smallest |sigma_i| of the first `rank`; inf if the smallest |mu_i| may be rounding, as
            at a principal pitch and if no h works.
    """

    h: float
    rank: int
    values: Array = field(converter=own)
    joint_directions: Array = field(converter=own)
    twists: Array = field(converter=own)
    condition: float

    @property
    def singular_values(self) -> Array:
        """(m,) sign(mu) sqrt|mu|."""
        return np.asarray(np.sign(self.values) * np.sqrt(np.abs(self.values)))


def hyperbolic_singular_values(
    J: ArrayLike | Subspace, h: float, *, joint_metric: ArrayLike | None = None
) -> HyperbolicSpectrum:
    """The hyperbolic singular values of (6, m) twists, with principal joint directions and twists.

    Args:
        J: (6, m) joint twists, or a `ScrewSystem`.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity. Give one for
            revolute and prismatic joints together: without it the result depends on the unit of length.

    Reference: asked for in [DS] Sect. 7; J'Q_h J is the subject of Sect. 3.
    """
    system, pitch = as_system(J).exact, finite_pitch(h)
    values, V = spectrum(system, pitch, joint_metric)
    r = system.dimension
    values[r:] = 0.0
    # The error of mu for an error of one in J is at most |J v|^2 |Q_h|.
    sizes = (system.coordinates.dot(V) ** 2).sum(axis=0)[:r]
    error = float(sizes.max(initial=0.0)) * float(np.linalg.norm(system.form(pitch), 2)) * system.length
    least = float(np.abs(values[:r]).min(initial=inf))
    gains = np.sqrt(np.abs(values[:r]))
    condition = 1.0 if not r else inf if least <= system.rounding * error else float(gains[0] / gains[-1])
    return HyperbolicSpectrum(pitch, r, values, V, system.twists.dot(V), condition)


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


def hyperbolic_polar(J: ArrayLike | Subspace, h: float, *, joint_metric: ArrayLike | None = None) -> HyperbolicPolar:
    """The hyperbolic polar decomposition of (6, m) twists; arguments are those of `hyperbolic_singular_values`.

    Raises:
        NoPolarDecomposition: h is a principal pitch of the system, or too near one for three correct digits; or no h
            works; or gains differ by a factor above a million, so that the least is rounding. Carries the proof.

    Reference: asked for in [DS] Sect. 7.
    """
    system, pitch = as_system(J), finite_pitch(h)
    result = hyperbolic_singular_values(system, pitch, joint_metric=joint_metric)
    r, m = result.rank, system.twists.shape[1]
    mu, V, moved = result.values[:r], result.joint_directions[:, :r], result.twists[:, :r]
    try:
        invert(system, pitch)
    except NoPseudoinverse as error:
        proof = (error.h, error.rank, error.gram_rank, error.self_reciprocal, error.principal_pitches)
        raise NoPolarDecomposition(*proof) from error
    if r and abs(mu[0]) >= LARGEST_CONDITION * abs(mu[-1]):
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
