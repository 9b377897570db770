"""What a hand-written loop reads of an arm: everything in the tool frame, by Pinocchio where it is installed.

A loop around a method is timed as one writes it by hand, so it does not go through the base frame of this library.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from invariantqp.compare.names import OURS
from invariantqp.extras import is_installed
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot

# Pinocchio has the linear part first.
ANGULAR_FIRST = np.array([3, 4, 5, 0, 1, 2])


class ToolView(NamedTuple):
    """An arm in one state, and how far it is from its target, all in its tool frame, angular part first."""

    J: Array  # (6, m) joint twists
    error: Array  # (6,) twist that takes the tool to its target in unit time
    ahead: Array  # (6,) twist of the target
    wanted: Array  # (4, 4) pose of the target


Look = Callable[[Array, Any, Any], ToolView]


def look_at(robot: Robot) -> Look:
    """The function of (q, target, feedforward) that views an arm."""
    by_pinocchio = kinematics() != OURS and getattr(robot, "model", None) is not None
    return _by_pinocchio(robot) if by_pinocchio else _by_twists(robot)


def kinematics() -> str:
    """The library whose functions they are; a time is to be read with it."""
    return "Pinocchio" if is_installed("pinocchio") else OURS


def _by_pinocchio(robot: Any) -> Look:
    import pinocchio as pin

    model, data = robot.model, robot.model.createData()
    frame = model.getFrameId(robot.tool)

    def look(q: Array, target: Any, feedforward: Any) -> ToolView:
        pin.forwardKinematics(model, data, q)
        tool = pin.updateFramePlacement(model, data, frame)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL).take(ANGULAR_FIRST, axis=0)
        gap = tool.actInv(target if isinstance(target, pin.SE3) else pin.SE3(pose_of(target)))
        error = pin.log6(gap).vector.take(ANGULAR_FIRST)
        if feedforward is None:
            return ToolView(J, error, np.zeros(6), gap.homogeneous)
        ahead = tool.actInv(pin.Motion(feedforward[3:], feedforward[:3])).vector.take(ANGULAR_FIRST)
        return ToolView(J, error, ahead, gap.homogeneous)

    return look


def _by_twists(robot: Robot) -> Look:
    def look(q: Array, target: Any, feedforward: Any) -> ToolView:
        sighting = robot.sight(q, target)
        tool = pose_of(sighting.pose)
        to_tool = se3.inverse_adjoint(tool)
        ahead = np.zeros(6) if feedforward is None else to_tool.dot(feedforward)
        wanted = se3.inverse(tool, check=False).dot(pose_of(target))
        return ToolView(to_tool.dot(sighting.J), to_tool.dot(sighting.error), ahead, wanted)

    return look


def pose_of(target: Any) -> Array:
    """The (4, 4) pose of a target, which may be an array or the target object of a robot of this library."""
    pose = getattr(target, "homogeneous", getattr(target, "pose", target))
    return np.asarray(pose, dtype=np.float64)
