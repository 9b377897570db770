"""Lines in involution: 2..6 joint axes whose forces can balance, Sylvester's det(J'Q_0 J) = 0, and their transversals.

    z in S meet S^{perp 0}:   W = Q_0 z is a wrench along the lines, W = Q_0 J lambda, that no joint feels, J'W = 0

m independent lines are in involution iff J has no 0-pseudoinverse; dependent lines are so by J lambda = 0, W = 0.
A transversal is a line reciprocal to all of them. [DS] says four lines are in involution precisely when they have
infinitely many; that is too narrow: four independent lines with one double transversal are so too.

Reference: [DS] Sect. 4, with the case m = 4 corrected.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.geometry.screws import pitch
from invariantqp.systems.gram import gram_matrix
from invariantqp.systems.span import RANK_TOLERANCE, span

# A column is a line if its pitch is below this fraction of its distance from the origin (or of 1): nine digits of a
# careful model file.
LINE_TOLERANCE = 1e-9

# An eigenvalue of the Klein form on an orthonormal basis below this is zero, and an angular part below it is at
# infinity: products of two rounded numbers of order one, and some cancellation.
FORM_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Involution:
    """Whether lines are in involution, and what meets them.

    Attributes:
        holds: whether a system of forces along the lines, not all zero, is felt by no joint.
        determinant: Sylvester's det(J'Q_0 J) of the columns as given; J A has det(A)^2 times it.
        rank: number of independent lines.
        transversals: (6, n) unit lines that meet (or are parallel to) all lines. All of them where finitely many;
            where infinitely many, independent ones from which the others are combined.
        transversal_count: 0, 1, 2 or inf.
        double: whether the one transversal counts twice (a limit of two that came together).
        at_infinity: (6, k) translations reciprocal to all lines: transversals at infinity.
        joint_forces: (m,) lambda, unit, the forces along the lines that balance; None unless `holds`.
        equilibrium_wrench: (6,) W = Q_0 J lambda, their sum: zero where the lines are dependent, else a force along a
            transversal (or a couple) that does no work on any joint; None unless `holds`.
    """

    holds: bool
    determinant: float
    rank: int
    transversals: Array
    transversal_count: float
    double: bool
    at_infinity: Array
    joint_forces: Array | None
    equilibrium_wrench: Array | None


def involution(lines: ArrayLike, tolerance: float = FORM_TOLERANCE) -> Involution:
    """Decide involution of 2..6 lines and find their transversals and equilibrium.

    Args:
        lines: (6, m) twists of pitch 0 as columns, of any length, 2 <= m <= 6.
        tolerance: size of a product of unit twists that counts as zero.

    Raises:
        BadInput: shapes, NaN, fewer than 2 or more than 6 columns, a column whose pitch is not 0.

    Reference: [DS] Sect. 4.
    """
    J = _lines(lines)
    system = span(J)
    Q = pitch_form(0.0)  # in any unit of length the same matrix
    U = system.basis
    mu, E = np.linalg.eigh(U.T.dot(Q).dot(U))
    least = int(np.abs(mu).argmin())
    dependent = system.rank < J.shape[1]
    holds = dependent or bool(abs(mu[least]) <= tolerance)
    forces = wrench = None
    if dependent:
        forces = np.linalg.qr(system.right, mode="complete")[0][:, -1]
        wrench = np.zeros(6)
    elif holds:
        forces = system.right.dot(E[:, least] / system.singular)
        forces = forces / np.linalg.norm(forces)
        wrench = Q.dot(J.dot(forces))
    R = np.linalg.qr(Q.dot(U), mode="complete")[0][:, system.rank :]
    null, plenty, double = _null_lines(R, Q, tolerance)
    finite, at_infinity = _split(null, tolerance)
    finite[3:] *= system.unit
    return Involution(
        holds=holds,
        determinant=float(np.linalg.det(gram_matrix(J, 0.0))),
        rank=system.rank,
        transversals=finite,
        transversal_count=inf if plenty else float(finite.shape[1]),
        double=double and finite.shape[1] == 1,
        at_infinity=at_infinity,
        joint_forces=forces,
        equilibrium_wrench=wrench,
    )


def _lines(value: ArrayLike) -> Array:
    J = arrays.columns(value, "lines")
    expected = "2 to 6 columns (omega; v), each a line: omega not zero and omega.v = 0"
    if not 2 <= J.shape[1] <= 6:
        raise BadInput("lines", f"{J.shape[1]} columns", expected)
    for i, s in enumerate(J.T):
        h = pitch(s) if s.any() else inf
        w = float(np.linalg.norm(s[:3]))
        if h == inf or abs(h) > LINE_TOLERANCE * max(1.0, float(np.linalg.norm(s[3:])) / w):
            found = f"a column {i} of pitch {h:.4g}" if s.any() else f"a zero column {i}"
            raise BadInput("lines", found, expected, "Only revolute axes are lines; see has_pseudoinverse for others.")
    return J


def _null_lines(R: Array, Q: Array, tolerance: float) -> tuple[Array, bool, bool]:
    """Null twists of the Klein form on the reciprocal system R (6, n); whether infinitely many; whether one, double."""
    n = R.shape[1]
    mu, E = np.linalg.eigh(R.T.dot(Q).dot(R))
    zero = np.abs(mu) <= tolerance
    up, down = np.flatnonzero(~zero & (mu > 0.0)), np.flatnonzero(~zero & (mu < 0.0))
    # Combinations of a positive and a negative direction are null, and so is all of the kernel.
    pairs = [
        np.sqrt(-mu[j]) * E[:, i] + sign * np.sqrt(mu[i]) * E[:, j] for i in up for j in down for sign in (1.0, -1.0)
    ]
    kernel = int(np.count_nonzero(zero))
    null = np.hstack((E[:, zero], np.array(pairs).T.reshape(n, len(pairs))))
    if n > 2 and len(up) and len(down):
        # Each pair spans its plane; the kernel added to a null twist is null: enough to span all there is.
        null = null[:, _independent(null)]
    plenty = (n > 2 and len(up) > 0 and len(down) > 0) or kernel > 1
    return R.dot(null), plenty, n > 1 and kernel == 1 and not pairs


def _independent(columns: Array) -> list[int]:
    """Indices of the first columns that are independent of those before them."""
    chosen: list[int] = []
    for i in range(columns.shape[1]):
        sigma = np.linalg.svd(columns[:, [*chosen, i]], compute_uv=False)
        if len(chosen) < len(columns) and sigma[-1] > RANK_TOLERANCE * sigma[0]:
            chosen.append(i)
    return chosen


def _split(null: Array, tolerance: float) -> tuple[Array, Array]:
    """Null twists (lengths of order one) as unit lines, and those with no angular part as unit translations."""
    unit = null / np.sqrt((null * null).sum(axis=0))
    w = np.sqrt((unit[:3] * unit[:3]).sum(axis=0))
    far = w <= tolerance
    at_infinity = unit[:, far]
    at_infinity[:3] = 0.0
    return unit[:, ~far] / w[~far], at_infinity
