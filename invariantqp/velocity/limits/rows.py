"""Limits on combinations of joint velocities, lower <= C x <= upper."""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.velocity.limits.box import Bounds
from invariantqp.velocity.qp.quadratic import Polytope


@frozen(init=False, eq=False, repr=False, slots=False)
class LimitRows(Value):
    """lower <= C x <= upper: a coupling of joints, the distance to an obstacle, one direction of a point's velocity.

    Where box and rows leave no velocity, the rows give way by the least sum of squares, each measured by its length (so
    its scale does not count); the box never does.

    Attributes:
        C: (k, m) rows on the joint velocity.
        lower: (k,), -inf where there is none.
        upper: (k,), +inf where there is none.
    """

    C: Array = field(converter=own)
    lower: Array = field(converter=own)
    upper: Array = field(converter=own)

    def __init__(self, C: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> None:
        """Rows.

        Args:
            C: (k, m) rows on the joint velocity.
            lower: (k,), -inf where there is none.
            upper: (k,), +inf where there is none.

        Raises:
            BadInput: shapes that do not fit, NaN, lower above upper (the row is named).
        """
        matrix = arrays.array(C, "C", "a (k, m) matrix")
        if matrix.ndim != 2 or 0 in matrix.shape:
            raise BadInput("C", f"shape {matrix.shape}", "(k, m), one row a limit")
        matrix = arrays.matrix(matrix, (None, matrix.shape[1]), "C")
        try:
            sides = Bounds(lower, upper)
        except BadInput as error:
            raise BadInput(
                error.argument, error.found.replace("joint", "row"), "lower <= upper for each row"
            ) from error
        if len(sides.lower) != len(matrix):
            raise BadInput("lower", f"{len(sides.lower)} limits", f"{len(matrix)}, one for each row of C")
        self.__attrs_init__(matrix, sides.lower, sides.upper)

    @classmethod
    def trusted(cls, C: Array, lower: Array, upper: Array) -> LimitRows:
        """Rows of float64 arrays that nobody else has and that are known to be right: nothing is checked or copied."""
        made = cls.__new__(cls)
        made.__setstate__({"C": C, "lower": lower, "upper": upper})
        return made

    def with_box(self, lower: Array, upper: Array) -> Polytope:
        """The polytope of a box (m,) on the joints and these rows."""
        A = np.vstack((np.eye(len(lower)), self.C))
        return Polytope(A, np.concatenate((lower, self.lower)), np.concatenate((upper, self.upper)))

    def allow(self, x: Array) -> bool:
        """Whether C x is inside."""
        y = self.C.dot(x)
        return bool((y >= self.lower).all() and (y <= self.upper).all())

    def excess(self, x: Array) -> Array:
        """(k,) how far C x is above the upper limit (positive) or below the lower one (negative); 0 inside."""
        y = self.C.dot(x)
        over, under = y - self.upper, y - self.lower
        return np.asarray(np.maximum(over, 0.0) + np.minimum(under, 0.0), dtype=np.float64)

    def share(self, x: Array) -> float:
        """The largest share of x in [0, 1] that the rows allow; rows that zero violates are ignored."""
        y, lower, upper = self.C.dot(x), self.lower, self.upper
        over = np.maximum(y / np.where(upper > 0.0, upper, np.inf), y / np.where(lower < 0.0, lower, -np.inf))
        return 1.0 / max(1.0, float(over.max()))
