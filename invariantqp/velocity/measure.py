"""The measure: the size of a twist, by a definite metric W at a physical point.

    s'Ws = L^2 |omega|^2 + |v_p|^2,   v_p = v + omega x p,   root = [[L I, 0], [-[p]x, I]],   W = root'root

p is a physical point, usually of the tool, and L a length, by default the arm's reach. s'Ws does not depend on the
frame of J, s and p, and scales with the unit of length. It decides what is missed of a twist that the joints cannot
achieve, near singularities and at limits. A `CarriedMetric` has a root of its own.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.se3 import cross_matrix, velocity_at
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.systems.points import centre, reach


def root_at(point: Array, length: float) -> Array:
    """(6, 6) root of diag(L^2 I, I) carried to `point` (3,): |root s|^2 = L^2 |omega|^2 + |v + omega x p|^2."""
    root = np.diag(np.repeat((length, 1.0), 3))
    root[3:, :3] = cross_matrix(-point)
    return root


def own_point(J: Array, s: Array | None = None) -> Array:
    """(3,) the arm's own point, which its joints move least."""
    return centre(J, s).point


def length_at(J: Array, point: Array, s: Array | None = None) -> float:
    """L: the arm's reach to the point; where all axes meet it, |v_p| / |omega| of turning joints or the twist.

    One unit of length where these are zero, too; the unit then changes no solution. Lengths of joints within rounding
    of the twist's count as zero.

    Args:
        J: (6, m) joint twists, the joint at the base first.
        point: (3,).
        s: (6,) the desired twist, or None.
    """
    of_twist = 0.0 if s is None else ratio(s, point)
    far = reach(J, point)
    if far <= ROUNDING * of_twist:
        turning = (J[:3] * J[:3]).sum(axis=0) * LENGTH_LIMIT**2 > (J[3:] * J[3:]).sum(axis=0)  # slides define no length
        far = ratio(J[:, turning], point)
    return far if far > ROUNDING * of_twist else of_twist or 1.0


def ratio(twists: Array, point: Array) -> float:
    """|v_p| / |omega| of one twist or several; 0 where either is zero, to rounding."""
    rate, speed = float(np.linalg.norm(twists[:3])), float(np.linalg.norm(velocity_at(twists, point)))
    moment = max(float(np.linalg.norm(twists[3:])), rate * float(np.linalg.norm(point)))
    if speed <= ROUNDING * moment or rate * LENGTH_LIMIT <= speed:
        return 0.0
    return speed / rate
