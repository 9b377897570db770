"""Pink with DAQP on the same tasks; no other file of the comparison imports Pink.

Its velocity and position limits are on, and it does not stop when a limit is exceeded.

Reference: Caron et al., Pink (pin-pink).
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import AHEAD, at_point, joints_of
from invariantqp.compare.laws.task_law import TaskLaw
from invariantqp.compare.method import Method, Takes
from invariantqp.compare.names import PINK
from invariantqp.errors import RobotModelError
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits import accelerations
from invariantqp.velocity.solution import VelocitySolution

# Pink's lm_damping in its own examples.
LM_DAMPING = 1.0
# What the frame at the told point is called.
POINT = "told point"


class PinkLaw(TaskLaw):
    """Pink's solve_ik on the robot's own Pinocchio model."""

    def __init__(self, robot: Robot, law: LawSpec, *, lm_damping: float = 0.0) -> None:
        """Set up Pink's tasks for the robot.

        Raises:
            RobotModelError: the robot has no Pinocchio model, or a helical joint, which Pink cannot have.
        """
        joints_of(robot)
        if getattr(robot, "model", None) is None:
            raise RobotModelError("Pink needs a robot with a Pinocchio model; this one has none")
        import pink

        from invariantqp.robots.pinocchio import pin

        model: Any = robot.model.copy()  # type: ignore[attr-defined]
        frame = str(getattr(robot, "tool", ""))
        if law.exact is not None:
            tool = model.frames[model.getFrameId(frame)]
            place = tool.placement * pin.SE3(at_point(law))
            model.addFrame(pin.Frame(POINT, tool.parentJoint, place, pin.FrameType.OP_FRAME))
        configuration = pink.Configuration(model, model.createData(), np.zeros(model.nq))
        # What solve_ik has by default, and the limit of accelerations, which is told what was commanded last.
        limits = [model.configuration_limit, model.velocity_limit]
        self._accelerations = None
        if law.acceleration_limit is not None:
            self._accelerations = pink.limits.AccelerationLimit(model, accelerations(law.acceleration_limit, model.nv))
            limits.append(self._accelerations)
        super().__init__(
            robot,
            law,
            pink,
            configuration,
            pose=pin.SE3,
            tool=(frame,),
            point=(POINT,),
            lm_damping=lm_damping,
            safety_break=False,
            limits=limits,
        )

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever Pink raises."""
        found = super().step(q, target, feedforward)
        if self._accelerations is not None:
            self._accelerations.set_last_integration(found.velocity, self._dt)
        return found


def _takes(damping: str) -> Takes:
    return Takes("posture task, cost 1e-3", "equality constraint", "inside the QP", damping, AHEAD)


METHODS = [
    Method(
        name=PINK,
        family="library",
        why="frame task and posture task of Pink's solve_ik with DAQP, and its limits",
        takes=_takes("1e-6 without a posture task"),
        system=PinkLaw,
        needs=("pink", "pinocchio"),
        extra="peers",
    ),
    Method(
        name="Pink with lm_damping",
        family="library",
        why="the same with lm_damping = 1, as in Pink's examples",
        takes=_takes("lm_damping = 1"),
        system=partial(PinkLaw, lm_damping=LM_DAMPING),
        needs=("pink", "pinocchio"),
        extra="peers",
        shown=False,
    ),
]
