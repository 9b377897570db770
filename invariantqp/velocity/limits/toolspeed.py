"""A limit on the speed of a point of the tool: |v_p(x)| <= limit, a second-order cone (250 mm/s beside a person).

    v_p(x) = J_p x,  J_p = J_v + J_omega x p        the same length in every frame

Kept by tangent planes inside the QP (`velocity.qp.tangents`), or as the cone itself by CVXPY (`velocity.qp.cones`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.qp.cones import ConeProgram

# An optimum this far outside the cone, relative to the limit, is at it; it is then shortened to the limit.
CONE_TOLERANCE = 1e-9

# Less than this of the point's velocity, relative, is rounding.
FIXED_TOLERANCE = 1e-13


class Cone(NamedTuple):
    """|start + J x| <= limit.

    Attributes:
        J: (3, m).
        limit: [length/s].
        program: the solver that takes the cone as it is; None for tangent planes.
        start: (3,).
    """

    J: Array
    limit: float
    program: ConeProgram | None
    start: Array

    def velocity(self, x: Array) -> Array:
        """(3,) of the point [length/s]."""
        return np.asarray(self.start + self.J.dot(x), dtype=np.float64)

    def speed(self, x: Array) -> float:
        """|v_p| [length/s]."""
        v = self.velocity(x)
        return sqrt(float(v.dot(v)))

    def allows(self, x: Array) -> bool:
        """Whether the point is slow enough."""
        return self.speed(x) <= self.limit

    def on(self, origin: Array, basis: Array) -> Cone:
        """The same cone on z, x = origin + basis z."""
        J = self.J.dot(basis)
        # Where the rows fix the point's velocity, rounding must not pass for a way to change it.
        J[np.abs(J) <= FIXED_TOLERANCE * np.abs(self.J).max() * np.abs(basis).max(initial=0.0)] = 0.0
        return self._replace(start=self.velocity(origin), J=J)

    def tangent(self, x: Array) -> tuple[Array, float]:
        """The half-space a.x <= b that touches the cone where x, outside it, points to."""
        v = self.velocity(x)
        speed = sqrt(float(v.dot(v)))
        n = v / speed if speed > 0.0 else v
        return n.dot(self.J), self.limit - float(n.dot(self.start))


@dataclass(frozen=True, eq=False)
class ToolSpeed:
    """The speed limit of a point of the tool.

    It gives way, by the least, where joint limits or rows force the tool to move faster; the status says so.

    Attributes:
        limit: [length/s].
        point: (3,) in the frame of J for `solve_velocity`; in the tool frame for a controller, None being its own.
        exact: True to give the second-order cone itself to CVXPY (slower, the same answer).

    Raises:
        BadInput: a limit that is not positive, a point that is none.
        MissingExtra: exact without CVXPY.
    """

    limit: float
    point: ArrayLike | None = None
    exact: bool = False
    _program: ConeProgram | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limit", arrays.number(self.limit, "limit", "a speed", positive=True))
        if self.point is not None:
            object.__setattr__(self, "point", arrays.vector(self.point, 3, "point"))
        if not isinstance(self.exact, bool):
            raise BadInput("exact", repr(self.exact), "True or False")
        if self.exact:
            object.__setattr__(self, "_program", ConeProgram())

    def cone(self, J: Array, point: Array) -> Cone:
        """The cone for joint twists J (6, m) and the point (3,) in the frame of J."""
        return Cone(velocity_at(J, point), self.limit, self._program, np.zeros(3))
