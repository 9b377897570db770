"""Parallel mechanisms: wrenches of the legs, their h-pseudoinverse, and stiffness and conditioning of the platform.

    W^{+h} = (W'Q_h^-1 W)^-1 W'Q_h^-1 = (Q_0 W)^{+(-h)} Q_0        K = W diag(k) W'

Q_0 swaps the halves of a wrench, which makes it a twist and Q_h^-1 the form Q_{-h}; so W^{+h} is computed as the
pseudoinverse of twists. The non-zero eigenvalues of K Q_h^-1 are those of (W'Q_h^-1 W, diag(1/k)): the same in every
frame, where the singular values of W or K depend on the origin.

Reference: [DS] Sect. 6.3 (W^{+h}); stiffness of parallel manipulators is asked for in its Sect. 7.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.hyperbolic import HyperbolicSpectrum, hyperbolic_singular_values
from invariantqp.systems.pseudoinverse import pseudoinverse


def leg_wrenches(base: ArrayLike, platform: ArrayLike) -> Array:
    """Unit forces along legs from base points to platform points, as wrenches (b x u; u).

    W' is the inverse Jacobian: leg speeds = W's for the platform twist s, and W f is the wrench on the platform of the
    leg forces f (positive: the leg pushes).

    Args:
        base: (n, 3) points of the base, one a leg [length].
        platform: (n, 3) points of the platform, in the same frame.

    Returns:
        (6, n) wrenches (m; f) in that frame.

    Raises:
        BadInput: shapes, NaN, no legs, a leg of length zero.

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


def wrench_pseudoinverse(W: ArrayLike, h: float, *, leg_metric: ArrayLike | None = None) -> Array:
    """W^{+h}, the h-pseudoinverse of (6, n) wrenches: leg forces f = W^{+h} w for the wrench w.

    Args:
        W: (6, n) wrenches as columns (m; f), of any rank.
        h: finite pitch [length/rad]; wrenches are measured by Q_h^-1.
        leg_metric: (n, n) or (n,) positive definite metric on leg forces; None is the identity. It matters only where
            wrenches are dependent (redundant legs).

    Returns:
        (n, 6) matrix.

    Raises:
        NoPseudoinverse: W'Q_h^-1 W is singular; its pitches are those of this form, its screw is Q_0 w of a wrench w.
        BadInput: shapes, NaN, infinite h, a metric that is not positive definite.

    Reference: [DS] Sect. 6.3.
    """
    wrenches = arrays.columns(W, "W")
    pitch = finite_pitch(h)
    metric = None if leg_metric is None else arrays.positive_definite(leg_metric, wrenches.shape[1], "leg_metric")
    swap = pitch_form(0.0)
    try:
        result: Array = pseudoinverse(swap.dot(wrenches), -pitch, joint_metric=metric).dot(swap)
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

    Args:
        W: (6, n) unit leg wrenches (m; f).
        leg_stiffness: (n,) above zero [force/length].

    Returns:
        (6, 6) symmetric, positive definite iff the legs have rank 6; a rigid motion takes K to Ad* K Ad*'.

    Raises:
        BadInput: shapes, NaN, a stiffness that is not above zero.

    Reference: asked for in [DS] Sect. 7.
    """
    wrenches = arrays.columns(W, "W")
    k = _leg_stiffness(leg_stiffness, wrenches.shape[1])
    return np.asarray((wrenches * k).dot(wrenches.T))


def leg_spectrum(W: ArrayLike, h: float, leg_stiffness: ArrayLike | None = None) -> HyperbolicSpectrum:
    """The conditioning of legs, the same in every frame: the eigenvalues of (W'Q_h^-1 W, diag(1/k)).

    `.condition` tells how near the legs are to singular, `.joint_directions` are leg forces, and `.twists` are the
    principal wrenches W v_i with their halves swapped: the screws along which they act.

    Args:
        W: (6, n) unit leg wrenches (m; f).
        h: finite pitch [length/rad].
        leg_stiffness: (n,) above zero [force/length]; None is the same for each leg.

    Raises:
        BadInput: shapes, NaN, a stiffness that is not above zero.

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
