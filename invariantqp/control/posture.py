"""The posture: joint positions to stay near, as far as the tool's motion leaves joints free."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle

# The default gain [1/s]: slow beside any tracking gain, fast enough to keep the arm off its limits on long paths.
POSTURE_GAIN = 1.0


def posture_of(posture: ArrayLike | bool, gain: float, robot: Robot) -> tuple[Array, Array]:
    """The joint positions (m,) and the gain (m,) [1/s] of each joint, 0 where there is no posture.

    True is the middle of the ranges of an arm with more than six joints; a joint without a range has none.

    Raises:
        BadInput: neither positions, True nor False; a gain below zero.
    """
    m = len(robot.names)
    strength = arrays.not_negative(gain, "posture_gain", "a gain in 1/s")
    if isinstance(posture, (bool, np.bool_)):
        bounded = np.isfinite(robot.position_lower) & np.isfinite(robot.position_upper)
        return middle(robot), np.where(bounded & (m > 6) & bool(posture), strength, 0.0)
    if np.ndim(arrays.array(posture, "posture", "joint positions, True or False")) == 0:
        raise BadInput(
            "posture", f"{posture}", f"({m},) joint positions, True or False", "How strong it is, is posture_gain."
        )
    return arrays.vector(posture, m, "posture"), np.full(m, strength)
