"""The same arm described in another way: with another base frame, another unit of length, or without speed limits.

screws' = Ad(Y) D screws,   home' = Y D(home),   D multiplies every length by the number of new units in an old one
"""

from __future__ import annotations

from typing import Any

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot


def rewrite(robot: Robot, *, base: Array | None = None, unit: float = 1.0, speed_limits: bool = True) -> Robot:
    """The arm in another description. A Pinocchio model stays one, every other robot becomes a chain of joint screws.

    Args:
        robot: the arm.
        base: (4, 4) pose of the old base frame in the new one, in the new unit; None keeps the base frame.
        unit: how many new units of length make an old one; joint positions keep their unit.
        speed_limits: whether to keep the velocity limits.
    """
    Y = np.eye(4) if base is None else base
    if getattr(robot, "model", None) is not None:
        return _model(robot, Y, unit, speed_limits)
    still = np.zeros(len(robot.names))
    screws, home = robot.jacobian(still), robot.pose(still)
    screws[3:] *= unit
    return Chain(
        se3.adjoint(Y).dot(screws),
        Y.dot(scale_lengths(home, unit)),
        robot.names,
        robot.position_lower,
        robot.position_upper,
        robot.velocity_limit if speed_limits else np.inf,
    )


def scale_lengths(pose: Array, unit: float) -> Array:
    """A (4, 4) pose in another unit of length."""
    result = pose.copy()
    result[:3, 3] *= unit
    return result


def _model(robot: Any, Y: Array, unit: float, speed_limits: bool) -> Robot:
    model = robot.model.copy()
    for i in range(1, model.njoints):
        placement = scale_lengths(model.jointPlacements[i].homogeneous, unit)
        placement = Y.dot(placement) if model.parents[i] == 0 else placement
        model.jointPlacements[i].rotation, model.jointPlacements[i].translation = placement[:3, :3], placement[:3, 3]
    for frame in model.frames:
        frame.placement.translation = unit * frame.placement.translation
    if not speed_limits:
        model.velocityLimit = np.zeros(model.nv)  # zero stands for no limit in URDFs
    written: Robot = type(robot)(model, robot.tool)
    return written
