"""One tick, stage by stage; each stage is a function of what the stage before it returned.

    free          the optimum without limits, where that is inside them; otherwise:
    give way      rows that contradict the box, and a tool speed that contradicts both, are relaxed by the least
    share         exact rows slow down along their direction where limits require it
    minimise      the optimum inside the limits
    calm          the optimum once more, with damping that grows with the residual (`calm`)
    guard         with a form: least squares inside the same limits is blended in where the form does not descend

Contradictions are reported in words (`troubles`). Only `SolverFailure` is raised, where no velocity was found at all.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm
from invariantqp.velocity.calm import CALM, calm
from invariantqp.velocity.exact import ExactRows, Reduction
from invariantqp.velocity.guard import Guard, blend
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits.conflicts import relaxed, slowed
from invariantqp.velocity.limits.rows import LimitRows
from invariantqp.velocity.objective import Objective
from invariantqp.velocity.posed import Left, Posed, limits_of
from invariantqp.velocity.qp.backends import Backend
from invariantqp.velocity.qp.quadratic import Cone, Optimum, Polytope, Quadratic, minimise
from invariantqp.velocity.reasons import FIRST_EXACT_ROW, TOOL_SPEED, Code, Reason, row_name
from invariantqp.velocity.share import Share, share_of
from invariantqp.velocity.solution import SLOWEST

# Exact rows of which more than this, relative, cannot be met: the joints cannot keep the direction of the demand.
UNMET_TOLERANCE = 1e-9
# Rounding of a pace, and of what it misses relative to the whole chase.
ROUNDING = 1e-14
# A chase, and what is left of one, below this share of what it is part of is rounding.
NOTHING = 1e-12
# A motion of an exact row below this share of the joints' is none: the weight below leaves 1e-9 of it.
BESIDE_TOLERANCE = 1e-6
# Weight of |y|^2 beside the squared motion of the rows where the least motion of the rows is computed.
REGULARISATION = 1e-9


HeldBy: TypeAlias = tuple[tuple[int, ...], tuple[str, ...]]  # joints, and other limits by name


class Answer(NamedTuple):
    """A velocity inside the limits, and how it came about."""

    y: Array  # (m,) the velocity, in the joints' own metric
    share: float  # of the exact rows' speed
    objective: Objective  # what was minimised last
    # the optimum of the QP, with multipliers (k,) of the polytope on y; None where no limit is met
    found: Optimum | None
    slowed: Array  # (m,) the part of the chase, as a velocity y, that limits slow down; zero where they do not
    pace: float  # share of the chase that is left, 1 where limits do not slow it down
    blended: float  # share of least squares that the guard blended in
    troubles: tuple[Reason, ...]  # what was not as asked
    held_by: HeldBy  # the limits that slow the exact rows down
    beside: tuple[Reason, ...]  # how far limits move the exact rows besides


class Limits(NamedTuple):
    """The limits on y, after contradictions gave way (`troubles` says which), and a y (m,) inside them."""

    polytope: Polytope
    placed: Polytope  # without the limits of velocity and acceleration
    cone: Cone | None
    troubles: tuple[Reason, ...]
    inside: Array


class Room(NamedTuple):
    """What is left to minimise over: the velocities at the share of the exact rows' speed that the limits allow."""

    problem: Posed  # the tick
    share: float  # of the exact rows' speed
    left: Left  # what the rows leave at that share
    polytope: Polytope  # the limits on z at that share
    cone: Cone | None  # likewise, or None
    placed: Polytope  # the limits on z but those of velocity and acceleration
    inside: Array  # (n,) a z inside all
    held_by: HeldBy  # the limits that slow the exact rows down
    beside: tuple[Reason, ...]  # how far limits move the exact rows besides
    troubles: tuple[Reason, ...]  # contradictions between limits


