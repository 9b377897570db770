"""The laws people have now, with the same `step` as ours: J and s in the tool frame, v in m/s, omega in rad/s.

    x = clip(J^+ s),   x = clip(J'(JJ' + lambda^2 I)^-1 s),   x = clip(sdls(J, s)),   x = argmin |s - Jx|^2

The first three are what a script writes; none is told about limits, so the result is clipped, joint by joint. The last
is what a QP makes of the same error: least squares inside the limits.

Reference: Whitney 1969; Nakamura & Hanafusa 1986; Wampler 1986; Buss & Kim 2005.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.sdls import sdls_step
from invariantqp.control.controller import TRACKING_SHARE
from invariantqp.control.taskfile import LawSpec
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.backends import Daqp, minimise
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.rows import Polytope
from invariantqp.velocity.solution import VelocitySolution

# The textbook damping of a script, in its own mixed units.
DLS_DAMPING = 0.05
# What keeps J'J positive definite in a least-squares QP, as scripts and Pink's users choose it.
QP_DAMPING = 1e-6

# (J, s, lower, upper) to a velocity, which is then clipped to the limits.
Rule = Callable[[Array, Array, Array, Array], Array]


class ToolFrameLaw:
    """A rule for J and s in the tool frame, its answer clipped to the limits."""

    def __init__(self, robot: Robot, law: LawSpec, name: str, rule: Rule) -> None:
        """`law` gives dt and gain; nothing else of it is used."""
        self._robot = robot
        self._gain = TRACKING_SHARE / law.dt if law.gain is None else law.gain
        self._rule = rule
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, law.dt)
        self._name = name

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick."""
        positions = arrays.vector(q, len(self._robot.names), "q")
        sighting = self._robot.sight(positions, target)
        s = self._gain * sighting.error + (0.0 if feedforward is None else arrays.twist(feedforward))
        to_tool = se3.adjoint(se3.inverse(self._robot.pose(positions)))
        lower, upper = self._box.at(positions)
        x = self._rule(to_tool.dot(sighting.J), to_tool.dot(s), lower, upper)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        residual = s - sighting.J.dot(clipped)
        return VelocitySolution(clipped, self._name, "ok", "", active, residual, 1.0, 0.0, 0.0, "")


def _pinv(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
    return np.asarray(np.linalg.pinv(J).dot(s))


def _dls(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
    return np.asarray(J.T.dot(np.linalg.solve(J.dot(J.T) + DLS_DAMPING**2 * np.eye(6), s)))


def _box(J: Array, s: Array, lower: Array, upper: Array) -> Array:
    H = J.T.dot(J) + QP_DAMPING * np.eye(J.shape[1])
    return minimise(Daqp(), H, J.T.dot(s), Polytope(None, lower, upper)).z


def moore_penrose(robot: Robot, law: LawSpec) -> ToolFrameLaw:
    """J^+ s, clipped."""
    return ToolFrameLaw(robot, law, "moore-penrose", _pinv)


def damped_least_squares(robot: Robot, law: LawSpec) -> ToolFrameLaw:
    """Damped least squares with lambda = 0.05, clipped."""
    return ToolFrameLaw(robot, law, "dls", _dls)


def selectively_damped(robot: Robot, law: LawSpec) -> ToolFrameLaw:
    """Selectively damped least squares, clipped; it thinks in the angles of one tick."""
    return ToolFrameLaw(robot, law, "sdls", lambda J, s, _lower, _upper: sdls_step(J, law.dt * s) / law.dt)


def least_squares_qp(robot: Robot, law: LawSpec) -> ToolFrameLaw:
    """Least squares inside the limits, by DAQP."""
    return ToolFrameLaw(robot, law, "least-squares-qp", _box)
