"""A convex quadratic inside limits: the active set is a solver's, the numbers are computed on it.

    minimise 1/2 |e|^2   over   lower <= A z <= upper,   |v_p| <= limit,   z = z* + T e

T is the inverse of a root of the Hessian, so this is the point of a polytope nearest to e = 0. Solvers stop at
tolerances of their own, so one is only used for the active set. The shortest e on that is computed by orthogonal
factors and checked: it must be inside the other limits, with multipliers of the right sign. A limit that fails the
check joins or leaves the set. So the answer depends on solver and frame only by rounding times the condition of T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.active import Face, Sides, face_of, weakest
from invariantqp.velocity.qp.backends import Backend, Daqp, SolverFailure, solved
from invariantqp.velocity.qp.polytope import Polytope
from invariantqp.velocity.qp.primal import from_inside
from invariantqp.velocity.qp.scaling import BoxQP, scaled
from invariantqp.velocity.qp.slow import Slow

# A limit this close to the solver's answer, on the scaled problem, is taken to be active until the check.
CLOSE = 1e-7
# How far an answer may be outside a limit, relative to the limit; it is clipped.
FEASIBLE = 1e-9
# Corrections of an active set, of a similar problem or empty, that are tried before a solver is called.
CORRECTIONS = 6
# Corrections begin with no active limit where z* exceeds so many at most. Measured with acceleration limits: where it
# exceeds six or seven, nine of ten end without an answer.
FEW = 4
# An answer from no guess is within this of its limits, relative to them and to how far outside z* is: what is closer is
# left to a solver, which tells limits apart that are.
ROUNDING = 1e-12
# What answers are called that no solver gave.
OWN = "active set"
# A row and a column of T whose cosine is below this are orthogonal, and what there is is rounding; it fades in, so that
# the law has no jump.
COSINE_ROUNDING = 1e-13
TINY = np.finfo(float).tiny


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
    multipliers: Array  # (k,) y, zero where the limit is not active (`active` tells their sign)
    backend: str = ""  # the solver; "" where none was needed
    trouble: str = ""  # what went wrong on the way, "" for nothing
    nu: float = 0.0  # multiplier of the speed limit, where there is one; 0 where it is not active


def minimise(
    backend: Backend,
    problem: Quadratic,
    limits: Polytope,
    inside: Array | None = None,
    near: Optimum | None = None,
) -> Optimum:
    """The optimum inside the limits.

    Args:
        backend: the solver asked first; DAQP stands in for it, and is called where a few corrections do not succeed.
        problem: what is minimised.
        limits: on z; infinite where there is none.
        inside: (n,) a z inside the limits, where one is known: then there always is an answer.
        near: the optimum of a similar problem with the same limits: no solver is called where its active set passes
            the check here.

    Raises:
        SolverFailure: no answer was found; `.infeasible` when a solver says that there is none.
    """
    lower, upper = limits.about(problem.centre)
    count, outside = len(lower), max(float(lower.max()), -float(upper.min()))
    if outside <= 0.0:
        return Optimum(problem.centre, np.zeros(count))
    room = Centred(_normals(problem, limits), lower, upper)
    if near is not None:
        answer = corrected(problem, limits, room, sides_of(near), CORRECTIONS, None, near.backend)
    else:
        few = np.count_nonzero((lower > 0.0) | (upper < 0.0)) <= FEW
        answer = _unaided(problem, limits, room, outside) if few and type(backend) is Daqp else None
    if answer is not None:
        return answer
    rows = limits.moving.nonzero()[0]
    if len(rows) < count:
        still = ~limits.moving
        _check_constant(room.lower[still], room.upper[still])
        if not len(rows):
            return Optimum(problem.centre, np.zeros(count))
    A = None if limits.A is None else limits.A[rows]
    qp, size = scaled(problem.K, A, limits.lengths[rows], room.lower[rows], room.upper[rows])
    try:
        found = solved(backend, qp)
    except SolverFailure as failure:
        if inside is None:
            raise
        answer = primal(problem, limits, room, inside)
        return answer._replace(backend=OWN, trouble="" if failure.infeasible else str(failure))
    side = np.zeros(count, dtype=np.intp)
    side[rows] = _sides(qp, found.z)
    answer = corrected(problem, limits, room, side, len(rows), None, found.backend, found.trouble)
    if answer is None and inside is not None:
        answer = primal(problem, limits, room, inside)._replace(backend=found.backend, trouble=found.trouble)
    if answer is None:
        answer = Optimum(problem.centre + size * found.z, np.zeros(count), found.backend, found.trouble)
    return answer


def _unaided(problem: Quadratic, limits: Polytope, room: Centred, outside: float) -> Optimum | None:
    """The optimum by a few corrections of no active limit, where few are: sooner than DAQP is called."""
    side = np.zeros(len(room.lower), dtype=np.intp)
    return corrected(problem, limits, room, side, CORRECTIONS, None, OWN, "", ROUNDING * min(1.0, outside))


def primal(problem: Quadratic, limits: Polytope, room: Centred, inside: Array, slow: Slow | None = None) -> Optimum:
    """The optimum by way of points inside the limits, from one z (n,) that is."""
    start = problem.K.dot(inside - problem.centre)
    e, face, multipliers, nu = from_inside(room.N, room.lower, room.upper, start, slow)
    z = problem.centre + problem.T.dot(e) if face is None else _precise(problem, limits, face, e)
    return Optimum(z, multipliers, nu=nu)


class Centred(NamedTuple):
    """lower <= N e <= upper, the limits on e."""

    N: Array
    lower: Array
    upper: Array


def centred(problem: Quadratic, limits: Polytope) -> Centred:
    """The limits on e."""
    return Centred(_normals(problem, limits), *limits.about(problem.centre))


def _normals(problem: Quadratic, limits: Polytope) -> Array:
    """(k, n) N of the limits on e."""
    T = problem.T
    N = T if limits.A is None else limits.A.dot(T)
    over = np.abs(N) / (np.outer(limits.lengths, COSINE_ROUNDING * np.sqrt((T * T).sum(axis=0))) + TINY)
    if (over < 2.0).any():
        N = np.minimum(np.maximum(over - 1.0, 0.0), 1.0) * N
    if not limits.moving.all():
        N = N * limits.moving[:, None]
    return N


def sides_of(optimum: Optimum) -> Sides:
    """(k,) 1 at an active upper limit, -1 at an active lower one, 0 elsewhere."""
    return np.sign(optimum.multipliers).astype(np.intp)


def corrected(
    problem: Quadratic,
    limits: Polytope,
    room: Centred,
    side: Sides,
    tries: int,
    slow: Slow | None = None,
    backend: str = "",
    trouble: str = "",
    feasible: float = FEASIBLE,
) -> Optimum | None:
    """The optimum, from a guess at its active set that is corrected where necessary; None where that fails.

    Args:
        problem: what is minimised.
        limits: on z.
        room: the same on e.
        side: (k,) the guess; it is changed.
        tries: of active sets, at most.
        slow: a speed limit beside them.
        backend: who guessed.
        trouble: on the way there.
        feasible: how far outside a limit the answer may be, relative to the limit.
    """
    N, lower, upper = room
    side[~limits.moving] = 0
    for _ in range(tries):
        try:
            face = face_of(N, lower, upper, side)
        except np.linalg.LinAlgError:
            return None
        e, pull, nu = (face.e, face.e, 0.0) if slow is None else slow.on(face)
        value = N.dot(e)
        worst = _furthest_outside(value, lower, upper, face, feasible)
        if worst >= 0:
            side[worst] = 1 if value[worst] > upper[worst] else -1
            continue
        y = face.multipliers(pull)
        wrong = weakest(N, face, pull, y)
        if wrong >= 0:
            side[wrong] = 0
            continue
        if slow is not None and nu > 0.0 and not slow.allows(e):
            return None
        return Optimum(_precise(problem, limits, face, e), face.spread(y, len(lower)), backend, trouble, nu)
    return None


def _furthest_outside(value: Array, lower: Array, upper: Array, face: Face, feasible: float) -> int:
    """The limit that is exceeded by most, beyond rounding; -1 for none."""
    outside = np.maximum(value - upper, lower - value)
    outside[face.at] = -1.0
    if outside[outside.argmax()] <= 0.0:
        return -1
    outside -= feasible * (1.0 + np.minimum(np.abs(lower), np.abs(upper)))
    worst = int(outside.argmax())
    return worst if outside[worst] > 0.0 else -1


def _precise(problem: Quadratic, limits: Polytope, face: Face, e: Array) -> Array:
    """(n,) z of an e on a face, on its active limits to rounding in z, whatever the condition of T."""
    z: Array = problem.centre + problem.T.dot(e)
    at = face.at
    if len(at):
        value = z[at] if limits.A is None else limits.A[at].dot(z)
        z = z + problem.T.dot(face.shortest(np.where(face.above, limits.upper[at], limits.lower[at]) - value))
    return z


def _check_constant(lower: Array, upper: Array) -> None:
    """Check rows that do not depend on z."""
    size = sum(np.where(np.isfinite(limit), np.abs(limit), 0.0) for limit in (lower, upper))
    if (np.maximum(lower, -upper) > FEASIBLE * (1.0 + size)).any():
        raise SolverFailure("the exact rows", "their only velocity is outside the limits", infeasible=True)


def _sides(qp: BoxQP, z: Array) -> Sides:
    """(k,) 1 at an upper limit, -1 at a lower one, 0 away from both, of the scaled problem."""
    value = z if qp.C is None else qp.C.dot(z)
    return np.where(value >= qp.upper - CLOSE, 1, np.where(value <= qp.lower + CLOSE, -1, 0))
