"""How large a twist counts: a definite metric W carried to a physical point, where limits and singularities are paid.

    s'Ws = L^2 |omega|^2 + |v_p|^2,   v_p = v + omega x p,   root = [[L I, 0], [-[p]x, I]],   W = root'root

p is a point of the tool that somebody names and L a length, the arm's reach. Moving the frame in which J, s and p are
told, or telling them in another unit of length, changes no value of s'Ws but its unit.

A body may carry another metric (`CarriedMetric`): its root takes the place of this one.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.centre import centre, reach

# A length this short is rounding, whatever the unit: of arms some metres long, or some thousand millimetres.
SMALL = 1e-12


def root_at(point: Array, length: float) -> Array:
    """(6, 6) root of diag(L^2 I, I) carried to `point` (3,): |root s|^2 = L^2 |omega|^2 + |v + omega x p|^2."""
    x, y, z = point.tolist()
    root = np.zeros((6, 6))
    root[0, 0] = root[1, 1] = root[2, 2] = length
    root[3, 3] = root[4, 4] = root[5, 5] = 1.0
    root[3, 1], root[3, 2] = z, -y
    root[4, 0], root[4, 2] = -z, x
    root[5, 0], root[5, 1] = y, -x
    return root


def own_point(J: Array, s: Array | None = None) -> Array:
    """(3,) the arm's own point: the one that its joints move least, for those who name none."""
    return centre(J, s).point


def length_at(J: Array, point: Array) -> float:
    """L: the arm's reach to the point; where no axis is away from it, |v at the point| per |omega|; else one unit."""
    far = reach(J, point)
    if far > 0.0:
        return far
    turning, sliding = np.linalg.norm(J[:3]), np.linalg.norm(se3.velocity_at(J, point))
    return float(sliding / turning) if turning > 0.0 and sliding > SMALL * turning else 1.0
