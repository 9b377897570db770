"""What [DS] asks for in its last section: singular values, polar decomposition, and the legs of parallel mechanisms.

    J'Q_h J v_i = mu_i M v_i,   v_i'M v_j = delta_ij,   sigma_i = sign(mu_i) sqrt|mu_i|,   t_i = J v_i
    J = W S = R W,   S = |G|^(1/2) = sum g_i v_i v_i'M,   W v_i = w_i = J v_i / g_i,   g_i = sqrt|mu_i|

The mu_i and the gains depend on the joint positions, h and the joint metric M alone, where ordinary singular values
change with the origin of the frame; the twists t_i, w_i move with the arm. Q_h is indefinite, so mu_i can be negative:
the sign is that of w_i'Q_h w_i = 2 |omega|^2 (pitch - h), positive for a screw of pitch above h. At rank 6 the product
of the |sigma_i| is sqrt det(J M^-1 J'), for every h. A small gain belongs to a screw of pitch near h.

With G = M^-1 J'Q_h J, W moves the tool with all gains one, and R is S seen on the tool's side. W is an isometry up to
signs, W'Q_h W = M sign(G): it exists iff the kernel of G is that of J, which is to say iff J has an h-pseudoinverse. It
is an isometry (Higham, Mehl and Tisseur) iff G has no negative eigenvalue besides: for rank J <= 3 and h below all
principal pitches, above all of them for -Q_h, and for rank 4 or more never. S and W are unique on the joint velocities
that move the tool, and zero on the others.

Parallel mechanisms have wrenches W of the legs instead of joint twists:

    W^{+h} = (W'Q_h^-1 W)^-1 W'Q_h^-1 = (Q_0 W)^{+(-h)} Q_0        K = W diag(k) W'

Q_0 swaps the halves of a wrench, which makes it a twist and Q_h^-1 the form Q_{-h}. The non-zero eigenvalues of
K Q_h^-1 are those of (W'Q_h^-1 W, diag(1/k)): the same in every frame.

Reference: asked for in [DS] Sect. 7; W^{+h} is that of Sect. 6.3. Bolshakov, van der Mee, Ran, Reichstein and Rodman
1997; Higham, Mehl and Tisseur 2010.
"""

from __future__ import annotations

from math import inf

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, NoPolarDecomposition, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.gram import gram_matrix
from invariantqp.systems.pseudoinverses import LARGEST_CONDITION, pseudoinverse
from invariantqp.systems.subspaces import span


@frozen(eq=False, repr=False, slots=False)
class HyperbolicSpectrum(Value):
    """Generalised eigenvalues of (J'Q_h J, M) and their directions, |mu| descending.

    Attributes:
        h: the pitch [length/rad].
        rank: rank of J; the last m - rank values are zero because joints are dependent.
        values: (m,) mu_i [length, over the metric's unit].
        joint_directions: (m, m) v_i as columns, M-orthonormal.
        twists: (6, m) t_i = J v_i, mutually h-reciprocal.
    """

    h: float
    rank: int
    values: Array = field(converter=own)
    joint_directions: Array = field(converter=own)
    twists: Array = field(converter=own)

    @property
    def singular_values(self) -> Array:
        """(m,) sign(mu) sqrt|mu|."""
        return np.asarray(np.sign(self.values) * np.sqrt(np.abs(self.values)))

    @property
    def condition(self) -> float:
        """Largest over smallest |sigma_i| of the first `rank`; 1e8 or more where J^{+h} does not exist."""
        counted = np.abs(self.singular_values[: self.rank])
        if not self.rank:
            return 1.0
        return float(counted[0] / counted[-1]) if counted[-1] > 0.0 else inf


