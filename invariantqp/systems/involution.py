"""Lines in involution: 2 to 6 joint axes along which forces can balance, det(J'Q_0 J) = 0, and their transversals.

    z in S meet S^{perp 0}:   W = Q_0 z = Q_0 J lambda is a wrench along the lines with J'W = 0: no joint needs a torque

Independent lines are in involution iff J has no 0-pseudoinverse; dependent lines are, by J lambda = 0 and W = 0.

A transversal is a line reciprocal to all of the lines: it meets each or is parallel to it. A transversal at infinity
is a translation reciprocal to all: all lines are parallel to the plane across it. Both are null twists of the Klein
form on the reciprocal system R, and det(J'Q_0 J) = 0 iff det(R'Q_0 R) = 0. Of four independent lines R is a 2-system:

    R of type IA, pitches of one sign, or IIA of pitch p != 0     no real transversal             not in involution
    IA, pitches of opposite sign                                  two                             not
    IB                                                            one, and one at infinity        not
    IA, one pitch 0                                               one, which counts twice         in involution
    IIB, pitch p != 0                                             one at infinity, twice          in involution
    IIA or IIB, pitch 0                                           infinitely many                 in involution

[DS] says that four lines are in involution precisely when they have infinitely many transversals, and gives two to
every IA; both are too narrow. IIB with p != 0 is four lines parallel to one plane at heights above it that have the
cross ratio of their directions. Five lines are in involution iff they have a transversal, finite or at infinity.

Reference: [DS] Sect. 4, corrected.
"""

from __future__ import annotations

from math import inf

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import pitch_form
from invariantqp.geometry.screws import pitch
from invariantqp.systems.factors import LARGEST_CONDITION, factors
from invariantqp.systems.gram import gram_matrix
from invariantqp.systems.span import RANK_TOLERANCE, orthogonal, span

# A column is a line if its pitch is below this fraction of its distance from the origin (or of 1): model files have
# nine digits at best.
LINE_TOLERANCE = 1e-9

# Relative error of the lines that must not change the answer: that at which `has_pseudoinverse` refuses.
ERROR_TOLERANCE = 1.0 / LARGEST_CONDITION


@frozen(eq=False, repr=False, slots=False)
class Involution(Value):
    """Whether lines are in involution, and what meets them.

    Attributes:
        holds: whether forces along the lines, not all zero, ask no torque of any joint.
        determinant: Sylvester's det(J'Q_0 J) of the columns as given; J A has det(A)^2 times it.
        rank: number of independent lines.
        transversals: (6, n) unit lines that meet (or are parallel to) all lines. All of them where finitely many;
            where infinitely many, independent ones from which the others are combined.
        transversal_count: 0, 1, 2 or inf, without those at infinity.
        double: whether the only transversal, a line or at infinity, counts twice (a limit of two that came together).
        at_infinity: (6, k) translations reciprocal to all lines: transversals at infinity.
        joint_forces: (m,) lambda, unit, the forces along the lines that balance; None unless `holds`.
        equilibrium_wrench: (6,) their sum W = Q_0 J lambda: zero where the lines are dependent, else a force along a
            transversal, or a couple, that does no work on any joint; None unless `holds`.
    """

    holds: bool
    determinant: float
    rank: int
    transversals: Array = field(converter=own)
    transversal_count: float
    double: bool
    at_infinity: Array = field(converter=own)
    joint_forces: Array | None = field(converter=optional(own))
    equilibrium_wrench: Array | None = field(converter=optional(own))


def involution(lines: ArrayLike, tolerance: float = ERROR_TOLERANCE) -> Involution:
    """Decide involution of 2..6 lines and find their transversals and equilibrium.

    Args:
        lines: (6, m) twists of pitch 0 as columns, of any length, 2 <= m <= 6.
        tolerance: relative error of the lines: they are in involution if such an error could have made them so.

    Raises:
        BadInput: shapes, NaN, fewer than 2 or more than 6 columns, a column whose pitch is not 0, a tolerance that is
            not between 0 and 1.

    Reference: [DS] Sect. 4.
    """
    J = _lines(lines)
    limit = arrays.tolerance(tolerance)
    system, found = span(J), factors(J, 0.0)
    Q = pitch_form(0.0)  # in any unit of length the same matrix
    dependent = system.rank < J.shape[1]
    kernel = int(np.count_nonzero(found.shares * limit > 1.0))
    holds = dependent or kernel > 0
    forces: Array | None = None
    wrench: Array | None = None
    if dependent:
        forces = system.still[:, -1]
        wrench = np.zeros(6)
    elif holds:
        balanced = np.linalg.lstsq(J, found.lost, rcond=None)[0]
        forces = np.asarray(balanced / np.linalg.norm(balanced))
        wrench = Q.dot(J.dot(forces))
    R = orthogonal(Q.dot(system.basis))
    null, plenty, double = _null_lines(R, Q, kernel)
    finite, at_infinity = _split(null, limit * system.spread)
    finite[3:] *= system.unit
    return Involution(
        holds=holds,
        determinant=float(np.linalg.det(gram_matrix(J, 0.0))),
        rank=system.rank,
        transversals=finite,
        transversal_count=inf if plenty else float(finite.shape[1]),
        double=double,
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
            raise BadInput("lines", found, expected, "Only revolute joints are lines; for others has_pseudoinverse.")
    return J


def _null_lines(R: Array, Q: Array, kernel: int) -> tuple[Array, bool, bool]:
    """Null twists of the Klein form on the reciprocal system R (6, n); whether infinitely many; whether one, twice.

    `kernel` is the dimension of S meet S^{perp 0}, on which the form vanishes whether seen from S or from R.
    """
    n = R.shape[1]
    mu, E = np.linalg.eigh(R.T.dot(Q).dot(R))
    zero = np.zeros(n, dtype=bool)
    zero[np.argsort(np.abs(mu))[:kernel]] = True
    up, down = np.flatnonzero(~zero & (mu > 0.0)), np.flatnonzero(~zero & (mu < 0.0))
    # Combinations of a positive and a negative direction are null, and so is all of the kernel.
    pairs = [
        np.sqrt(-mu[j]) * E[:, i] + sign * np.sqrt(mu[i]) * E[:, j] for i in up for j in down for sign in (1.0, -1.0)
    ]
    null = np.hstack((E[:, zero], np.array(pairs).T.reshape(n, len(pairs))))
    if n > 2 and len(up) and len(down):
        # Infinitely many: keep as many independent ones as there are.
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
