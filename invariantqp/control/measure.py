"""The size of twists in a controller: at a point of the tool, at the arm's own point, or by a carried metric."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.target import Target, constrained_root
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle, require_robot
from invariantqp.velocity.forms import CarriedMetric
from invariantqp.velocity.measure import length_at, own_point, root_at


class ToolMeasure:
    """|s|^2 = L^2 |omega|^2 + |v_p|^2 at a physical point p of the tool, or a carried metric instead.

    Attributes:
        point: (3,) p in the tool frame [length]; None is the arm's own point.
        length: L [length/rad].
        carried: the metric instead, or None.
    """

    def __init__(
        self,
        robot: Robot,
        point: ArrayLike | str | None = None,
        length: float | None = None,
        carried: CarriedMetric | None = None,
    ) -> None:
        """A measure that is determined in the middle of the joint range.

        Args:
            robot: the arm.
            point: (3,) in the tool frame; None is its origin, "own" the arm's own point.
            length: L; None is the arm's reach to the point.
            carried: a metric carried by a body, instead of point and length.
        """
        self.point: Array | None = point_of(point)
        mid = middle(require_robot(robot))
        J = robot.jacobian(mid)
        if length is None:
            place = own_point(J) if self.point is None else robot.pose(mid).dot([*self.point.tolist(), 1.0])[:3]
            self.length: float = length_at(J, place)
        else:
            self.length = arrays.number(length, "length", "a length", positive=True)
        self.carried = carried

    @property
    def radian(self) -> float:
        """The size of a rotation by one radian: L; of a metric, the mean over all axes through its centre."""
        if self.carried is None:
            return self.length
        W = self.carried.matrix
        turns = W[:3, :3] - W[:3, 3:].dot(np.linalg.solve(W[3:, 3:], W[3:, :3]))  # independent of the metric's frame
        return sqrt(float(np.trace(turns)) / 3.0)

    def root_for(self, J: Array, pose: Any, at: Array | None = None, part: Target | None = None) -> Array:
        """(6, 6) root of the metric for joint twists J (6, m) and the tool at `pose`; `at` (3,) replaces the point.

        For a partial target, (k, 6) of its constrained directions, measured at its point.
        """
        if part is not None:
            T = _homogeneous(pose)
            return constrained_root(part, self.root_for(J, T, T[:3, :3].dot(part.tool_point) + T[:3, 3]), T)
        if self.carried is not None:
            return self.carried.root(_homogeneous(pose) if self.carried.follows_tool else None)
        if at is None and self.point is not None:
            T = _homogeneous(pose)
            at = T[:3, :3].dot(self.point) + T[:3, 3]
        return root_at(own_point(J) if at is None else at, self.length)


def point_of(point: ArrayLike | str | None) -> Array | None:
    """The argument point= as (3,) in its frame; None for "own", the arm's own point."""
    if isinstance(point, str) and point != "own":
        raise BadInput("point", excerpt(point), '"own" or (3,) in the frame')
    return None if isinstance(point, str) else np.zeros(3) if point is None else arrays.vector(point, 3, "point")


def tool_metric(robot: Robot, length: float | None = None) -> CarriedMetric:
    """diag(L^2 I, I) carried by the tool, L the arm's reach: the default measure of a controller.

    Args:
        robot: the arm.
        length: another L [length/rad].
    """
    L = ToolMeasure(robot, length=length).length
    return CarriedMetric(np.repeat((L * L, 1.0), 3))


def _homogeneous(pose: Any) -> Array:
    return np.asarray(getattr(pose, "homogeneous", pose))
