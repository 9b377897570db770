"""Own point and length of an arm, its reach, and the joint velocities that move a point along a line.

    p = argmin |J_v(p)|_F,   L = |J_v(p)|_F / |J_omega|_F,   J_v(p) = v_i + omega_i x p
    {x : (J x)(p) parallel to q} = J^{+h}(S_q meet im J) + ker J,   S_q = {s : v + omega x p parallel to q}

A rigid change of frame moves the own point p and keeps every length; a change of the unit of length converts them. So a
metric diag(L^2 I, I) at p depends on no choice of frame or unit.

All J^{+h} agree on im J, up to ker J, so the second line needs no h and holds even if no h works. [DS] Example 3 prints
J^{+h}(S_q), which is too large: for a generic arm of three joints it contains every joint velocity.

Reference: [DS] Example 3, corrected; S_q is a 4-system whose reciprocal is a IIA 2-system.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import least_moving_point
from invariantqp.geometry.se3 import cross, norm, velocity_at
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.subspaces import Subspace, as_system

# Largest shift along parallel axes, in own lengths of the arm (or the caller's units): a larger one is the rounding of
# a twist that does not rotate across the axes.
LARGEST_SHIFT = 1e6


class Centre(NamedTuple):
    """Own point p (3,) [length] and length L [length/rad]; L is inf if no joint rotates, 0 if all axes meet in p."""

    point: Array
    length: float


def centre(J: ArrayLike, twist: ArrayLike | None = None) -> Centre:
    """The arm's own point and length for (6, m) joint twists.

    If all axes are parallel (a planar arm), every point of a line along them is an own point. `twist` (6,) chooses the
    one that it moves least; without it, or if the twist does not rotate across the axes, it is the one nearest to the
    origin.
    """
    twists = arrays.columns(J)
    p, free = least_moving_point(twists)
    # L is the same for every shift of p along the free directions: every axis is parallel to them.
    length = inf if free.shape[1] == 3 else _length(twists, velocity_at(twists, p))
    if free.shape[1] and twist is not None:
        s = arrays.twist(twist)
        # omega x (free t) = across t is the change of the point's velocity.
        across = np.cross(s[:3], free, axis=0)
        rotates = np.linalg.norm(across) > ROUNDING * np.linalg.norm(s[:3])
        shift = np.linalg.pinv(across).dot(velocity_at(s, p)) if rotates else np.zeros(free.shape[1])
        if norm(shift) <= LARGEST_SHIFT * (length if 0.0 < length < inf else 1.0):
            p = p - free.dot(shift)
    return Centre(p, length)


def reach(J: ArrayLike, point: ArrayLike) -> float:
    """The length of the polygonal line from a point to the first rotation axis through its feet on all the others.

    The line starts at `point` (3,), goes to its foot on the last rotation axis of J (6, m), from there to its foot on
    the axis before, and so on to the first; prismatic joints are skipped. With revolute joints no leg depends on the
    joint positions, since both of its ends are points of one link. No revolute joint moves the point faster than
    `reach` times its own rate, at any joint positions. It is the same in every frame, the point given in that frame; 0
    if all axes meet in the point, or no joint rotates.
    """
    twists = arrays.columns(J)
    foot = arrays.vector(point, 3, "point")
    length, size = 0.0, norm(foot)
    for s in reversed(twists.T):
        rate, moment = norm(s[:3]), norm(s[3:])
        if rate * LENGTH_LIMIT <= moment:
            continue
        leg = cross(s[:3] / rate, velocity_at(s / rate, foot))
        foot = foot + leg
        length += norm(leg)
        size = max(size, moment / rate)
    return length if length > ROUNDING * size else 0.0


def _length(twists: Array, velocities: Array) -> float:
    """|J_v(p)| / |J_omega|; 0 if all axes meet up to rounding, which is relative to their distance from the origin."""
    angular, moved = float(np.vdot(twists[:3], twists[:3])), float(np.vdot(velocities, velocities))
    if moved * LENGTH_LIMIT**2 <= max(float(np.vdot(twists[3:], twists[3:])), angular):
        return 0.0
    return sqrt(moved / angular)


@frozen(eq=False, repr=False, slots=False)
class PointMotion(Value):
    """The joint velocities that move a point along a direction.

    Attributes:
        velocities: (m, n) basis: first k joint velocities for `twists`, then m - r of ker J.
        twists: (6, k) basis of S_q meet im J, the corresponding twists of the tool.
        moves: whether the point can move along the direction; if not, all these velocities leave it at rest.
    """

    velocities: Array = field(converter=own)
    twists: Array = field(converter=own)
    moves: bool


def motions_along(point: ArrayLike, direction: ArrayLike) -> Array:
    """S_q: a basis (6, 4) of the twists that move a point (3,) along a direction (3,) or leave it at rest.

    The rotations about three axes through the point, and the translation along the direction.

    Reference: [DS] Example 3 (the 4-system ev_x^-1(L)).
    """
    p = arrays.vector(point, 3, "point")
    S = np.zeros((6, 4))
    S[:3, :3] = np.eye(3)
    S[3:, :3] = np.cross(p, np.eye(3)).T
    S[3:, 3] = arrays.direction(direction, "direction")
    return S


def point_motion(J: ArrayLike | Subspace, point: ArrayLike, direction: ArrayLike) -> PointMotion:
    """All joint velocities whose twist moves a point (3,) along a direction (3,), in the frame of J (6, m).

    Reference: [DS] Example 3, corrected.
    """
    system = as_system(J)
    shared = Subspace(motions_along(point, direction), tolerance=ROUNDING).meet(system).basis
    velocities = system.joint_velocities(shared)  # on im J any J^{+h} gives the same, up to ker J
    p = arrays.vector(point, 3, "point")
    terms = np.linalg.norm(shared[3:]) + np.linalg.norm(shared[:3]) * (np.linalg.norm(p) + system.length)
    moves = bool(np.linalg.norm(velocity_at(shared, p)) > ROUNDING * terms)
    return PointMotion(np.hstack((velocities, system.null_space)), shared, moves)
