"""Stiffness: legs of parallel mechanisms, their h-pseudoinverse, and the eigenscrews of any stiffness or compliance.

    W^{+h} = (W'Q_h^-1 W)^-1 W'Q_h^-1 = (Q_0 W)^{+(-h)} Q_0        K = W diag(k) W'        K t = lambda Q_0 t

Q_0 swaps the halves of a wrench, which makes it a twist and Q_h^-1 the form Q_{-h}. The non-zero eigenvalues of
K Q_h^-1 are those of (W'Q_h^-1 W, diag(1/k)): the same in every frame. A stiffness K = [[A, B], [B', D]] is a sum of
three springs along wrenches and three about couples,

    K = sum k_i w_i w_i' + sum c_i (n_i; 0)(n_i; 0)',   D n = k n,  w = (B n / k; n),   (A - B D^+ B') n = c n

Reference: [DS] Sect. 6.3 (W^{+h}), asked for in Sect. 7. H. Lipkin and T. Patterson, Geometrical properties of modelled
robot elasticity, ASME 1992, and Structure of robot compliance, J. Mech. Des. 115 (1993): eigenscrews, the two families
of axes; J. Loncaric, Normal forms of stiffness and compliance matrices, IEEE J. Robot. Autom. 3 (1987): the centre.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.linear import TINY
from invariantqp.geometry.se3 import SWAPPED, cross_matrix
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.pseudoinverses import pseudoinverse
from invariantqp.systems.spectra import HyperbolicSpectrum, hyperbolic_singular_values
from invariantqp.systems.subspaces import ROUNDING_ERROR


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
        proof = (error.rank, error.gram_rank, error.self_reciprocal)
        raise NoPseudoinverse(pitch, *proof, -error.principal_pitches) from error
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

    `.condition` is that of the legs, `.joint_directions` are leg forces, and `.twists` are the screws along which the
    principal wrenches W v_i act. h is finite [length/rad], the stiffness k (n,) above zero [force/length], by default
    the same for each leg.

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


@frozen(eq=False, repr=False, slots=False)
class Eigenscrews(Value):
    """Screws, centre and axes of a stiffness K (twist to wrench) or of a compliance C (wrench to twist).

    Attributes:
        values: (r,) r the rank; lambda of K t = lambda Q_0 t [force/rad], or of C w = lambda Q_0 w; descending. Three
            are positive and three negative if K is definite; the sum is zero if K is made of springs along lines.
        screws: (6, r) eigenscrews, mutually reciprocal: twists t of K, wrenches w of C; of unit angular part or force,
            or, if that is zero, of unit translation or moment.
        pitches: (r,) of the eigenscrews [length/rad].
        centre: (3,) the point about which the coupling block of K, or of C, is symmetric; None if it is not unique. The
            centres of K and of C = K^-1 generally differ.
        translational: (a,) principal stiffnesses against translation [force/length], or compliances, descending.
        force_axes: (6, a) for each a wrench of unit force, which translates the body along that force.
        rotational: (b,) principal stiffnesses against rotation [moment/rad], or compliances, descending.
        rotation_axes: (6, b) for each a twist of unit angular part, the displacement by a couple along its axis.
    """

    values: Array = field(converter=own)
    screws: Array = field(converter=own)
    pitches: Array = field(converter=own)
    centre: Array | None = field(converter=optional(own))
    translational: Array = field(converter=own)
    force_axes: Array = field(converter=own)
    rotational: Array = field(converter=own)
    rotation_axes: Array = field(converter=own)


def eigenscrews(K: ArrayLike, *, compliance: bool = False) -> Eigenscrews:
    """Eigenscrews, centre and axes of a (6, 6) symmetric, positive semidefinite stiffness, or compliance.

    Args:
        K: stiffness, wrench (m; f) = K twist (omega; v) for small displacements; or compliance, twist = C wrench.
        compliance: whether K is a compliance.

    Raises:
        BadInput: not symmetric, or with a negative eigenvalue. The stiffness of a loaded mechanism may be either, and
            then may have no real eigenscrews.

    Reference: Lipkin and Patterson 1992, 1993; Loncaric 1987.
    """
    M = arrays.symmetric(K, 6, "K")
    M = 0.5 * (M + M.T)
    if arrays.flag(compliance, "compliance"):
        M = M[SWAPPED][:, SWAPPED]  # C takes forces where K takes angular parts
    point, is_unique = _centre(M)
    X = np.eye(6)
    X[3:, :3] = cross_matrix(point)
    length, rounding = _length(M, X.T.dot(M).dot(X), float(np.sqrt(point.dot(point))))
    X[3:, 3:] *= length
    moved = X.T.dot(M).dot(X)  # about the centre, over a length of its own
    sizes, E = np.linalg.eigh(moved)
    if not sizes[-1] > 0.0 or sizes[0] < -rounding * sizes[-1]:
        found = f"an eigenvalue {sizes[0] / np.abs(sizes).max():.2g} times the largest" if M.any() else "zeros"
        raise BadInput("K", found, "a positive semidefinite stiffness or compliance", "Take one without load.")
    positive = sizes > rounding * sizes[-1]
    B = E[:, positive] * np.sqrt(sizes[positive])
    swap = pitch_form(0.0)
    values, Y = np.linalg.eigh(B.T.dot(swap).dot(B))
    order = np.argsort(-values, kind="stable")
    T = swap.dot(B.dot(Y[:, order]))
    T /= np.linalg.norm(T, axis=0)
    angular_norms = np.linalg.norm(T[:3], axis=0)
    has_pitch = angular_norms > ROUNDING
    T[:3, ~has_pitch] = 0.0
    T[:, has_pitch] /= angular_norms[has_pitch]
    with np.errstate(divide="ignore", invalid="ignore"):
        pitches = np.where(has_pitch, length * (T[:3] * T[3:]).sum(axis=0), np.inf)
    screws = X.dot(T)
    screws[:, ~has_pitch] /= length
    d, images, a, rotation_axes = _families(moved, rounding * float(sizes[-1]))
    images = np.linalg.inv(X).T.dot(images)
    images /= np.linalg.norm(images[3:], axis=0)
    families = [(d / length**2, images), (a, X.dot(rotation_axes))]
    if compliance:
        screws = screws[SWAPPED]
        families = [(size, axes[SWAPPED]) for size, axes in reversed(families)]
    (translational, forces), (rotational, rotations) = families
    centre = point if is_unique else None
    return Eigenscrews(values[order] / length, screws, pitches, centre, translational, forces, rotational, rotations)


def _centre(M: Array) -> tuple[Array, bool]:
    """The point about which the coupling block of M = [[A, B], [B', D]] is symmetric; whether it is the only one.

    About p the block is B - p^ D; its skew part is zero where (tr(D) I - D) p is the vector of B - B'.
    """
    B, D = M[:3, 3:], M[3:, 3:]
    skew = B - B.T
    sums, axes = np.linalg.eigh(np.trace(D) * np.eye(3) - D)
    fixed = sums > ROUNDING * max(float(sums[-1]), 0.0)
    moment = axes.T.dot((skew[2, 1], skew[0, 2], skew[1, 0]))
    return axes[:, fixed].dot(moment[fixed] / sums[fixed]), bool(fixed.all())


def _length(M: Array, moved: Array, distance: float) -> tuple[float, float]:
    """sqrt(tr A / tr D) about the centre, at a distance from the origin, and the rounding of the largest eigenvalue.

    If tr A is within the rounding of M, or one of the two is zero, the length is the distance or 1.
    """
    given, a, d = (float(np.trace(block)) for block in (M[:3, :3], moved[:3, :3], moved[3:, 3:]))
    terms = abs(given) + distance * distance * abs(d)
    length = distance if d > 0.0 else 1.0
    if a > ROUNDING * terms and d * LENGTH_LIMIT**2 > a:
        length = float(np.sqrt(a / d))
    length = length or 1.0
    return length, max(ROUNDING, ROUNDING_ERROR * (terms + distance * length * abs(d)) / max(a, length**2 * d, TINY))


def _families(M: Array, least: float) -> tuple[Array, Array, Array, Array]:
    """D n = d n with the images M (0; n) / d, and (A - B D^+ B') n = a n with the arguments (n; -D^+ B' n)."""
    A, B, D = M[:3, :3], M[:3, 3:], M[3:, 3:]
    d, N = np.linalg.eigh(D)
    positive = d > least
    d, N = d[positive][::-1], N[:, positive][:, ::-1]
    inverse = (N / d).dot(N.T)
    a, H = np.linalg.eigh(A - B.dot(inverse).dot(B.T))
    positive = a > least
    a, H = a[positive][::-1], H[:, positive][:, ::-1]
    return d, np.vstack((B.dot(N) / d, N)), a, np.vstack((H, -inverse.dot(B.T).dot(H)))
