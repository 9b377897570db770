"""Ten arms of three to eight joints on which the examples 14 and 15 try what they study."""

from __future__ import annotations

from typing import Any

import numpy as np

import invariantqp as iq
from invariantqp.workbench.runs.taskfile import RobotSpec

THREE = [((0, 0, 1), (0, 0, 0)), ((0, 1, 0), (0.1, 0, 0.3)), ((1, 0, 0), (0.4, 0.2, 0.5))]
FIVE = [*THREE, ((0, 1, 0), (0.6, 0.2, 0.4)), ((0, 0, 1), (0.8, 0.1, 0.3))]
EIGHT = [*FIVE, ((1, 0, 0), (0.9, 0.1, 0.3)), ((0, 1, 0), (1.0, 0.0, 0.4)), ((0, 0, 1), (1.1, 0.1, 0.2))]
ARMS = ("panda", "ur5", "ur10", "xarm7", "kinova", "z1", "so101", "three joints", "five joints", "eight joints")


CHAINS = {"three joints": THREE, "five joints": FIVE, "eight joints": EIGHT}


def spec(name: str) -> dict[str, Any]:
    """The arm of a name as a task file's [robot] has it, without its start."""
    axes = CHAINS.get(name)
    if axes is None:
        return {"source": name}
    bounds = {"lower": -2.5, "upper": 2.5, "speed": 2.0}
    screws = [{"axis": list(map(float, axis)), "point": list(map(float, point)), **bounds} for axis, point in axes]
    return {"screws": screws, "tool_point": np.add(axes[-1][1], (0.2, 0.1, -0.1)).tolist()}


def arm(name: str) -> Any:
    """The arm of a name."""
    axes = CHAINS.get(name)
    if axes is None:
        return iq.load_robot(name)
    return RobotSpec(**spec(name), start=[0.0] * len(axes)).load(None)


def limits(robot: Any) -> tuple[np.ndarray, np.ndarray]:
    """Joint ranges, three radians each way where there is none."""
    low, high = np.asarray(robot.position_lower), np.asarray(robot.position_upper)
    return np.where(np.isfinite(low), low, -3.0), np.where(np.isfinite(high), high, 3.0)