def answered(law: VelocityLaw, demand: Demand, problem: Posed) -> Answer:
    """The answer, with or without active limits.

    Raises:
        SolverFailure: no velocity was found.
    """
    objective = problem.objective(1.0)
    guard = None if problem.attempt is problem.wanted else law.guard
    y = problem.left(1.0).joint(objective.centre())
    blocked = problem.reduction is not None and problem.reduction.unmet > UNMET_TOLERANCE
    if not blocked and demand.allows(y if law.to_joint is None else law.to_joint.dot(y)):
        first = Answer(y, 1.0, objective, None, np.zeros(len(y)), 1.0, 0.0, (), ((), ()), ())
        room = _room(problem, Limits(*limits_of(law, demand), (), y), Share(1.0, y, []), demand.rows)
    else:
        limits = given_way(law, demand)
        share = Share(1.0, limits.inside, [])
        if problem.reduction is not None:
            reduction, share = slowed_rows(problem.reduction, limits, law.dt, law.backend)
            if reduction is not problem.reduction:
                problem = problem._replace(reduction=reduction)
            objective = problem.slowed(objective, share.value)
        room = _room(problem, limits, share, demand.rows, beside(demand.exact, problem.reduction, law.to_joint, share))
        first = _within(law, room, objective, demand)
    mu = _calm(law, room, first)
    answer = first if mu == 0.0 else _calmed(law, room, first, mu)
    return answer if guard is None else _guarded(law, guard, room, answer, mu, demand)


def given_way(law: VelocityLaw, demand: Demand) -> Limits:
    """The limits; those that contradict others are relaxed by the least that is necessary."""
    troubles: list[Reason] = []
    m = len(demand.lower)
    x = np.minimum(np.maximum(np.zeros(m), demand.lower), demand.upper)
    if demand.rows is not None and not demand.rows.allow(x):
        moved = relaxed(demand.rows, demand.lower, demand.upper, law.to_joint)
        x = moved.inside
        if moved.violation.any():
            lengths = np.linalg.norm(demand.rows.C, axis=1)
            worst = sorted(
                np.flatnonzero(moved.violation).tolist(), key=lambda i: -abs(moved.violation[i]) / lengths[i]
            )
            troubles.append(
                Reason(
                    Code.ROWS_CONTRADICT,
                    tuple(i for i in moved.held_by if i < m),
                    tuple(row_name(i, demand.rows.names) for i in worst),
                    tuple(np.abs(moved.violation[worst]).tolist()),
                )
            )
            demand = demand._replace(rows=moved.rows)
    polytope, placed, cone = limits_of(law, demand)
    y = x if law.from_joint is None else law.from_joint.dot(x)
    if cone is not None and not cone.allows(y):
        slower, y = slowed(cone, polytope)
        if slower.limit > cone.limit:
            troubles.append(Reason(Code.TOOL_FASTER, numbers=(slower.limit, cone.limit)))
            cone = slower
    return Limits(polytope, placed, cone, tuple(troubles), y)


def _room(problem: Posed, limits: Limits, share: Share, rows: LimitRows | None, moved: tuple[Reason, ...] = ()) -> Room:
    """The velocities inside the limits at a share of the exact rows' speed."""
    left = problem.left(share.value)
    m = problem.A.shape[1]
    by = [TOOL_SPEED] if share.fast else []
    if rows is not None:
        by += [row_name(i - m, rows.names) for i in share.held_by if i >= m]
    return Room(
        problem,
        share.value,
        left,
        left.limits(limits.polytope),
        left.cone(limits.cone),
        left.limits(limits.placed),
        left.free(share.velocity),
        (tuple(i for i in share.held_by if i < m), tuple(by)),
        moved,
        limits.troubles,
    )


