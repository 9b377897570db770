"""The solution that a tick returns: the velocity as it may be commanded, its status, and the reasons for it.

"degraded"   demands contradict limits or the arm
"scaled"     limits slow the exact rows down
"guarded"    the descent guard blended in least squares
"limited"    limits, a singularity or fewer than six joints keep more of the twist away than "ok" allows
"ok"         none of these: at most MISSED of the twist is missed, or the errors of position and of orientation each
             shrink at FALLING of the requested rate at least. Beside exact rows, the twist is what these leave of it.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.se3 import norm
from invariantqp.legacy.damping import PROGRESS_SHARE
from invariantqp.legacy.exact import Reduction
from invariantqp.legacy.law import Demand
from invariantqp.legacy.objective import Objective
from invariantqp.legacy.qp import PRODUCT_ROUNDING
from invariantqp.legacy.solution import clipped
from invariantqp.legacy.tick import Answer, Problem, Room
from invariantqp.velocity.limits import LimitRows
from invariantqp.velocity.reasons import FIRST_EXACT_ROW, TOOL_SPEED, Code, Reason, row_name, worst_first
from invariantqp.velocity.solution import ACTIVE_TOLERANCE, SLOWEST, Status, VelocitySolution

# What "ok" promises.
MISSED = 0.05
FALLING = 0.5
# Fewer than six joints that can achieve this share of a twist are not to blame.
ENOUGH = 0.95
# The joints move a point in all directions where the product of their squared speeds is above this share of the cube of
# their sum: one direction with a thousandth of the speed of another is none.
SPREAD = 1e-6
# An error within slack may grow at this share of the slack: less is rounding, or a loop that comes to rest.
GROWING = 0.01
# Exact rows at this share of their speed count as not slowed down: regularising the share takes 1e-7 of it.
WHOLE_SPEED = 1.0 - ACTIVE_TOLERANCE


def reported(demand: Demand, problem: Problem, answer: Answer, to_joint: Array | None) -> VelocitySolution:
    """The solution for an answer y; x = T y, T (m, m) `to_joint` or the identity."""
    share, m = answer.room.share.value, len(demand.lower)
    x, active = clipped(demand, answer.y if to_joint is None else to_joint.dot(answer.y))
    slowed, troubles = slowed_rows(demand, answer.room, to_joint), row_troubles(demand, problem.reduction)
    troubles = [*answer.troubles, *troubles]
    missed, limited, stuck = _judged(demand, problem, x, share, slowed)
    damping = answer.objective.damping if missed > 0.0 else 0.0
    bound, pulls = answer.bound is not None, None if answer.bound is None else answer.bound.multipliers
    row_pulls = None if pulls is None or demand.rows is None else pulls[m:]
    status = status_of(troubles, share, answer.blended, limited=limited)
    reasons = [*troubles, *([Reason(Code.STUCK)] if stuck else []), *slowed, *_reductions(answer, damping)]
    achievable = _achievable(demand, problem) if status is Status.LIMITED else 1.0
    if achievable < 1.0:
        reasons += [Reason(Code.FEW_JOINTS, numbers=(float(m), achievable)), *_position_alone(demand, problem)]
    explained = 0.0 if achievable == 1.0 else sqrt(1.0 - achievable) + MISSED
    if status is Status.LIMITED and not stuck and not _has(slowed, Code.ROWS_MOVED) and answer.pace >= WHOLE_SPEED:
        reasons += _short(missed, by_calm=not bound and damping == 0.0) if missed >= explained else []
    reasons += at_limits(demand, x, active, row_pulls)
    return VelocitySolution(
        velocity=x,
        method="qp" if share < WHOLE_SPEED or bound else "damped" if damping > 0.0 else "closed-form",
        status=status,
        reasons=worst_first(reasons),
        active=active,
        residual=demand.s - demand.J.dot(x),
        scale=share,
        damping=damping,
        guard=answer.blended,
        backend="" if answer.bound is None else answer.bound.backend,
        multipliers=None if pulls is None else pulls[:m],
        row_multipliers=row_pulls,
        row_names=() if demand.rows is None else demand.rows.names,
    )


def _judged(demand: Demand, problem: Problem, x: Array, share: float, slowed: list[Reason]) -> tuple[float, bool, bool]:
    """What of the twist is missed, whether that is more than "ok" allows, and whether nothing gets nearer at all."""
    missed, little = _missed(demand, problem, x), _is_little(demand, problem.wanted, x, share)
    limited = little or _has(slowed, Code.ROWS_MOVED) or (missed > MISSED and not _falls(demand, x))
    if little and demand.chase is None:
        return missed, limited, True
    return missed, limited, (little or (limited and missed == inf)) and _rests(demand, x)


def _has(reasons: list[Reason], code: Code) -> bool:
    """Whether some reason is of a code."""
    return any(reason.code is code for reason in reasons)


def _reductions(answer: Answer, damping: float) -> list[Reason]:
    """What slows the chase down, what the guard does, and damping."""
    reasons = []
    if answer.pace < WHOLE_SPEED:
        reasons.append(Reason(Code.CHASE_SLOWED, numbers=(answer.pace,)))
    if answer.blended > 0.0:
        reasons.append(Reason(Code.GUARDED, numbers=(answer.blended,)))
    if damping > 0.0:
        reasons.append(damped(answer.objective))
    return reasons


def _short(missed: float, *, by_calm: bool) -> list[Reason]:
    """What a "limited" tick misses, where nothing else says why: infinitely much where nothing is to move."""
    if missed == inf:
        return [Reason(Code.MOVED)]
    return [*([Reason(Code.CALMED)] if by_calm else []), Reason(Code.MISSED, numbers=(missed,))]


def _achievable(demand: Demand, problem: Problem) -> float:
    """Which share of the twist, along it, fewer than six joints can achieve; 1 where that is `ENOUGH` or all."""
    wanted = problem.wanted
    size = norm(wanted)
    if demand.exact is not None or problem.A.shape[1] >= 6 or size <= _nothing(demand):
        return 1.0
    share = float(wanted.dot(problem.possible())) / size**2
    return share if share < ENOUGH else 1.0


def _position_alone(demand: Demand, problem: Problem) -> list[Reason]:
    """The advice to keep the velocity of the tool point, where the joints can have any."""
    A = (demand.root.dot(demand.J))[3:]
    square = A.dot(A.T)
    free = np.linalg.det(square) > SPREAD * np.trace(square) ** 3
    return [Reason(Code.POSITION_ALONE)] if free and problem.A.shape[1] >= 3 else []


def damped(objective: Objective) -> Reason:
    """Why lambda is not zero."""
    return Reason(Code.DAMPED, numbers=(objective.ratio,))


def status_of(troubles: list[Reason], share: float, blended: float, *, limited: bool) -> Status:
    """The status of a tick: of several, the gravest."""
    if troubles:
        return Status.DEGRADED
    if share < WHOLE_SPEED:
        return Status.SCALED
    if blended > 0.0:
        return Status.GUARDED
    return Status.LIMITED if limited else Status.OK


def at_limits(demand: Demand, x: Array, active: tuple[int, ...], row_multipliers: Array | None) -> list[Reason]:
    """The limits that x is at: joints in their order, the tool's speed, then rows, the one that pulls hardest first."""
    cone, rows, names = demand.cone, demand.rows, []
    if cone is not None and cone.speed(x) >= cone.limit * (1.0 - ACTIVE_TOLERANCE):
        names.append(TOOL_SPEED)
    if rows is not None:
        lengths = np.linalg.norm(rows.C, axis=1)
        margin = ACTIVE_TOLERANCE * lengths * max(SLOWEST, norm(x))
        value = rows.C.dot(x)
        held = (lengths > 0.0) & ((value <= rows.lower + margin) | (value >= rows.upper - margin))
        names += strongest(np.flatnonzero(held), rows, row_multipliers)
    return [Reason(Code.AT_LIMITS, active, tuple(names))] if active or names else []


