"""The null-space motion of a redundant arm: towards the middle of its joint ranges."""

from __future__ import annotations

import numpy as np

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot

# The default gain [1/s]: slow beside any tracking gain, fast enough to keep the arm off its limits on long paths.
POSTURE_GAIN = 1.0


def posture_gain(posture: float | bool, joints: int) -> float:
    """The gain [1/s] of the drift: 0 for an arm with no more than six joints, the default for True.

    Raises:
        BadInput: not a gain, True or False.
    """
    if isinstance(posture, (bool, np.bool_)):
        gain = POSTURE_GAIN if posture else 0.0
    else:
        gain = arrays.not_negative(posture, "posture", "a gain in 1/s, True or False")
    return gain if joints > 6 else 0.0


def joint_gains(robot: Robot, gain: float) -> Array:
    """(m,) the gain [1/s] of each joint: 0 where its range is not bounded on both sides and has no middle."""
    bounded = np.isfinite(robot.position_lower) & np.isfinite(robot.position_upper)
    return np.where(bounded, gain, 0.0)
