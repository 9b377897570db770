"""The task error: the twist from an arm to a target, and the part of it that counts.

|R s|     the size, in the measure, of the part of a twist s that counts: of exact rows, of the twists that few joints
          can do, or all of it

The error is the screw to the target, but for exact rows their own error: the screw to a target whose orientation is
free would move its point off the straight line.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.demands import View, rows_of
from invariantqp.control.target import Target, nearest_pose
from invariantqp.engine import law
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.linear import TINY
from invariantqp.robots.kinematics import RobotState
from invariantqp.velocity.exact import ROW_TOLERANCE

# The engine's failure where a form has no projector.
NO_PROJECTOR = 2
# The twist of a target at rest, and of an arm that is to stop.
STILL = np.zeros(6)


class TaskError(NamedTuple):
    """The state of the arm at q, and its error to a target."""

    state: RobotState  # of the arm
    root: Array  # (6, 6) of the measure; (k, 6) where a target leaves something free
    rows: Array  # (k, 6) R, orthonormal in the measure
    part: Array  # (6, 6) the projector on the part of exact rows
    error: Array  # (6,) the twist that leads to the target
    exact: bool  # whether the rows are exact
    joint_rows: tuple[Array, Array] | None  # exact rows (k, m) and (k,) that are no part of the twist

    @property
    def off(self) -> float:
        """The distance |R error| of the tool from the target [length]."""
        off = self.rows.dot(self.error)
        return sqrt(float(off.dot(off)))

    def joint_velocity(
        self,
        controller: Controller,
        q: Array,
        twist: Array,
        h: float,
        posture: Array | None = None,
        *,
        exact: bool = True,
        **more: Any,
    ) -> tuple[Array, float]:
        """The law's joint velocity x (m,) for a twist, and the size of its residual in the measure.

        It keeps q + h x inside the position limits.

        Args:
            controller: whose law it is.
            q: (m,) joint positions.
            twist: (6,).
            h: how long the velocity is applied.
            posture: (m,) desired joint velocity in the null space; None is zero.
            exact: whether exact rows of the twist are met.
            more: other arguments of the engine's tick: damping, root, lower, upper, ...
        """
        J, box = self.state.J, controller.box
        fields = controller.in_engine.law | {
            "root": self.root,
            "feedforward": twist,
            "lower": (box.position_lower - q) / h,
            "upper": (box.position_upper - q) / h,
            "posture": posture,
        }
        fields["exact"] = self._exact_rows(twist, met=exact)
        velocity, _, _, missed, _, _, _, failure, *_ = law.tick(J, **(fields | more))
        if failure == NO_PROJECTOR and controller.guard is not None:  # which leaves none of the form then
            velocity, _, _, missed, *_ = law.tick(J, **(fields | more | {"form": None}))
        return velocity, missed

    def _exact_rows(self, twist: Array, *, met: bool) -> tuple[Array, Array, None] | None:
        """The exact rows for a twist as the engine takes them; `met` is whether those of the twist are among them."""
        found = [] if self.joint_rows is None else [self.joint_rows]
        if met and self.exact:
            found.append((self.rows.dot(self.state.J), self.rows.dot(twist)))
        if not found:
            return None
        return np.vstack([E for E, _ in found]), np.concatenate([b for _, b in found]), None


def task_error(controller: Controller, q: Array, target: Any) -> TaskError:
    """The error at q (m,) to a target: a `Target`, or a pose in the form of `robot.target`.

    With exact demands their part of the twist counts, and the rest is least squares. Of an arm with few joints the
    twists that they can do count.
    """
    robot, part = controller.robot, target if isinstance(target, Target) else None
    if part is not None:
        target = robot.target(nearest_pose(part, robot.pose(q)))
    state = robot.state(q, target)
    root, error = controller.measure.root_for(state.J, state.pose, part=part), state.error
    if controller.exact:
        demands = rows_of(controller.exact, View(robot, state, target, 1.0, STILL))
        D, A, b = demands.of_twist, np.asarray(demands.A), np.asarray(demands.b)
        if D is None:  # no rows of the twist
            return TaskError(state, root, np.zeros((0, 6)), np.zeros((6, 6)), error, False, (A, b))
        own = ~D.any(axis=1)
        inverse = np.linalg.inv(root)
        U, sigma, Vt = np.linalg.svd(D.dot(inverse), full_matrices=False)
        k = np.count_nonzero(sigma > ROW_TOLERANCE * max(float(sigma[0]), TINY))
        rows, back = Vt[:k].dot(root), inverse.dot(Vt[:k].T)
        error = error + back.dot((b - D.dot(error)).dot(U[:, :k] / sigma[:k]))
        return TaskError(state, root, rows, back.dot(rows), error, True, (A[own], b[own]) if own.any() else None)
    rows = root
    if state.J.shape[1] < len(root):  # even at a singularity an arm goes on
        rows = np.linalg.svd(root.dot(state.J), full_matrices=False)[0].T.dot(root)
    return TaskError(state, root, rows, np.eye(6), error, False, None)
