"""The measure of a controller: at a point of the tool, at the arm's own point, or by a metric carried by a body."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.target import Target, root_of
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
        """Choose once, in the middle of the joint range.

        The point is (3,) in the tool frame, None its origin, "own" the arm's own point; the length L, None the arm's
        reach to it; or a metric is carried by a body, or by the tool.
        """
        self.point: Array | None = point_of(point)
        mid = middle(require_robot(robot))
        J = robot.jacobian(mid)
        there = own_point(J) if self.point is None else robot.pose(mid).dot([*self.point.tolist(), 1.0])[:3]
        given = None if length is None else arrays.number(length, "length", "a length", positive=True)
        self.length: float = length_at(J, there) if given is None else given
        self.carried = carried

    @property
    def radian(self) -> float:
        """The size of a turn by one radian: L, or of turns about a metric's own centre, in the mean of all axes."""
        if self.carried is None:
            return self.length
        W = self.carried.matrix
        turns = W[:3, :3] - W[:3, 3:].dot(np.linalg.solve(W[3:, 3:], W[3:, :3]))  # the same wherever the metric is
        return sqrt(float(np.trace(turns)) / 3.0)

    def root_for(self, J: Array, pose: Any, at: Array | None = None, part: Target | None = None) -> Array:
        """(6, 6) root of the metric for joint twists J (6, m) and the tool at `pose`; `at` (3,) replaces the point.

        Of a target that leaves something free, (k, 6) of the part that counts, measured at its own point.
        """
        if part is not None:
            T = _homogeneous(pose)
            return root_of(part, self.root_for(J, T, T[:3, :3].dot(part.tool_point) + T[:3, 3]), T)
        if self.carried is not None:
            return self.carried.root(_homogeneous(pose) if self.carried.follows_tool else None)
        if at is None and self.point is not None:
            T = _homogeneous(pose)
            at = T[:3, :3].dot(self.point) + T[:3, 3]
        return root_at(own_point(J) if at is None else at, self.length)


def point_of(point: ArrayLike | str | None) -> Array | None:
    """(3,) a point in a frame, None for its origin; of "own", the arm's own point, None."""
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
