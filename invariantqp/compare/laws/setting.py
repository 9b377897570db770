"""What the methods of the comparison are told of an arm: the same for all of them."""

from __future__ import annotations

import numpy as np

from invariantqp.compare.method import Setting
from invariantqp.control.measure import ToolMeasure
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.problem import metric_of


def setting_of(robot: Robot, law: LawSpec) -> Setting:
    """What methods may know of an arm; lengths in the robot's unit, the point in its tool frame."""
    point = np.asarray(law.point)
    length = ToolMeasure(robot, point).length
    metric = metric_of(law.joint_metric, robot.jacobian(middle(robot)), length)
    return Setting(len(robot.names), law.dt, pitch_of(robot, law), point, length, metric)


def pitch_of(robot: Robot, law: LawSpec) -> float:
    """The pitch of methods that need one: the task's or, without one, the arm's reach to the point.

    The reach is well above the principal pitches of most arms, where projectors are neither oblique nor large.
    """
    return law.form if isinstance(law.form, float) else ToolMeasure(robot, law.point).length
