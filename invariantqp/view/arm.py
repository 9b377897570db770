"""An arm in one state, as pictures need it: where its joints and its tool are, and how they move."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot


class ArmShape(NamedTuple):
    """What to draw of an arm in one state."""

    points: Array  # (m + 2, 3) base, joints, tool
    axes: Array  # (m, 3) unit directions of the joints
    tool: Array  # (4, 4) pose


def arm_shape(robot: Robot, q: ArrayLike) -> ArmShape:
    """What to draw of an arm at joint positions q (m,)."""
    J, T = robot.jacobian(q), robot.pose(q)
    axes = np.where(J[:3].any(axis=0), J[:3], J[3:])
    points = np.vstack((np.zeros(3), robot.origins(q), T[:3, 3]))
    return ArmShape(points, (axes / np.linalg.norm(axes, axis=0)).T, T)


def motions(screws: Array, q: Array) -> list[Array]:
    """The m + 1 motions (4, 4) exp(s_1 q_1) ... exp(s_i q_i), i = 0 ... m, of what is behind i joints."""
    T = [np.eye(4)]
    for screw, x in zip(screws.T, q, strict=True):
        T.append(T[-1].dot(se3.exp(x * screw, check=False)))
    return T


def tool_velocity(robot: Robot, q: Array, velocity: Array) -> Array:
    """(3,) velocity of the tool frame's origin at joint positions and velocities (m,)."""
    return se3.velocity_at(robot.jacobian(q).dot(velocity), robot.pose(q)[:3, 3])
