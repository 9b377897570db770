"""Two who move one tool, each along a system of twists of their own: neither can push the other off.

    s = P1 s_robot + P2 s_operator,    P1 S2 = 0,   P2 S1 = 0

P1 projects on S1 along S2 + R, P2 on S2 along S1 + R. R is what neither may move: nothing where S1 and S2 fill six
dimensions, else what is h-reciprocal, or orthogonal in a metric, to both together.

Reference: [DS] Sect. 6.1 (projectors along a complement).
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.projectors import dual_projectors
from invariantqp.systems.span import span
from invariantqp.systems.subspaces import screw_system


@dataclass(frozen=True, eq=False)
class SharedTask:
    """S1 for the robot, S2 for the operator.

    Attributes:
        S1: (6, m) twists the robot moves along, base frame.
        S2: (6, n) twists the operator moves along; None is all that the h or the metric leaves, S1^{perp h}.
        h: pitch [length/rad] for what is left over; not needed where S1 and S2 fill six dimensions.
        metric: (6, 6) or (6,) positive definite instead, base frame.
        robot: (6, 6) P1.
        operator: (6, 6) P2.

    Raises:
        BadInput: S1 and S2 share a twist, both h and metric, or neither where one is needed.
        NoProjectors: the h does not do for S1, or for S1 and S2 together.
    """

    S1: ArrayLike
    S2: ArrayLike | None = None
    h: float | None = None
    metric: Any = None
    robot: Array = field(init=False, repr=False)
    operator: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        first = screw_system(self.S1)
        if self.metric is not None:
            M = arrays.positive_definite(getattr(self.metric, "carried", self.metric), 6, "metric")
            object.__setattr__(self, "metric", M)
        rule = {"h": self.h, "metric": self.metric}
        if self.S2 is None:
            split = dual_projectors(first, **rule)
            both = split.motion, np.eye(6) - split.motion
        else:
            both = _three_ways(first, screw_system(self.S2), rule)
        object.__setattr__(self, "robot", both[0])
        object.__setattr__(self, "operator", both[1])

    def twist(self, robot: ArrayLike, operator: ArrayLike) -> Array:
        """The (6,) twist for what each of the two asks, (6,) twists in the base frame.

        Raises:
            BadInput: NaN, shapes.
        """
        s1, s2 = arrays.twist(robot, "robot"), arrays.twist(operator, "operator")
        twist: Array = self.robot.dot(s1) + self.operator.dot(s2)
        return twist

    def moved(self, pose: ArrayLike) -> SharedTask:
        """The same task after a (4, 4) rigid motion of both systems."""
        T = arrays.pose(pose)
        A, B = se3.adjoint(T, check=False), se3.coadjoint(T, check=False)
        M = self.metric
        told: dict[str, Any] = {
            "S1": A.dot(np.asarray(self.S1)),
            "S2": None if self.S2 is None else A.dot(np.asarray(self.S2)),
            "metric": None if M is None else B.dot(np.asarray(M)).dot(B.T),
            "robot": A.dot(self.robot).dot(B.T),
            "operator": A.dot(self.operator).dot(B.T),
        }
        moved = copy(self)  # nothing is worked out again: a task moves in every tick
        for name, value in told.items():
            object.__setattr__(moved, name, value)
        return moved


def _three_ways(first: Array, second: Array, rule: dict[str, Any]) -> tuple[Array, Array]:
    """P1 and P2 where S1, S2 and what is left over fill six dimensions together."""
    joined = np.hstack((first, second))
    if span(joined).rank < joined.shape[1]:
        shared = f"systems of {first.shape[1]} and {second.shape[1]} dimensions that share a twist"
        raise BadInput("S2", shared, "one that meets S1 in nothing", "Whose would that twist be?")
    rest = np.empty((6, 0))
    if joined.shape[1] < 6:
        rest = dual_projectors(joined, **rule).complement
    return (
        dual_projectors(first, complement=np.hstack((second, rest))).motion,
        dual_projectors(second, complement=np.hstack((first, rest))).motion,
    )
