"""All joint velocities that move a point of the tool along a line or leave it at rest.

    {x : (J x)(p) parallel to q} = J^{+h}(S_q meet im J) + ker J,   S_q = {s : v + omega x p parallel to q}

All J^{+h} agree on im J, up to ker J, so the answer needs no h, not even that one works. [DS] Example 3 prints
J^{+h}(S_q), which is too large: for a generic arm of three joints it contains every joint velocity.

Reference: [DS] Example 3, corrected; S_q is a 4-system whose reciprocal is a IIA 2-system.
"""

from __future__ import annotations

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import velocity_at
from invariantqp.systems.span import span
from invariantqp.systems.subspaces import system_meet

# Angle below which a twist of im J counts as one of S_q, and fraction of the fastest speed below which the point counts
# as being at rest: two factorisations leave some 1e-15.
MEET_TOLERANCE = 1e-12


@frozen(eq=False, repr=False, slots=False)
class PointMotion(Value):
    """The joint velocities that move a point along a direction.

    Attributes:
        velocities: (m, n) basis of them all: those of `twists` first, then those that move nothing.
        twists: (6, k) basis of S_q meet im J, the motions of the tool that move the point so.
        self_motions: (m, m-r) basis of ker J.
        moves: whether the point can move along the direction; if not, all these velocities leave it at rest.
    """

    velocities: Array = field(converter=own)
    twists: Array = field(converter=own)
    self_motions: Array = field(converter=own)
    moves: bool


def motions_along(point: ArrayLike, direction: ArrayLike) -> Array:
    """S_q: a basis (6, 4) of the twists that move a point along a direction or leave it at rest.

    The rotations about three axes through the point, and the translation along the direction.

    Args:
        point: (3,) the point [length].
        direction: (3,) not zero.

    Raises:
        BadInput: not three finite numbers, or a zero direction.

    Reference: [DS] Example 3 (the 4-system ev_x^-1(L)).
    """
    p = arrays.vector(point, 3, "point")
    S = np.zeros((6, 4))
    S[:3, :3] = np.eye(3)
    S[3:, :3] = np.cross(p, np.eye(3)).T
    S[3:, 3] = arrays.direction(direction, "direction")
    return S


def point_motion(J: ArrayLike, point: ArrayLike, direction: ArrayLike) -> PointMotion:
    """Every joint velocity whose twist moves `point` along `direction`.

    Args:
        J: (6, m) joint twists, any m and rank.
        point: (3,) point of the tool, in the frame of J [length].
        direction: (3,) not zero, in the frame of J.

    Returns:
        PointMotion with bases of the joint velocities, twists and self-motions.

    Raises:
        BadInput: shapes, NaN, a zero direction.

    Reference: [DS] Example 3, corrected.
    """
    twists = arrays.columns(J)
    wanted = motions_along(point, direction)
    system = span(twists)
    still = system.still
    shared = system_meet(wanted, twists, MEET_TOLERANCE) if system.rank else np.empty((6, 0))
    # The right inverse of C = diag(sigma) V' on the coordinates U'D s; on im J any J^{+h} gives the same.
    coordinates = system.basis.T.dot(system.scaled(shared))
    active = system.right.dot(coordinates / system.singular[:, None])
    p = arrays.vector(point, 3, "point")
    speeds = velocity_at(shared, p)
    terms = np.linalg.norm(shared[3:]) + np.linalg.norm(shared[:3]) * (np.linalg.norm(p) + system.unit)
    moves = bool(np.linalg.norm(speeds) > MEET_TOLERANCE * terms)
    return PointMotion(np.hstack((active, still)), shared, still, moves)
