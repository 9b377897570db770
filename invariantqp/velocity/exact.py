"""Exact demands: equality constraints A x = b on the joint velocity."""

from __future__ import annotations

from math import sqrt

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.linear import TINY, rank_of
from invariantqp.geometry.se3 import cross, norm
from invariantqp.velocity.measure import root_at

# Relative tolerance of singular values in the rank of the rows.
ROW_TOLERANCE = 1e-10

# Inconsistencies are compared with demands of at least this share of the terms they sum: 1e-16 of the terms is
# rounding, 1e-9 of a demand an inconsistency.
LEAST_DEMAND = 1e-5


@frozen(init=False, eq=False, repr=False, slots=False)
class ExactRows(Value):
    """A x = b, satisfied exactly, or scaled down where limits forbid it."""

    A: Array = field(converter=own)
    b: Array = field(converter=own)
    of_twist: Array | None = field(converter=optional(own))

    def __init__(self, A: ArrayLike, b: ArrayLike, of_twist: ArrayLike | None = None) -> None:
        """Rows.

        Args:
            A: (k, m) rows on the joint velocity, for instance the velocity of a point, v + omega x p.
            b: (k,) demands.
            of_twist: (k, 6) D where rows are parts of the twist, A = D J, zero for a row that is not; None for none.
                The rank of rows in several units is then decided by the measure, not by their scaling.

        Raises:
            BadInput: shapes that do not fit, NaN.
        """
        rows = arrays.array(A, "A", "a (k, m) matrix")
        if rows.ndim != 2 or 0 in rows.shape:
            raise BadInput("A", f"shape {rows.shape}", "(k, m), one row a demand")
        D = None if of_twist is None else arrays.matrix(of_twist, (len(rows), 6), "of_twist")
        self.__attrs_init__(arrays.matrix(rows, (None, rows.shape[1]), "A"), arrays.vector(b, len(rows), "b"), D)

    def with_rows(self, others: ExactRows) -> ExactRows:
        """These rows and others on the same joints.

        Raises:
            BadInput: no ExactRows, or rows on another number of joints.
        """
        if not isinstance(others, ExactRows):
            raise BadInput("others", excerpt(others), "ExactRows(A, b)")
        if self.A.shape[1] != others.A.shape[1]:
            raise BadInput("others", f"rows on {others.A.shape[1]} joints", f"rows on {self.A.shape[1]}")
        D = None
        if self.of_twist is not None or others.of_twist is not None:
            D = np.vstack([np.zeros((len(r.A), 6)) if r.of_twist is None else r.of_twist for r in (self, others)])
        return ExactRows(np.vstack((self.A, others.A)), np.concatenate((self.b, others.b)), D)

    @classmethod
    def of(cls, J: ArrayLike, D: ArrayLike, b: ArrayLike, *, check: bool = True) -> ExactRows:
        """Parts of the twist: D J x = b for joint twists J (6, m) and D (k, 6).

        Args:
            J: (6, m) joint twists.
            D: (k, 6) parts of the twist.
            b: (k,) demands.
            check: False for float64 arrays that are known to be valid.

        Raises:
            BadInput: shapes that do not fit, NaN.
        """
        if check is not False:
            J, D = arrays.columns(J), arrays.matrix(D, (None, 6), "D")
            b = arrays.vector(b, len(D), "b")
        twists, parts = np.asarray(J), np.asarray(D)
        A = arrays.matrix(parts.dot(twists), (len(parts), twists.shape[1]), "A")
        return cls._made(A, np.asarray(b), parts)

    @classmethod
    def _made(cls, A: Array, b: Array, D: Array | None) -> ExactRows:
        made = cls.__new__(cls)
        made.__attrs_init__(A, b, D)
        return made

    def on(self, to_joint: Array | None) -> ExactRows:
        """The same rows on y, x = T y."""
        return self if to_joint is None else ExactRows(self.A.dot(to_joint), self.b, self.of_twist)

    @classmethod
    def point(cls, J: ArrayLike, point: ArrayLike, velocity: ArrayLike) -> ExactRows:
        """The velocity (3,) of the body point now at `point` (3,), v + omega x p, for joint twists J (6, m).

        Raises:
            BadInput: shapes that do not fit, NaN.
        """
        velocity = arrays.vector(velocity, 3, "velocity")
        return cls.of(J, _velocity_of(arrays.vector(point, 3, "point")), velocity)

    @classmethod
    def axis(cls, J: ArrayLike, axis: ArrayLike, omega: ArrayLike) -> ExactRows:
        """The turning of a direction (3,) fixed in the body: omega (3,) without its part about that direction.

        Raises:
            BadInput: a zero axis.
        """
        a = arrays.direction(axis, "axis")
        first = arrays.direction(cross(a, np.eye(3)[np.abs(a).argmin()]), "axis")
        across = np.array((first, cross(a, first)))
        D = np.hstack((across, np.zeros((2, 3))))
        return cls.of(J, D, across.dot(arrays.vector(omega, 3, "omega")))

    @classmethod
    def plane(cls, J: ArrayLike, point: ArrayLike, normal: ArrayLike, speed: float) -> ExactRows:
        """The speed of the body point now at `point` (3,) along `normal` (3,) of any length, towards or off a plane.

        Raises:
            BadInput: a zero normal.
        """
        n = arrays.direction(normal, "normal")
        D = n.dot(_velocity_of(arrays.vector(point, 3, "point"))).reshape(1, 6)
        return cls.of(J, D, [arrays.number(speed, "speed")])


