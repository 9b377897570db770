"""A limit on the speed of a point of the tool: |v_p(x)| <= limit, a second-order cone (250 mm/s beside a person).

    v_p(x) = J_p x,  J_p = J_v + J_omega x p        the same length in every frame

Kept by its one multiplier inside the QP (`limits.cone`), or given as the cone itself to CVXPY.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.qp.backends import Cvxpy
from invariantqp.velocity.qp.quadratic import Cone


@frozen(init=False, eq=False, repr=False, slots=False)
class ToolSpeed(Value):
    """The speed limit of a point of the tool.

    It gives way, by the least, where joint limits or rows force the tool to move faster; the status says so.

    Attributes:
        limit: [length/s].
        point: (3,) in the frame of J for `solve_velocity`; in the tool frame for a controller, None being its own.
        exact: True to give the second-order cone itself to CVXPY (slower, the same answer).
    """

    limit: float
    point: Array | None = field(converter=optional(own))
    exact: bool
    _program: Cvxpy | None = field(eq=False, repr=False)

    def __init__(self, limit: float, point: ArrayLike | None = None, *, exact: bool = False) -> None:
        """A speed limit.

        Args:
            limit: [length/s], positive.
            point: (3,) in the frame of J for `solve_velocity`; in the tool frame for a controller, None being its own.
            exact: True to give the second-order cone itself to CVXPY (slower, the same answer).

        Raises:
            BadInput: a limit that is not positive, a point that is none.
            MissingExtra: exact without CVXPY.
        """
        speed = arrays.number(limit, "limit", "a speed", positive=True)
        where = None if point is None else arrays.vector(point, 3, "point")
        if not isinstance(exact, bool):
            raise BadInput("exact", excerpt(exact), "True or False")
        self.__attrs_init__(speed, where, exact, Cvxpy() if exact else None)

    def cone(self, J: Array, point: Array) -> Cone:
        """The cone for joint twists J (6, m) and the point (3,) in the frame of J."""
        return Cone(velocity_at(J, point), self.limit, np.zeros(3), self._program)