def strongest(indices: NDArray[np.intp], rows: LimitRows, multipliers: Array | None) -> list[str]:
    """The names of some rows, the one that pulls hardest first; its scale does not count."""
    pulls = np.zeros(len(rows.C)) if multipliers is None else np.abs(multipliers) * np.linalg.norm(rows.C, axis=1)
    return [row_name(i, rows.names) for i in sorted(indices.tolist(), key=lambda i: -pulls[i])]


def is_met(A: Array, b: Array, x: Array) -> bool:
    """Whether A x = b but for rounding, also that of A x: an arm rests on its target while its null space moves.

    Joints that are slower than what counts as being at a limit stand still.
    """
    left, rounding = norm(b - A.dot(x)), max(PRODUCT_ROUNDING * norm(x), ACTIVE_TOLERANCE * SLOWEST)
    return left <= NEGLIGIBLE * norm(b) or left <= sqrt(float(np.vdot(A, A))) * rounding


def _missed(demand: Demand, problem: Problem, x: Array) -> float:
    """The share of the measured twist that x misses, 0 where it is met but for rounding.

    Beside exact rows, the share of what is left for the joints to do.
    """
    wanted, A = problem.wanted, demand.root.dot(demand.J)
    if is_met(A, wanted, x):
        return 0.0
    if demand.exact is not None:
        wanted = problem.possible()
        if is_met(A, wanted, x):
            return 0.0
    size = norm(wanted)
    return norm(wanted - A.dot(x)) / size if size > _nothing(demand) else inf


