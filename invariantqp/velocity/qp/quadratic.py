"""A convex quadratic inside limits: a library says which limits are active, the numbers are computed on those.

    minimise 1/2 |e|^2   over   lower <= A z <= upper,   |v_p| <= limit,   z = z* + T e

T is the inverse of a root of the Hessian, so this is the point of a convex set nearest to e = 0: a least-distance
problem. Solvers are given the QP in units of its limits and stop at tolerances of their own, so one only says which
limits are near. Non-negative least squares decides which of these are active, and least squares gives the shortest e
on them; a limit that it exceeds is added. So the answer depends on solver, frame and unit only by rounding times the
condition of T.

    e + N'y = 0,  N = A T:     y > 0 at an upper limit, y < 0 at a lower one; loosening limit i by d gains |y_i| d

The speed limit of a point is kept by its one multiplier: 1/2 nu |v_p|^2 is added to the objective, nu >= 0 such that
the speed is the limit. The speed falls as nu grows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, nnls

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.backends import UNBOUNDED, Backend, BoxQP, Cvxpy, Daqp, SolverFailure, solved

# A limit this close, relative to its value (or 1), is at it.
ACTIVE_TOLERANCE = 1e-6
# A row and a column whose cosine is below this are orthogonal, and what there is is rounding; it fades in, so that the
# law has no jump. The optimum without limits may be outside one by this share of it.
COSINE_ROUNDING = 1e-13
TINY = np.finfo(float).tiny
# A limit this close to the solver's answer, on the scaled problem, is taken to be active until the check.
CLOSE = 1e-7
# A value outside its limit by less than this, relative to the velocities that it comes from, is at it; it is clipped.
ROUNDING = 1e-9
# What answers are called that no solver gave.
OWN = "least distance"
# A multiplier with which the speed limit outweighs the rest by this factor is the largest tried.
MOST_SHARE = 1e8


@dataclass(frozen=True, eq=False)
class Polytope:
    """lower <= A z <= upper; A = None is the identity."""

    A: Array | None  # (k, n) or None: the joints of the box first, then the rows; zero where no z moves a limit
    lower: Array  # (k,), -inf where there is none
    upper: Array  # (k,), inf where there is none
    rounding: Array | float = 0.0  # (k,) how far a value may be outside: rounding of what exact rows fix of it

    @cached_property
    def rows(self) -> Array:
        """(k, n) A as a matrix."""
        return np.eye(len(self.lower)) if self.A is None else self.A

    @cached_property
    def lengths(self) -> Array:
        """(k,) of the rows."""
        return np.asarray(np.linalg.norm(self.rows, axis=1))

    def margin(self, *velocities: Array) -> Array:
        """(k,) how far a value may be outside its limit: rounding, where it comes from some z (n,)."""
        speed = sum(float(np.linalg.norm(z)) for z in velocities)
        return np.asarray(self.rounding + ROUNDING * self.lengths * speed)

    def allows(self, z: Array) -> bool:
        """Whether z is inside but for rounding."""
        value, margin = self.rows.dot(z), self.margin(z)
        return bool(((value <= self.upper + margin) & (value >= self.lower - margin)).all())

    def admitting(self, z: Array) -> Polytope:
        """The same limits, widened so far that z is inside by rounding."""
        value, margin = self.rows.dot(z), self.margin(z)
        return replace(self, lower=np.minimum(self.lower, value - margin), upper=np.maximum(self.upper, value + margin))

    def about(self, z: Array) -> tuple[Array, Array]:
        """(lower, upper), each (k,), on A d for the z + d."""
        value = self.rows.dot(z)
        return self.lower - value, self.upper - value

    def on(self, origin: Array, basis: Array) -> Polytope:
        """The same limits on z, x = origin + basis z."""
        rounding = self.rounding + ROUNDING * self.lengths * np.linalg.norm(origin)
        return Polytope(_product(self.rows, basis), *self.about(origin), rounding)


class Cone(NamedTuple):
    """|start + J x| <= limit: the speed of a point."""

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
        return self.speed(x) <= self.limit * (1.0 + ROUNDING)

    def on(self, origin: Array, basis: Array) -> Cone:
        """The same cone on z, x = origin + basis z."""
        return self._replace(start=self.velocity(origin), J=_product(self.J, basis))


def _product(A: Array, B: Array) -> Array:
    """(k, n) A B, zero where it is only rounding."""
    rounding = COSINE_ROUNDING * np.outer(np.linalg.norm(A, axis=1), np.linalg.norm(B, axis=0)) + TINY
    C: Array = A.dot(B)
    return np.clip(np.abs(C) / rounding - 1.0, 0.0, 1.0) * C


class Quadratic(NamedTuple):
    """1/2 |e|^2 = 1/2 |K (z - centre)|^2 at z = centre + T e, K and T = K^-1 (n, n), centre (n,)."""

    K: Array
    T: Array
    centre: Array

    @classmethod
    def diagonal(cls, root: Array, centre: Array) -> Quadratic:
        """1/2 |e|^2 with K = diag(root), root (n,)."""
        same = np.eye(len(root))
        return cls(root * same, same / root, centre)

    def plus(self, root: Array, wanted: Array) -> Quadratic:
        """The same with 1/2 |root z - wanted|^2 added."""
        n = len(self.centre)
        U, sizes, Wt = np.linalg.svd(root.dot(self.T))
        size, pull = np.zeros(n), np.zeros(n)
        size[: len(sizes)] = sizes
        pull[: len(sizes)] = (wanted - root.dot(self.centre)).dot(U[:, : len(sizes)])
        more = np.sqrt(1.0 + size * size)
        T = self.T.dot(Wt.T) / more
        return Quadratic(more[:, None] * Wt.dot(self.K), T, self.centre + T.dot(size * pull / more))


def weighted(root: Array, wanted: Array) -> Quadratic:
    """1/2 |root z - wanted|^2 but for a constant, root (k, n) of full column rank."""
    U, sizes, Vt = np.linalg.svd(root, full_matrices=False)
    T = Vt.T / sizes
    return Quadratic(sizes[:, None] * Vt, T, T.dot(wanted.dot(U)))


class Optimum(NamedTuple):
    """The minimiser, its multipliers, and how it was found."""

    z: Array  # (n,)
    multipliers: Array  # (k,) y, zero where the limit is not active
    backend: str = ""  # the solver; "" where none was needed
    trouble: str = ""  # what went wrong on the way, "" for nothing
    nu: float = 0.0  # multiplier of the speed limit, where there is one; 0 where it is not active


def minimise(
    backend: Backend, problem: Quadratic, limits: Polytope, cone: Cone | None = None, inside: Array | None = None
) -> Optimum:
    """The optimum inside limits and cone.

    Args:
        backend: the solver asked first; DAQP stands in for it.
        problem: what is minimised.
        limits: on z; infinite where there is none.
        cone: likewise, or None.
        inside: (n,) a z inside both, but for rounding, where one is known: the answer where no other is found.

    Raises:
        SolverFailure: no answer was found; `.infeasible` when a solver says that there is none, or where exact rows
            alone are outside.
    """
    found = _in_polytope(backend, problem, limits, inside)
    if cone is None or cone.nearly_allows(found.z):
        return found
    if not cone.J.any():
        if inside is None:
            raise SolverFailure("the exact rows", "their only velocity is too fast for the tool", infeasible=True)
        return found
    trouble = ""
    if cone.program is not None:
        try:
            return _by_program(cone.program, problem, limits, cone)
        except SolverFailure as failure:
            trouble = str(failure)
    found = _in_cone(backend, problem, limits, cone, inside)
    return found._replace(trouble=trouble or found.trouble)


def _in_cone(backend: Backend, problem: Quadratic, limits: Polytope, cone: Cone, inside: Array | None) -> Optimum:
    """The optimum at the speed limit, by its multiplier."""

    def at(nu: float) -> Optimum:
        priced = problem.plus(sqrt(nu) * cone.J, -sqrt(nu) * cone.start)
        return _in_polytope(backend, priced, limits, inside)._replace(nu=nu)

    def excess(nu: float) -> float:
        return 1.0 - cone.limit / max(cone.speed(at(nu).z), TINY)  # nearly linear in nu

    size = float(np.linalg.norm(cone.J))
    unit = float(np.vdot(problem.K, problem.K)) / (size * size)  # the speed weighs as much as all the rest
    low, high = 0.0, unit
    while excess(high) > 0.0:
        low, high = high, 10.0 * high
        if high > MOST_SHARE * unit:
            if inside is None:
                raise SolverFailure("the limits", "no velocity in them is slow enough for the tool", infeasible=True)
            return _slowed(cone, at(low), inside)
    if excess(low) <= 0.0:  # it was above the limit by rounding
        return at(low)
    return at(brentq(excess, low, high, xtol=TINY, disp=False))


def _slowed(cone: Cone, found: Optimum, inside: Array) -> Optimum:
    """The velocity, moved towards one that is inside until the speed is the limit."""
    start, step = cone.velocity(found.z), cone.J.dot(inside - found.z)
    a, b, c = float(step.dot(step)), float(start.dot(step)), float(start.dot(start)) - cone.limit**2
    root = sqrt(max(0.0, b * b - a * c)) - b  # of a t^2 + 2 b t + c = 0, the smaller t
    share = min(max(c / root, 0.0), 1.0) if root > 0.0 else 1.0
    return found._replace(z=found.z + share * (inside - found.z))


def scaled(problem: Quadratic, limits: Polytope, outside: float = 0.0) -> tuple[BoxQP, float]:
    """The problem of the step z - z*, in units of how far outside z* is, and these units: `outside` at least."""
    moving = limits.lengths.nonzero()[0]
    lengths = limits.lengths[moving]
    lower, upper = (side[moving] / lengths for side in limits.about(problem.centre))
    size = float(np.maximum(lower, -upper).max(initial=outside))
    lower, upper = np.maximum(lower / size, -UNBOUNDED), np.minimum(upper / size, UNBOUNDED)
    H = problem.K.T.dot(problem.K)
    C = None if limits.A is None else limits.A[moving] / lengths[:, None]
    return BoxQP(H / H.diagonal().max(), np.zeros(len(H)), lower, upper, C), size


class Nearest(NamedTuple):
    """The least-distance problem of a quadratic: minimise 1/2 |d|^2 over N d <= b, e = size d, rows of length one."""

    problem: Quadratic
    limits: Polytope
    moving: NDArray[np.intp]  # (r,) the limits that some z moves
    lengths: Array  # (r,) of their rows A T
    size: float  # how far outside e = 0 is
    N: Array  # (2 r, n) upper limits, then lower ones
    b: Array  # (2 r,)

    @classmethod
    def of(cls, problem: Quadratic, limits: Polytope, outside: float = 0.0) -> Nearest:
        """The problem in units of how far outside its optimum without limits is: by `outside` at least."""
        moving = limits.lengths.nonzero()[0]
        rows = _product(limits.rows[moving], problem.T)
        lengths = np.linalg.norm(rows, axis=1)
        lower, upper = (side[moving] / lengths for side in limits.about(problem.centre))
        size = float(np.maximum(lower, -upper).max(initial=outside))
        rows, b = rows / lengths[:, None], np.concatenate((upper, -lower)) / size
        return cls(problem, limits, moving, lengths, size, np.vstack((rows, -rows)), b)

    def near(self, d: Array) -> NDArray[np.bool_]:
        """(2 r,) the limits that d is at."""
        return np.asarray(self.N.dot(d) >= self.b - CLOSE)

    def balanced(self, d: Array, pull: Array | None = None) -> tuple[Optimum, float]:
        """The optimum for a solver's d, and the multiplier nu of another pull (n,): d + N'y + nu pull = 0."""
        near = self.near(d).nonzero()[0]
        others = np.zeros((0, len(d))) if pull is None else pull[None]
        y = _non_negative(np.vstack((self.N[near], others)).T, -d)
        return self.optimum(d, near, y[: len(near)]), float(y[len(near) :].sum())

    def optimum(self, d: Array, at: NDArray[np.intp], y: Array) -> Optimum:
        """The optimum for d and the multipliers y (k,) of the limits `at` (k,) of b."""
        both, r = np.zeros(len(self.b)), len(self.moving)
        both[at] = y
        multipliers = np.zeros(len(self.limits.lower))
        multipliers[self.moving] = self.size * (both[:r] - both[r:]) / self.lengths
        return Optimum(self.problem.centre + self.size * self.problem.T.dot(d), multipliers)

    def corrected(self, guess: NDArray[np.bool_]) -> Optimum | None:
        """The optimum at limits among those guessed (2 r,), to which those that it exceeds are added; None for none."""
        T, centre, sides = self.problem.T, self.problem.centre, (self.limits.upper, -self.limits.lower)
        A = np.vstack([sign * self.limits.rows[self.moving] for sign in (1.0, -1.0)])
        limit, lengths = np.concatenate([side[self.moving] for side in sides]), np.tile(self.lengths, 2)
        near = guess.copy()
        while True:
            at = self.pulling(near)
            shortest = np.linalg.pinv(self.N[at])
            d = shortest.dot(self.b[at])
            found = self.optimum(d, at, np.maximum(-d.dot(shortest), 0.0))
            missing = (limit[at] - A[at].dot(found.z)) / lengths[at]
            z = found.z + T.dot(shortest.dot(missing))  # at its limits to rounding, whatever the condition of T
            outside = A.dot(z) - limit - np.tile(self.limits.margin(z, z - centre)[self.moving], 2)
            worst = int(outside.argmax())
            if outside[worst] <= 0.0:
                return found._replace(z=z)
            if near[worst]:
                return None
            near[worst] = True

    def pulling(self, near: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Those of some limits that are active at the shortest d inside these; they do not depend on each other.

        Reference: Lawson and Hanson 1974, ch. 23 (least distance by non-negative least squares).
        """
        some = near.nonzero()[0]
        E = np.vstack((-self.N[some].T, -self.b[some]))
        return np.asarray(some[_non_negative(E, np.eye(len(E))[-1]) > 0.0])


