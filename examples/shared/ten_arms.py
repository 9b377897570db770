"""Ten arms of three to eight joints on which the examples 14 and 15 try what they study."""

from __future__ import annotations

from typing import Any

import numpy as np

import invariantqp as iq

THREE = [((0, 0, 1), (0, 0, 0)), ((0, 1, 0), (0.1, 0, 0.3)), ((1, 0, 0), (0.4, 0.2, 0.5))]
FIVE = [*THREE, ((0, 1, 0), (0.6, 0.2, 0.4)), ((0, 0, 1), (0.8, 0.1, 0.3))]
EIGHT = [*FIVE, ((1, 0, 0), (0.9, 0.1, 0.3)), ((0, 1, 0), (1.0, 0.0, 0.4)), ((0, 0, 1), (1.1, 0.1, 0.2))]
ARMS = ("panda", "ur5", "ur10", "xarm7", "kinova", "z1", "so101", "three joints", "five joints", "eight joints")


def arm(name: str) -> Any:
    """The arm of a name."""
    axes = {"three joints": THREE, "five joints": FIVE, "eight joints": EIGHT}.get(name)
    if axes is None:
        return iq.load_robot(name)
    screws = np.column_stack([iq.revolute(axis, point) for axis, point in axes])
    home = np.eye(4)
    home[:3, 3] = np.add(axes[-1][1], (0.2, 0.1, -0.1))
    return iq.robots.Chain(screws, home, position_lower=-2.5, position_upper=2.5, velocity_limit=2.0)


def limits(robot: Any) -> tuple[np.ndarray, np.ndarray]:
    """Joint ranges, three radians each way where there is none."""
    low, high = np.asarray(robot.position_lower), np.asarray(robot.position_upper)
    return np.where(np.isfinite(low), low, -3.0), np.where(np.isfinite(high), high, 3.0)
