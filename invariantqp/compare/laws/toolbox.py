"""The Robotics Toolbox, and a robot rebuilt in it from its joint screws; no other file imports the toolbox.

    T(q) = A_1 Z(q_1) A_1^-1 A_2 Z(q_2) A_2^-1 ... T(0),    with z of A_i along joint i at q = 0

Reference: Corke & Haviland, Robotics Toolbox for Python.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from invariantqp.analysis.survey import joint_ranges
from invariantqp.compare.laws.peers import joints_of
from invariantqp.errors import MissingExtra
from invariantqp.geometry import se3
from invariantqp.robots.kinematics import Robot


def toolbox() -> Any:
    """The Robotics Toolbox.

    Raises:
        MissingExtra: it is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # importing it gives SyntaxWarnings about its own source
            import roboticstoolbox
    except ImportError as error:
        raise MissingExtra("roboticstoolbox-python", "peers") from error
    return roboticstoolbox


def ets_of(robot: Robot) -> Any:
    """The robot as elementary transforms (ETS) with its limits; a joint without limits gets one turn, or one unit.

    Raises:
        MissingExtra: the Robotics Toolbox is not installed.
        RobotModelError: the robot has a helical joint.
    """
    rtb = toolbox()
    pieces: list[Any] = []
    before = np.eye(4)
    for joint, low, high in zip(joints_of(robot), *joint_ranges(robot), strict=True):
        frame = se3.facing(joint.axis, joint.point)
        pieces.append(rtb.ET.SE3(se3.inverse(before).dot(frame)))
        pieces.append((rtb.ET.tz if joint.slides else rtb.ET.Rz)(qlim=np.array([low, high])))
        before = frame
    home = robot.pose(np.zeros(len(robot.names)))
    return rtb.ETS([*pieces, rtb.ET.SE3(se3.inverse(before).dot(home))])
