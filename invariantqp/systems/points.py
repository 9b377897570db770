"""What joint twists do with points: the arm's own point and length, its reach, and all that moves a point along a line.

    p = argmin |J_v(p)|_F,   L = |J_v(p)|_F / |J_omega|_F,   J_v(p) = v_i + omega_i x p
    {x : (J x)(p) parallel to q} = J^{+h}(S_q meet im J) + ker J,   S_q = {s : v + omega x p parallel to q}

A rigid change of frame moves the arm's own point p along and leaves every length as it is; a change of the unit of
length only converts them. So a metric diag(L^2 I, I) at p depends on nobody's choice of frame or unit.

All J^{+h} agree on im J, up to ker J, so the second line needs no h, not even that one works. [DS] Example 3 prints
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
from invariantqp.geometry.screws import resting_point
from invariantqp.geometry.se3 import cross, norm, velocity_at
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.subspaces import Subspace

# A point this many of the arm's lengths away (of the caller's units where it has none) is what rounding makes of a
# twist that does not turn across the axes; measured from there, every velocity nearby would count as nothing.
FAR = 1e6


class Centre(NamedTuple):
    """Point p (3,) [length] and length L [length/rad]; L is inf where no joint turns, 0 where all axes meet in p."""

    point: Array
    length: float


def centre(J: ArrayLike, twist: ArrayLike | None = None) -> Centre:
    """The arm's own point and length for (6, m) joint twists.

    Where all axes are parallel (a planar arm) the point is free along them; `twist` (6,), if given, settles it as the
    point of that line which the twist moves least, unless it is too far: a twist that does not turn across the
    axes moves all their points alike.
    """
    twists = arrays.columns(J)
    p, free = resting_point(twists)
    moving = velocity_at(twists, p)
    # The same wherever along the free directions p is: every axis is parallel to them.
    length = inf if free.shape[1] == 3 else _length(twists, moving)
    if free.shape[1] and twist is not None:
        s = arrays.twist(twist)
        # Among the free points only the component of omega across them moves the point: w x (free t) = across t.
        across = np.cross(s[:3], free, axis=0)
        turns = np.linalg.norm(across) > ROUNDING * np.linalg.norm(s[:3])
        along = np.linalg.pinv(across).dot(velocity_at(s, p)) if turns else np.zeros(free.shape[1])
        if norm(along) <= FAR * (length if 0.0 < length < inf else 1.0):
            p = p - free.dot(along)
    return Centre(p, length)


def reach(J: ArrayLike, point: ArrayLike) -> float:
    """The length of the broken line from a point to the first turning axis, by way of all the others.

    The line starts at `point` (3,), goes to its foot on the last turning axis of J (6, m), from there to its foot on
    the axis before, and so on to the first; joints that only slide are skipped. With revolute joints no leg of it
    depends on the joint positions, since both of its ends are points of one link. No revolute joint moves the point
    faster than `reach` times its own rate, in any position of the joints. It is the same in every frame, the point
    given in that frame; 0 where all axes meet in the point, or where no joint turns.
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


def _length(twists: Array, moving: Array) -> float:
    """|J_v(p)| / |J_omega|; 0 where all axes meet but for rounding, which is relative to how far off they do."""
    turning, moved = float(np.vdot(twists[:3], twists[:3])), float(np.vdot(moving, moving))
    if moved * LENGTH_LIMIT**2 <= max(float(np.vdot(twists[3:], twists[3:])), turning):
        return 0.0
    return sqrt(moved / turning)


@frozen(eq=False, repr=False, slots=False)
class PointMotion(Value):
    """The joint velocities that move a point along a direction.

    Attributes:
        velocities: (m, n) basis of them all: the k of `twists` first, then the m - r that move nothing, ker J.
        twists: (6, k) basis of S_q meet im J, the motions of the tool that move the point so.
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


def point_motion(J: ArrayLike, point: ArrayLike, direction: ArrayLike) -> PointMotion:
    """Every joint velocity whose twist moves a point (3,) along a direction (3,), in the frame of J (6, m).

    Reference: [DS] Example 3, corrected.
    """
    twists = arrays.columns(J)
    wanted = motions_along(point, direction)
    system = Subspace(twists)
    shared = Subspace(wanted, tolerance=ROUNDING).meet(system).basis
    active = system.joint_velocities(shared)  # on im J any J^{+h} gives the same, up to ker J
    p = arrays.vector(point, 3, "point")
    speeds = velocity_at(shared, p)
    terms = np.linalg.norm(shared[3:]) + np.linalg.norm(shared[:3]) * (np.linalg.norm(p) + system.length)
    moves = bool(np.linalg.norm(speeds) > ROUNDING * terms)
    return PointMotion(np.hstack((active, system.null_space)), shared, moves)
