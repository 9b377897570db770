"""An arm in the Robotics Toolbox's own words, from its joint screws: the one file that imports it.

    T(q) = A_1 Z(q_1) A_1^-1 A_2 Z(q_2) A_2^-1 ... T(0),    z of A_i along joint i at q = 0

Reference: Corke & Haviland, Robotics Toolbox for Python.
"""

from __future__ import annotations

import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np

from invariantqp.control.survey import joint_ranges
from invariantqp.errors import MissingExtra, RobotModelError
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot

# A hinge's pitch below this share of its distance from the base is rounding.
HINGE_PITCH = 1e-9


def has_toolbox() -> bool:
    """Whether the Robotics Toolbox is installed."""
    return find_spec("roboticstoolbox") is not None


def ets_of(robot: Robot) -> Any:
    """The elementary transforms (ETS) of a robot, with its limits; one turn, or unit, where a joint has none.

    Raises:
        MissingExtra: the Robotics Toolbox is not installed.
        RobotModelError: a helical joint, which it does not have.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of its own syntax
            from roboticstoolbox import ET, ETS
    except ImportError as error:
        raise MissingExtra("roboticstoolbox-python", "peers") from error
    zero = np.zeros(len(robot.names))
    pieces: list[Any] = []
    before = np.eye(4)
    for twist, low, high in zip(robot.jacobian(zero).T, *joint_ranges(robot), strict=True):
        frame = _along(twist)
        pieces.append(ET.SE3(se3.inverse(before).dot(frame)))
        pieces.append((ET.Rz if twist[:3].any() else ET.tz)(qlim=np.array([low, high])))
        before = frame
    return ETS([*pieces, ET.SE3(se3.inverse(before).dot(robot.pose(zero)))])


def _along(twist: Array) -> Array:
    """A (4, 4) frame with z along a joint's axis."""
    turns = bool(twist[:3].any())
    if turns and abs(screws.pitch(twist)) > HINGE_PITCH * (1.0 + float(np.linalg.norm(twist[3:]))):
        raise RobotModelError("the Robotics Toolbox has no helical joints")
    z, point = screws.axis(twist) if turns else (twist[3:] / np.linalg.norm(twist[3:]), np.zeros(3))
    x = np.linalg.svd(z.reshape(1, 3))[2][1]
    return se3.transform(np.column_stack((x, np.cross(z, x), z)), point)
