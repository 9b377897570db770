"""How far an arm is from a target in what is wanted of it: its exact rows, or what its joints can do, or all of it.

|R s|     the size, in the measure, of the part of a twist s that the arm is to do

The way to a target is a screw, but for what exact demands ask of it: their own error. A screw that also turns a tool
whose orientation is left free would take a point elsewhere first.
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

# Of the engine's tick: fields of its answer, and the failure of a form without a projector.
VELOCITY, MISSED, FAILURE = 0, 3, 7
NO_PROJECTOR = 2
# Rows of the twist that are dependent but for this share are one.
ROW_RATIO = 1e-10
# The twist of what stands: a target of which only the error counts, an arm that is to stop.
STILL = np.zeros(6)


class TaskError(NamedTuple):
    """The arm before a target, and the way there."""

    state: RobotState  # of the arm
    root: Array  # (6, 6) of the measure; (k, 6) of what counts where a target leaves something free
    rows: Array  # (k, 6) R, what is wanted, orthonormal in the measure
    part: Array  # (6, 6) the projector on what exact rows ask for
    error: Array  # (6,) the twist that leads to the target
    exact: bool  # whether exact demands ask for the rows
    joint_rows: tuple[Array, Array] | None  # exact rows (k, m) and (k,) that are no part of the twist

    @property
    def off(self) -> float:
        """How far the tool is from the target in what is wanted."""
        off = self.rows.dot(self.error)
        return sqrt(float(off.dot(off)))

    def answer(
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
        """The law's joint velocity (m,) for a twist, and the size of what it misses of that, in the measure.

        It is such that q + h x is inside the position limits, from q (m,).

        Args:
            controller: whose law it is.
            q: (m,) joint positions.
            twist: (6,).
            h: how long the velocity is held.
            posture: (m,) joint velocity wanted where the twist leaves joints free; None is zero.
            exact: whether exact demands on the twist are met.
            more: other arguments of the engine's tick: damping, root, lower, upper, ...
        """
        J, box = self.state.J, controller.box
        fields = controller.in_engine.law | {
            "root": self.root,
            "ahead": twist,
            "lower": (box.position_lower - q) / h,
            "upper": (box.position_upper - q) / h,
            "posture": posture,
        }
        fields["exact"] = self._exact_rows(twist, met=exact)
        found = law.tick(J, **(fields | more))
        if found[FAILURE] == NO_PROJECTOR and controller.guard is not None:  # which leaves none of the form then
            found = law.tick(J, **(fields | more | {"form": None}))
        return found[VELOCITY], found[MISSED]

    def _exact_rows(self, twist: Array, *, met: bool) -> tuple[Array, Array, None] | None:
        """The exact rows for a twist as the engine takes them; `met` is whether parts of the twist are among them."""
        found = [] if self.joint_rows is None else [self.joint_rows]
        if met and self.exact:
            found.append((self.rows.dot(self.state.J), self.rows.dot(twist)))
        if not found:
            return None
        return np.vstack([E for E, _ in found]), np.concatenate([b for _, b in found]), None


def task_error(controller: Controller, q: Array, target: Any) -> TaskError:
    """Before a target, a `Target` or what `robot.target` returned, at joint positions q (m,).

    With exact demands their part of the twist is wanted; the rest is least squares, and may stray. Fewer joints than
    that are to do the twists that they can.
    """
    robot, part = controller.robot, target if isinstance(target, Target) else None
    if part is not None:
        target = robot.target(nearest_pose(part, robot.pose(q)))
    state = robot.state(q, target)
    root, error = controller.measure.root_for(state.J, state.pose, part=part), state.error
    if controller.exact:
        demands = rows_of(controller.exact, View(robot, state, target, 1.0, STILL))
        D, A, b = demands.of_twist, np.asarray(demands.A), np.asarray(demands.b)
        if D is None:  # joint rows ask for nothing of the twist
            return TaskError(state, root, np.zeros((0, 6)), np.zeros((6, 6)), error, False, (A, b))
        own = ~D.any(axis=1)
        inverse = np.linalg.inv(root)
        U, sigma, Vt = np.linalg.svd(D.dot(inverse), full_matrices=False)
        k = np.count_nonzero(sigma > ROW_RATIO * max(float(sigma[0]), TINY))
        rows, back = Vt[:k].dot(root), inverse.dot(Vt[:k].T)
        error = error + back.dot((b - D.dot(error)).dot(U[:, :k] / sigma[:k]))
        return TaskError(state, root, rows, back.dot(rows), error, True, (A[own], b[own]) if own.any() else None)
    asked = root
    if state.J.shape[1] < len(root):  # all of them, however weak: at the edge of its reach an arm still goes on
        asked = np.linalg.svd(root.dot(state.J), full_matrices=False)[0].T.dot(root)
    return TaskError(state, root, asked, np.eye(6), error, False, None)
