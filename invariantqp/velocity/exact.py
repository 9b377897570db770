"""Exact demands on the joint velocity, A x = b, removed before anything is minimised: x = x0 + B z.

    x0 = M^-1 A'(A M^-1 A')^-1 b,    A B = 0,    B'MB = I

What is left is a problem in z alone, in which the rows hold by construction. A joint metric M enters here and nowhere
else: z is a coordinate in which M is the identity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at

# A singular value of A M^-1/2 below this fraction of the largest is a dependent row.
ROW_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class ExactRows:
    """A x = b, met exactly, or along the same direction more slowly where limits forbid it.

    Attributes:
        A: (k, m) rows on the joint velocity, for instance the velocity of a point, v + omega x p.
        b: (k,) demands.

    Raises:
        BadInput: shapes that do not fit, NaN.
    """

    A: ArrayLike
    b: ArrayLike

    def __post_init__(self) -> None:
        A = arrays.array(self.A, "A", "a (k, m) matrix")
        if A.ndim != 2 or 0 in A.shape:
            raise BadInput("A", f"shape {A.shape}", "(k, m), one row a demand")
        object.__setattr__(self, "A", arrays.matrix(A, (None, A.shape[1]), "A"))
        object.__setattr__(self, "b", arrays.vector(self.b, len(A), "b"))

    def with_rows(self, others: ExactRows) -> ExactRows:
        """These rows and others, of the same joints.

        Raises:
            BadInput: rows on another number of joints.
        """
        A, B = np.asarray(self.A), np.asarray(others.A)
        if A.shape[1] != B.shape[1]:
            raise BadInput("others", f"rows on {B.shape[1]} joints", f"rows on {A.shape[1]}")
        return ExactRows(np.vstack((A, B)), np.concatenate((np.asarray(self.b), np.asarray(others.b))))

    @classmethod
    def point(cls, J: ArrayLike, point: ArrayLike, velocity: ArrayLike) -> ExactRows:
        """The velocity (3,) of the body point now at `point` (3,), v + omega x p, for joint twists J (6, m)."""
        return cls(velocity_at(arrays.columns(J), arrays.vector(point, 3, "point")), velocity)

    @classmethod
    def axis(cls, J: ArrayLike, axis: ArrayLike, omega: ArrayLike) -> ExactRows:
        """How a direction (3,) fixed in the body turns: omega (3,) but for its part about the axis itself.

        Raises:
            BadInput: a zero axis.
        """
        across = np.linalg.svd(arrays.direction(axis, "axis").reshape(1, 3))[2][1:]
        return cls(across.dot(arrays.columns(J)[:3]), across.dot(arrays.vector(omega, 3, "omega")))

    @classmethod
    def plane(cls, J: ArrayLike, point: ArrayLike, normal: ArrayLike, speed: float) -> ExactRows:
        """The speed of the body point now at `point` (3,) along `normal` (3,), of any length: its way from a plane.

        Raises:
            BadInput: a zero normal.
        """
        n = arrays.direction(normal, "normal")
        moves = velocity_at(arrays.columns(J), arrays.vector(point, 3, "point"))
        return cls(n.dot(moves).reshape(1, -1), [arrays.number(speed, "speed")])


class Reduction(NamedTuple):
    """x = x0 + B z.

    Attributes:
        origin: (m,) x0, the M-shortest velocity that meets the rows; empty where basis is None.
        basis: (m, n) B, or None for the identity.
        dual: (n, m) B'M, which gives z = B'M (x - x0); None for the identity.
        unmet: the part of |b| that no velocity can meet, relative.
    """

    origin: Array
    basis: Array | None
    dual: Array | None
    unmet: float = 0.0

    def joint(self, z: Array) -> Array:
        """The joint velocity x0 + B z."""
        return z if self.basis is None else self.origin + self.basis.dot(z)

    def reduced(self, x: Array) -> Array:
        """The z of the solution nearest x."""
        return x if self.dual is None else self.dual.dot(x - self.origin)

    def scaled(self, alpha: float) -> Reduction:
        """The same rows with demand alpha b."""
        return self._replace(origin=alpha * self.origin)


# Nothing demanded, nothing weighted: z is x.
FREE = Reduction(np.empty(0), None, None)


def reduce(m: int, exact: ExactRows | None, metric: Array | None) -> Reduction:
    """Solve the rows and find what is left free; `metric` (m, m) is M or None for the identity."""
    if exact is None and metric is None:
        return FREE
    M = np.eye(m) if metric is None else metric
    to_joint = np.linalg.inv(np.linalg.cholesky(M)).T  # x = to_joint y; M is the identity in y
    if exact is None:
        return Reduction(np.zeros(m), to_joint, to_joint.T.dot(M))
    A, b = np.asarray(exact.A), np.asarray(exact.b)
    U, sigma, Vt = np.linalg.svd(A.dot(to_joint))
    r = int(np.count_nonzero(sigma > ROW_TOLERANCE * max(sigma[0], np.finfo(float).tiny)))
    reachable = U[:, :r].T.dot(b)
    unmet = b - U[:, :r].dot(reachable)
    scale = float(np.linalg.norm(b))
    y0 = Vt[:r].T.dot(reachable / sigma[:r])
    B = to_joint.dot(Vt[r:].T)
    return Reduction(to_joint.dot(y0), B, B.T.dot(M), float(np.linalg.norm(unmet)) / scale if scale > 0.0 else 0.0)
