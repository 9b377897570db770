"""How much of the exact rows' speed the limits allow: the rows keep their direction and slow down.

    minimise 1/2 (1 - a)^2 |y0|^2 + 1/2 nu |y|^2   over a in [0, 1] and z,   y = a y0 + B z inside the limits
    nu = EXACT_CALM / 2 dt (1 - a_max) |y0| effort

a_max is the largest share, the solution with nu nearly 0. Where it is below one, the problem is solved again with
nu > 0, which grows with the unmet part of the rows and with the joint motion that the rows need (`Reduction.effort`).
This damps the loop as `calm` does: joints do not move at full speed for a thousandth of the rows' speed. Both
problems have a solution where standing still is inside the limits. Where it is not, y0 and y count from the velocity
that moves the rows least. Both are strictly convex, so the share is continuous in limits and demand.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.exact import Reduction
from invariantqp.velocity.qp.backends import Backend
from invariantqp.velocity.qp.quadratic import ACTIVE_TOLERANCE, Cone, Optimum, Polytope, Quadratic, minimise

# The least nu: it makes the problem strictly convex, and the share smaller by this much, relative.
REGULARISATION = 1e-9
# Measured with 160 random targets on four arms: none oscillates from 0.5 on, some do at 0.15; at 2 some loops that
# arrive with 1 no longer do within eight seconds.
EXACT_CALM = 1.0
# A share above this counts as 1.
WHOLE = 1.0 - 1e-8
# Where limits bind, the share is reduced by this part of 1 - share, so that the next problem has an interior.
INTERIOR = 1e-6


class Share(NamedTuple):
    """The part of the exact rows' speed that the limits allow."""

    value: float  # a in [0, 1]
    velocity: Array  # (m,) a y with that share
    held_by: list[int]  # limits (indices of the polytope) that keep it from being larger
    fast: bool = False  # whether a tool speed limit does


def share_of(
    reduction: Reduction, limits: Polytope, cone: Cone | None, inside: Array, dt: float, backend: Backend
) -> Share:
    """The share of the rows' speed inside the limits on y, calmed for ticks of dt [s].

    Args:
        reduction: what the rows leave.
        limits: on y.
        cone: likewise, or None.
        inside: (m,) a y inside both that moves the rows by `reduction.start`.
        dt: tick [s].
        backend: the solver asked first.

    Raises:
        SolverFailure: no answer was found.
    """
    start = reduction.start
    d = reduction.full - start
    length = sqrt(float(d.dot(d)))
    if length == 0.0:
        return Share(1.0, inside, [])
    m, n = reduction.basis.shape[0], reduction.basis.shape[1] + 1
    basis = np.empty((m, n))
    basis[:, 0], basis[:, 1:] = d / length, reduction.basis
    room = limits.on(start, basis)
    count = len(room.lower)
    if inside.any():  # else part of the way from standing still costs less than a share outside [0, 1]
        whole = np.append(room.lower, 0.0), np.append(room.upper, length)
        room = Polytope(np.vstack((room.rows, np.eye(1, n))), *whole)
    slow = None if cone is None else cone.on(start, basis)

    first = (inside - start).dot(basis)

    def best(nu: float) -> Optimum:
        weight = REGULARISATION + nu
        root, centre = np.full(n, sqrt(weight)), np.zeros(n)
        root[0], centre[0] = sqrt(1.0 + weight), length / (1.0 + weight)
        return minimise(backend, Quadratic.diagonal(root, centre), room, slow, first)

    found = best(0.0)
    possible = min(max(found.z[0] / length, 0.0), 1.0)
    nu = 0.5 * EXACT_CALM * dt * (1.0 - possible) * length * reduction.effort
    if nu > REGULARISATION:
        found = best(nu)
    value = min(max(found.z[0] / length, 0.0), 1.0)
    velocity = start + basis.dot(found.z)
    if value >= WHOLE:
        return Share(1.0, velocity, [])
    multipliers = found.multipliers[:count]
    fast = slow is not None and slow.speed(found.z) >= slow.limit * (1.0 - ACTIVE_TOLERANCE)
    given = 1.0 - INTERIOR * (1.0 - value)
    held_by = multipliers.nonzero()[0].tolist()
    return Share(value * given, inside + given * (velocity - inside), held_by, fast)
