"""The QP inside a speed limit |start + J z| <= limit, by the limit's one multiplier.

    minimise 1/2 |K (z - z*)|^2 + 1/2 nu |start + J z|^2   inside the other limits,
    nu >= 0 such that the speed is the limit

Given which of the other limits are active, nu is the root of one scalar equation (`slow`). The search for them begins
with none: a tool at its speed limit meets few others. Where it does not succeed, it begins with those active without
the speed limit and, where that fails too, goes by way of velocities inside all limits.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.backends import Backend, SolverFailure
from invariantqp.velocity.qp.cones import Cvxpy
from invariantqp.velocity.qp.polytope import Polytope
from invariantqp.velocity.qp.quadratic import Optimum, Quadratic, centred, corrected, minimise, primal, sides_of
from invariantqp.velocity.qp.scaling import scaled
from invariantqp.velocity.qp.slow import Slow

# A speed this far above the limit, relative to it, is at it; the velocity is then shortened to it.
CONE_TOLERANCE = 1e-9
# Less than this of the point's velocity, relative, is rounding.
FIXED_TOLERANCE = 1e-13
# Corrections of the active set, at most, for each limit.
CORRECTIONS = 3
# A multiplier with which the speed limit outweighs the rest by this factor is the largest tried.
MOST_SHARE = 1e8


class Cone(NamedTuple):
    """|start + J x| <= limit."""

    J: Array  # (3, m)
    limit: float  # [length/s]
    start: Array  # (3,)
    program: Cvxpy | None = None  # a solver for second-order cones; None to use the multiplier

    def velocity(self, x: Array) -> Array:
        """(3,) of the point [length/s]."""
        return np.asarray(self.start + self.J.dot(x), dtype=np.float64)

    def speed(self, x: Array) -> float:
        """|v_p| [length/s]."""
        v = self.velocity(x)
        return sqrt(float(v.dot(v)))

    def allows(self, x: Array) -> bool:
        """Whether the point is slow enough."""
        return self.speed(x) <= self.limit

    def nearly_allows(self, x: Array) -> bool:
        """Whether the point is slow enough but for rounding."""
        return self.speed(x) <= self.limit * (1.0 + CONE_TOLERANCE)

    def on(self, origin: Array, basis: Array) -> Cone:
        """The same cone on z, x = origin + basis z."""
        J = self.J.dot(basis)
        # Where exact rows fix the point's velocity, J is zero; rounding must not make it look otherwise.
        J[np.abs(J) <= FIXED_TOLERANCE * np.abs(self.J).max() * np.abs(basis).max(initial=0.0)] = 0.0
        return self._replace(start=self.velocity(origin), J=J)


def minimise_in_cone(
    backend: Backend,
    problem: Quadratic,
    limits: Polytope,
    cone: Cone | None,
    inside: Array,
    near: Optimum | None = None,
) -> Optimum:
    """The optimum inside limits and cone, both on z (n,), from one inside both; `near` is that of a like problem.

    Raises:
        SolverFailure: as `minimise`; `.infeasible` where exact rows alone are too fast.
    """
    if cone is None:
        return minimise(backend, problem, limits, inside, near)
    most = MOST_SHARE * _unit(problem, cone)
    slow = Slow(cone.J.dot(problem.T), cone.velocity(problem.centre), cone.limit, most)
    movable = bool(cone.J.any())
    if movable and (near is not None or cone.program is None):
        found = _similar(problem, limits, slow, near)
        if found is not None:
            return found
    found = minimise(backend, problem, limits, inside, near)
    if cone.nearly_allows(found.z):
        return found
    if not movable:
        raise SolverFailure("the exact rows", "their only velocity is too fast for the tool", infeasible=True)
    if cone.program is not None:
        try:
            return _programmed(cone.program, problem, limits, cone)
        except SolverFailure as failure:
            if failure.infeasible:
                raise
            found = found._replace(trouble=str(failure))
    answer = _similar(problem, limits, slow, found)
    if answer is None:
        answer = primal(problem, limits, centred(problem, limits), inside, slow)
        answer = answer._replace(backend=found.backend, trouble=found.trouble)
    return _slowed(cone, answer, inside)


def _similar(problem: Quadratic, limits: Polytope, slow: Slow, near: Optimum | None) -> Optimum | None:
    """The optimum with the active set of `near`, or an empty one, corrected; None where that does not succeed."""
    room = centred(problem, limits)
    count = len(room.lower)
    if near is None:
        return corrected(problem, limits, room, np.zeros(count, dtype=np.intp), CORRECTIONS * count, slow)
    return corrected(problem, limits, room, sides_of(near), CORRECTIONS * count, slow, near.backend, near.trouble)


def _unit(problem: Quadratic, cone: Cone) -> float:
    """A multiplier at which the speed weighs as much as the rest."""
    size = float(np.vdot(cone.J, cone.J))
    return float(np.vdot(problem.K, problem.K)) / size if size > 0.0 else 0.0


def _slowed(cone: Cone, found: Optimum, inside: Array) -> Optimum:
    """The velocity, moved towards one that is inside until the speed is the limit."""
    if cone.nearly_allows(found.z):
        return found
    start, step = cone.velocity(found.z), cone.J.dot(inside - found.z)
    a, b, c = float(step.dot(step)), float(start.dot(step)), float(start.dot(start)) - cone.limit**2
    root = sqrt(max(0.0, b * b - a * c)) - b  # of a t^2 + 2 b t + c = 0, the smaller t
    share = min(max(c / root, 0.0), 1.0) if root > 0.0 else 1.0
    return found._replace(z=found.z + share * (inside - found.z))


def _programmed(program: Cvxpy, problem: Quadratic, limits: Polytope, cone: Cone) -> Optimum:
    """The problem with the second-order cone, by CVXPY."""
    room, rows, A = centred(problem, limits), limits.moving.nonzero()[0], limits.A
    some = None if A is None else A[rows]
    qp, size = scaled(problem.K, some, limits.lengths[rows], room.lower[rows], room.upper[rows])
    start = cone.velocity(problem.centre)
    d = size * program.solve_in_cone(qp, cone.J * (size / cone.limit), start / cone.limit)
    z = problem.centre + d
    # K'K d + nu J'v + y = 0: nu from the joints at no other limit, then the multipliers y of the others.
    pull, normal = -problem.K.dot(d).dot(problem.K), cone.velocity(z).dot(cone.J)
    at = limits.at(z) if A is None else np.zeros(len(z), dtype=bool)
    square = float(normal[~at].dot(normal[~at]))
    nu = max(float(pull[~at].dot(normal[~at])) / square if square > 0.0 else 0.0, np.finfo(float).tiny)
    multipliers = np.where(at, pull - nu * normal, 0.0) if A is None else np.zeros(len(room.lower))
    return Optimum(z, multipliers, program.name, nu=nu)
