"""An arm's own point and length: the point p that the joints move least, and how fast they move it.

    p = argmin |J_v(p)|_F,   L = |J_v(p)|_F / |J_omega|_F,   J_v(p) = v_i + omega_i x p

Both are carried by every rigid change of frame and L scales with the unit of length, so a metric diag(L^2 I, I) at p
depends on nobody's choice of frame or unit.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.systems.span import LENGTH_LIMIT

# Directions along which moving p changes |J_v(p)| by less than this fraction are free: all axes are parallel to them.
PARALLEL_TOLERANCE = 1e-12

# A twist whose axis is this many times the arm's size away turns across the free directions by rounding alone.
FARTHEST = 1e6


class Centre(NamedTuple):
    """Point p (3,) [length] and length L [length/rad]; L is inf where no joint turns, 0 where all axes meet in p."""

    point: Array
    length: float


class Resting(NamedTuple):
    """Point (3,) that the twists move least, the nearest to the origin of those; free (3, f) directions it may move."""

    point: Array
    free: Array


def resting_point(twists: Array, tolerance: float = PARALLEL_TOLERANCE, longest: float = LENGTH_LIMIT) -> Resting:
    """The least-norm minimiser of |v + omega x p|_F over p, for checked (6, m) twists.

    Args:
        twists: (6, m).
        tolerance: share of the largest stiffness of |J_v(p)|^2 against p below which a direction is free.
        longest: |J_v| / |J_omega| above which no joint turns: the point is the origin, and free.
    """
    w, v = twists[:3], twists[3:]
    if np.vdot(v, v) > longest * longest * np.vdot(w, w):
        return Resting(np.zeros(3), np.eye(3))
    moment = w.dot(v.T)
    b = np.array(
        [moment[1, 2] - moment[2, 1], moment[2, 0] - moment[0, 2], moment[0, 1] - moment[1, 0]]
    )  # sum of w x v
    spread, axes = np.linalg.eigh(w.dot(w.T))
    stiffness = spread.sum() - spread  # eigenvalues of |w|^2 I - w w', descending
    fixed = stiffness > tolerance * stiffness[0]
    along = axes[:, fixed]
    return Resting(along.dot(along.T.dot(b) / stiffness[fixed]), axes[:, ~fixed])


def centre(J: ArrayLike, twist: ArrayLike | None = None) -> Centre:
    """The arm's own point and length for (6, m) joint twists.

    Where all axes are parallel (a planar arm) the point is free along them; `twist` (6,), if given, settles it as the
    point of that line which the twist moves least.

    Raises:
        BadInput: J is not finite (6, m).
    """
    twists = arrays.columns(J)
    p, free = resting_point(twists)
    moving = velocity_at(twists, p)
    # The same wherever along the free directions p is: every axis is parallel to them.
    length = inf if free.shape[1] == 3 else _length(twists, moving)
    if free.shape[1] and twist is not None:
        p = _settled(p, free, arrays.twist(twist), length)
    return Centre(p, length)


def _length(twists: Array, moving: Array) -> float:
    """|J_v(p)| / |J_omega|; 0 where all axes meet but for rounding, which is relative to how far off they do."""
    turning, moved = (sqrt(np.vdot(a, a)) for a in (twists[:3], moving))
    met = moved * LENGTH_LIMIT <= max(sqrt(np.vdot(twists[3:], twists[3:])), turning)
    return 0.0 if met else moved / turning


def _settled(p: Array, free: Array, s: Array, length: float) -> Array:
    """The point p + free t that the twist s moves least; p itself where s turns about the free directions alone."""
    # Only the component of omega across the free directions moves the point: w x (free t) = across t.
    across, moved = np.cross(s[:3], free, axis=0), velocity_at(s, p)
    reach = length + sqrt(p.dot(p))
    if reach > 0.0 and np.linalg.norm(across) < np.linalg.norm(moved) / (FARTHEST * reach):
        return p
    return np.asarray(p - free.dot(np.linalg.pinv(across).dot(moved)))
