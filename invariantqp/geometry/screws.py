"""Joint twists, their pitch and their axis: s = (u; q x u + h u), h = omega.v / omega.omega, axis {q + t u}.

A revolute joint is a twist of pitch 0, a helical joint one of finite pitch h [length/rad], a prismatic joint one of
infinite pitch (0; u).

Reference: [DS] Sect. 2.2.
"""

from __future__ import annotations

from math import hypot, inf, isinf

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array


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


def turning(J: Array) -> Array:
    """(m,) how fast the joints of twists (6, m) turn at unit rate, |omega|: 1 of a hinge in radians, 0 of a slide."""
    return np.asarray(np.linalg.norm(J[:3], axis=0))


def axis(twist: ArrayLike) -> tuple[Array, Array]:
    """The axis of a (6,) twist: its unit direction (3,) and its point (3,) nearest to the origin."""
    s = arrays.twist(twist)
    length = hypot(*s[:3].tolist())
    if length == 0.0:
        raise BadInput("twist", "a twist with omega = 0", "a twist with a finite axis", "Its direction is twist[3:].")
    u = s[:3] / length
    return u, np.cross(u, s[3:] / length)