def slowed_rows(reduction: Reduction, limits: Limits, dt: float, backend: Backend) -> tuple[Reduction, Share]:
    """The rows, counted from the velocity that moves them least, and the share of their speed that the limits allow.

    Raises:
        SolverFailure: no velocity was found.
    """
    inside = limits.inside
    if inside.any():  # standing still is not allowed
        m = len(inside)
        rows = np.eye(m) - reduction.basis.dot(reduction.basis.T)
        still = Quadratic.diagonal(np.full(m, np.sqrt(REGULARISATION)), np.zeros(m)).plus(rows, np.zeros(m))
        inside = minimise(backend, still, limits.polytope, limits.cone, inside).z
        reduction = reduction._replace(start=reduction.fixed(inside))
    if reduction.unmet > UNMET_TOLERANCE:  # the share tends to zero as the joints lose a direction of the rows
        return reduction, Share(0.0, inside, [])
    return reduction, share_of(reduction, limits.polytope, limits.cone, inside, dt, backend)


def unkept(reduction: Reduction | None) -> list[Reason]:
    """The reason where the joints cannot keep the direction of the exact rows."""
    if reduction is None or reduction.unmet <= UNMET_TOLERANCE:
        return []
    return [Reason(Code.ROWS_UNKEPT, numbers=(reduction.unmet,))]


def beside(
    rows: ExactRows | None, reduction: Reduction | None, to_joint: Array | None, share: Share
) -> tuple[Reason, ...]:
    """How far a motion that limits require takes each exact row off its share of the speed, where it does.

    The rows are on x = T y, T (m, m) `to_joint` or the identity; their reduction is on y, counted from the velocity
    that moves them least.
    """
    if rows is None or reduction is None or share.value == 1.0 or not reduction.start.any():
        return ()
    T = np.eye(len(reduction.start)) if to_joint is None else to_joint
    off = np.abs(rows.A.dot(T.dot((1.0 - share.value) * reduction.start)))
    fast = max(SLOWEST, float(np.linalg.norm(T.dot(share.velocity))))  # slower is rounding of an arm that stands still
    least = BESIDE_TOLERANCE * np.linalg.norm(rows.A, axis=1) * fast
    moved = np.flatnonzero(off > least).tolist()
    names = tuple(row_name(FIRST_EXACT_ROW - i) for i in moved)
    return (Reason(Code.ROWS_MOVED, rows=names, numbers=tuple(off[moved].tolist())),) if moved else ()


def _within(law: VelocityLaw, room: Room, objective: Objective, demand: Demand) -> Answer:
    """The velocity inside the limits: position limits bend the chase of a target, all others slow it down first.

        z*(p)     the optimum without limits for the twist whose chase has the pace p in [0, 1]
        z         nearest to z*(p) inside all limits: least squares of that twist
        z1, z0    nearest to z*(1) and z*(0) inside the position limits and rows,   u = K (z1 - z0) / |K (z1 - z0)|
        p         the largest pace with   u'K (z0 + p (z1 - z0) - z(p)) <= delta,   delta = |ahead| + slack,
                  z(p) nearest to z0 + p (z1 - z0) inside all limits

    So limits may take away delta along the chase, as least squares has it; what is more slows the chase down, in all
    its directions alike. p is part of the minimum of one convex function, 1/2 |K (z - z0 - p (z1 - z0))|^2 +
    delta |K (z1 - z0)| (1 - p) over z inside the limits and p, so the answer is continuous in all data.
    """
    quadratic = objective.quadratic()
    if demand.chase is None or objective.still is None:
        return _answer(room, objective, _nearest(law, room, quadratic))
    found = minimise(law.backend, quadratic, room.placed, None, room.inside)
    if room.polytope.allows(found.z) and (room.cone is None or room.cone.nearly_allows(found.z)):
        return _answer(room, objective, found)
    unchased = objective.paced(0.0).quadratic()
    z0 = minimise(law.backend, unchased, room.placed, None, room.inside).z
    chase = found.z - z0
    whole = quadratic.K.dot(chase)
    length = norm(whole)
    if length <= NOTHING * norm(quadratic.K.dot(found.z)):
        return _answer(room, objective, _nearest(law, room, quadratic))
    u = whole / length
    delta = norm(demand.root.dot(demand.chase.ahead)) * room.share + demand.chase.slack

    def missed(pace: float) -> float:
        centre = z0 + pace * chase
        nearest = _nearest(law, room, quadratic._replace(centre=centre)).z
        return float(u.dot(quadratic.K.dot(centre - nearest))) - delta

    pace = _largest(missed)
    paced = objective.paced(pace)
    slowed = (1.0 - pace) * (quadratic.centre - unchased.centre)
    return _answer(room, paced, _nearest(law, room, paced.quadratic()), slowed, pace)


