"""The Gram matrix G_h = J'Q_h J of twists, and the principal pitches, at which it loses rank.

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

from math import inf, isinf
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BlindSystem
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import pitch_form
from invariantqp.geometry.linear import TINY, orthogonal
from invariantqp.geometry.se3 import SWAPPED
from invariantqp.systems.subspaces import Subspace, as_system, rounding_error


def gram_matrix(J: ArrayLike | Subspace, h: float) -> Array:
    """G_h = J'Q_h J of (6, m) twists: (m, m) symmetric, the same in every frame [length].

    The pitch h is finite [length/rad], or inf for half the Killing form.

    Reference: [DS] Sect. 3.
    """
    system, pitch = as_system(J), arrays.number(h, "h", "a pitch, finite or inf", infinite=True)
    T = system.coordinates  # about the own point, where few digits cancel
    G: Array = T.T.dot(pitch_form(pitch / system.length)).dot(T)
    return (1.0 if isinf(pitch) else system.length) * 0.5 * (G + G.T)


@frozen
class Border:
    """A decision of the type: `quantity` is zero if the relative error of the twists is `value`, or else it is not."""

    quantity: str
    value: float
    tolerance: float

    @property
    def vanishes(self) -> bool:
        """Whether the quantity counts as zero."""
        return self.value <= self.tolerance

    @property
    def margin(self) -> float:
        """The factor, above 1, between the value and the tolerance."""
        if self.value == 0.0:
            return inf
        return max(self.value / self.tolerance, self.tolerance / self.value)


class Parts(NamedTuple):
    """A system of at most three dimensions, split into screws of finite pitch and translations, in own coordinates.

    W (3, e) orthonormal directions, V (3, e) their moments, N (3, d) orthonormal translations; `angular` (e,) is the
    angular part of a unit twist along each column of W, `coupled` whether a translation has a part along the axes. The
    `pitches` of a type are its distinct principal pitches; W and V are then along principal directions.
    """

    W: Array
    V: Array
    N: Array
    angular: Array
    coupled: bool
    borders: tuple[Border, ...]
    pitches: Array = np.empty(0)


def split(system: Subspace) -> Parts:
    """Split a system of 1 to 3 dimensions, or the reciprocal of one of 4 or 5."""
    independence, tolerance = system.independence, system.tolerance  # errors of the basis are tolerance / independence
    basis = system.span.basis
    basis = basis if basis.shape[1] <= 3 else orthogonal(basis[SWAPPED])
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


def check_rounding(system: Subspace, borders: tuple[Border, ...]) -> None:
    """Raise `BadInput` if rounding of twists far from the origin decides one of the borders."""
    if system.rounding > system.tolerance and any(b.value <= system.rounding for b in borders):
        raise rounding_error("a type and principal pitches", system)


@frozen(eq=False, repr=False, slots=False)
class PrincipalPitches(Value):
    """The pitches at which a system has no h-pseudoinverse, with their screws.

    Attributes:
        values: (k',) ascending, with multiplicity [length/rad]; empty if every h works, or none does.
        screws: (6, k') z_i of pitch h_i and unit angular part, with mutually orthogonal axes: J'Q_{h_i} z_i = 0.
        conditions: (k',) change of each pitch, over the own length, for a relative error of one in the twists.
        blind: (6, b) unit translations (0; v) that are reciprocal to the whole system for every h; b = 0 iff some h
            works.
    """

    values: Array = field(converter=own)
    screws: Array = field(converter=own)
    conditions: Array = field(converter=own)
    blind: Array = field(converter=own)


def pencil(system: Subspace) -> PrincipalPitches:
    """The principal pitches and screws of a system, and its blind directions.

    Raises:
        BadInput: rounding decides.
    """
    none = np.empty((6, 0))
    if system.dimension in (0, 6):
        return PrincipalPitches(np.empty(0), none, np.empty(0), none)
    W, V, N, _, coupled, borders, _ = split(system)
    check_rounding(system, borders)
    e, d = W.shape[1], N.shape[1]
    left, coupling, right = np.linalg.svd(W.T.dot(N))
    c = 1 if coupled else 0  # the rank of C: one screw beside translations, or one translation beside screws
    if c < d:
        blind = np.vstack((np.zeros((3, d - c)), N.dot(right[c:].T)))
        return PrincipalPitches(np.empty(0), none, np.empty(0), blind)
    E = left[:, c:]
    A = W.T.dot(V)
    pitches, X = np.linalg.eigh(0.5 * E.T.dot(A + A.T).dot(E))
    z = np.vstack((W, V)).dot(E.dot(X))
    if d and e > d:  # translations solve the rows of G_h z = 0 that are orthogonal to null(C')
        force = W.T.dot(z[3:]) + V.T.dot(z[:3]) - 2.0 * W.T.dot(z[:3]) * pitches
        z[3:] -= N.dot(right[:c].T.dot(left[:, :c].T.dot(force) / coupling[:c, None]))
    if system.dimension > 3:
        pitches, z = -pitches[::-1], z[:, ::-1]
        z[3:] += 2.0 * pitches * z[:3]
    images = np.sqrt(((z[3:] - 2.0 * pitches * z[:3]) ** 2).sum(axis=0) + (z[:3] ** 2).sum(axis=0))
    rates = system.span.right.dot(system.span.basis.T.dot(z) / system.span.singular[:, None])
    conditions = images * system.error_factors.dot(np.abs(rates))
    return PrincipalPitches(pitches * system.length, system.from_own.dot(z), conditions, none)


def principal_pitches(J: ArrayLike | Subspace) -> Array:
    """The finite pitches at which (6, m) twists have no h-pseudoinverse: (k',) ascending, with multiplicity.

    In length/rad; empty if every h works (rank 6, or a hinge with a slide along it).

    Raises:
        BlindSystem: no h works; carries the translations that are reciprocal to the whole system.
        BadInput: the twists are so far from the origin that rounding decides.

    Reference: [DS] Sect. 3 and 5; the reduction for systems with screws of infinite pitch is ours.
    """
    return principal_screws(J)[0]


def principal_screws(J: ArrayLike | Subspace) -> tuple[Array, Array]:
    """The principal pitches h_i (k',) with their screws z_i (6, k'): J'Q_{h_i} z_i = 0 proves that h_i does not work.

    The screws are mutually orthogonal axes (omega_i.omega_j = 0) of unit angular part, and of pitch h_i each.

    Raises:
        BlindSystem, BadInput: as `principal_pitches`.

    Reference: [DS] Sect. 5.2, 5.3; proof of Theorem 3.1.
    """
    result = pencil(as_system(J))
    if result.blind.shape[1]:
        raise BlindSystem(result.blind)
    return result.values, result.screws


def blind_directions(J: ArrayLike | Subspace) -> Array:
    """The translations in the span of (6, m) twists that are reciprocal to all of it for every h.

    They are unit columns (6, b), (0; v); b = 0 iff some h works.

    Reference: [DS] Sect. 5 (planes tangent to every q_h at an infinite pitch screw).
    """
    return pencil(as_system(J)).blind


def gram_polynomial(J: ArrayLike | Subspace) -> Array:
    """Coefficients (m + 1,) of det(J'Q_h J) = c_0 + c_1 h + ... + c_m h^m for the (6, m) columns given.

    For other columns J A of the same system they are multiplied by det(A)^2, so their ratios and signs are invariants
    of the system; a rigid motion changes nothing. All are zero iff no h works or the columns are dependent. They are
    not normalised: divide by the last non-zero one for a monic polynomial. The unit of c_i is length^(m-i).

    Reference: [DS] (5.1) and the invariants i_1, i_2, i_3 of Sect. 5.2; Sect. 5.3.
    """
    system = as_system(J)
    coefficients = np.zeros(system.twists.shape[1] + 1)
    roots = pencil(system)
    if system.dimension < len(coefficients) - 1 or roots.blind.shape[1]:
        return coefficients
    # The polynomial from its roots and its value at a pitch that is no root.
    h = system.length + float(np.abs(roots.values).max(initial=0.0))
    monic = np.atleast_1d(np.poly(roots.values))[::-1]
    coefficients[: len(monic)] = monic * np.linalg.det(gram_matrix(system, h)) / np.prod(h - roots.values)
    return coefficients
