"""Whether S has an h-pseudoinverse, asked in three independent ways, and the twist z that proves that it has none.

    (i) rank(J'Q_h J) < rank(J)     (ii) S meets S^{perp h}     (iii) S is tangent to q_h at a point z of S

(i) is an eigenvalue of the Gram matrix, (ii) the angle between two subspaces that are computed apart, (iii) a critical
value of the pitch on S (or a translation that no form sees). They are equivalent; each is computed without the others.
[DS] prints (iii) with "at some non-zero point" but proves it for a point of S, and needs that: every 1- and 2-system
lies in the tangent space at some null twist outside it, whether or not it has a pseudoinverse.

Reference: [DS] Theorem 3.1, Corollary 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.systems.gram import principal_screws
from invariantqp.systems.pseudoinverse import GRAM_TOLERANCE, has_pseudoinverse
from invariantqp.systems.span import Span, span
from invariantqp.systems.subspaces import reciprocal

# S and S^{perp h} meet below this angle [rad], and h is a principal pitch within this fraction of |h| + the unit of
# length: each is computed through two factorisations, which leave some 1e-15.
MEET_TOLERANCE = 1e-13


@dataclass(frozen=True)
class Existence:
    """The three conditions of Theorem 3.1, each with the number that vanishes where it holds.

    Attributes:
        h: the pitch asked for [length/rad].
        rank: rank of J.
        gram_rank: (i) rank of J'Q_h J.
        gram_eigenvalue: (i) least |eigenvalue| of U'Q_h U over |Q_h|, U orthonormal.
        angle: (ii) least angle between S and S^{perp h} [rad].
        pitch_distance: (iii) |h - h_i| to the nearest principal pitch, in units of |h| + the system's length; 0 where
            some translation is reciprocal to all of S, inf where nothing ever fails.
        degenerate: (i), (ii), (iii) as they came out.
        certificate: (6,) z in S, h-reciprocal to all of S; None where the pseudoinverse exists.
    """

    h: float
    rank: int
    gram_rank: int
    gram_eigenvalue: float
    angle: float
    pitch_distance: float
    degenerate: tuple[bool, bool, bool]
    certificate: Array | None

    @property
    def exists(self) -> bool:
        """Whether the h-pseudoinverse exists, by (i): the condition of Theorem 2.2 itself."""
        return not self.degenerate[0]

    @property
    def agree(self) -> bool:
        """Whether the three say the same; they may differ only where all three numbers are at their tolerances."""
        return len(set(self.degenerate)) == 1


def existence(J: ArrayLike, h: float) -> Existence:
    """Ask Theorem 3.1 whether (6, m) twists have an h-pseudoinverse.

    Args:
        J: (6, m) twists, dependent or not: rank(J) takes the place of m.
        h: finite pitch [length/rad].

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Theorem 3.1; the certificate is the z of its proof.
    """
    pitch = finite_pitch(h)
    system = span(J)
    Q = pitch_form(pitch / system.unit)
    if system.rank in (0, 6):
        return Existence(pitch, system.rank, system.rank, 1.0, 0.5 * np.pi, inf, (False, False, False), None)
    mu, E = np.linalg.eigh(system.basis.T.dot(Q).dot(system.basis))
    ratio = np.abs(mu) / np.abs(Q).max()
    lost = int(np.count_nonzero(ratio <= GRAM_TOLERANCE))
    angle = _least_angle(system, Q)
    distance = _pitch_distance(arrays.columns(J), pitch, system)
    z = system.twists(E[:, int(ratio.argmin())])
    return Existence(
        h=pitch,
        rank=system.rank,
        gram_rank=system.rank - lost,
        gram_eigenvalue=float(ratio.min()),
        angle=angle,
        pitch_distance=distance,
        degenerate=(lost > 0, angle <= MEET_TOLERANCE, distance <= MEET_TOLERANCE),
        certificate=z / np.linalg.norm(z) if lost else None,
    )


def _least_angle(system: Span, Q: Array) -> float:
    """Between S and S^{perp h}, from the two bases side by side: 2 arcsin(sigma_min / sqrt 2)."""
    other = np.linalg.qr(Q.dot(system.basis), mode="complete")[0][:, system.rank :]
    sigma = np.linalg.svd(np.hstack((system.basis, other)), compute_uv=False)
    return float(2.0 * np.arcsin(min(1.0, sigma[-1] / np.sqrt(2.0))))


def _pitch_distance(twists: Array, h: float, system: Span) -> float:
    """From h to the nearest pitch of which S is tangent to the hyperquadric."""
    try:
        pitches, _ = principal_screws(twists)
    except BlindSystem:
        return 0.0
    return float(np.abs(pitches - h).min()) / (abs(h) + system.unit) if len(pitches) else inf


def reciprocal_has_pseudoinverse(J: ArrayLike, h: float) -> bool:
    """Whether S^{perp h} has an h-pseudoinverse: it has exactly if S has, which is a check on both.

    Raises:
        BadInput: J is not finite (6, m), or h is not finite.

    Reference: [DS] Corollary 3.2.
    """
    other = reciprocal(J, h)
    return other.shape[1] == 0 or has_pseudoinverse(other, h)
