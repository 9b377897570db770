"""The textbook's hybrid controller: a diagonal selection of axes in a task frame, beside ours and with its `step`.

    xi = R' (Sigma (gain e + s_d) + (I - Sigma) C (W_d - W)) R-axes,     x = clip(J^+ xi)

e is the tool origin's error and the tool's rotation vector, W the sensor's reading turned into the task frame's axes:
turned, not moved, so its moment counts from the sensor's own origin; and xi is a velocity of the tool's origin. Each is
right while tool, sensor and contact share one origin, as in the textbook's picture.

Reference: Raibert & Craig 1981; Lipkin & Duffy 1988 and Duffy 1990 for what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits.box import JointBox
from invariantqp.velocity.solution import VelocitySolution


class RaibertCraig:
    """Selection-matrix hybrid control of one arm.

    Attributes:
        robot: the arm.
        selection: (6,) 1 where an axis of the task frame is moved along, 0 where it is pressed; turns first.
        axes: (3, 3) the task frame's axes in the base frame, as columns.
    """

    def __init__(
        self,
        robot: Robot,
        selection: Sequence[float],
        axes: ArrayLike,
        wrench: ArrayLike,
        *,
        dt: float,
        gain: float,
        compliance: ArrayLike,
        sensor_axes: ArrayLike,
    ) -> None:
        """The loop's fixed part.

        Args:
            robot: the arm.
            selection: (6,) of the task frame's axes.
            axes: (3, 3) of the task frame, in the base frame.
            wrench: (6,) wanted, in the task frame's axes.
            dt: tick [s].
            gain: [1/s].
            compliance: (6,) diagonal, twist per wrench.
            sensor_axes: (3, 3) of the sensor's frame, in the tool's.
        """
        self.robot = robot
        self.selection: Array = arrays.vector(selection, 6, "selection")
        self.axes: Array = arrays.matrix(axes, (3, 3), "axes")
        self._wanted = arrays.vector(wrench, 6, "wrench")
        self._gain = gain
        self._compliance = arrays.vector(compliance, 6, "compliance")
        self._sensor_axes = arrays.matrix(sensor_axes, (3, 3), "sensor_axes")
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, dt)

    def step(
        self, q: ArrayLike, target: Any, wrench: ArrayLike, feedforward: ArrayLike | None = None
    ) -> VelocitySolution:
        """One tick; `wrench` is the sensor's reading of what the tool exerts, in the sensor's frame."""
        positions = arrays.vector(q, len(self.robot.names), "q")
        reading = arrays.vector(wrench, 6, "wrench")
        sighting, T = self.robot.sight(positions, target), self.robot.pose(positions)
        s = self._gain * sighting.error + (0.0 if feedforward is None else arrays.twist(feedforward))
        to_sensor = self.axes.T.dot(T[:3, :3]).dot(self._sensor_axes)
        felt = np.concatenate((to_sensor.dot(reading[:3]), to_sensor.dot(reading[3:])))
        # Twists taken at the tool's origin, in the axes of the task frame.
        at_tool = se3.adjoint(se3.inverse(_placed(self.axes, T[:3, 3]), check=False), check=False)
        motion, force = (
            self.selection * at_tool.dot(s),
            (1.0 - self.selection) * self._compliance * (self._wanted - felt),
        )
        x: Array = np.linalg.pinv(at_tool.dot(sighting.J)).dot(motion + force)
        lower, upper = self._box.at(positions)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        residual = s - sighting.J.dot(clipped)
        return VelocitySolution(clipped, "raibert-craig", "ok", "", active, residual, 1.0, 0.0, 0.0, "")


def _placed(axes: Array, point: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = axes, point
    return T
