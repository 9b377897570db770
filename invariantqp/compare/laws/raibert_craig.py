"""The hybrid controller of textbooks: a diagonal selection matrix says along which axes of a task frame the tool moves.

    xi = Sigma (gain e + s_d) + (I - Sigma) C (W_d - W),     x = clip(J^+ xi)

All are written in the axes of the task frame. e is the error of the tool's position and its rotation vector. W is the
sensor's reading, rotated into the axes of the task frame but not moved to its origin, so its moment is still about the
origin of the sensor. xi is the velocity of the tool's origin. This is right while tool, sensor and contact have the
same origin, as in the figures of textbooks.

Reference: Raibert & Craig 1981; Lipkin & Duffy 1988 and Duffy 1990 for what is wrong with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.solution import Status, VelocitySolution


@dataclass
class RaibertCraig:
    """Selection-matrix hybrid control of one arm."""

    robot: Robot  # the arm
    selection: Array  # (6,) diagonal of Sigma, rotations first: 1 for an axis of motion, 0 for an axis of force
    axes: Array  # (3, 3) the task frame's axes in the base frame, as columns; they may change from tick to tick
    wanted: Array  # (6,) wrench W_d, in the axes of the task frame
    dt: float  # duration of a tick [s]
    gain: float  # of the tracking error [1/s]
    compliance: Array  # (6,) diagonal of C, twist per wrench
    sensor_axes: Array  # (3, 3) axes of the sensor frame in the tool frame, as columns

    def step(
        self, q: ArrayLike, target: Any, wrench: ArrayLike, feedforward: ArrayLike | None = None
    ) -> VelocitySolution:
        """One tick; `wrench` (6,) is what the tool exerts, as the sensor reads it in its own frame."""
        positions = arrays.vector(q, len(self.robot.names), "q")
        reading = arrays.vector(wrench, 6, "wrench")
        sighting, T = self.robot.sight(positions, target), self.robot.pose(positions)
        s = self.gain * sighting.error + (0.0 if feedforward is None else arrays.twist(feedforward))
        to_sensor = self.axes.T.dot(T[:3, :3]).dot(self.sensor_axes)
        felt = np.concatenate((to_sensor.dot(reading[:3]), to_sensor.dot(reading[3:])))
        # Twists about the tool's origin, in the axes of the task frame.
        at_tool = se3.adjoint(se3.inverse(se3.transform(self.axes, T[:3, 3]), check=False), check=False)
        motion, force = at_tool.dot(s), self.compliance * (self.wanted - felt)
        xi = self.selection * motion + (1.0 - self.selection) * force
        x: Array = np.linalg.pinv(at_tool.dot(sighting.J)).dot(xi)
        limits = self.robot.position_lower, self.robot.position_upper, self.robot.velocity_limit
        lower, upper = JointBox(*limits, self.dt).at(positions)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        residual = s - sighting.J.dot(clipped)
        return VelocitySolution(clipped, "raibert-craig", Status.OK, "", active, residual, 1.0, 0.0, 0.0, "")
