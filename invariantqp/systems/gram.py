"""The Gram matrix G_h = J'Q_h J of a set of twists, and the pitches at which it loses rank.

    G_h = G_0 - 2h K,   K = J_omega'J_omega;   principal pitches: the finite h with rank(G_h) < rank(J)

G_h is the same in every frame. Split the span into pure translations N and the rest F; then G_0 = [[A, C], [C', 0]]
and the finite principal pitches are the generalised eigenvalues of (A, 2K) on null(C').

Reference: [DS] Sect. 3, Theorem 3.1, Sect. 5.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.systems.span import span

# A direction of the orthonormal basis whose angular part is below this is a pure translation, and a coupling C below it
# is none: a screw of pitch 1e10 units of length is infinite for every purpose of control.
BLIND_TOLERANCE = 1e-10


def gram_matrix(J: ArrayLike, h: float) -> Array:
    """G_h = J'Q_h J of (6, m) twists: (m, m) symmetric, the same in every frame [length].

    Raises:
        BadInput: J is not finite (6, m), or h is NaN.

    Reference: [DS] Sect. 3.
    """
    twists = arrays.columns(J)
    G: Array = twists.T.dot(pitch_form(h)).dot(twists)
    return 0.5 * (G + G.T)


def principal_pitches(J: ArrayLike, tolerance: float = BLIND_TOLERANCE) -> Array:
    """The finite pitches at which J has no h-pseudoinverse, ascending, with multiplicity.

    Args:
        J: (6, m) twists, independent or not.
        tolerance: relative size below which an angular part or a coupling is zero.

    Returns:
        (k',) ascending pitches [length/rad]; empty where every h works (rank 6).

    Raises:
        BlindSystem: no h works at all; carries the translations that no Q_h sees.
        BadInput: J is not finite (6, m).

    Reference: [DS] Sect. 3 and 5; the reduction for systems with screws of infinite pitch is ours.
    """
    system = span(J)
    if system.rank in (0, 6):
        return np.empty(0)
    B = system.basis
    _, sigma, Vt = np.linalg.svd(B[:3])
    e = int(np.count_nonzero(sigma > tolerance))
    F, N = B.dot(Vt[:e].T), B.dot(Vt[e:].T)
    C = F[:3].T.dot(N[3:])
    A = F[:3].T.dot(F[3:])
    d = N.shape[1]
    left, coupling, right_t = np.linalg.svd(C)
    c = int(np.count_nonzero(coupling > tolerance))
    if c < d:
        blind = N.dot(right_t[c:].T)
        blind[:3] = 0.0
        raise BlindSystem(blind / np.linalg.norm(blind, axis=0))
    E = left[:, c:]
    whiten = np.linalg.inv(np.linalg.cholesky(E.T.dot(F[:3].T).dot(F[:3]).dot(E)))
    pitches = np.linalg.eigvalsh(0.5 * whiten.dot(E.T.dot(A + A.T).dot(E)).dot(whiten.T))
    return np.asarray(pitches * system.unit)
