"""The Gram matrix G_h = J'Q_h J of twists, and the pitches at which it loses rank.

    G_h = G_0 - 2h K,   K = J_omega'J_omega;   principal pitches: the finite h with rank(G_h) < rank(J)

G_h is the same in every frame. A k-system with k <= 3 is split into e screws (W; V), W orthonormal, and d translations
(0; N). With A = (W'V + V'W) / 2, C = W'N and E an orthonormal basis of null(C'),

    det G_h = (-1)^d 2^(e-d) det(C'C) det(E'A E - h I)    up to the square of the change of basis

so the principal pitches are the e - d eigenvalues of E'A E, and no h works iff the rank of C is below d. A 4- or
5-system has the pitches of its reciprocal with the opposite sign: z = (omega; v) of pitch -h in S^{perp 0} gives
(omega; v + 2h omega) in S.

Reference: [DS] Sect. 3, Theorem 3.1, Sect. 5. The split, the determinant by it and the reciprocal's pitches are ours,
proved by the formulas above and checked in exact arithmetic by tests/systems/test_gram.py.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch, pitch_form
from invariantqp.geometry.linear import TINY, orthogonal
from invariantqp.geometry.se3 import SWAPPED
from invariantqp.systems.subspaces import Subspace, undecided


def gram_matrix(J: ArrayLike, h: float) -> Array:
    """G_h = J'Q_h J of (6, m) twists: (m, m) symmetric, the same in every frame [length].

    Reference: [DS] Sect. 3.
    """
    return gram(Subspace(arrays.columns(J)), arrays.number(h, "h", "a pitch, finite or inf", infinite=True))


def gram(system: Subspace, h: float) -> Array:
    """J'Q_h J of the twists of a system, computed about its own point, where few digits cancel."""
    T = system.coordinates
    G: Array = T.T.dot(pitch_form(h / system.length)).dot(T)
    return (1.0 if abs(h) == inf else system.length) * 0.5 * (G + G.T)


@frozen
class Border:
    """One decision: `quantity` is zero up to a relative error `value` of the twists, compared with the tolerance."""

    quantity: str
    value: float
    tolerance: float

    @property
    def vanishes(self) -> bool:
        """Whether the quantity counted as zero."""
        return self.value <= self.tolerance

    @property
    def margin(self) -> float:
        """The factor, above 1, between the value and the tolerance."""
        if self.value == 0.0:
            return inf
        return max(self.value / self.tolerance, self.tolerance / self.value)


class Parts(NamedTuple):
    """A system of at most three dimensions, split into screws of finite pitch and translations, in own coordinates.

    W (3, e) orthonormal directions, V (3, e) their moments, N (3, d) orthonormal translations; `firmness` (e,) is the
    angular part of a unit twist along each column of W, `coupled` whether a translation has a part along the axes. The
    `pitches` of a type are its distinct principal pitches; W and V are then along principal directions.
    """

    W: Array
    V: Array
    N: Array
    firmness: Array
    coupled: bool
    borders: tuple[Border, ...]
    pitches: Array = np.empty(0)


def at_most_three(basis: Array) -> Array:
    """An orthonormal basis of a system or, of one with more than three dimensions, of its reciprocal."""
    return basis if basis.shape[1] <= 3 else orthogonal(basis[SWAPPED])


def split(basis: Array, independence: float, tolerance: float) -> Parts:
    """Split an orthonormal basis (6, n), n <= 3, whose errors are those of the twists over `independence`."""
    W, sigma, Vt = np.linalg.svd(basis[:3], full_matrices=False)
    e, n = int(np.count_nonzero(sigma * independence > tolerance)), basis.shape[1]
    borders = [
        Border("smallest angular part", float(s) * independence, tolerance) for s in sigma[max(e - 1, 0) : e + 1]
    ]
    moments = basis[3:].dot(Vt.T)
    N = moments[:, e:] / np.maximum(np.linalg.norm(moments[:, e:], axis=0), TINY)
    coupled = False
    if 0 < e < n:
        coupling = float(np.linalg.norm(W[:, :e].T.dot(N))) * independence * float(sigma[e - 1])
        borders.append(Border("translation along the axes", coupling, tolerance))
        coupled = coupling > tolerance
    return Parts(W[:, :e], moments[:, :e] / sigma[:e], N, sigma[:e], coupled, tuple(borders))


def parts_of(system: Subspace) -> Parts:
    """The split of a system of 1 to 5 dimensions, or of its reciprocal.

    Raises:
        BadInput: rounding leaves it open.
    """
    parts = split(at_most_three(system.span.basis), system.independence, system.tolerance)
    decided(system, parts.borders)
    return parts


def decided(system: Subspace, borders: tuple[Border, ...]) -> None:
    """Raise where a number near zero may be the rounding of twists far from their own point."""
    if system.rounding > system.tolerance and any(b.value <= system.rounding for b in borders):
        raise undecided("a type and principal pitches", system)


