"""A control loop around any method, with the same `step` as our controller.

    s = gain log(T_target T^-1) + feedforward,    x = clip(solve(J, s, lower, upper))

J and s are given in the frame that the method is meant for; its answer is clipped to the joint limits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import pose_of
from invariantqp.compare.laws.setting import setting_of
from invariantqp.compare.method import Method, Solve
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits.box import JointBox
from invariantqp.velocity.solution import VelocitySolution


class MethodLaw:
    """The control loop of one method."""

    def __init__(self, robot: Robot, law: LawSpec, method: Method, solve: Solve) -> None:
        """Put `solve`, which `method` made for this robot, in a loop; of `law` only dt and gain are used."""
        self._robot = robot
        self._gain = tracking_gain(law.gain, law.dt)
        self._solve = solve
        self._at_tool = method.frame == "tool"
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, law.dt)
        self._name = method.name

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever the method raises."""
        positions = arrays.vector(q, len(self._robot.names), "q")
        sighting = self._robot.sight(positions, target)
        s = self._gain * sighting.error + (0.0 if feedforward is None else arrays.twist(feedforward))
        lower, upper = self._box.at(positions)
        if self._at_tool:
            to_tool = se3.inverse_adjoint(pose_of(sighting.pose))
            x = self._solve(to_tool.dot(sighting.J), to_tool.dot(s), lower, upper)
        else:
            x = self._solve(sighting.J, s, lower, upper)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        residual = s - sighting.J.dot(clipped)
        return VelocitySolution(clipped, self._name, "ok", "", active, residual, 1.0, 0.0, 0.0, "")


def controller_of(method: Method) -> MakeController:
    """The control loop of a method: its own if it is a whole system, a `MethodLaw` otherwise.

    Raises:
        BadInput: the method has neither a solver nor a loop.
    """
    if method.system is not None:
        return method.system
    make = method.make
    if make is None:
        raise BadInput("method", f"{method.name}, which has neither a solver nor a loop", "a method with one of them")
    return lambda robot, law: MethodLaw(robot, law, method, make(setting_of(robot, law)))
