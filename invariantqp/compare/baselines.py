"""The laws people have now, with the same `step` as ours: Moore-Penrose and damped least squares, clipped to limits.

    x = clip(J^+ s),      x = clip(J'(JJ' + lambda^2 I)^-1 s),      J and s in the tool frame, v in m/s, omega in rad/s

Both are what a script writes; neither is told about limits, so the result is clipped, joint by joint.

Reference: Whitney 1969; Nakamura & Hanafusa 1986; Wampler 1986.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import TRACKING_SHARE
from invariantqp.control.taskfile import LawSpec
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.solution import VelocitySolution

# The textbook damping of a script, in its own mixed units.
DLS_DAMPING = 0.05


class ClippedLeastSquares:
    """Moore-Penrose (damping 0) or damped least squares in the tool frame, clipped to the limits."""

    def __init__(self, robot: Robot, law: LawSpec, damping: float) -> None:
        """`law` gives dt and gain; nothing else of it is used."""
        self._robot = robot
        self._gain = TRACKING_SHARE / law.dt if law.gain is None else law.gain
        self._damping = damping
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, law.dt)
        self._name = "moore-penrose" if damping == 0.0 else "dls"

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick."""
        positions = arrays.vector(q, len(self._robot.names), "q")
        sighting = self._robot.sight(positions, target)
        s = self._gain * sighting.error + (0.0 if feedforward is None else arrays.twist(feedforward))
        to_tool = se3.adjoint(se3.inverse(self._robot.pose(positions)))
        x = _least_squares(to_tool.dot(sighting.J), to_tool.dot(s), self._damping)
        lower, upper = self._box.at(positions)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        residual = s - sighting.J.dot(clipped)
        return VelocitySolution(clipped, self._name, "ok", "", active, residual, 1.0, self._damping, 0.0, "")


def _least_squares(J: Array, s: Array, damping: float) -> Array:
    if damping == 0.0:
        return np.asarray(np.linalg.pinv(J).dot(s))
    return np.asarray(J.T.dot(np.linalg.solve(J.dot(J.T) + damping**2 * np.eye(6), s)))


def moore_penrose(robot: Robot, law: LawSpec) -> ClippedLeastSquares:
    """J^+ s, clipped."""
    return ClippedLeastSquares(robot, law, 0.0)


def damped_least_squares(robot: Robot, law: LawSpec) -> ClippedLeastSquares:
    """Damped least squares with lambda = 0.05, clipped."""
    return ClippedLeastSquares(robot, law, DLS_DAMPING)
