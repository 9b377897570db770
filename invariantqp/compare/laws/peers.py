"""What whole systems of others share here: a robot handed over joint by joint, feedforward where there is none.

Each system has a loop of its own, with the `step` that ours has; its robot is built from the same joint screws. A
target so far ahead that the system's own gain asks for the path's velocity stands for feedforward.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import TRACKING_SHARE
from invariantqp.errors import RobotModelError
from invariantqp.geometry import arrays, screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec

# A pitch below this is a hinge's [m]: URDFs have six digits.
HINGE = 1e-9


class Joint(NamedTuple):
    """A hinge or a slide at q = 0, seen from the base.

    Attributes:
        axis: (3,) unit direction.
        point: (3,) of its axis; the origin for a slide [m].
        slides: whether it is a slide.
    """

    axis: Array
    point: Array
    slides: bool


def joints_of(robot: Robot) -> list[Joint]:
    """Every joint of an arm, base first.

    Raises:
        RobotModelError: a helical joint, which simulators' models do not have.
    """
    found = []
    for name, screw in zip(robot.names, robot.jacobian(np.zeros(len(robot.names))).T, strict=True):
        if not screw[:3].any():
            found.append(Joint(screw[3:] / np.linalg.norm(screw[3:]), np.zeros(3), slides=True))
        elif abs(screws.pitch(screw)) < HINGE:
            found.append(Joint(*screws.axis(screw), slides=False))
        else:
            raise RobotModelError(f"joint {name} is helical; other systems have hinges and slides alone")
    return found


def share_of(law: LawSpec) -> float:
    """The share of an error that a loop takes back in a tick."""
    return TRACKING_SHARE if law.gain is None else law.gain * law.dt


def pose_of(target: Any) -> Array:
    """A target, a (4, 4) pose or one of this library's robots' own, as a (4, 4) pose."""
    pose = getattr(target, "homogeneous", getattr(target, "pose", target))
    return np.asarray(pose, dtype=np.float64)


def led(pose: Array, feedforward: ArrayLike | None, lead: float) -> Array:
    """The pose [4, 4] that the target has `lead` seconds later."""
    ahead = np.zeros(6) if feedforward is None else arrays.twist(feedforward)
    return se3.exp(lead * ahead, check=False).dot(pose) if ahead.any() else pose
