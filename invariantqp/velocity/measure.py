"""The measure: the size of a twist, by a definite metric W at a physical point.

    s'Ws = L^2 |omega|^2 + |v_p|^2,   v_p = v + omega x p,   root = [[L I, 0], [-[p]x, I]],   W = root'root

p is a physical point, usually of the tool, and L a length, by default the arm's reach. s'Ws is the same in every frame
that J, s and p are expressed in, and another unit of length only converts it. It decides what is given up where the
joints cannot do the whole twist, near singularities and at limits.

A body may carry another metric (`CarriedMetric`): its root replaces this one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.points import WELL_POSED, centre, reach


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
    """(3,) the arm's own point, which its joints move least: the default where no point is named."""
    return centre(J, s).point


def length_at(J: Array, point: Array, s: Array | None = None) -> float:
    """L: the arm's reach to the point; where no axis is away from it, |v_p| / |omega| of turning joints or the twist.

    Where those vanish too, it is one unit of length; the unit then changes no answer. Beside the twist's, a length of
    joints that rounding makes is none.

    Args:
        J: (6, m) joint twists, the joint at the base first.
        point: (3,).
        s: (6,) the twist wanted, or None.
    """
    asked = 0.0 if s is None else ratio(s, point)
    far = reach(J, point)
    if far <= ROUNDING * asked:
        turning = (J[:3] * J[:3]).sum(axis=0) * LENGTH_LIMIT**2 > (J[3:] * J[3:]).sum(axis=0)  # slides define no length
        far = ratio(J[:, turning], point)
    return far if far > ROUNDING * asked else asked or 1.0


def ratio(twists: Array, point: Array) -> float:
    """|v_p| / |omega| of one twist or several; 0.0 where either is zero, to rounding."""
    rate, speed = float(np.linalg.norm(twists[:3])), float(np.linalg.norm(velocity_at(twists, point)))
    moment = max(float(np.linalg.norm(twists[3:])), rate * float(np.linalg.norm(point)))
    if speed <= ROUNDING * moment or rate * LENGTH_LIMIT <= speed:
        return 0.0
    return speed / rate


def measures(J: Array, s: Array, point: Array | None, length: float | None) -> Array:
    """(N, 6, 6) roots of diag(L^2 I, I) at a point (3,) or (N, 3), or at each row's own point; L is its reach."""
    n = len(J)
    same = point is not None and length is not None and point.strides[0] == 0  # one point, as broadcast to all rows
    p = _own_points(J, s) if point is None else np.broadcast_to(point, (n, 3))[: 1 if same else n]
    L = _reaches(J, s, p) if length is None else np.full(len(p), length)
    roots = np.zeros((len(p), 6, 6))
    for i in range(3):
        roots[:, i, i], roots[:, i + 3, i + 3] = L, 1.0
        j, k = (i + 1) % 3, (i + 2) % 3
        roots[:, j + 3, k], roots[:, k + 3, j] = p[:, i], -p[:, i]
    return np.broadcast_to(roots, (n, 6, 6))


def _own_points(J: Array, s: Array) -> Array:
    """`own_point` for all rows."""
    w, v = J[:, :3], J[:, 3:]
    b = np.cross(w, v, axis=1).sum(axis=2)
    spread = np.matmul(w, w.transpose(0, 2, 1))
    trace = np.trace(spread, axis1=1, axis2=2)
    S = trace[:, None, None] * np.eye(3) - spread
    slow = (v * v).sum(axis=(1, 2)) <= trace * LENGTH_LIMIT**2
    certain: NDArray[np.bool_] = np.asarray(np.linalg.det(S) > WELL_POSED * (2.0 * trace) ** 3) & slow
    S[~certain] = np.eye(3)
    points: Array = np.linalg.solve(S, b[:, :, None])[:, :, 0]
    for i in np.flatnonzero(~certain).tolist():
        points[i] = own_point(J[i], s[i])
    return points


def _reaches(J: Array, s: Array, points: Array) -> Array:
    """`length_at` for all rows: the broken line from the point to its foot on each turning axis, the last one first."""
    n, _, m = J.shape
    here, length, size = points.copy(), np.zeros(n), np.sqrt((points * points).sum(axis=1))
    rate, far = (np.sqrt((part * part).sum(axis=1)) for part in (s[:, :3], s[:, 3:] + np.cross(s[:, :3], points)))
    size = np.maximum(size, np.where(rate * LENGTH_LIMIT > far, far / np.where(rate > 0.0, rate, 1.0), 0.0))
    for column in range(m - 1, -1, -1):
        turn, moment = J[:, :3, column], J[:, 3:, column]
        rate, far = np.sqrt((turn * turn).sum(axis=1)), np.sqrt((moment * moment).sum(axis=1))
        turns = rate * LENGTH_LIMIT > far
        rate = np.where(turns, rate, 1.0)[:, None]
        leg = np.where(turns[:, None], np.cross(turn, moment / rate + np.cross(turn / rate, here)) / rate, 0.0)
        here = here + leg
        length += np.sqrt((leg * leg).sum(axis=1))
        size = np.where(turns, np.maximum(size, far / rate[:, 0]), size)
    for i in np.flatnonzero(length <= ROUNDING * size).tolist():
        length[i] = length_at(J[i], points[i], s[i])
    return length