def hyperbolic_singular_values(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> HyperbolicSpectrum:
    """The hyperbolic singular values of (6, m) twists, with principal joint directions and twists.

    Args:
        J: (6, m) joint twists.
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite metric M on joint velocities; None is the identity. Where joints
            turn and slide, give one: without it the answer depends on the unit of length.

    Reference: asked for in [DS] Sect. 7; J'Q_h J is the subject of Sect. 3.
    """
    twists = arrays.columns(J)
    pitch = finite_pitch(h)
    m = twists.shape[1]
    M = np.eye(m) if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    whiten = np.linalg.inv(np.linalg.cholesky(M)).T
    mu, V = np.linalg.eigh(whiten.T.dot(gram_matrix(twists, pitch)).dot(whiten))
    V = whiten.dot(V)
    rank = span(twists).rank
    order = np.argsort(-np.abs(mu), kind="stable")
    values, V = mu[order], V[:, order]
    values[rank:] = 0.0
    return HyperbolicSpectrum(pitch, rank, values, V, twists.dot(V))


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


def hyperbolic_polar(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> HyperbolicPolar:
    """The hyperbolic polar decomposition of (6, m) twists; arguments are those of `hyperbolic_singular_values`.

    Raises:
        NoPolarDecomposition: h is a principal pitch of the system, or too near one for three correct digits; or no h
            works; or gains differ by a factor above a million, so that the least is rounding. Carries the proof.

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


def leg_wrenches(base: ArrayLike, platform: ArrayLike) -> Array:
    """Unit forces along legs from base points to platform points, as wrenches (6, n), (b x u; u).

    W' is the inverse Jacobian: leg speeds = W's for the platform twist s, and W f is the wrench on the platform of the
    leg forces f (positive: the leg pushes). Both are (n, 3) points, one a leg, in one frame [length].

    Reference: [DS] Sect. 6.3, 7.
    """
    b = arrays.matrix(base, (None, 3), "base")
    legs = arrays.matrix(platform, (len(b), 3), "platform") - b
    lengths = np.sqrt((legs * legs).sum(axis=1))
    if len(b) == 0 or not lengths.all():
        found = f"leg {int(lengths.argmin())} of length zero" if len(b) else "no legs"
        raise BadInput("platform", found, "at least one leg, each longer than zero", "A leg joins two distinct points.")
    u = legs / lengths[:, None]
    return np.vstack((np.cross(b, u).T, u.T))


def wrench_pseudoinverse(W: ArrayLike, h: float) -> Array:
    """W^{+h} (n, 6), the h-pseudoinverse of (6, n) wrenches (m; f): leg forces f = W^{+h} w for the wrench w.

    Args:
        W: (6, n) wrenches as columns, of any rank.
        h: finite pitch [length/rad]; wrenches are measured by Q_h^-1.

    Raises:
        NoPseudoinverse: W'Q_h^-1 W is singular; its pitches are those of this form, its screw is Q_0 w of a wrench w.

    Reference: [DS] Sect. 6.3.
    """
    wrenches = arrays.columns(W, "W")
    pitch = finite_pitch(h)
    swap = pitch_form(0.0)
    try:
        result: Array = pseudoinverse(swap.dot(wrenches), -pitch).dot(swap)
    except NoPseudoinverse as error:
        raise NoPseudoinverse(
            h=pitch,
            rank=error.rank,
            gram_rank=error.gram_rank,
            self_reciprocal=error.self_reciprocal,
            principal_pitches=-error.principal_pitches,
        ) from error
    return result


def platform_stiffness(W: ArrayLike, leg_stiffness: ArrayLike) -> Array:
    """The stiffness K = W diag(k) W' of a platform on unloaded legs: wrench = K s for a small displacement twist s.

    It is (6, 6), symmetric, positive definite iff the legs have rank 6; a rigid motion takes K to Ad* K Ad*'. W are the
    (6, n) unit leg wrenches, k (n,) above zero [force/length].

    Reference: asked for in [DS] Sect. 7.
    """
    wrenches = arrays.columns(W, "W")
    k = _leg_stiffness(leg_stiffness, wrenches.shape[1])
    return np.asarray((wrenches * k).dot(wrenches.T))


def leg_spectrum(W: ArrayLike, h: float, leg_stiffness: ArrayLike | None = None) -> HyperbolicSpectrum:
    """The conditioning of (6, n) unit leg wrenches, the same in every frame: eigenvalues of (W'Q_h^-1 W, diag(1/k)).

    `.condition` tells how near the legs are to singular, `.joint_directions` are leg forces, and `.twists` are the
    principal wrenches W v_i with their halves swapped: the screws along which they act. h is finite [length/rad], the
    stiffness k (n,) above zero [force/length], the same for each leg if left out.

    Reference: asked for in [DS] Sect. 7.
    """
    wrenches = arrays.columns(W, "W")
    compliance = None if leg_stiffness is None else 1.0 / _leg_stiffness(leg_stiffness, wrenches.shape[1])
    return hyperbolic_singular_values(pitch_form(0.0).dot(wrenches), -finite_pitch(h), joint_metric=compliance)


def _leg_stiffness(value: ArrayLike, n: int) -> Array:
    k = arrays.vector(value, n, "leg_stiffness")
    if not (k > 0.0).all():
        raise BadInput(
            "leg_stiffness", f"{k.min():.4g}", "stiffnesses above zero", "Leave out legs that carry no force."
        )
    return k
