"""The h-pseudoinverse J^{+h}: the pseudoinverse that measures twists by Q_h and so depends on no choice of frame.

    J = T C  (T a basis of the system, C of full row rank):   J^{+h} = M^-1 C'(C M^-1 C')^-1 (T'Q_h T)^-1 T'Q_h

It exists iff rank(T'Q_h T) = rank(J). J is factored before a Gram matrix is formed, because (J'Q_h J)^-1 J'Q_h squares
the condition number of J. In floating point the rank is decided by the condition number of J^{+h}: the answer is given
where at least three digits of it are correct, and refused where rounding could have changed more.

Reference: [DS] Theorem 2.2 (existence), (hP1)-(hP4). On the joint side of (hP4) the ordinary transpose is meant (with a
joint metric M, the M-adjoint); [DS] prints the h-adjoint there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.engine import core
from invariantqp.errors import NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch
from invariantqp.systems.factors import Factors, factors
from invariantqp.systems.gram import pitches_or_none
from invariantqp.systems.subspaces import screw_system


def has_pseudoinverse(J: ArrayLike, h: float) -> bool:
    """Whether (6, m) twists have an h-pseudoinverse that can be computed to three digits: rank(J'Q_h J) = rank(J).

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Theorem 2.2.
    """
    return factors(arrays.columns(J), finite_pitch(h)).exists


def pseudoinverse(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> Array:
    """J^{+h}, the h-pseudoinverse of (6, m) twists of any rank, correct to three digits or more.

    For rank 6 it is the same for every h, and with `joint_metric=None` it is the Moore-Penrose pseudoinverse.

    Args:
        J: (6, m) joint twists as columns, (omega; v).
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite, the metric M on joint velocities; None is the identity. It
            matters only where joints are dependent.

    Returns:
        (m, 6) matrix; x = J^{+h} s is the joint velocity for the twist s.

    Raises:
        NoPseudoinverse: h is a principal pitch of the system, or too near one for three correct digits; or no h works;
            or the joints are too nearly dependent. Carries the proof.
        BadInput: shapes, NaN, infinite h, a metric that is not positive definite.

    Reference: [DS] Theorem 2.2, (3.1) for independent columns, (2.15) for rank 6.
    """
    if core is not None and joint_metric is None and type(J) is np.ndarray and type(h) is float:
        inverse: Array | None = core.pseudoinverse(J, h)  # where it is well conditioned
        if inverse is not None:
            return inverse
    twists = arrays.columns(J)
    pitch = finite_pitch(h)
    metric = None
    if joint_metric is not None:
        metric = arrays.positive_definite(joint_metric, twists.shape[1], "joint_metric")
    found = factors(twists, pitch, metric)
    if not found.exists:
        raise _no_pseudoinverse(twists, pitch, found)
    return found.inverse


def _no_pseudoinverse(J: Array, h: float, found: Factors) -> NoPseudoinverse:
    pitches = pitches_or_none(J)
    z = screw_system(J)[:, -1] if found.dependent else found.lost
    return NoPseudoinverse(
        h=h,
        rank=found.rank,
        gram_rank=found.rank if found.dependent else found.gram_rank,
        self_reciprocal=z / np.linalg.norm(z),
        principal_pitches=pitches[np.argsort(np.abs(pitches - h), kind="stable")],
    )
