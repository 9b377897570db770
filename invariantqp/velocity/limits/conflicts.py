"""Limits that contradict each other: which of them give way, by the least amount.

rows against the box        first minimise |t|^2 with lower <= N y - t <= upper, x = T y in the box; then |y|^2
tool speed against both     the least speed of the point that they leave

N are the rows on y, in which the joint metric is the identity, at length one: neither the scale of a row nor a unit
decides which of them gives way. Rows that some velocity in the box satisfies never do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits.rows import LimitRows
from invariantqp.velocity.qp.backends import Daqp, SolverFailure
from invariantqp.velocity.qp.quadratic import Cone, Optimum, Polytope, Quadratic, minimise

# Weight of |y|^2 beside |t|^2, only to make the problem strictly convex. Rows that need a motion v then give way by
# this share of v more than necessary; the second pass, centred at the first one's velocity, by the square of that.
REGULARISATION = 1e-8
# A violation below this share of the velocity is rounding, and what a joint's bound adds to it below this share of it.
VIOLATION_TOLERANCE = 1e-9
# Limits that gave way are widened by this share of the violation more, so that the next problem has an interior.
WIDENING = 1e-7
# Likewise for the tool's least speed.
FASTER = 1e-4


class Relaxed(NamedTuple):
    """Rows after giving way to the box."""

    rows: LimitRows  # with the limits moved
    violation: Array  # (k,) by how much, positive above and negative below
    held_by: list[int]  # joints whose bounds require it, and the rows that gave way (indices of the polytope on x)
    inside: Array  # (m,) the least velocity inside the box and the moved rows


def relaxed(rows: LimitRows, lower: Array, upper: Array, to_joint: Array | None) -> Relaxed:
    """The rows, moved by the least sum of squares for which the box contains a velocity.

    Args:
        rows: on x.
        lower: (m,) of the box.
        upper: (m,).
        to_joint: (m, m) T, x = T y, that makes the joint metric the identity; None is the identity.

    Raises:
        SolverFailure: none was found.
    """
    C = np.asarray(rows.C)
    k, m = C.shape
    T = np.eye(m) if to_joint is None else to_joint
    try:
        return Relaxed(rows, np.zeros(k), [], _least(rows, lower, upper, T))
    except SolverFailure:  # there is none; if it is the solver, the next problem fails too
        pass
    lengths = np.linalg.norm(C.dot(T), axis=1)
    lengths[lengths == 0.0] = 1.0
    found = _least_violation(
        LimitRows(C / lengths[:, None], rows.lower / lengths, rows.upper / lengths), lower, upper, T
    )
    t = found.z[m:]
    told = np.abs(t) > VIOLATION_TOLERANCE * np.linalg.norm(found.z)
    t = np.where(told | ~told.any(), t, 0.0)
    wider = lengths * (t + np.sign(t) * WIDENING * np.abs(t).max())
    moved = LimitRows(C, rows.lower + np.minimum(wider, 0.0), rows.upper + np.maximum(wider, 0.0))
    violation = np.where(told, lengths * t, 0.0)
    pulls = np.abs(found.multipliers[:m]) * np.linalg.norm(T, axis=1) > VIOLATION_TOLERANCE * np.abs(t).max()
    held_by = np.append(pulls, told).nonzero()[0].tolist() if told.any() else []
    return Relaxed(moved, violation, held_by, _least(moved, lower, upper, T))


def _least(rows: LimitRows, lower: Array, upper: Array, T: Array) -> Array:
    """(m,) the least velocity inside box and rows."""
    m = len(lower)
    limits = rows.with_box(lower, upper).on(np.zeros(m), T)
    y = minimise(Daqp(), Quadratic.diagonal(np.ones(m), np.zeros(m)), limits).z
    return np.asarray(np.clip(T.dot(y), lower, upper))


def _least_violation(rows: LimitRows, lower: Array, upper: Array, T: Array) -> Optimum:
    """z = (y, t) with the least |t|."""
    k, m = rows.C.shape
    apart = LimitRows(np.hstack((rows.C.dot(T), -np.eye(k))), rows.lower, rows.upper)
    box = Polytope(np.hstack((T, np.zeros((m, k)))), lower, upper)
    limits = Polytope(
        np.vstack((box.rows, apart.C)), np.append(box.lower, apart.lower), np.append(box.upper, apart.upper)
    )
    root = np.append(np.full(m, np.sqrt(REGULARISATION)), np.ones(k))
    first = minimise(Daqp(), Quadratic.diagonal(root, np.zeros(m + k)), limits)
    return minimise(Daqp(), Quadratic.diagonal(root, np.append(first.z[:m], np.zeros(k))), limits)


class Slowed(NamedTuple):
    """The cone, its limit raised where necessary, and a velocity (m,) inside it and the other limits."""

    cone: Cone
    inside: Array


def slowed(cone: Cone, limits: Polytope) -> Slowed:
    """The cone, its limit raised to the least speed inside the other limits, where that is above its own.

    Raises:
        SolverFailure: that was not found.
    """
    m = cone.J.shape[1]
    weight = np.full(m, np.sqrt(REGULARISATION) * (float(np.linalg.norm(cone.J)) or 1.0))
    still = Quadratic.diagonal(weight, np.zeros(m)).plus(cone.J, -cone.start)
    slowest = minimise(Daqp(), still, limits).z
    least = cone.speed(slowest)
    return Slowed(cone if least <= cone.limit else cone._replace(limit=least * (1.0 + FASTER)), slowest)
