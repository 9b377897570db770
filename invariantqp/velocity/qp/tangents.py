"""The QP inside a speed cone by tangent planes: solve, cut off where the answer points to, solve again.

    add  n.v(z) <= limit,  n = v / |v|,   and to the objective   price / (2 limit) |v - n (n.v)|^2

The planes touch the cone, so nothing inside is lost. A plane alone lets the answer slide along it, and what is left
outside halves from one to the next; what the plane costs times the cone's curvature is what sliding costs, and with it
the steps are Newton's, three or four to rounding. Where they do not settle, planes alone are heaped up instead.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits.rows import Polytope
from invariantqp.velocity.limits.toolspeed import CONE_TOLERANCE, Cone
from invariantqp.velocity.qp.backends import Backend, Solved, SolverFailure, minimise
from invariantqp.velocity.qp.prices import prices

# Newton steps before planes are heaped up.
MOST_STEPS = 12
# A direction that turns by less than this between two steps has settled: what is left is its square.
TURN_TOLERANCE = 1e-8
# Planes heaped up in a tick; what is left over then is shortened away.
MOST_PLANES = 40


class Cut(NamedTuple):
    """The optimum, and the polytope with the planes it was found in."""

    solved: Solved
    limits: Polytope


def with_plane(limits: Polytope, cone: Cone, z: Array) -> Polytope:
    """The polytope cut by the tangent plane where z points to."""
    row, most = cone.tangent(z)
    A = np.eye(len(z)) if limits.A is None else limits.A
    return Polytope(np.vstack((A, row)), np.append(limits.lower, -np.inf), np.append(limits.upper, most))


def minimise_in_cone(backend: Backend, H: Array, c: Array, limits: Polytope, cone: Cone) -> Cut:
    """Minimise 1/2 z'Hz - c'z inside limits and cone, both on z.

    Raises:
        SolverFailure: as `minimise`.
    """
    solved = minimise(backend, H, c, limits)
    if cone.speed(solved.z) <= cone.limit * (1.0 + CONE_TOLERANCE):
        return Cut(solved, limits)
    if not len(c):
        raise SolverFailure("the exact rows", "their only velocity is too fast for the tool", infeasible=True)
    return _settled(backend, H, c, limits, cone, solved.z) or _heaped(backend, H, c, limits, cone, solved)


def _settled(backend: Backend, H: Array, c: Array, limits: Polytope, cone: Cone, z: Array) -> Cut | None:
    """One plane, turned by Newton's steps until it touches the cone at the optimum; None where it does not settle."""
    price = 0.0
    n = _direction(cone, z)
    for _ in range(MOST_STEPS):
        plane = with_plane(limits, cone, z)
        sideways = cone.J - np.outer(n, n.dot(cone.J))
        bend = price / cone.limit
        bent = H + bend * sideways.T.dot(sideways)
        pull = c - bend * sideways.T.dot(cone.start)
        solved = minimise(backend, bent, pull, plane)
        z = solved.z
        price = float(prices(bent, pull, z, plane)[-1])
        before, n = n, _direction(cone, z)
        turn = n - before
        if price > 0.0 and turn.dot(turn) <= TURN_TOLERANCE**2:
            return Cut(solved, plane)
    return None


def _heaped(backend: Backend, H: Array, c: Array, limits: Polytope, cone: Cone, solved: Solved) -> Cut:
    """Planes alone, each where the last answer pointed to."""
    for _ in range(MOST_PLANES):
        if cone.speed(solved.z) <= cone.limit * (1.0 + CONE_TOLERANCE):
            break
        limits = with_plane(limits, cone, solved.z)
        solved = minimise(backend, H, c, limits)
    return Cut(solved, limits)


def _direction(cone: Cone, z: Array) -> Array:
    """(3,) unit vector along the point's velocity; zero where it stands still."""
    v = cone.velocity(z)
    speed = float(np.sqrt(v.dot(v)))
    return v / speed if speed > 0.0 else v