@frozen(eq=False, repr=False, slots=False)
class PrincipalPitches(Value):
    """The pitches at which a system has no h-pseudoinverse, with their proofs.

    Attributes:
        values: (k',) ascending, with multiplicity [length/rad]; none where every h works, or none does.
        screws: (6, k') z_i of pitch h_i and unit angular part, with mutually orthogonal axes: J'Q_{h_i} z_i = 0.
        conditions: (k',) change of each pitch, over the own length, for a relative error of one in the twists.
        blind: (6, b) unit translations (0; v) that are reciprocal to the whole system for every h; b = 0 iff some h
            works.
    """

    values: Array = field(converter=own)
    screws: Array = field(converter=own)
    conditions: Array = field(converter=own)
    blind: Array = field(converter=own)


def pencil(system: Subspace, parts: Parts | None = None) -> PrincipalPitches:
    """The principal pitches and screws of a system, and the translations that no pitch form sees."""
    none = np.empty((6, 0))
    if system.dimension in (0, 6):
        return PrincipalPitches(np.empty(0), none, np.empty(0), none)
    W, V, N, _, coupled, *_ = parts_of(system) if parts is None else parts
    e, d = W.shape[1], N.shape[1]
    left, coupling, right = np.linalg.svd(W.T.dot(N))
    c = 1 if coupled else 0  # the rank of C, with at most one screw or one translation beside the other
    if c < d:
        blind = np.vstack((np.zeros((3, d - c)), N.dot(right[c:].T)))
        return PrincipalPitches(np.empty(0), none, np.empty(0), blind)
    E = left[:, c:]
    A = W.T.dot(V)
    pitches, X = np.linalg.eigh(0.5 * E.T.dot(A + A.T).dot(E))
    z = np.vstack((W, V)).dot(E.dot(X))
    if d and e > d:  # the rows of G_h z = 0 across null(C') are met by adding translations
        force = W.T.dot(z[3:]) + V.T.dot(z[:3]) - 2.0 * W.T.dot(z[:3]) * pitches
        z[3:] -= N.dot(right[:c].T.dot(left[:, :c].T.dot(force) / coupling[:c, None]))
    if system.dimension > 3:
        pitches, z = -pitches[::-1], z[:, ::-1]
        z[3:] += 2.0 * pitches * z[:3]
    images = np.sqrt(((z[3:] - 2.0 * pitches * z[:3]) ** 2).sum(axis=0) + (z[:3] ** 2).sum(axis=0))
    rates = system.span.right.dot(system.span.basis.T.dot(z) / system.span.singular[:, None])
    conditions = images * system.error_factors.dot(np.abs(rates))
    return PrincipalPitches(pitches * system.length, system.from_own.dot(z), conditions, none)


def principal_pitches(J: ArrayLike) -> Array:
    """The finite pitches at which (6, m) twists have no h-pseudoinverse: (k',) ascending, with multiplicity.

    In length/rad; there are none where every h works (rank 6, or a hinge with a slide along it).

    Raises:
        BlindSystem: no h works; carries the translations that are reciprocal to the whole system.
        BadInput: the twists are so far from the origin that rounding decides.

    Reference: [DS] Sect. 3 and 5; the reduction for systems with screws of infinite pitch is ours.
    """
    return principal_screws(J)[0]


def principal_screws(J: ArrayLike) -> tuple[Array, Array]:
    """The principal pitches h_i (k',) with their screws z_i (6, k'): J'Q_{h_i} z_i = 0 proves that h_i does not work.

    The screws are mutually orthogonal axes (omega_i.omega_j = 0) of unit angular part, and of pitch h_i each.

    Raises:
        BlindSystem, BadInput: as `principal_pitches`.

    Reference: [DS] Sect. 5.2, 5.3; proof of Theorem 3.1.
    """
    found = pencil(Subspace(J))
    if found.blind.shape[1]:
        raise BlindSystem(found.blind)
    return found.values, found.screws


def blind_directions(J: ArrayLike) -> Array:
    """The pure translations of (6, m) twists that are reciprocal to all of them for every h: no pitch form sees them.

    They are unit columns (6, b), (0; v); b = 0 iff some h works.

    Reference: [DS] Sect. 5 (planes tangent to every q_h at an infinite pitch screw).
    """
    return pencil(Subspace(J)).blind


def gram_polynomial(J: ArrayLike) -> Array:
    """Coefficients (m + 1,) of det(J'Q_h J) = c_0 + c_1 h + ... + c_m h^m for the (6, m) columns given.

    For other columns J A of the same system they are multiplied by det(A)^2, so their ratios and signs are invariants
    of the system; a rigid motion changes nothing. All are zero iff no h works or the columns are dependent. They are
    not normalised: divide by the last non-zero one for a monic polynomial. That of h^i is in units of length^(m-i).

    Reference: [DS] (5.1) and the invariants i_1, i_2, i_3 of Sect. 5.2; Sect. 5.3.
    """
    system = Subspace(J)
    result = np.zeros(system.twists.shape[1] + 1)
    found = pencil(system)
    if system.dimension < len(result) - 1 or found.blind.shape[1]:
        return result
    # The determinant at one pitch that is no root, and the roots.
    h = system.length + float(np.abs(found.values).max(initial=0.0))
    monic = np.atleast_1d(np.poly(found.values))[::-1]
    result[: len(monic)] = monic * np.linalg.det(gram(system, finite_pitch(h))) / np.prod(h - found.values)
    return result
