"""Pink with DAQP on the same tasks; no other file of the comparison imports Pink.

Its velocity and position limits are on, and it does not stop when a limit is exceeded. The frame task has unit costs.
The damping is 1e-6, since with the default of 1e-12 DAQP fails on seven joints. The posture task, to the middle of the
joint ranges at a cost of 1e-3, is the one of Pink's own examples.

Reference: Caron et al., Pink (pin-pink).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import lead_target, pose_of, share_of
from invariantqp.compare.laws.qp_backends import QP_DAMPING
from invariantqp.errors import MissingExtra, RobotModelError
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import VelocitySolution

# Cost of the posture task; the frame task has unit costs.
POSTURE_COST = 1e-3


def has_pink() -> bool:
    """Whether Pink is installed."""
    return find_spec("pink") is not None


class PinkLaw:
    """One Pink frame task on the robot's own Pinocchio model."""

    def __init__(self, robot: Robot, law: LawSpec, *, posture: bool = False) -> None:
        """Set up Pink's tasks for the robot; of `law` only dt and gain are used. `posture` adds a posture task.

        Raises:
            MissingExtra: Pink is not installed.
            RobotModelError: the robot has no Pinocchio model.
        """
        model: Any = getattr(robot, "model", None)
        if model is None:
            raise RobotModelError("Pink needs a robot from a URDF; this one is a chain of joint screws")
        try:
            import pink
        except ImportError as error:
            raise MissingExtra("pin-pink", "peers") from error
        self._pink = pink
        self._robot = robot
        self._dt = law.dt
        self._share = share_of(law)
        self._configuration = pink.Configuration(model, model.createData(), np.zeros(model.nq))
        self._task = pink.FrameTask(getattr(robot, "tool", ""), 1.0, 1.0, gain=self._share)
        self._tasks = [self._task]
        if posture:
            self._tasks.append(pink.PostureTask(cost=POSTURE_COST))
            self._tasks[-1].set_target(middle(robot))

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever Pink raises."""
        positions = np.asarray(q, dtype=np.float64)
        pose = pose_of(target)
        ahead = lead_target(pose, feedforward, self._dt / self._share)
        if ahead is not pose:
            target = self._robot.target(ahead)
        self._configuration.update(positions)
        self._task.set_target(target)
        x = self._pink.solve_ik(
            self._configuration, self._tasks, self._dt, solver="daqp", damping=QP_DAMPING, safety_break=False
        )
        return VelocitySolution(np.asarray(x), "pink", "ok", "", (), np.full(6, np.nan), 1.0, 0.0, 0.0, "daqp")