def _nothing(demand: Demand) -> float:
    """A measured twist up to which nothing is to move, as an error of a pose that may stay."""
    return 0.0 if demand.chase is None else GROWING * demand.chase.slack


def _falls(demand: Demand, x: Array) -> bool:
    """Whether the errors of position and angle each fall at `FALLING` of the wanted rate, or are within slack.

    One within slack need not fall so fast, but does not grow by more than `GROWING` of the slack either; nor does any
    error by what moves beside it, were that to go on for as long as closing it takes.

    By a carried metric position and angle are not measured apart, and are one error.
    """
    chase = demand.chase
    if chase is None:
        return False
    asked = demand.root.dot(demand.s - chase.ahead)
    done = demand.root.dot(demand.J.dot(x) - chase.ahead)
    parts = [slice(0, 3), slice(3, 6)] if chase.apart else [slice(0, 6)]
    rates = [norm(asked[part]) for part in parts]
    growing = _nothing(demand)
    return all(
        asked[part].dot(done[part]) >= rate * max(FALLING * rate - chase.slack, -growing)
        and norm(asked[part] - done[part]) <= rate + growing
        for part, rate in zip(parts, rates, strict=True)
    )


def row_troubles(demand: Demand, reduction: Reduction) -> list[Reason]:
    """What of the exact rows no velocity meets, here or anywhere."""
    troubles = []
    if reduction.contradicts:
        troubles.append(Reason(Code.ROWS_UNKEPT, numbers=(reduction.unmet,)))
    if reduction.beyond > NEGLIGIBLE and norm(demand.root.dot(demand.s)) > _nothing(demand):
        troubles.append(Reason(Code.ROWS_TOO_MANY, numbers=(float(demand.row_rank or 0), reduction.beyond)))
    return troubles


def slowed_rows(demand: Demand, room: Room, to_joint: Array | None) -> list[Reason]:
    """The share of the exact rows' speed, and how far a motion that limits require moves them."""
    share, start = room.share, room.reduction.start
    m = len(start)
    reasons = [Reason(Code.ROWS_SLOWED, numbers=(share.value,))] if share.value < WHOLE_SPEED else []
    if demand.exact is None or not start.any():
        return reasons
    T = np.eye(m) if to_joint is None else to_joint
    off = np.abs(demand.exact.A.dot(T.dot(start)))
    fast = max(SLOWEST, norm(T.dot(share.velocity)))  # slower is rounding of an arm that stands still
    moved = np.flatnonzero(off > ACTIVE_TOLERANCE * np.linalg.norm(demand.exact.A, axis=1) * fast).tolist()
    if moved:
        exact = tuple(row_name(FIRST_EXACT_ROW - i) for i in moved)
        reasons.append(Reason(Code.ROWS_MOVED, (), exact, tuple(off[moved].tolist())))
    return reasons


def _rests(demand: Demand, x: Array) -> bool:
    """Whether joints move the tool, each by itself, by no more than nothing."""
    A = demand.root.dot(demand.J)
    return float(np.sqrt((A * A).sum(axis=0)).dot(np.abs(x))) <= _nothing(demand)


def _is_little(demand: Demand, wanted: Array, x: Array, share: float) -> bool:
    """Whether nothing moves towards a twist or along the exact rows, short of both."""
    if (demand.exact is not None and share > PROGRESS_SHARE) or norm(wanted) <= _nothing(demand):
        return False
    left = demand.root.dot(demand.s - demand.J.dot(x))
    little = wanted.dot(wanted - left) < PROGRESS_SHARE * wanted.dot(wanted)
    return bool(little) and not is_met(demand.root.dot(demand.J), wanted, x)
