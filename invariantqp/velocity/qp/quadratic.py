"""A convex quadratic inside limits: the active set is a solver's, the numbers are computed from the root.

    minimise 1/2 |K (z - z*)|^2   over   lower <= A z <= upper

Solvers work on the Hessian K'K and stop at tolerances of their own; K has the square root of its condition. So the
solver is only used for the active set. The optimum on that is computed by orthogonal factors of K and checked: it must
be inside the other limits, with multipliers of the right sign. A limit that fails the check joins or leaves the set. So
the answer depends on solver and frame only by rounding times the condition number of K.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.active import WRONG_SIGN, Sides, factored, least, on_active
from invariantqp.velocity.qp.backends import Backend, SolverFailure, solved
from invariantqp.velocity.qp.polytope import Polytope
from invariantqp.velocity.qp.primal import from_inside
from invariantqp.velocity.qp.scaling import BoxQP, scaled

# A limit this close to the solver's answer, on the scaled problem, is taken to be active until the check.
CLOSE = 1e-7
# How far an answer may be outside a limit, relative to the limit; it is clipped.
FEASIBLE = 1e-9
# Corrections of the active set of a similar problem that are tried before a solver is called.
CORRECTIONS = 3


class Quadratic(NamedTuple):
    """1/2 |K (z - centre)|^2, K (k, n) of full column rank, centre (n,)."""

    K: Array
    centre: Array

    def plus(self, root: Array, wanted: Array) -> Quadratic:
        """The same with 1/2 |root z - wanted|^2 added."""
        K = np.vstack((self.K, root))
        return Quadratic(K, least(K, np.concatenate((self.K.dot(self.centre), wanted))))


def weighted(root: Array, wanted: Array) -> Quadratic:
    """1/2 |root z - wanted|^2, but for a constant."""
    return Quadratic(root, least(root, wanted))


class Optimum(NamedTuple):
    """The minimiser, its multipliers, and how it was found.

    Attributes:
        z: (n,).
        multipliers: (k,) y, zero where the limit is not active (`active` tells their sign).
        backend: the solver; "" where none was needed.
        trouble: what went wrong on the way, "" for nothing.
        nu: multiplier of the speed limit, where there is one; 0 where it is not active.
    """

    z: Array
    multipliers: Array
    backend: str = ""
    trouble: str = ""
    nu: float = 0.0


def minimise(
    backend: Backend,
    problem: Quadratic,
    limits: Polytope,
    inside: Array | None = None,
    near: Optimum | None = None,
) -> Optimum:
    """The optimum inside the limits.

    Args:
        backend: the solver asked first; DAQP stands in for it.
        problem: what is minimised.
        limits: on z; infinite where there is none.
        inside: (n,) a z inside the limits, where one is known: then there always is an answer.
        near: the optimum of a similar problem with the same limits: no solver is called where its active set passes
            the check here.

    Raises:
        SolverFailure: no answer was found; `.infeasible` when a solver says that there is none.
    """
    K, centre = problem
    value = limits.value(centre)
    lower, upper = limits.lower - value, limits.upper - value
    if (lower <= 0.0).all() and (upper >= 0.0).all():
        return Optimum(centre, np.zeros(len(value)))
    if not len(centre):
        _check_constant(lower, upper, np.abs(limits.lower) + np.abs(limits.upper))
        return Optimum(centre, np.zeros(len(value)))
    if near is not None and near.multipliers.any():
        side = np.sign(near.multipliers).astype(np.intp)
        answer = _checked(K, limits.A, lower, upper, side, CORRECTIONS)
        if answer is not None:
            return Optimum(centre + answer[0], answer[1], near.backend)
    qp, rows, size = scaled(K, limits.A, lower, upper)
    if len(rows) < len(value):
        still = np.ones(len(value), dtype=bool)
        still[rows] = False
        _check_constant(lower[still], upper[still], size)
    A = None if limits.A is None else limits.A[rows]
    lower, upper = lower[rows], upper[rows]
    multipliers = np.zeros(len(value))
    try:
        found = solved(backend, qp)
    except SolverFailure as failure:
        if inside is None:
            raise
        d, multipliers[rows] = from_inside(K, A, lower, upper, inside - centre)
        trouble = "" if failure.infeasible else str(failure)
        return Optimum(centre + d, multipliers, "active set", trouble)
    answer = _checked(K, A, lower, upper, _sides(qp, found.z), len(rows))
    if answer is None and inside is not None:
        answer = from_inside(K, A, lower, upper, inside - centre)
    if answer is None:
        return Optimum(centre + size * found.z, multipliers, found.backend, found.trouble)
    d, multipliers[rows] = answer
    return Optimum(centre + d, multipliers, found.backend, found.trouble)


def face(limits: Polytope, multipliers: Array, n: int) -> Array:
    """(n, f) orthonormal directions along which all limits with a multiplier stay active."""
    at = np.flatnonzero(multipliers)
    if limits.A is None:
        return np.delete(np.eye(n), at, axis=1)
    if not len(at):
        return np.eye(n)
    directions: Array = factored(limits.A[at].T)[0][:, len(at) :]
    return directions


def _check_constant(lower: Array, upper: Array, size: Array | float) -> None:
    """Check rows that do not depend on z."""
    if (np.maximum(lower, -upper) > FEASIBLE * (1.0 + size)).any():
        raise SolverFailure("the exact rows", "their only velocity is outside the limits", infeasible=True)


def _sides(qp: BoxQP, z: Array) -> Sides:
    """(k,) 1 at an upper limit, -1 at a lower one, 0 away from both, of the scaled problem."""
    value = z if qp.C is None else qp.C.dot(z)
    return np.where(value >= qp.upper - CLOSE, 1, np.where(value <= qp.lower + CLOSE, -1, 0))


def _checked(
    K: Array, A: Array | None, lower: Array, upper: Array, side: Sides, tries: int
) -> tuple[Array, Array] | None:
    """The optimum d and its multipliers, after correcting the active set where necessary; None where that fails."""
    edge = FEASIBLE * (1.0 + np.minimum(np.abs(lower), np.abs(upper)))
    for _ in range(tries):
        try:
            d, y = on_active(K, A, lower, upper, side)
        except np.linalg.LinAlgError:
            return None
        value = d if A is None else A.dot(d)
        outside = np.where(side == 0, np.maximum(value - upper, lower - value) - edge, -1.0)
        worst = int(outside.argmax())
        if outside[worst] > 0.0:
            side[worst] = 1 if value[worst] > upper[worst] else -1
            continue
        pull = y * side
        weakest = int(pull.argmin())
        if pull[weakest] >= -WRONG_SIGN * np.abs(y).max():
            return d, y
        side[weakest] = 0
    return None
