"""A control loop around a function of a tick, the same for every method, and as lean as one writes it by hand.

    s = gain log(T^-1 T_target) + feedforward,    x = clip(solve(J, s, limits, posture, exact rows))

J and s are in the tool frame, whose origin and axes are those of the robot's model, as in most scripts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.ramp import RampBounds
from invariantqp.compare.laws.view import look_at
from invariantqp.compare.method import Method, Question, Setting, Solve, answer, posture_of
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import BadInput
from invariantqp.extras import require
from invariantqp.geometry import arrays, se3
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.solution import VelocitySolution


def setting_of(robot: Robot, law: LawSpec) -> Setting:
    """What methods are told of an arm; the point is in its tool frame."""
    point = np.asarray(law.point, np.float64)
    length = ToolMeasure(robot, point, law.length).length
    return Setting(len(robot.names), law.dt, point, length, robot.position_lower, robot.position_upper)


class MethodLaw:
    """The loop of one method."""

    def __init__(self, robot: Robot, law: LawSpec, name: str, make: Callable[[Setting], Solve]) -> None:
        """Of `law`, dt, gain, delay, acceleration_limit, point, length, posture, exact and position_margin count."""
        self._name, self._robot, self._look = name, robot, look_at(robot)
        self._gain = tracking_gain(law.gain, law.dt, law.delay)
        setting = setting_of(robot, law)
        self._solve = make(setting)
        self._middle, self._pull = posture_of(robot, law)
        limits = robot.position_lower, robot.position_upper, robot.velocity_limit
        self._box = JointBox(*limits, law.dt, law.position_margin)
        self._ramp = RampBounds(law, setting.m)
        self._exact, self._point = law.exact is not None, setting.point
        self._at_point = root_at(setting.point, 1.0)[3:]
        self._none = np.zeros((0, setting.m)), np.zeros(0)

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever the method raises."""
        positions = arrays.vector(q, len(self._middle), "q")
        J, error, ahead, wanted = self._look(positions, self._robot.target(target), feedforward)
        C, e = self._none
        if self._exact:
            there = wanted[:3, :3].dot(self._point) + wanted[:3, 3]
            C = self._at_point.dot(J)
            e = self._gain * (there - self._point) + ahead[3:] + se3.cross(ahead[:3], there)
        lower, upper = self._ramp.within(*self._box.at(positions))
        pull = self._pull * (self._middle - positions)
        tick = Question(J, self._gain * error + ahead, lower, upper, pull, C, e, positions)
        x = np.minimum(np.maximum(self._solve(tick), lower), upper)
        return answer(self._ramp.cut(x), self._name)


def controller_of(method: Method) -> MakeController:
    """The control loop of a method: its own, or this one around its function of a tick.

    Raises:
        MissingExtra: a module that it needs is not installed.
        BadInput: the method has neither.
    """
    require(method.extra, *method.needs)
    if method.system is not None:
        return method.system
    make = method.make
    if make is None:
        raise BadInput("method", f"{method.name}, which has neither a solver nor a loop", "a method with one of them")
    return lambda robot, law: MethodLaw(robot, law, method.name, make)
