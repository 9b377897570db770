"""States with the tool straight up or down, in which most work is done: the last axis parallel to the first.

    Gauss-Newton on  w_1 - w_m = sum over i of (w_i x w_m) dq_i,    w_i unit axes of the turning joints, w_1 up or down

A random state is never such a state, so samples of the range say nothing of them; and an SO-101, among others, has no
pitch there at all. They are told by axes, not by the tool frame's z axis or by gravity, so no choice of frame decides
what they are.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot

# Newton's steps; four to eight are enough from anywhere for arms whose wrist can turn that far.
STEPS = 20
# The longest of them in one joint [rad].
LONGEST = 0.5
# The sine of the angle between axes that count as parallel, which is finer than anyone points a tool.
PARALLEL = 1e-3
# Directions in which turning the axis needs joints a thousand times faster than in others are left alone.
WEAK = 1e-3


def upright(robot: Robot, q: Array) -> Array:
    """(k, m) states near the (n, m) given ones, inside the joint limits, with the last axis parallel to the first.

    There are none where no joint or only one turns, where joint limits forbid them, and where the two axes are parallel
    in every state (a SCARA): then they are no other states than the rest.
    """
    found = [state for start in q if (state := _turned(robot, start)) is not None]
    return np.array(found).reshape(-1, q.shape[1])


def _turned(robot: Robot, start: Array) -> Array | None:
    q = start
    for step in range(STEPS + 1):
        w = robot.jacobian(q)[:3]
        sizes = np.linalg.norm(w, axis=0)
        turning = sizes > 0.0
        if np.count_nonzero(turning) < 2:
            return None
        axes = w[:, turning] / sizes[turning]
        first, last = axes[:, 0], axes[:, -1]
        if np.linalg.norm(np.cross(first, last)) < PARALLEL:
            return q if step else None
        if step == STEPS:
            break
        rates = np.cross(axes.T, last).T  # (3, turning) how each joint turns the last axis
        wanted = np.copysign(1.0, first.dot(last)) * first - last
        change = np.zeros(len(q))
        change[turning] = np.linalg.pinv(rates, rcond=WEAK).dot(wanted) / sizes[turning]
        q = np.clip(q + np.clip(change, -LONGEST, LONGEST), robot.position_lower, robot.position_upper)
    return None
