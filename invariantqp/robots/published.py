"""Kinematics of arms from their makers' data, without meshes and masses.

Each joint turns about z of its frame. A frame is placed in the previous one by a translation and by quarter turns about
fixed axes, Rz(yaw) Ry(pitch) Rx(roll). The base frame is the maker's; the tool frame is the flange.

Sources: Universal Robots, "DH parameters for calculations of kinematics and dynamics"; limits from ur_description,
which quotes the user manuals 5.8 and halves the elbow's range against collisions of links. Franka Robotics,
franka_description (fr3). KUKA LBR iiwa 7 R800 and 14 R820: lbr_fri_ros2_stack and iiwa_stack. Kinova, ros_kortex (Gen3
with seven joints). UFACTORY, xarm_ros (Lite 6). Rounded right angles of a source, such as 1.5708, are exact here.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, pi, radians, tau

import numpy as np

from invariantqp.geometry import se3
from invariantqp.robots.tree import TreeJoint
from invariantqp.robots.urdf import rotation

# The pose of a frame in the previous one: translation [m], quarter turns (roll, pitch, yaw).
Place = tuple[tuple[float, float, float], tuple[int, int, int]]
# A joint: the pose of its frame, position limits [rad], velocity limit [rad/s].
Row = tuple[tuple[float, float, float], tuple[int, int, int], float, float, float]

UR_JOINT_NAMES = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def published(name: str) -> list[TreeJoint]:
    """The joints of an arm, base first, and the fixed joint of its flange."""
    joints, flange = PUBLISHED[name]
    last = f"link{len(joints)}"
    return [*joints, TreeJoint("flange", "fixed", last, "tool0", _frame(flange), np.array((0.0, 0.0, 1.0)))]


def _frame(place: Place) -> np.ndarray:
    xyz, quarters = place
    return se3.transform(rotation([0.5 * pi * k for k in quarters]).round(), xyz)


def _joints(names: Sequence[str], rows: Sequence[Row]) -> list[TreeJoint]:
    """Joints from their names and rows, base first."""
    z = np.array((0.0, 0.0, 1.0))
    return [
        TreeJoint(name, "revolute", f"link{i}", f"link{i + 1}", _frame((xyz, quarters)), z, lower, upper, speed)
        for i, (name, (xyz, quarters, lower, upper, speed)) in enumerate(zip(names, rows, strict=True))
    ]


def _ur(d1: float, a2: float, a3: float, d4: float, d5: float, d6: float, speeds: Sequence[float]) -> list[TreeJoint]:
    """A Universal Robots arm from its DH parameters [m] and velocity limits [deg/s]."""
    v = [radians(speed) for speed in speeds]
    rows: list[Row] = [
        ((0.0, 0.0, d1), (0, 0, 0), -tau, tau, v[0]),
        ((0.0, 0.0, 0.0), (1, 0, 0), -tau, tau, v[1]),
        ((a2, 0.0, 0.0), (0, 0, 0), -pi, pi, v[2]),
        ((a3, 0.0, d4), (0, 0, 0), -tau, tau, v[3]),
        ((0.0, -d5, 0.0), (1, 0, 0), -tau, tau, v[4]),
        ((0.0, d6, 0.0), (-1, 0, 0), -tau, tau, v[5]),
    ]
    return _joints([f"{name}_joint" for name in UR_JOINT_NAMES], rows)


def _iiwa(d: Sequence[float], speeds: Sequence[float]) -> tuple[list[TreeJoint], Place]:
    """A KUKA LBR iiwa from shoulder height, arm lengths and flange [m], and velocity limits [deg/s]."""
    v = [radians(speed) for speed in speeds]
    rows: list[Row] = [
        ((0.0, 0.0, 0.0), (0, 0, 0), -radians(170), radians(170), v[0]),
        ((0.0, 0.0, d[0]), (-1, 0, 0), -radians(120), radians(120), v[1]),
        ((0.0, 0.0, 0.0), (1, 0, 0), -radians(170), radians(170), v[2]),
        ((0.0, 0.0, d[1]), (1, 0, 0), -radians(120), radians(120), v[3]),
        ((0.0, 0.0, 0.0), (-1, 0, 0), -radians(170), radians(170), v[4]),
        ((0.0, 0.0, d[2]), (-1, 0, 0), -radians(120), radians(120), v[5]),
        ((0.0, 0.0, 0.0), (1, 0, 0), -radians(175), radians(175), v[6]),
    ]
    return _joints([f"A{i}" for i in range(1, 8)], rows), ((0.0, 0.0, d[3]), (0, 0, 0))


AT_LAST_JOINT: Place = ((0.0, 0.0, 0.0), (0, 0, 0))
# Joints and flange of each arm.
PUBLISHED: dict[str, tuple[list[TreeJoint], Place]] = {
    "ur3e": (_ur(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921, [180, 180, 180, 360, 360, 360]), AT_LAST_JOINT),
    "ur5e": (_ur(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996, [180] * 6), AT_LAST_JOINT),
    "ur10e": (_ur(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655, [120, 120, 180, 180, 180, 180]), AT_LAST_JOINT),
    "ur16e": (_ur(0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655, [120, 120, 180, 180, 180, 180]), AT_LAST_JOINT),
    "fr3": (
        _joints(
            [f"fr3_joint{i}" for i in range(1, 8)],
            [
                ((0.0, 0.0, 0.333), (0, 0, 0), -2.7437, 2.7437, 2.62),
                ((0.0, 0.0, 0.0), (-1, 0, 0), -1.7837, 1.7837, 2.62),
                ((0.0, -0.316, 0.0), (1, 0, 0), -2.9007, 2.9007, 2.62),
                ((0.0825, 0.0, 0.0), (1, 0, 0), -3.0421, -0.1518, 2.62),
                ((-0.0825, 0.384, 0.0), (-1, 0, 0), -2.8065, 2.8065, 5.26),
                ((0.0, 0.0, 0.0), (1, 0, 0), 0.5445, 4.5169, 4.18),
                ((0.088, 0.0, 0.0), (1, 0, 0), -3.0159, 3.0159, 5.26),
            ],
        ),
        ((0.0, 0.0, 0.107), (0, 0, 0)),
    ),
    "iiwa7": _iiwa((0.34, 0.4, 0.4, 0.126), [98, 98, 100, 130, 140, 180, 180]),
    "iiwa14": _iiwa((0.36, 0.42, 0.4, 0.126), [85, 85, 100, 75, 130, 135, 135]),
    "gen3": (
        _joints(
            [f"joint_{i}" for i in range(1, 8)],
            [
                ((0.0, 0.0, 0.15643), (2, 0, 0), -inf, inf, 1.3963),
                ((0.0, 0.005375, -0.12838), (1, 0, 0), -2.41, 2.41, 1.3963),
                ((0.0, -0.21038, -0.006375), (-1, 0, 0), -inf, inf, 1.3963),
                ((0.0, 0.006375, -0.21038), (1, 0, 0), -2.66, 2.66, 1.3963),
                ((0.0, -0.20843, -0.006375), (-1, 0, 0), -inf, inf, 1.2218),
                ((0.0, 0.00017505, -0.10593), (1, 0, 0), -2.23, 2.23, 1.2218),
                ((0.0, -0.10593, -0.00017505), (-1, 0, 0), -inf, inf, 1.2218),
            ],
        ),
        ((0.0, 0.0, -0.061525), (2, 0, 0)),
    ),
    "lite6": (
        _joints(
            [f"joint{i}" for i in range(1, 7)],
            [
                ((0.0, 0.0, 0.2435), (0, 0, 0), -tau, tau, 3.14),
                ((0.0, 0.0, 0.0), (1, -1, 2), -2.61799, 2.61799, 3.14),
                ((0.2002, 0.0, 0.0), (2, 0, 1), -0.061087, 5.235988, 3.14),
                ((0.087, -0.22761, 0.0), (1, 0, 0), -tau, tau, 3.14),
                ((0.0, 0.0, 0.0), (1, 0, 0), -2.1642, 2.1642, 3.14),
                ((0.0, 0.0625, 0.0), (-1, 0, 0), -tau, tau, 3.14),
            ],
        ),
        AT_LAST_JOINT,
    ),
}
