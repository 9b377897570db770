"""A limit on the speed of a point of the tool: |v_p(x)| <= limit, a second-order cone (250 mm/s beside a person).

    v_p(x) = J_p x,  J_p = J_v + J_omega x p        the same length in every frame

Kept by its one multiplier inside the QP (`limits.cone`), or given as the cone itself to CVXPY.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.limits.cone import Cone
from invariantqp.velocity.qp.cones import Cvxpy


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
    _program: Cvxpy | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        object.__setattr__(self, "limit", arrays.number(self.limit, "limit", "a speed", positive=True))
        if self.point is not None:
            object.__setattr__(self, "point", arrays.vector(self.point, 3, "point"))
        if not isinstance(self.exact, bool):
            raise BadInput("exact", repr(self.exact), "True or False")
        if self.exact:
            object.__setattr__(self, "_program", Cvxpy())

    def cone(self, J: Array, point: Array) -> Cone:
        """The cone for joint twists J (6, m) and the point (3,) in the frame of J."""
        return Cone(velocity_at(J, point), self.limit, np.zeros(3), self._program)
