"""Shared control: a robot and an operator move one tool without disturbing each other.

    s = P1 s_robot + P2 s_operator,    P1 S2 = 0,   P2 S1 = 0

P1 projects on S1 along S2 + R, P2 on S2 along S1 + R. R has the twists that neither may use: none if S1 and S2 span six
dimensions, else the twists h-reciprocal, or orthogonal in a metric, to both.

Reference: [DS] Sect. 6.1 (projectors along a complement).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from attrs import field, frozen
from attrs.converters import optional
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.forms import finite_pitch
from invariantqp.systems.projectors import dual_projectors
from invariantqp.systems.subspaces import Subspace, screw_system


@frozen(init=False, eq=False, repr=False, slots=False)
class SharedTask(Value):
    """A tool that a robot moves along S1 and an operator along S2.

    Attributes:
        S1: (6, m) twists the robot moves along, base frame.
        S2: (6, n) twists the operator moves along, or None for the complement of S1 in h or the metric.
        h: pitch [length/rad] that defines R, or None.
        metric: (6, 6) positive definite, base frame, instead of h, or None.
        robot_projector: (6, 6) P1.
        operator_projector: (6, 6) P2.
    """

    S1: Array = field(converter=own)
    S2: Array | None = field(converter=optional(own))
    h: float | None
    metric: Array | None = field(converter=optional(own))
    robot_projector: Array = field(converter=own, repr=False)
    operator_projector: Array = field(converter=own, repr=False)

    def __init__(self, S1: ArrayLike, S2: ArrayLike | None = None, h: float | None = None, metric: Any = None) -> None:
        """See the attributes; metric= also takes a CarriedMetric. S1 and S2 that span all twists need no h or metric.

        Raises:
            BadInput: S1 and S2 share a twist, both h and metric, or neither where one is needed.
            NoProjectors: h has no projectors for S1, or for S1 and S2 together.
        """
        twists = arrays.columns(S1, "S1")
        others = None if S2 is None else arrays.columns(S2, "S2")
        pitch = None if h is None else finite_pitch(h)
        M = None if metric is None else arrays.positive_definite(getattr(metric, "carried", metric), 6, "metric")
        if pitch is not None and M is not None:
            raise BadInput("h", "h and metric", "one of the two")
        rule: dict[str, Any] = {"h": pitch, "metric": M}
        if others is None:
            robot = dual_projectors(screw_system(twists), **rule).motion
            operator = np.eye(6) - robot
        else:
            robot, operator = _project(screw_system(twists), screw_system(others), rule)
        self.__attrs_init__(twists, others, pitch, M, robot, operator)

    def twist(self, robot: ArrayLike, operator: ArrayLike) -> Array:
        """(6,) the twist of the tool from the desired twists (6,) of both, base frame."""
        s1, s2 = arrays.twist(robot, "robot"), arrays.twist(operator, "operator")
        return np.asarray(self.robot_projector.dot(s1) + self.operator_projector.dot(s2))

    def moved(self, pose: ArrayLike) -> SharedTask:
        """The same task after a rigid motion (4, 4) of both systems."""
        T = arrays.pose(pose)
        A, B = se3.adjoint(T, check=False), se3.coadjoint(T, check=False)
        task = SharedTask.__new__(SharedTask)  # its fields are known to be valid
        task.__attrs_init__(
            S1=A.dot(self.S1),
            S2=None if self.S2 is None else A.dot(self.S2),
            h=self.h,
            metric=None if self.metric is None else B.dot(self.metric).dot(B.T),
            robot_projector=A.dot(self.robot_projector).dot(B.T),
            operator_projector=A.dot(self.operator_projector).dot(B.T),
        )
        return task


def _project(first: Array, second: Array, rule: dict[str, Any]) -> tuple[Array, Array]:
    """P1 and P2 for S1 and S2."""
    joined = np.hstack((first, second))
    if Subspace(joined).dimension < joined.shape[1]:
        found = f"systems of {first.shape[1]} and {second.shape[1]} dimensions that share a twist"
        raise BadInput("S2", found, "a system with no twist of S1 in it", "Give each shared twist to one of the two.")
    rest = np.empty((6, 0))
    if joined.shape[1] < 6:
        rest = dual_projectors(joined, **rule).complement
    return (
        dual_projectors(first, complement=np.hstack((second, rest))).motion,
        dual_projectors(second, complement=np.hstack((first, rest))).motion,
    )
