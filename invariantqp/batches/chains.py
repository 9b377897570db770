"""Tool poses and Jacobians of an arm at many joint positions, on arrays of any library: the product of exponentials.

T(q) = exp(s_1 q_1) ... exp(s_m q_m) T_0,    column i of J:  Ad(exp(s_1 q_1) ... exp(s_{i-1} q_{i-1})) s_i
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.batches.measure import cross
from invariantqp.batches.namespace import Rows, constant, shaped, together
from invariantqp.geometry import arrays
from invariantqp.robots.chain import Chain


class Kinematics(NamedTuple):
    """Where the tool is and how it moves; a pytree of JAX.

    Attributes:
        pose: (..., 4, 4) tool poses in the base frame.
        jacobian: (..., 6, m) joint twists (omega; v) in the base frame.
    """

    pose: Rows
    jacobian: Rows


def kinematics(robot: Chain, q: ArrayLike) -> Kinematics:
    """Tool poses and Jacobians where the joint positions are: numpy, torch, JAX, CuPy; differentiable.

    Args:
        robot: a chain of joint screws, as `load_robot` returns it.
        q: (..., m) joint positions [rad, length]; NaN stays in its row.

    Raises:
        BadInput: not a `Chain`, another shape, or not real numbers.
        MissingExtra: array-api-compat is not installed.
    """
    arrays.instance(robot, Chain, "robot", "a Chain, as load_robot returns it")
    xp, (positions,) = together({"q": q})
    m = len(robot.names)
    shaped(positions, (m,), "q", f"shape (..., {m}), one position a joint")
    rates, powers = robot.powers
    t = positions * constant(xp, positions, rates)
    half = xp.sin(0.5 * t)
    parts = xp.stack((t, 2.0 * half * half, t - xp.sin(t)), axis=-1)  # (..., m, 3)
    steps = (parts[..., None, :] @ constant(xp, t, powers))[..., 0, :]
    one = constant(xp, t, np.eye(4))
    steps = one + xp.reshape(steps, (*t.shape, 4, 4))
    screws = constant(xp, t, robot.screws)
    T, columns = xp.broadcast_to(one, (*t.shape[:-1], 4, 4)), []
    for i in range(m):
        R, p = T[..., :3, :3], T[..., :3, 3]
        w = (R @ screws[:3, i, None])[..., 0]
        v = (R @ screws[3:, i, None])[..., 0] + cross(xp, p, w)
        columns.append(xp.concat((w, v), axis=-1))
        T = T @ steps[..., i, :, :]
    return Kinematics(T @ constant(xp, t, robot.home), xp.stack(columns, axis=-1))
