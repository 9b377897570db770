"""How well a pitch splits twists in one state: |P_h|, the factor between the errors of P_h s and of least squares.

    A = root J,  U its directions of which the law does half and more,  M the form on measured twists
    P_h = U (U'MU)^-1 U'M,    |s - P_h s| <= |P_h| |s - U U's|,    |P_h| = 1 / sin(angle between U and what P_h removes)

Proof: (I - P_h) U = 0, so (I - P_h) s = (I - P_h)(s - U U's), and |I - P_h| = |P_h| for every projector but 0 and I.

|P_h| is infinite at a principal pitch and where the arm is blind, and it is large near both. So no
tolerance on the type of a screw system is needed, and rounding in a URDF decides nothing.

Reference: [DS] Sect. 6.1 for P_h; Szyld 2006 for |I - P| = |P|.
"""

from __future__ import annotations

from math import inf

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Adaptive
from invariantqp.velocity.forms import PitchForm

# An eigenvalue of U'MU below this share of |M| is rounding of zero.
ROUNDING = 1e-12


def can_do(A: Array) -> Array:
    """(6, k) orthonormal: the twists that the measured joints A (6, m) can do, damping leaves half of them and more."""
    U, sigma, _ = np.linalg.svd(A, full_matrices=False)
    damped = Adaptive().squares(sigma, np.zeros(len(sigma)), sigma[0])
    return np.asarray(U[:, sigma * sigma >= np.maximum(damped, np.finfo(float).tiny)])


def projector_norm(U: Array, inverse_root: Array, h: float) -> float:
    """|P_h| in the measure: 1 where the joints can do every twist, inf where h [length/rad] has no projector.

    U (6, k) is what the joints can do, orthonormal; (6, 6) the inverse of the measure's root.
    """
    if U.shape[1] in (0, 6):
        return 1.0
    on_arm = _on_arm(U, inverse_root, h)
    G = on_arm.dot(U)
    if np.linalg.norm(G, -2) < ROUNDING:
        return inf
    return float(np.linalg.norm(np.linalg.solve(G, on_arm), 2))


def unseen(U: Array, inverse_root: Array, pitches: tuple[float, ...], bound: float) -> Array:
    """(6, b) twists of the arm that none of the pitches sees: |U'M s| is below |M| |s| / bound for each of them.

    U (6, k) is what the joints can do, orthonormal in the measure; `bound` the largest |P_h| that serves.
    """
    seen = np.vstack([_on_arm(U, inverse_root, h).dot(U) for h in pitches])
    _, size, directions = np.linalg.svd(seen)
    return np.asarray(inverse_root.dot(U).dot(directions[size < 1.0 / bound].T))


def _on_arm(U: Array, inverse_root: Array, h: float) -> Array:
    """(k, 6) U'M with |M| = 1."""
    M = PitchForm(h).matrix(inverse_root)
    return np.asarray(U.T.dot(M) / np.linalg.norm(M, 2))
