"""Pink with DAQP on the same tasks; no other file of the comparison imports Pink.

Its velocity and position limits are on, and it does not stop when a limit is exceeded. The frame task has unit costs,
the posture task the cost of Pink's own examples and the gain per tick that makes the told gain per second. A point to
be met exactly is an equality constraint of Pink: the first three rows of a frame task at that point.

Reference: Caron et al., Pink (pin-pink).
"""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import (
    AHEAD,
    POSTURE_COST,
    at_point,
    joints_of,
    lead_target,
    position_task,
    qp_damping,
    share_of,
)
from invariantqp.compare.laws.view import pose_of
from invariantqp.compare.method import Method, Takes, posture_of
from invariantqp.compare.names import PINK
from invariantqp.errors import MissingExtra, RobotModelError
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import VelocitySolution

# Pink's lm_damping in its own examples.
LM_DAMPING = 1.0
# What the frame at the told point is called.
POINT = "told point"


def has_pink() -> bool:
    """Whether Pink is installed."""
    return find_spec("pink") is not None


class PinkLaw:
    """Pink's solve_ik on the robot's own Pinocchio model."""

    def __init__(self, robot: Robot, law: LawSpec, *, lm_damping: float = 0.0) -> None:
        """Set up Pink's tasks for the robot; of `law`, dt, gain, posture, exact and point are used.

        Raises:
            MissingExtra: Pink is not installed.
            RobotModelError: the robot has no Pinocchio model, or a helical joint, which Pink cannot have.
        """
        joints_of(robot)
        if getattr(robot, "model", None) is None:
            raise RobotModelError("Pink needs a robot with a Pinocchio model; this one has none")
        try:
            import pink

            from invariantqp.robots.pinocchio import pin
        except ImportError as error:
            raise MissingExtra("pin-pink", "peers") from error
        self._pink, self._pose = pink, pin.SE3
        self._dt, self._share = law.dt, share_of(law)
        model: Any = robot.model.copy()  # type: ignore[attr-defined]
        frame = str(getattr(robot, "tool", ""))
        if law.exact is not None:
            tool = model.frames[model.getFrameId(frame)]
            place = tool.placement * pin.SE3(at_point(law))
            model.addFrame(pin.Frame(POINT, tool.parentJoint, place, pin.FrameType.OP_FRAME))
        self._configuration = pink.Configuration(model, model.createData(), np.zeros(model.nq))
        self._task = pink.FrameTask(frame, 1.0, 1.0, lm_damping=lm_damping, gain=self._share)
        self._tasks, self._exact = [self._task], []
        mid, pull = posture_of(robot, law)
        self._damping = qp_damping(pull)
        if pull.any():
            self._tasks.append(pink.PostureTask(cost=POSTURE_COST, gain=float(pull.max()) * law.dt))
            self._tasks[-1].set_target(mid)
        if law.exact is not None:
            self._exact.append(position_task(pink.FrameTask, POINT, gain=self._share))
        self._offset = at_point(law)

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever Pink raises."""
        pose = pose_of(target)
        ahead = lead_target(pose, feedforward, self._dt / self._share)
        self._configuration.update(np.asarray(q, dtype=np.float64))
        self._task.set_target(self._pose(ahead))
        for task in self._exact:
            task.set_target(self._pose(ahead.dot(self._offset)))
        x = self._pink.solve_ik(
            self._configuration,
            self._tasks,
            self._dt,
            solver="daqp",
            damping=self._damping,
            constraints=self._exact,
            safety_break=False,
        )
        return VelocitySolution(np.asarray(x), "pink", "ok", "", (), np.full(6, np.nan), 1.0, 0.0, 0.0, "daqp")


def _takes(damping: str) -> Takes:
    return Takes("posture task, cost 1e-3", "equality constraint", "inside the QP", damping, AHEAD)


METHODS = [
    Method(
        name=PINK,
        family="library",
        why="frame task and posture task of Pink's solve_ik with DAQP, and its limits",
        takes=_takes("1e-6 without a posture task"),
        system=PinkLaw,
        needs=("pink",),
        extra="peers",
    ),
    Method(
        name="Pink with lm_damping",
        family="library",
        why="the same with lm_damping = 1, as in Pink's examples",
        takes=_takes("lm_damping = 1"),
        system=partial(PinkLaw, lm_damping=LM_DAMPING),
        needs=("pink",),
        extra="peers",
        shown=False,
    ),
]