def _velocity_of(point: Array) -> Array:
    """(3, 6) D with D s = v + omega x p."""
    return root_at(point, 1.0)[3:]


def whitened(exact: ExactRows, root: Array, s: Array | None = None) -> tuple[Array, float]:
    """M (k, r) with rows M'A and demands M'b, and the relative inconsistency of the demands.

    Rows that are parts of the twist become orthonormal in the measure; others are scaled to the norm of all of these.
    So the rank and the solution of inconsistent rows do not depend on frame, unit of length or choice of rows.

    Args:
        exact: the rows.
        root: (6, 6) of the measure.
        s: (6,) the twist of which the demands are parts, if they are; inconsistencies within its rounding are ignored.
    """
    C, e, D = exact.A, exact.b, exact.of_twist
    if D is None or np.count_nonzero(D) == 0:
        return np.eye(len(e)), 0.0
    twist = D.any(axis=1)
    mix, inconsistency = _orthonormal(e[twist], D[twist], root, s)
    if twist.all():
        return mix, inconsistency
    parts = mix.T.dot(C[twist])
    sizes = np.sqrt((C[~twist] * C[~twist]).sum(axis=1))
    scale = (sqrt(float((parts * parts).sum())) or 1.0) / np.where(sizes > 0.0, sizes, 1.0)
    M = np.zeros((len(e), len(parts) + len(scale)))
    M[twist, : len(parts)], M[~twist, len(parts) :] = mix, np.diag(scale)
    return M, inconsistency


def _orthonormal(e: Array, D: Array, root: Array, s: Array | None) -> tuple[Array, float]:
    """The same for rows that are all parts of the twist."""
    measured: Array = lapack.dgesv(root.T, D.T)[2].T
    sizes = np.sqrt((measured * measured).sum(axis=1))
    U, sigma = lapack.dgesdd(measured / sizes[:, None])[:2]
    r = rank_of(sigma, ROW_TOLERANCE)
    inconsistency = 0.0
    if r < len(e):
        demands, terms = (e / sizes).dot(U), 0.0 if s is None else LEAST_DEMAND * norm(np.abs(D).dot(np.abs(s)) / sizes)
        inconsistency = norm(demands[r:]) / max(norm(demands), terms, TINY)
    return U[:, :r] / sigma[:r] / sizes[:, None], inconsistency
