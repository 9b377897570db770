"""The controllers that a task's [law] describes: its keys are their arguments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from invariantqp.control.controller import Controller, Controls
from invariantqp.control.demands import ExactPoint
from invariantqp.control.limits import AnyLimit as Limit
from invariantqp.control.measure import tool_metric
from invariantqp.engine import Engine
from invariantqp.force.hybrid import HybridController
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.wrench import WrenchSensor
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits import ToolSpeed

MakeController = Callable[[Robot, LawSpec], Controls]


def our_controller(robot: Robot, law: LawSpec, limits: Sequence[Limit] = (), engine: Engine = "compiled") -> Controller:
    """The velocity controller that a [law] describes, with more limits."""
    return Controller(robot, limits=limits, **law_options(robot, law), engine=engine)


def our_hybrid(
    robot: Robot, law: LawSpec, task: HybridTask, sensor: WrenchSensor | None, limits: Sequence[Limit] = ()
) -> HybridController:
    """The hybrid controller that a [law] and a contact describe, with more limits."""
    return HybridController(robot, task, sensor=sensor, limits=limits, **law_options(robot, law))


def law_options(robot: Robot, law: LawSpec) -> dict[str, Any]:
    """A [law] as keyword arguments of `Controller`."""
    return {
        "dt": law.dt,
        "gain": law.gain,
        "form": tool_metric(robot) if law.form == "tool" else law.form,
        "damping": law.damping,
        "guard": law.guard,
        "posture": law.posture,
        "posture_gain": law.posture_gain,
        "joint_metric": law.joint_metric,
        "backend": law.backend,
        "exact": None if law.exact is None else ExactPoint(law.point),
        "point": law.point if any(law.point) else None,  # in contact that is the point of contact
        "length": law.length,
        "acceleration_limit": law.acceleration_limit,
        "delay": law.delay,
        "position_margin": law.position_margin,
        "tool_speed": None if law.tool_speed is None else ToolSpeed(law.tool_speed, law.tool_speed_point),
    }
