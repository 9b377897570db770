"""Limits on combinations of joint velocities, lower <= C x <= upper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits.box import Bounds
from invariantqp.velocity.qp.polytope import Polytope


@dataclass(frozen=True, eq=False)
class LimitRows:
    """lower <= C x <= upper: a coupling of joints, the distance to an obstacle, one direction of a point's velocity.

    Where box and rows leave no velocity, the rows give way by the least sum of squares; the box never does.

    Attributes:
        C: (k, m) rows on the joint velocity.
        lower: (k,), -inf where there is none.
        upper: (k,), +inf where there is none.

    Raises:
        BadInput: shapes that do not fit, NaN, lower above upper (the row is named).
    """

    C: ArrayLike
    lower: ArrayLike
    upper: ArrayLike

    def __post_init__(self) -> None:
        C = arrays.array(self.C, "C", "a (k, m) matrix")
        if C.ndim != 2 or 0 in C.shape:
            raise BadInput("C", f"shape {C.shape}", "(k, m), one row a limit")
        C = arrays.matrix(C, (None, C.shape[1]), "C")
        try:
            sides = Bounds(self.lower, self.upper)
        except BadInput as error:
            raise BadInput(
                error.argument, error.found.replace("joint", "row"), "lower <= upper for each row"
            ) from error
        if len(np.asarray(sides.lower)) != len(C):
            raise BadInput("lower", f"{len(np.asarray(sides.lower))} limits", f"{len(C)}, one for each row of C")
        object.__setattr__(self, "C", C)
        object.__setattr__(self, "lower", sides.lower)
        object.__setattr__(self, "upper", sides.upper)

    def with_box(self, lower: Array, upper: Array) -> Polytope:
        """The polytope of a box (m,) on the joints and these rows."""
        A = np.vstack((np.eye(len(lower)), np.asarray(self.C)))
        return Polytope(A, np.concatenate((lower, self.lower)), np.concatenate((upper, self.upper)))

    def allow(self, x: Array) -> bool:
        """Whether C x is inside."""
        y = np.asarray(self.C).dot(x)
        return bool((y >= self.lower).all() and (y <= self.upper).all())

    def excess(self, x: Array) -> Array:
        """(k,) how far C x is above the upper limit (positive) or below the lower one (negative); 0 inside."""
        y = np.asarray(self.C).dot(x)
        over, under = y - np.asarray(self.upper), y - np.asarray(self.lower)
        return np.asarray(np.maximum(over, 0.0) + np.minimum(under, 0.0), dtype=np.float64)

    def share(self, x: Array) -> float:
        """The largest share of x in [0, 1] that the rows allow; rows that standing still does not meet have no say."""
        y = np.asarray(self.C).dot(x)
        lower, upper = np.asarray(self.lower), np.asarray(self.upper)
        over = np.maximum(y / np.where(upper > 0.0, upper, np.inf), y / np.where(lower < 0.0, lower, -np.inf))
        return 1.0 / max(1.0, float(over.max()))
