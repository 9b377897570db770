"""The QP inside a speed limit |start + J z| <= limit, by the limit's one multiplier.

    minimise 1/2 |K (z - z*)|^2 + 1/2 nu |start + J z|^2   inside the other limits,
    nu >= 0 such that the speed is the limit

Given which of the other limits are active, the velocity on their face is v(nu) = (I + nu G)^-1 v(0), G = J H^-1 J'
three by three, and nu the root of one scalar equation; the QP with that nu confirms which limits are active.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.backends import Backend, SolverFailure
from invariantqp.velocity.qp.cones import Cvxpy
from invariantqp.velocity.qp.polytope import Polytope
from invariantqp.velocity.qp.quadratic import Optimum, Quadratic, face, minimise
from invariantqp.velocity.qp.scaling import scaled

# A speed this far above the limit, relative to it, is at it; the velocity is then shortened to it.
CONE_TOLERANCE = 1e-9
# Less than this of the point's velocity, relative, is rounding.
FIXED_TOLERANCE = 1e-13
# Multipliers tried, at most, and how often the range is bisected instead of solved for on the limits active now.
MOST_MULTIPLIERS = 150
BISECTED = 4
# Newton's steps for the multiplier on one face: |v(nu)|^-1 is nearly linear in nu, a few reach rounding.
NEWTON_STEPS = 20
# A multiplier with which the cone's term outweighs the rest by this factor is the largest tried.
MOST_SHARE = 1e8
# A multiplier that is too small is followed by one this many times as large.
GROWTH = 10.0


class Cone(NamedTuple):
    """|start + J x| <= limit.

    Attributes:
        J: (3, m).
        limit: [length/s].
        start: (3,).
        program: a solver for second-order cones; None to use the multiplier.
    """

    J: Array
    limit: float
    start: Array
    program: Cvxpy | None = None

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
    inside: Array | None = None,
    near: Optimum | None = None,
) -> Optimum:
    """The optimum inside limits and cone, both on z.

    Args:
        backend: the solver asked first.
        problem: what is minimised.
        limits: on z.
        cone: likewise, or None.
        inside: (n,) a z inside both, where one is known.
        near: the optimum of a problem like this one inside the same limits.

    Raises:
        SolverFailure: as `minimise`; `.infeasible` where exact rows alone are too fast.
    """
    nu = 0.0 if near is None or cone is None else near.nu
    found = _with_multiplier(backend, problem, limits, cone, nu, inside, near)
    if cone is None or (nu == 0.0 and cone.nearly_allows(found.z)):
        return found
    if not cone.J.any():
        raise SolverFailure("the exact rows", "their only velocity is too fast for the tool", infeasible=True)
    if cone.program is None:
        return _by_multiplier(backend, problem, limits, cone, found, inside)
    try:
        return _programmed(cone.program, problem, limits, cone)
    except SolverFailure as failure:
        if failure.infeasible:
            raise
        return _by_multiplier(backend, problem, limits, cone, found, inside)._replace(trouble=str(failure))


def _by_multiplier(
    backend: Backend, problem: Quadratic, limits: Polytope, cone: Cone, found: Optimum, inside: Array | None
) -> Optimum:
    low, high, unit = 0.0, inf, _unit(problem, cone)
    for attempt in range(1, MOST_MULTIPLIERS):
        speed = cone.speed(found.z)
        if abs(speed - cone.limit) <= CONE_TOLERANCE * cone.limit:
            return found
        low, high = (found.nu, high) if speed > cone.limit else (low, found.nu)
        nu = _on_face(problem, limits, cone, found, MOST_SHARE * unit)
        if nu == low == 0.0 and attempt == 1:
            found = minimise(backend, problem, limits, inside, found)
            if cone.nearly_allows(found.z):
                return found
            continue
        if attempt % BISECTED == 0 or not low < nu < high:
            nu = 0.5 * (low + high) if high < inf else max(GROWTH * low, unit)
        if nu > MOST_SHARE * unit:
            break
        found = _with_multiplier(backend, problem, limits, cone, nu, inside, found)
    return _slowed(cone, found, inside)


def _with_multiplier(
    backend: Backend,
    problem: Quadratic,
    limits: Polytope,
    cone: Cone | None,
    nu: float,
    inside: Array | None,
    near: Optimum | None,
) -> Optimum:
    """The optimum inside the limits where the cone is a cost."""
    if cone is None or nu == 0.0:
        return minimise(backend, problem, limits, inside, near)
    root = sqrt(nu)
    return minimise(backend, problem.plus(root * cone.J, -root * cone.start), limits, inside, near)._replace(nu=nu)


def _unit(problem: Quadratic, cone: Cone) -> float:
    """A multiplier at which the cone's term weighs as much as the rest."""
    return float(np.vdot(problem.K, problem.K) / np.vdot(cone.J, cone.J))