def _non_negative(E: Array, f: Array) -> Array:
    """u >= 0 with the least |E u - f|; zero where SciPy does not find it."""
    try:
        return np.asarray(nnls(E, f)[0]) if E.size else np.zeros(E.shape[1])
    except RuntimeError:
        return np.zeros(E.shape[1])


def _in_polytope(backend: Backend, problem: Quadratic, limits: Polytope, inside: Array | None) -> Optimum:
    """The optimum inside the limits; limits that leave hardly more room than rounding are widened by that, once."""
    try:
        return _optimum(backend, problem, limits)
    except SolverFailure as failure:
        if inside is None:
            raise
        trouble = "" if failure.infeasible else str(failure)
    try:
        return _optimum(backend, problem, limits.admitting(inside))
    except SolverFailure:
        return Optimum(inside, np.zeros(len(limits.lower)), OWN, trouble)


def _optimum(backend: Backend, problem: Quadratic, limits: Polytope) -> Optimum:
    lower, upper = limits.about(problem.centre)
    fixed, size = limits.lengths == 0.0, float(np.linalg.norm(problem.centre))
    outside = np.maximum(lower, -upper) - np.where(fixed, limits.rounding, COSINE_ROUNDING * limits.lengths * size)
    if (outside <= 0.0).all():
        return Optimum(problem.centre, np.zeros(len(lower)))
    if (outside[fixed] > 0.0).any():
        raise SolverFailure("the exact rows", "their only velocity is outside the limits", infeasible=True)
    nearest, (qp, size) = Nearest.of(problem, limits), scaled(problem, limits)
    try:
        step, name, trouble = solved(backend, qp)
    except SolverFailure as failure:
        found = nearest.corrected(np.zeros(len(nearest.b), dtype=bool))
        if found is None:
            raise
        return found._replace(backend=OWN, trouble="" if type(backend) is Daqp else str(failure))
    d = problem.K.dot(step) * (size / nearest.size)
    found = nearest.corrected(nearest.near(d)) or nearest.balanced(d)[0]
    return found._replace(backend=name, trouble=trouble)


def _by_program(program: Cvxpy, problem: Quadratic, limits: Polytope, cone: Cone) -> Optimum:
    """The problem with the second-order cone, by CVXPY."""
    J, start = cone.J / cone.limit, cone.velocity(problem.centre) / cone.limit
    outside = float(np.linalg.norm(start)) - 1.0
    nearest = Nearest.of(problem, limits, outside / float(np.linalg.norm(J.dot(problem.T))))
    qp, size = scaled(problem, limits, outside / float(np.linalg.norm(J)))
    step = size * program.solve_in_cone(qp, size * J, start)
    found, nu = nearest.balanced(problem.K.dot(step) / nearest.size, (start + J.dot(step)).dot(J).dot(problem.T))
    return found._replace(backend=program.name, nu=nu * nearest.size / cone.limit**2)
