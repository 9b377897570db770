"""Joint twists, their pitch and their axis: s = (u; q x u + h u), h = omega.v / omega.omega, axis {q + t u}.

A revolute joint is a twist of pitch 0, a helical joint one of finite pitch h [length/rad], a prismatic joint one of
infinite pitch (0; u).

Reference: [DS] Sect. 2.2.
"""

from __future__ import annotations

from math import hypot, inf, isinf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.se3 import SWAPPED
from invariantqp.geometry.sizes import LENGTH_LIMIT


def helical(axis: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0), pitch: float = 0.0) -> Array:
    """The (6,) unit twist of a screw joint about a line.

    Args:
        axis: (3,) direction of the line, any non-zero length.
        point: (3,) any point of the line [length].
        pitch: translation per radian [length/rad]; inf gives the prismatic twist along the axis.
    """
    u = arrays.direction(axis, "axis")
    q = arrays.vector(point, 3, "point")
    h = arrays.number(pitch, "pitch", "a pitch, finite or inf", infinite=True)
    if isinf(h):
        return np.concatenate((np.zeros(3), u))
    return np.concatenate((u, np.cross(q, u) + h * u))


def revolute(axis: ArrayLike, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """The (6,) unit twist of a revolute joint (a hinge) about the line through `point` along `axis`: pitch 0."""
    return helical(axis, point)


def prismatic(axis: ArrayLike) -> Array:
    """The (6,) unit twist of a prismatic joint (a slide) along `axis`: infinite pitch."""
    return helical(axis, pitch=inf)


def pitch(twist: ArrayLike) -> float:
    """The pitch omega.v / omega.omega of a (6,) twist [length/rad]; inf for a pure translation."""
    s = arrays.twist(twist)
    if not s.any():
        raise BadInput("twist", "the zero twist", "a non-zero twist", "Only a non-zero twist has a pitch.")
    s = s / np.abs(s).max()
    length = hypot(*s[:3].tolist())
    return float((s[:3] / length).dot(s[3:]) / length) if length > 0.0 else inf


def angular_speeds(J: Array) -> Array:
    """(m,) |omega| of joint twists (6, m): 1 for a revolute joint in radians, 0 for a prismatic one."""
    return np.asarray(np.linalg.norm(J[:3], axis=0))


def axis(twist: ArrayLike) -> tuple[Array, Array]:
    """The axis of a (6,) twist: its unit direction (3,) and its point (3,) nearest to the origin."""
    s = arrays.twist(twist)
    length = hypot(*s[:3].tolist())
    if length == 0.0:
        raise BadInput("twist", "a twist with omega = 0", "a twist with a finite axis", "Its direction is twist[3:].")
    u = s[:3] / length
    return u, np.cross(u, s[3:] / length)


class Screw(NamedTuple):
    """Magnitude, pitch, unit direction (3,) and the axis' point (3,) nearest to the origin of a twist or a wrench.

    For a twist the magnitude is |omega| [rad/s] and the pitch in length/rad; for a wrench |f| [force] and length. A
    translation or a couple has infinite pitch, magnitude |v| or |m|, and no point.
    """

    magnitude: float
    pitch: float
    direction: Array
    point: Array | None


def screw_of(twist: ArrayLike) -> Screw:
    """Magnitude, pitch and axis of a (6,) twist (omega; v).

    Reference: [DS] Sect. 2.2.
    """
    s = arrays.twist(twist)
    h = pitch(s)
    if isinf(h):
        size = hypot(*s[3:].tolist())
        return Screw(size, h, s[3:] / size, None)
    return Screw(hypot(*s[:3].tolist()), h, *axis(s))


def screw_of_wrench(wrench: ArrayLike) -> Screw:
    """Magnitude, pitch and axis of a (6,) wrench (m; f): a force f along the axis with the moment pitch times f.

    Reference: Ball 1900, Poinsot's theorem.
    """
    return screw_of(arrays.twist(wrench, "wrench")[SWAPPED])


class LeastMovingPoint(NamedTuple):
    """The point (3,) that twists move least, nearest to the origin, and the directions (3, f) in which it is free."""

    point: Array
    free: Array


def least_moving_point(twists: Array, tolerance: float = ROUNDING, longest: float = LENGTH_LIMIT) -> LeastMovingPoint:
    """The least-norm minimiser of |v + omega x p|_F over p, for checked (6, m) twists.

    A direction is free if the eigenvalue of the Hessian is below `tolerance` times the largest. With |J_v| / |J_omega|
    above `longest` no joint rotates: the point is the origin, and free.
    """
    w, v = twists[:3], twists[3:]
    squares, axes = np.linalg.eigh(w.dot(w.T))
    stiffness = squares.sum() - squares  # eigenvalues of A = |w|^2 I - w w', descending
    if np.vdot(v, v) > squares.sum() * longest * longest:
        return LeastMovingPoint(np.zeros(3), np.eye(3))
    fixed = stiffness > tolerance * stiffness[0]
    along = axes[:, fixed]
    M = w.dot(v.T)
    moment = np.array((M[1, 2] - M[2, 1], M[2, 0] - M[0, 2], M[0, 1] - M[1, 0]))  # A p = sum of w x v
    return LeastMovingPoint(along.dot(along.T.dot(moment) / stiffness[fixed]), axes[:, ~fixed])
