"""Rigid motions, twists and arms, many at once, on arrays of any library: `exp`, `log`, `adjoint`; T and J of an arm.

T(q) = exp(s_1 q_1) ... exp(s_m q_m) T_0,    column i of J:  Ad(exp(s_1 q_1) ... exp(s_{i-1} q_{i-1})) s_i

Errors are those of `kinematics`; NaN stays in its row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.batches.namespace import Namespace, Rows, as_arrays, constant, cross, length_of, shaped
from invariantqp.geometry import arrays
from invariantqp.geometry.se3 import SMALL_ANGLE
from invariantqp.robots.chain import Chain

POSES, TWISTS = "shape (..., 4, 4): homogeneous", "shape (..., 6): angular part first"


def exps(twists: ArrayLike) -> Rows:
    """(..., 4, 4) the rigid motion of each of (..., 6) twists."""
    xp, (s,) = as_arrays({"twists": twists})
    shaped(s, (6,), "twists", TWISTS)
    w, v = s[..., :3], s[..., 3:]
    t2 = xp.sum(w * w, axis=-1, keepdims=True)
    small, t = _angle(xp, t2)
    a = xp.where(small, 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0)), xp.sin(t) / t)
    half = xp.sin(0.5 * t) / t
    b = xp.where(small, 0.5 * (1.0 - t2 / 12.0 * (1.0 - t2 / 30.0 * (1.0 - t2 / 56.0))), 2.0 * half * half)
    series = (1.0 - t2 / 20.0 * (1.0 - t2 / 42.0 * (1.0 - t2 / 72.0))) / 6.0
    c = xp.where(small, series, (1.0 - a) / (t * t))
    wv = cross(xp, w, v)
    p = v + b * wv + c * cross(xp, w, wv)
    x, y, z = (w[..., i] for i in range(3))
    zero = xp.zeros_like(x)
    W = xp.reshape(xp.stack((zero, -z, y, z, zero, -x, -y, x, zero), axis=-1), (*x.shape, 3, 3))
    one = constant(xp, w, np.eye(3))
    top = xp.concat((one + a[..., None] * W + b[..., None] * (W @ W), p[..., None]), axis=-1)
    last = xp.concat((xp.zeros_like(p), xp.ones_like(p[..., :1])), axis=-1)
    return xp.concat((top, last[..., None, :]), axis=-2)


def logs(poses: ArrayLike) -> Rows:
    """(..., 6) the twist of each of (..., 4, 4) poses, angle in [0, pi]; whether they are rigid is not checked."""
    xp, (T,) = as_arrays({"poses": poses})
    shaped(T, (4, 4), "poses", POSES)
    p = T[..., :3, 3]
    w = vector_of(xp, quaternion_of(xp, T[..., :3, :3]))
    t2 = xp.sum(w * w, axis=-1, keepdims=True)
    small, t = _angle(xp, t2)
    exact = (1.0 - 0.5 * t * xp.cos(0.5 * t) / xp.sin(0.5 * t)) / (t * t)
    c = xp.where(small, (1.0 + t2 / 60.0 * (1.0 + t2 / 42.0)) / 12.0, exact)
    wp = cross(xp, w, p)
    return xp.concat((w, p - 0.5 * wp + c * cross(xp, w, wp)), axis=-1)


def adjoints(poses: ArrayLike) -> Rows:
    """(..., 6, 6) the matrix [[R, 0], [p^ R, R]] of each of (..., 4, 4) poses."""
    xp, (T,) = as_arrays({"poses": poses})
    shaped(T, (4, 4), "poses", POSES)
    R, p = T[..., :3, :3], T[..., :3, 3]
    moved = xp.matrix_transpose(cross(xp, p[..., None, :], xp.matrix_transpose(R)))
    upper = xp.concat((R, xp.zeros_like(R)), axis=-1)
    return xp.concat((upper, xp.concat((moved, R), axis=-1)), axis=-2)


def quaternion_of(xp: Namespace, R: Rows) -> Rows:
    """(..., 4) quaternions (w, x, y, z) of rotations (..., 3, 3), up to their size (Shepperd's method)."""
    (a, b, c), (d, e, f), (g, h, i) = ([R[..., j, k] for k in range(3)] for j in range(3))
    trace = a + e + i
    found = xp.stack((1.0 + trace, h - f, c - g, d - b), axis=-1)
    largest = trace
    for entry, choice in (
        (a, (h - f, 1.0 + a - e - i, b + d, c + g)),
        (e, (c - g, b + d, 1.0 - a + e - i, f + h)),
        (i, (d - b, c + g, f + h, 1.0 - a - e + i)),
    ):
        found = xp.where((entry > largest)[..., None], xp.stack(choice, axis=-1), found)
        largest = xp.maximum(largest, entry)
    return found


def vector_of(xp: Namespace, quaternion: Rows) -> Rows:
    """(..., 3) rotation vectors, angle in [0, pi], of quaternions (w, x, y, z) of any size but zero."""
    w, v = quaternion[..., :1], quaternion[..., 1:]
    n = length_of(xp, v)[..., None]
    turned, one = n > 0.0, xp.ones_like(w)
    sign = xp.where(w < 0.0, -one, one)
    share = xp.atan2(xp.where(turned, n, one), xp.abs(w)) / xp.where(turned, n, one)
    return 2.0 * sign * xp.where(turned, share, 1.0 / xp.where(turned, one, xp.abs(w))) * v


def _angle(xp: Namespace, t2: Rows) -> tuple[Rows, Rows]:
    """Whether angles with these squares are small, and the angles; 1 for small ones, which nothing may divide by."""
    small = t2 < SMALL_ANGLE**2
    return small, xp.sqrt(xp.where(small, xp.ones_like(t2), t2))


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
    xp, (positions,) = as_arrays({"q": q})
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
