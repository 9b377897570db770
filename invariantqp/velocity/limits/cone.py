"""The QP inside a speed limit |start + J z| <= limit, by the limit's one multiplier.

    minimise 1/2 |K (z - z*)|^2 + 1/2 nu |start + J z|^2   inside the other limits, nu >= 0 that makes the speed the limit

Given which of the other limits are active, the velocity on their face is v(nu) = (I + nu G)^-1 v(0), G = J H^-1 J'
three by three, and nu a root of one scalar equation; the QP with that nu says whether those limits are the active ones.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

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
# Sets of active limits tried before the multiplier is bisected, and bisections.
MOST_FACES = 8
MOST_BISECTIONS = 60
# Newton's steps for the multiplier on one face: |v(nu)|^-1 is nearly linear in nu, a few reach rounding.
NEWTON_STEPS = 20
# A multiplier that shrinks the easiest direction this many times: the limit is out of reach on the face.
BEYOND = 1e100


class Cone(NamedTuple):
    """|start + J x| <= limit.

    Attributes:
        J: (3, m).
        limit: [length/s].
        start: (3,).
        program: the solver that takes the cone as it is; None for the multiplier.
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
        # Where the rows fix the point's velocity, rounding must not pass for a way to change it.
        J[np.abs(J) <= FIXED_TOLERANCE * np.abs(self.J).max() * np.abs(basis).max(initial=0.0)] = 0.0
        return self._replace(start=self.velocity(origin), J=J)


def minimise_in_cone(
    backend: Backend, problem: Quadratic, limits: Polytope, cone: Cone | None, inside: Array | None = None
) -> Optimum:
    """The optimum inside limits and cone, both on z; `inside` (n,) is a z inside both, where one is known.

    Raises:
        SolverFailure: as `minimise`; `.infeasible` where exact rows alone are too fast.
    """
    first = minimise(backend, problem, limits, inside)
    if cone is None or cone.nearly_allows(first.z):
        return first
    if not cone.J.any():
        raise SolverFailure("the exact rows", "their only velocity is too fast for the tool", infeasible=True)
    if cone.program is not None:
        try:
            return _programmed(cone.program, problem, limits, cone)
        except SolverFailure as failure:
            if failure.infeasible:
                raise
            return _by_multiplier(backend, problem, limits, cone, first, inside)._replace(trouble=str(failure))
    return _by_multiplier(backend, problem, limits, cone, first, inside)


def _by_multiplier(
    backend: Backend, problem: Quadratic, limits: Polytope, cone: Cone, found: Optimum, inside: Array | None
) -> Optimum:
    low, high = 0.0, inf
    for attempt in range(MOST_FACES + MOST_BISECTIONS):
        nu = _on_face(problem, limits, cone, found) if attempt < MOST_FACES else inf
        if not low < nu < high:
            nu = 0.5 * (low + high) if high < inf else max(2.0 * low, _unit(problem, cone))
        root = sqrt(nu)
        found = minimise(backend, problem.plus(root * cone.J, -root * cone.start), limits, inside)
        speed = cone.speed(found.z)
        if abs(speed - cone.limit) <= CONE_TOLERANCE * cone.limit:
            break
        low, high = (nu, high) if speed > cone.limit else (low, nu)
    return found


def _unit(problem: Quadratic, cone: Cone) -> float:
    """A multiplier at which the cone's term weighs as much as the rest."""
    return float(np.vdot(problem.K, problem.K) / np.vdot(cone.J, cone.J))


def _on_face(problem: Quadratic, limits: Polytope, cone: Cone, found: Optimum) -> float:
    """The multiplier at which the point has the limit's speed while the limits active now stay so."""
    K, centre = problem
    free = face(limits, found.multipliers, len(centre))
    if not free.shape[1]:
        return inf
    R = np.linalg.qr(K.dot(free), mode="r")
    try:
        reached = np.linalg.solve(R.T, cone.J.dot(free).T)  # G = reached'reached
    except np.linalg.LinAlgError:
        return inf
    # Where the face's optimum without the cone is, from any point of it: the gradient there says.
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
        ahead = square / slope * (sqrt(square / wanted) - 1.0)
        nu += ahead
        if nu * float(gains[-1]) > BEYOND:
            return inf
        if ahead <= np.finfo(float).eps * nu:
            break
    return nu


def _programmed(program: Cvxpy, problem: Quadratic, limits: Polytope, cone: Cone) -> Optimum:
    """The cone as it is, by CVXPY."""
    K, centre = problem
    value = limits.value(centre)
    A = limits.A
    start = cone.velocity(centre)
    qp, _, size = scaled(K, A, limits.lower - value, limits.upper - value)
    d = size * program.solve_in_cone(qp, cone.J * (size / cone.limit), start / cone.limit)
    pull = -K.dot(d).dot(K)
    multipliers = np.where(limits.at(centre + d), pull, 0.0) if A is None else np.zeros(len(value))
    return Optimum(centre + d, multipliers, program.name)