def _largest(missed: Callable[[float], float]) -> float:
    """The largest p in [0, 1] with missed(p) <= 0, or 0: `missed` does not fall and is linear, piece by piece."""
    low, high, pace = 0.0, 1.0, 1.0
    over = missed(high)
    if over <= 0.0:
        return high
    under = missed(low)
    whole, side = over - under, 0
    if under >= -NOTHING * whole:
        return low
    while high - low > ROUNDING:
        pace = low + (high - low) * under / (under - over)  # the secant: exact once both ends are on one piece
        at = missed(pace)
        if abs(at) <= ROUNDING * whole or not low < pace < high:
            break
        if at > 0.0:
            under *= 0.5 if side > 0 else 1.0  # an end that stays is weighed down, so that it moves, too
            high, over, side = pace, at, 1
        else:
            over *= 0.5 if side < 0 else 1.0
            low, under, side = pace, at, -1
    return pace


def _nearest(law: VelocityLaw, room: Room, quadratic: Quadratic) -> Optimum:
    """The optimum inside all limits."""
    return minimise(law.backend, quadratic, room.polytope, room.cone, room.inside)


def _answer(room: Room, objective: Objective, found: Optimum, slowed: Array | None = None, pace: float = 1.0) -> Answer:
    """The answer for an optimum in z."""
    troubles = room.troubles
    if found.trouble:
        troubles = (*troubles, Reason(Code.SOLVER, words=f"{found.trouble}; solved by {found.backend}"))
    y, m = room.left.joint(found.z), room.problem.A.shape[1]
    basis = room.left.basis
    lost = np.zeros(m) if slowed is None else slowed if basis is None else basis.dot(slowed)
    met = found.nu > 0.0 or bool(found.multipliers.any())
    held = found if met or pace < 1.0 else None
    return Answer(y, room.share, objective, held, lost, pace, 0.0, troubles, room.held_by, room.beside)


def _calm(law: VelocityLaw, room: Room, answer: Answer) -> float:
    problem = room.problem
    if law.dt == 0.0 or problem.spectrum is None:
        return 0.0
    factor = CALM if problem.reduction is None else CALM * problem.reduction.bend
    speed = answer.objective.speed(room.left.free(answer.y))
    return calm(problem.A, problem.wanted, problem.A.dot(answer.y + answer.slowed), speed, law.dt, factor)


def _calmed(law: VelocityLaw, room: Room, answer: Answer, mu: float) -> Answer:
    """The answer once more, at its pace, with 1/2 mu |z|^2 added."""
    objective = answer.objective.calmed(mu)
    again = _answer(room, objective, _nearest(law, room, objective.quadratic()), None, answer.pace)
    return again._replace(slowed=answer.slowed)


def _guarded(law: VelocityLaw, guard: Guard, room: Room, answer: Answer, mu: float, demand: Demand) -> Answer:
    """The answer of a form, with as much least squares blended in as descent requires."""
    problem = room.problem
    ahead = None if demand.chase is None else demand.root.dot(demand.chase.ahead)
    plain = problem._replace(attempt=problem.wanted, ahead=ahead)
    best = _within(law, room, plain.objective(room.share), demand)
    best = best if mu == 0.0 else _calmed(law, room, best, mu)
    wanted = room.share * problem.wanted
    t = blend(problem.A, wanted, mu, answer.y, best.y, guard.fraction)
    if t == 0.0:
        return answer
    return answer._replace(y=(1.0 - t) * answer.y + t * best.y, blended=t)
