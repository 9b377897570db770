"""Limits that contradict each other: which of them give way, by the least amount.

rows against the box        minimise |t|^2 with lower <= C x - t <= upper, x in the box
tool speed against both     the least speed of the point that they leave
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits.cone import Cone
from invariantqp.velocity.limits.rows import LimitRows
from invariantqp.velocity.qp.backends import Daqp
from invariantqp.velocity.qp.polytope import Polytope
from invariantqp.velocity.qp.quadratic import Quadratic, minimise

# Weight of |x|^2 beside |t|^2, only to make the problem strictly convex. Rows that need a motion v then give way by
# this share of v more than necessary; the second pass, centred at the first one's velocity, by the square of that.
REGULARISATION = 1e-8
# A violation below this, relative to the size of the row, is rounding.
VIOLATION_TOLERANCE = 1e-9
# Likewise relative to the range of the row over the box: near standing still C x itself is only rounding.
ROUNDING = 1e-12
# Limits that gave way are widened by this share of the violation more, so that the next problem has an interior.
WIDENING = 1e-7
# Likewise for the tool's least speed.
FASTER = 1e-4


class Relaxed(NamedTuple):
    """Rows after giving way to the box."""

    rows: LimitRows  # with the limits moved
    violation: Array  # (k,) by how much, positive above and negative below
    held_by: list[int]  # joints whose bounds require it, and the rows that gave way (indices of the polytope on x)
    inside: Array  # (m,) a velocity inside the box and the moved rows


def relaxed(rows: LimitRows, lower: Array, upper: Array) -> Relaxed:
    """The rows, moved by the least sum of squares for which the box contains a velocity.

    Raises:
        SolverFailure: none was found.
    """
    C = np.asarray(rows.C)
    k, m = C.shape
    size = float(np.abs(C).max()) or 1.0
    root = np.concatenate((np.full(m, np.sqrt(REGULARISATION) * size), np.ones(k)))
    free = np.full(k, np.inf)
    apart = LimitRows(np.hstack((C, -np.eye(k))), rows.lower, rows.upper)
    limits = apart.with_box(np.concatenate((lower, -free)), np.concatenate((upper, free)))
    start = np.minimum(np.maximum(np.zeros(m), lower), upper)
    apart_by = np.minimum(np.maximum(C.dot(start), rows.lower), rows.upper) - C.dot(start)
    z, centre = np.concatenate((start, -apart_by)), np.zeros(m + k)
    for _ in range(2):
        found = minimise(Daqp(), Quadratic.diagonal(root, centre), limits, z)
        z, centre = found.z, np.concatenate((found.z[:m], np.zeros(k)))
    x = np.minimum(np.maximum(z[:m], lower), upper)
    violation = rows.excess(x)
    reach = np.abs(C).dot(np.abs(x)) + np.abs(violation)
    whole = np.abs(C).dot(np.where(np.isfinite(upper - lower), upper - lower, 0.0))
    violation[np.abs(violation) <= VIOLATION_TOLERANCE * reach + ROUNDING * whole] = 0.0
    more = WIDENING * float(np.abs(violation).max())
    low = np.asarray(rows.lower) + np.where(violation < 0.0, violation - more, 0.0)
    high = np.asarray(rows.upper) + np.where(violation > 0.0, violation + more, 0.0)
    holding = np.flatnonzero(found.multipliers[:m]) if violation.any() else np.empty(0, dtype=np.intp)
    held_by = [int(i) for i in holding] + [m + int(i) for i in np.flatnonzero(violation)]
    return Relaxed(LimitRows(C, low, high), violation, held_by, x)


class Slowed(NamedTuple):
    """The cone, its limit raised where necessary, and a velocity (m,) inside it and the other limits."""

    cone: Cone
    inside: Array


def slowed(cone: Cone, limits: Polytope, inside: Array) -> Slowed:
    """The cone, its limit raised to the least speed inside the other limits, where that is above its own.

    Raises:
        SolverFailure: that was not found.
    """
    m = cone.J.shape[1]
    size = float(np.abs(cone.J).max()) or 1.0
    still = Quadratic.diagonal(np.full(m, np.sqrt(REGULARISATION) * size), np.zeros(m)).plus(cone.J, -cone.start)
    slowest = minimise(Daqp(), still, limits, inside).z
    least = cone.speed(slowest)
    return Slowed(cone if least <= cone.limit else cone._replace(limit=least * (1.0 + FASTER)), slowest)