def _slowed(cone: Cone, found: Optimum, inside: Array | None) -> Optimum:
    """The velocity, moved towards one that is inside until the speed is the limit."""
    if inside is None or cone.nearly_allows(found.z):
        return found
    start, step = cone.velocity(found.z), cone.J.dot(inside - found.z)
    a, b, c = float(step.dot(step)), float(start.dot(step)), float(start.dot(start)) - cone.limit**2
    root = sqrt(max(0.0, b * b - a * c)) - b  # of a t^2 + 2 b t + c = 0, the smaller t
    share = min(max(c / root, 0.0), 1.0) if root > 0.0 else 1.0
    return found._replace(z=found.z + share * (inside - found.z))


def _on_face(problem: Quadratic, limits: Polytope, cone: Cone, found: Optimum, most: float) -> float:
    """The multiplier at which the point has the limit's speed while the limits active now stay so; inf beyond most."""
    K, centre = problem
    free = face(limits, found.multipliers, len(centre))
    if not free.shape[1]:
        return inf
    R: Array = np.triu(lapack.dgeqrf(K.dot(free))[0][: free.shape[1]])
    try:
        reached = np.linalg.solve(R.T, cone.J.dot(free).T)  # G = reached'reached
    except np.linalg.LinAlgError:
        return inf
    # The step from this point to the optimum on the face without the cone, from the gradient.
    gradient = K.dot(found.z - centre).dot(K).dot(free)
    step = reached.T.dot(np.linalg.solve(R.T, gradient))
    gains, axes = np.linalg.eigh(reached.T.dot(reached))
    along = (cone.velocity(found.z) - step).dot(axes)
    gains = np.maximum(gains, 0.0)
    squares, wanted = (along * along).tolist(), cone.limit * cone.limit
    nu = 0.0
    for _ in range(NEWTON_STEPS):
        shrunk = [(g, a / (1.0 + nu * g) ** 2) for g, a in zip(gains.tolist(), squares, strict=True)]
        square = sum(a for _, a in shrunk)
        slope = sum(a * g / (1.0 + nu * g) for g, a in shrunk)
        if slope <= 0.0 or square <= wanted:
            break
        # Newton on 1 / |v|: from below, it never overshoots.
        ahead = square / slope * (sqrt(square) / cone.limit - 1.0)  # the square of a tiny limit is zero
        nu += ahead
        if nu > most:
            return inf
        if ahead <= np.finfo(float).eps * nu:
            break
    return nu


def _programmed(program: Cvxpy, problem: Quadratic, limits: Polytope, cone: Cone) -> Optimum:
    """The problem with the second-order cone, by CVXPY."""
    K, centre = problem
    value = limits.value(centre)
    A = limits.A
    start = cone.velocity(centre)
    qp, _, size = scaled(K, A, limits.lower - value, limits.upper - value)
    d = size * program.solve_in_cone(qp, cone.J * (size / cone.limit), start / cone.limit)
    z = centre + d
    # K'K d + nu J'v + y = 0: nu from the joints at no other limit, then the multipliers y of the others.
    pull, normal = -K.dot(d).dot(K), cone.velocity(z).dot(cone.J)
    at = limits.at(z) if A is None else np.zeros(len(z), dtype=bool)
    square = float(normal[~at].dot(normal[~at]))
    nu = max(float(pull[~at].dot(normal[~at])) / square if square > 0.0 else 0.0, np.finfo(float).tiny)
    multipliers = np.where(at, pull - nu * normal, 0.0) if A is None else np.zeros(len(value))
    return Optimum(z, multipliers, program.name, nu=nu)
