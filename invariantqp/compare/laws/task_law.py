"""The control loop of Pink and of mink, whose tasks and whose `solve_ik` are called alike.

The frame task has unit costs, the posture task the cost of Pink's own examples and the gain per tick that makes the
told gain per second. A point to be met exactly is an equality constraint: the first three rows of a frame task there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import POSTURE_COST, at_point, lead_target, qp_damping, share_of
from invariantqp.compare.laws.ramp import RampBounds
from invariantqp.compare.laws.view import pose_of
from invariantqp.compare.method import answer, posture_of
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import VelocitySolution


class TaskLaw:
    """`solve_ik` of one of the two libraries with DAQP; a subclass has its model of the robot."""

    def __init__(
        self,
        robot: Robot,
        law: LawSpec,
        library: Any,
        configuration: Any,
        *,
        pose: Callable[[Array], Any],
        tool: tuple[str, ...],
        point: tuple[str, ...],
        posture: tuple[Any, ...] = (),
        lm_damping: float = 0.0,
        **options: Any,
    ) -> None:
        """Set up a library's tasks with its `Configuration` of the robot; of the law, dt, gain, delay,
        acceleration_limit, posture, exact and point are used.

        `pose` makes the library's poses from (4, 4); `tool` and `point` are the tool frame and one at the told point as
        its `FrameTask` takes them, `posture` what its `PostureTask` takes before the cost, `options` go to its
        `solve_ik`.
        """
        self._name, self._solve, self._options, self._pose = library.__name__, library.solve_ik, options, pose
        self._configuration, self._offset = configuration, at_point(law)
        self._dt, self._share, self._ramp = law.dt, share_of(law), RampBounds(law, len(robot.names))
        self._task = library.FrameTask(*tool, 1.0, 1.0, lm_damping=lm_damping, gain=self._share)
        self._tasks: list[Any] = [self._task]
        mid, pull = posture_of(robot, law)
        self._damping = qp_damping(pull)
        if pull.any():
            self._tasks.append(library.PostureTask(*posture, cost=POSTURE_COST, gain=float(pull.max()) * law.dt))
            self._tasks[-1].set_target(mid)
        self._exact: list[Any] = []
        if law.exact is not None:
            self._exact.append(_position_task(library.FrameTask)(*point, 1.0, 1.0, gain=self._share))

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever the library raises."""
        ahead = lead_target(pose_of(target), feedforward, self._dt / self._share)
        self._configuration.update(np.asarray(q, dtype=np.float64))
        self._task.set_target(self._pose(ahead))
        for task in self._exact:
            task.set_target(self._pose(ahead.dot(self._offset)))
        x = self._solve(
            self._configuration,
            self._tasks,
            self._dt,
            solver="daqp",
            damping=self._damping,
            constraints=self._exact,
            **self._options,
        )
        return answer(self._ramp.cut(x), self._name, "daqp")


def _position_task(frame_task: Any) -> Any:
    """A library's frame task without the rows of orientation."""

    class PositionTask(frame_task):  # type: ignore[misc]
        def compute_error(self, configuration: Any) -> Any:
            return super().compute_error(configuration)[:3]

        def compute_jacobian(self, configuration: Any) -> Any:
            return super().compute_jacobian(configuration)[:3]

    return PositionTask
