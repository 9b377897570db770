"""The Gram matrix G_h = J'Q_h J of a set of twists, and the pitches at which it loses rank.

    G_h = G_0 - 2h K,   K = J_omega'J_omega;   principal pitches: the finite h with rank(G_h) < rank(J)

G_h is the same in every frame. Split the span into pure translations N (d columns) and the rest F (e columns); then
G_0 = [[A + A', C], [C', 0]], C = F_omega'N_v, and with E a basis of null(C')

    det G_h = (-1)^d det(C'C) det(E'(A + A' - 2h F_omega'F_omega)E)

so there are e - d finite principal pitches, as eigenvalues, and no h works iff the rank of C is below d.

Reference: [DS] Sect. 3, Theorem 3.1, Sect. 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.systems.subspaces import Span, span


def gram_matrix(J: ArrayLike, h: float) -> Array:
    """G_h = J'Q_h J of (6, m) twists: (m, m) symmetric, the same in every frame [length].

    Reference: [DS] Sect. 3.
    """
    twists = arrays.columns(J)
    G: Array = twists.T.dot(pitch_form(h)).dot(twists)
    return 0.5 * (G + G.T)


class _Reduction(NamedTuple):
    """The span split into F (6, e) and translations N (6, d), orthonormal, lengths in the unit of the span's basis.

    C = left diag(coupling) right_t; c is the rank of C.
    """

    F: Array
    N: Array
    left: Array
    coupling: Array
    right_t: Array
    c: int


class _Pencil(NamedTuple):
    """The eigenproblem on null(C'): pitches (e-d,) ascending, basis X (e, e-d) of F-coordinates, X'K X = I."""

    pitches: Array
    vectors: Array
    volume: float


def _reduction(system: Span) -> _Reduction:
    # A direction whose angular part is negligible is a pure translation: a pitch of 1e9 units of length is infinite.
    B = system.basis
    _, sigma, Vt = np.linalg.svd(B[:3])
    e = int(np.count_nonzero(sigma > NEGLIGIBLE))
    F, N = B.dot(Vt[:e].T), B.dot(Vt[e:].T)
    left, coupling, right_t = np.linalg.svd(F[:3].T.dot(N[3:]))
    return _Reduction(F, N, left, coupling, right_t, int(np.count_nonzero(coupling > NEGLIGIBLE)))


def _blind(part: _Reduction) -> Array:
    """The pure translations of the system that are reciprocal to all of it, unit columns (6, d - c)."""
    blind = part.N.dot(part.right_t[part.c :].T)
    blind[:3] = 0.0
    return np.asarray(blind / np.linalg.norm(blind, axis=0))


def _pencil(part: _Reduction) -> _Pencil:
    E = part.left[:, part.c :]
    FE = part.F.dot(E)
    lower = np.linalg.cholesky(FE[:3].T.dot(FE[:3]))
    whiten = np.linalg.inv(lower).T
    A = whiten.T.dot(FE[:3].T.dot(FE[3:])).dot(whiten)
    pitches, vectors = np.linalg.eigh(0.5 * (A + A.T))
    return _Pencil(pitches, E.dot(whiten).dot(vectors), float(np.diag(lower).prod()) ** 2)


def principal_pitches(J: ArrayLike) -> Array:
    """The finite pitches at which (6, m) twists have no h-pseudoinverse: (k',) ascending, with multiplicity.

    In length/rad; there are none where every h works (rank 6).

    Raises:
        BlindSystem: no h works; carries the translations that are reciprocal to the whole system.

    Reference: [DS] Sect. 3 and 5; the reduction for systems with screws of infinite pitch is ours.
    """
    return principal_screws(J)[0]


def pitches_or_none(J: Array) -> Array:
    """`principal_pitches`, and none of a system for which no h works."""
    try:
        return principal_pitches(J)
    except BlindSystem:
        return np.empty(0)


def principal_screws(J: ArrayLike) -> tuple[Array, Array]:
    """The principal pitches h_i (k',) with their screws z_i (6, k'): J'Q_{h_i} z_i = 0 proves that h_i does not work.

    The screws are mutually orthogonal axes (omega_i.omega_j = 0) of unit angular part, and of pitch h_i each.

    Raises:
        BlindSystem: as `principal_pitches`.

    Reference: [DS] Sect. 5.2, 5.3; proof of Theorem 3.1.
    """
    system = span(J)
    if system.rank in (0, 6):
        return np.empty(0), np.empty((6, 0))
    part = _reduction(system)
    if part.c < part.N.shape[1]:
        raise BlindSystem(_blind(part))
    pencil = _pencil(part)
    z = part.F.dot(pencil.vectors)
    # The rows of G_h z = 0 outside null(C') are satisfied by adding translations y: C y = -F'Q_h z.
    force = part.F[:3].T.dot(z[3:]) + part.F[3:].T.dot(z[:3]) - 2.0 * part.F[:3].T.dot(z[:3]) * pencil.pitches
    y = part.right_t.T.dot(part.left[:, : part.c].T.dot(force) / part.coupling[: part.c, None])
    z = z - part.N.dot(y)
    z[3:] *= system.unit
    return pencil.pitches * system.unit, z


def blind_directions(J: ArrayLike) -> Array:
    """The pure translations of (6, m) twists that are reciprocal to all of them for every h: no pitch form sees them.

    They are unit columns (6, b), (0; v); b = 0 iff some h works.

    Reference: [DS] Sect. 5 (planes tangent to every q_h at an infinite pitch screw).
    """
    system = span(J)
    if system.rank in (0, 6):
        return np.empty((6, 0))
    return _blind(_reduction(system))


def gram_polynomial(J: ArrayLike) -> Array:
    """Coefficients (m + 1,) of det(J'Q_h J) = c_0 + c_1 h + ... + c_m h^m for the (6, m) columns given.

    For other columns J A of the same system they are multiplied by det(A)^2, so their ratios and signs are invariants
    of the system; a rigid motion changes nothing. All are zero iff no h works or the columns are dependent. They are
    not normalised: divide by the last non-zero one for a monic polynomial. That of h^i is in units of length^(m-i).

    Reference: [DS] (5.1) and the invariants i_1, i_2, i_3 of Sect. 5.2; Sect. 5.3.
    """
    system = span(J)
    m = len(system.right)
    result = np.zeros(m + 1)
    if system.rank < m:
        return result
    part = _reduction(system)
    d = part.N.shape[1]
    if part.c < d:
        return result
    pencil = _pencil(part)
    scale = (-1.0) ** d * np.prod(part.coupling[:d]) ** 2 * pencil.volume * np.prod(system.singular) ** 2
    # det(2 diag(h_i - h)) in the basis' unit of length u: h -> h / u, and each of the m rows of J'Q_h J carries a u.
    factors = np.atleast_1d(np.poly(pencil.pitches))[::-1] * (-2.0) ** len(pencil.pitches)
    powers = float(system.unit) ** (m - np.arange(len(factors)))
    result[: len(factors)] = scale * factors * powers
    return result
