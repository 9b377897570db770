"""Limits that contradict each other: what has to give way, by the least.

rows against the box        least sum of squares of t with lower <= C x - t <= upper, x in the box
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

# What a joint velocity costs beside a violation of the same size, squared: only to make the problem strictly convex.
# Rows that need a motion v then give way by this share of v more than they have to; where a second pass starts from the
# first one's velocity, by the square of it.
REGULARISATION = 1e-8
# Rows that would have to give way by less than this, relative to their size, need not.
VIOLATION_TOLERANCE = 1e-9
# Likewise by less than this share of what they do over the box: an arm nearly at rest has rows of no size but rounding.
ROUNDING = 1e-12
# Limits that gave way are let go by this share of the violation more, for a solver to find an inside.
WIDENING = 1e-7
# Likewise of the tool's least speed.
FASTER = 1e-4


class Relaxed(NamedTuple):
    """Rows moved out of the box's way.

    Attributes:
        rows: with the limits where they have to be.
        violation: (k,) by how much, positive above and negative below.
        held_by: joints whose bounds ask for it, and the rows that gave way (indices of the polytope on x).
        inside: (m,) a velocity inside the box and the moved rows.
    """

    rows: LimitRows
    violation: Array
    held_by: list[int]
    inside: Array


def relaxed(rows: LimitRows, lower: Array, upper: Array) -> Relaxed:
    """The rows, given way by the least sum of squares that leaves a velocity in the box.

    Raises:
        SolverFailure: nobody found one.
    """
    C = np.asarray(rows.C)
    k, m = C.shape
    size = float(np.abs(C).max()) or 1.0
    K = np.diag(np.concatenate((np.full(m, np.sqrt(REGULARISATION) * size), np.ones(k))))
    free = np.full(k, np.inf)
    apart = LimitRows(np.hstack((C, -np.eye(k))), rows.lower, rows.upper)
    limits = apart.with_box(np.concatenate((lower, -free)), np.concatenate((upper, free)))
    start = np.minimum(np.maximum(np.zeros(m), lower), upper)
    apart_by = np.minimum(np.maximum(C.dot(start), rows.lower), rows.upper) - C.dot(start)
    z, centre = np.concatenate((start, -apart_by)), np.zeros(m + k)
    for _ in range(2):
        found = minimise(Daqp(), Quadratic(K, centre), limits, z)
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
    """The cone, its speed raised where it has to be, and a velocity (m,) inside it and the other limits."""

    cone: Cone
    inside: Array


def slowed(cone: Cone, limits: Polytope, inside: Array) -> Slowed:
    """The cone, its speed raised to the least that the other limits leave, where that is above its own.

    Raises:
        SolverFailure: nobody found it.
    """
    m = cone.J.shape[1]
    size = float(np.abs(cone.J).max()) or 1.0
    still = Quadratic(np.sqrt(REGULARISATION) * size * np.eye(m), np.zeros(m)).plus(cone.J, -cone.start)
    slowest = minimise(Daqp(), still, limits, inside).z
    least = cone.speed(slowest)
    return Slowed(cone if least <= cone.limit else cone._replace(limit=least * (1.0 + FASTER)), slowest)
