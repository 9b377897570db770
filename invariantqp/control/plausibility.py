"""Plausibility of joint positions: beyond these bounds they are in another unit, degrees for instance."""

from __future__ import annotations

from operator import le
from typing import TypeAlias

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import PLAUSIBLE_ANGLE, Robot
from invariantqp.velocity.reasons import Code, Reason

PositionBounds: TypeAlias = tuple[list[float], list[float]]  # lower and upper, one number a joint [rad, length]


def bounds_against_degrees(robot: Robot, J: Array) -> PositionBounds:
    """The position range widened to two turns either way, for joints with a range that turn in J (6, m)."""
    bounded = np.isfinite(robot.position_upper - robot.position_lower)
    widest = np.where(np.logical_and(J[:3].any(axis=0), bounded), PLAUSIBLE_ANGLE, np.inf)
    return np.minimum(-widest, robot.position_lower).tolist(), np.maximum(widest, robot.position_upper).tolist()


def implausible(robot: Robot, q: Array, bounds: PositionBounds) -> Reason | None:
    """Why joint positions (m,) cannot be true, None inside the bounds; of several joints, the one farthest outside."""
    lower, upper = bounds
    positions = q.tolist()
    if all(map(le, lower, positions)) and all(map(le, positions, upper)):
        return None
    i = int(np.maximum(q - upper, lower - q).argmax())
    outside = max(float(q[i] - robot.position_upper[i]), float(robot.position_lower[i] - q[i]))
    return Reason(Code.IMPLAUSIBLE_POSITION, (i,), numbers=(float(q[i]), outside), names=(robot.names[i],))


def require_plausible(robot: Robot, q: Array, bounds: PositionBounds, argument: str) -> None:
    """Raise BadInput for joint positions (m,) outside the bounds."""
    if reason := implausible(robot, q, bounds):
        found = str(reason).partition(" Give")[0]
        raise BadInput(argument, found, "joint positions in radians, near the position ranges")
