"""Pink with DAQP on the same problems, where it is installed: the one file that imports it.

Its velocity and position limits are on, its break at a limit is off, so that it may go on where it can; its frame task
has unit costs, and damping 1e-6, since with its default 1e-12 DAQP fails on seven joints. A posture task beside it, to
the middle of the joint ranges at a cost of 1e-3, is what its own examples have.

Reference: Caron et al., Pink (pin-pink).
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import led, pose_of, share_of
from invariantqp.compare.laws.qp_backends import QP_DAMPING
from invariantqp.errors import MissingExtra, RobotModelError
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import VelocitySolution


def has_pink() -> bool:
    """Whether Pink is installed."""
    return find_spec("pink") is not None


# Beside unit costs of the frame task.
POSTURE_COST = 1e-3


class PinkLaw:
    """One Pink frame task on the robot's own Pinocchio model."""

    def __init__(self, robot: Robot, law: LawSpec, *, posture: bool = False) -> None:
        """`law` gives dt and gain; nothing else of it is used. `posture` adds a posture task.

        Raises:
            MissingExtra: Pink is not installed.
            RobotModelError: a robot without a Pinocchio model.
        """
        model: Any = getattr(robot, "model", None)
        if model is None:
            raise RobotModelError("Pink needs a robot from a URDF, not a chain of screws")
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
        """One tick; Pink's exceptions get out as they are."""
        positions = np.asarray(q, dtype=np.float64)
        pose = pose_of(target)
        ahead = led(pose, feedforward, self._dt / self._share)
        if ahead is not pose:
            target = self._robot.target(ahead)
        self._configuration.update(positions)
        self._task.set_target(target)
        x = self._pink.solve_ik(
            self._configuration, self._tasks, self._dt, solver="daqp", damping=QP_DAMPING, safety_break=False
        )
        return VelocitySolution(np.asarray(x), "pink", "ok", "", (), np.full(6, np.nan), 1.0, 0.0, 0.0, "daqp")
