"""The h-pseudoinverse J^{+h}: the pseudoinverse in which twists are measured by Q_h, so that no frame matters.

    J = U C  (U orthonormal, C of full row rank):   J^{+h} = M^-1 C'(C M^-1 C')^-1 (U'Q_h U)^-1 U'Q_h

It exists iff rank(U'Q_h U) = rank(J). Factoring before the Gram matrix is formed keeps the digits that
(J'Q_h J)^-1 J'Q_h loses: that route squares cond(J).

Reference: [DS] Theorem 2.2 (existence), (hP1)-(hP4). (hP4) is meant with the ordinary transpose on the joint side (or
the M-adjoint with a joint metric M); [DS] prints the h-adjoint there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BlindSystem, NoPseudoinverse
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.gram import principal_pitches
from invariantqp.systems.span import Span, span

# An eigenvalue of U'Q_h U below this fraction of |Q_h| is zero: rounding leaves a few 1e-16 of it where h is exactly a
# principal pitch.
GRAM_TOLERANCE = 1e-14


def _form_spectrum(system: Span, h: float) -> tuple[Array, Array, Array]:
    """Q_h in the basis' unit of length, and the eigenvalues and -vectors of U'Q_h U."""
    Q = pitch_form(h / system.unit)
    mu, E = np.linalg.eigh(system.basis.T.dot(Q).dot(system.basis))
    return Q, mu, E


def _vanishing(mu: Array, Q: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(mu) <= GRAM_TOLERANCE * np.abs(Q).max())


def has_pseudoinverse(J: ArrayLike, h: float) -> bool:
    """Whether J (6, m) has an h-pseudoinverse: rank(J'Q_h J) = rank(J).

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Theorem 2.2.
    """
    system = span(J)
    Q, mu, _ = _form_spectrum(system, finite_pitch(h))
    return system.rank == 6 or not _vanishing(mu, Q).any()


def pseudoinverse(J: ArrayLike, h: float, *, joint_metric: ArrayLike | None = None) -> Array:
    """J^{+h}, the h-pseudoinverse of (6, m) twists of any rank.

    For rank 6 it is the same for every h, and with `joint_metric=None` it is the Moore-Penrose pseudoinverse.

    Args:
        J: (6, m) joint twists as columns, (omega; v).
        h: finite pitch [length/rad].
        joint_metric: (m, m) or (m,) positive definite, the metric M on joint velocities; None is the identity. It
            matters only where joints are dependent.

    Returns:
        (m, 6) matrix; x = J^{+h} s is the joint velocity for the twist s.

    Raises:
        NoPseudoinverse: h is a principal pitch of the system, or no h works; carries the proof.
        BadInput: shapes, NaN, infinite h, a metric that is not positive definite.

    Reference: [DS] Theorem 2.2, (3.1) for independent columns, (2.14) for rank 6.
    """
    twists = arrays.columns(J)
    pitch = finite_pitch(h)
    m = twists.shape[1]
    metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
    system = span(twists)
    r = system.rank
    U = system.basis
    if r == 6:
        left_inverse = U.T  # U is square: (U'QU)^-1 U'Q = U^-1 for every Q
    else:
        Q, mu, E = _form_spectrum(system, pitch)
        if r and _vanishing(mu, Q).any():
            raise _no_pseudoinverse(twists, pitch, system, (Q, mu, E))
        left_inverse = (E / mu).dot(E.T).dot(U.T.dot(Q))
    result: Array = _right_inverse(system, metric).dot(system.scaled_rows(left_inverse))
    return result


def _right_inverse(system: Span, metric: Array | None) -> Array:
    """The (m, r) M-minimal right inverse M^-1 C'(C M^-1 C')^-1 of C = diag(sigma) V'."""
    V, sigma = system.right, system.singular
    if metric is None or system.rank == len(V):
        result: Array = V / sigma
    else:
        MV = np.linalg.solve(metric, V)
        result = np.linalg.solve(V.T.dot(MV), MV.T).T / sigma
    return result


def _no_pseudoinverse(J: Array, h: float, system: Span, spectrum: tuple[Array, Array, Array]) -> NoPseudoinverse:
    Q, mu, E = spectrum
    lost = _vanishing(mu, Q)
    z = system.twists(E[:, int(np.abs(mu).argmin())])
    try:
        pitches = principal_pitches(J)
    except BlindSystem:
        pitches = np.empty(0)
    return NoPseudoinverse(
        h=h,
        rank=system.rank,
        gram_rank=system.rank - int(np.count_nonzero(lost)),
        self_reciprocal=z / np.linalg.norm(z),
        principal_pitches=pitches[np.argsort(np.abs(pitches - h), kind="stable")],
    )
