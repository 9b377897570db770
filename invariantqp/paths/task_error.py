"""How far an arm is from a target in what is wanted of it: its exact rows, or what its joints can do, or all of it.

|R s|     the size, in the measure, of the part of a twist s that the arm is to do

The way to a target is a screw, but for what exact demands ask of it: their own error. A screw that also turns a tool
whose orientation is left free would take a point elsewhere first.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from invariantqp.control.demands import View, rows_of
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.linear import TINY
from invariantqp.legacy.law import Demand
from invariantqp.legacy.loop import LegacyLoop
from invariantqp.robots.kinematics import Sighting
from invariantqp.velocity.exact import ExactRows

# Rows of the twist that are dependent but for this share are one.
ROW_RATIO = 1e-10
# The twist of what stands: a target of which only the error counts, an arm that is to stop.
STILL = np.zeros(6)


class TaskError(NamedTuple):
    """The arm before a target, and the way there."""

    sighting: Sighting  # of the arm
    root: Array  # (6, 6) of the measure
    demands: ExactRows | None  # the exact rows, which ask for their own error; None where there are none
    rows: Array  # (k, 6) R, what is wanted, orthonormal in the measure
    part: Array  # (6, 6) the projector on what exact rows ask for
    error: Array  # (6,) the twist that leads to the target

    @property
    def off(self) -> float:
        """How far the tool is from the target in what is wanted."""
        off = self.rows.dot(self.error)
        return sqrt(float(off.dot(off)))

    def demand(self, controller: LegacyLoop, q: Array, twist: Array, h: float, posture: Array | None = None) -> Demand:
        """The demand on the law for a twist, such that q + h x is inside the position limits, from q (m,)."""
        lower, upper = (controller.box.position_lower - q) / h, (controller.box.position_upper - q) / h
        exact = self.demands
        if exact is not None and exact.of_twist is not None:
            D = exact.of_twist
            exact = exact.demanding(np.where(D.any(axis=1), D.dot(twist), exact.b))
        return Demand(self.sighting.J, twist, self.root, lower, upper, exact, posture, row_rank=controller.row_rank)


def task_error(controller: LegacyLoop, q: Array, target: Any) -> TaskError:
    """Before a target, at joint positions q (m,).

    With exact demands their part of the twist is wanted; the rest is least squares, and may stray. Fewer than six
    joints are to do the twists that they can.
    """
    robot = controller.robot
    sighting = robot.sight(q, target)
    root, error = controller.measure.root_for(sighting.J, sighting.pose), sighting.error
    if controller.exact:
        demands = rows_of(controller.exact, View(robot, sighting, target, 1.0, STILL))
        D = demands.of_twist
        if D is None:  # joint rows ask for nothing of the twist
            return TaskError(sighting, root, demands, np.zeros((0, 6)), np.zeros((6, 6)), error)
        inverse = np.linalg.inv(root)
        U, sigma, Vt = np.linalg.svd(D.dot(inverse), full_matrices=False)
        k = np.count_nonzero(sigma > ROW_RATIO * max(float(sigma[0]), TINY))
        rows, back = Vt[:k].dot(root), inverse.dot(Vt[:k].T)
        error = error + back.dot((demands.b - D.dot(error)).dot(U[:, :k] / sigma[:k]))
        return TaskError(sighting, root, demands, rows, back.dot(rows), error)
    asked = root
    if sighting.J.shape[1] < 6:  # all of them, however weak: at the edge of its reach an arm is still asked to go on
        asked = np.linalg.svd(root.dot(sighting.J), full_matrices=False)[0].T.dot(root)
    return TaskError(sighting, root, None, asked, np.eye(6), error)
