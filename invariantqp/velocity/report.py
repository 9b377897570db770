"""The solution that a tick returns: the velocity as it may be commanded, its status, and the reason in words.

"degraded"   demands contradict limits or the arm
"scaled"     limits slow the exact rows down
"guarded"    the descent guard blended in least squares
"limited"    limits or a singularity keep more of the twist away than "ok" allows; the best inside the limits
"ok"         none of these: at most MISSED of the twist is missed, or the errors of position and of angle each fall at
             FALLING of the rate asked for. Of fewer than six joints, and beside exact rows, the twist is what is left
             of it for the joints to do.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm
from invariantqp.velocity.exact import Reduction
from invariantqp.velocity.law import Demand
from invariantqp.velocity.objective import Objective
from invariantqp.velocity.qp import ACTIVE_TOLERANCE, ROUNDING
from invariantqp.velocity.solution import SLOWEST, Status, VelocitySolution, clipped
from invariantqp.velocity.tick import Answer, Problem, Room, named

# A twist is met, too, where the residual is the rounding of J x: an arm rests on its target while its null space moves.
PRODUCT_ROUNDING = 1e-14
# What "ok" promises.
MISSED = 0.05
FALLING = 0.5
# An error within slack may grow at this share of the slack: less is rounding, or a loop that comes to rest.
GROWING = 0.01
# Exact rows at this share of their speed count as not slowed down: regularising the share takes 1e-7 of it.
WHOLE_SPEED = 1.0 - 1e-6
STUCK = "no velocity reduces the error: it is the least that these joints and limits allow"
# A motion of an exact row below this share of the joints' is none: regularising leaves 1e-9 of it.
BESIDE_TOLERANCE = 1e-6
# A velocity that achieves less than this share of the twist makes no progress.
PROGRESS_SHARE = 1e-4


def reported(demand: Demand, problem: Problem, answer: Answer, to_joint: Array | None) -> VelocitySolution:
    """The solution for an answer y; x = T y, T (m, m) `to_joint` or the identity."""
    objective, found, share = answer.objective, answer.found, answer.room.share.value
    slow = share < WHOLE_SPEED
    y = answer.y if to_joint is None else to_joint.dot(answer.y)
    x, active = clipped(demand, _shortened(demand, y))
    missed = _missed(demand, problem, x)
    stuck = _is_stuck(demand, problem.wanted, x, share)
    limited = stuck or (missed > MISSED and not _falls(demand, x))
    troubles = [*answer.troubles, *row_troubles(demand, problem.reduction)]
    status = Status.DEGRADED if troubles else Status.SCALED if slow else Status.OK
    if status is Status.OK:
        status = Status.GUARDED if answer.blended > 0.0 else Status.LIMITED if limited else Status.OK
    words = [*troubles, *([STUCK] if stuck else []), *_slowed(demand, answer, to_joint)]
    if objective.damping > 0.0:
        words.append(damping_reason(objective))
    if status is Status.LIMITED and not stuck and answer.pace >= WHOLE_SPEED:
        words.append(f"{missed:.2g} of the twist is missed")
    if active:
        words.append(f"at the limits of {named(list(active), len(x))}")
    bound = found is not None and (found.nu > 0.0 or bool(found.multipliers.any()) or answer.pace < 1.0)
    multipliers, row_multipliers = _multipliers(demand, answer) if bound else (None, None)
    return VelocitySolution(
        velocity=x,
        method="qp" if slow or bound else "damped" if objective.damping > 0.0 else "closed-form",
        status=status,
        reason="; ".join(words),
        active=active,
        residual=demand.s - demand.J.dot(x),
        scale=share,
        damping=objective.damping,
        guard=answer.blended,
        backend=found.backend if found is not None and bound else "",
        multipliers=multipliers,
        row_multipliers=row_multipliers,
    )


def damping_reason(objective: Objective) -> str:
    """Why lambda is not zero, "" where it is."""
    if objective.damping == 0.0:
        return ""
    return f"near a singularity: the smallest singular value is {objective.ratio:.1e} of the largest; damped"


def is_met(A: Array, b: Array, x: Array) -> bool:
    """Whether A x = b but for rounding."""
    left = norm(b - A.dot(x))
    return left <= ROUNDING * norm(b) or left <= PRODUCT_ROUNDING * sqrt(float(np.vdot(A, A))) * norm(x)


def _missed(demand: Demand, problem: Problem, x: Array) -> float:
    """The share of the measured twist that x misses, 0 where it is met but for rounding.

    Of fewer than six joints, and beside exact rows, the share of what is left for them to do.
    """
    wanted, A = problem.wanted, demand.root.dot(demand.J)
    if is_met(A, wanted, x):
        return 0.0
    wanted = problem.possible()
    if is_met(A, wanted, x):
        return 0.0
    size = norm(wanted)
    return norm(wanted - A.dot(x)) / size if size > 0.0 else inf


def _falls(demand: Demand, x: Array) -> bool:
    """Whether the errors of position and angle each fall at `FALLING` of the rate asked for, or are within slack.

    One within slack need not fall so fast, but does not grow by more than `GROWING` of the slack either.

    By a carried metric position and angle are not measured apart, and are one error.
    """
    chase = demand.chase
    if chase is None:
        return False
    asked = demand.root.dot(demand.s - chase.ahead)
    done = demand.root.dot(demand.J.dot(x) - chase.ahead)
    parts = [slice(0, 3), slice(3, 6)] if chase.apart else [slice(0, 6)]
    rates = [norm(asked[part]) for part in parts]
    return all(
        asked[part].dot(done[part]) >= rate * max(FALLING * rate - chase.slack, -GROWING * chase.slack)
        for part, rate in zip(parts, rates, strict=True)
    )


def row_troubles(demand: Demand, reduction: Reduction) -> list[str]:
    """What of the exact rows no velocity meets, here or anywhere."""
    troubles = []
    if reduction.contradicts:
        unmet = f"{reduction.unmet:.1e} of the demand is unmet"
        troubles.append(f"the joints cannot keep the direction of the exact rows: {unmet}")
    if reduction.beyond > ROUNDING:
        unmet = f"{reduction.beyond:.1e} of the demand is unmet"
        troubles.append(f"this arm can keep {demand.row_rank} of the exact rows: {unmet}")
    return troubles


def _slowed(demand: Demand, answer: Answer, to_joint: Array | None) -> list[str]:
    """What limits slow down, and what the guard does about the rest, in words."""
    words = [] if answer.room.share.value >= WHOLE_SPEED else slowed_rows(demand, answer.room, to_joint)
    if answer.pace < WHOLE_SPEED:
        words.append(f"limits allow {answer.pace:.3g} of the approach's speed")
    if answer.blended > 0.0:
        words.append(f"descent guard: {answer.blended:.3g} of least squares blended in")
    return words


def slowed_rows(demand: Demand, room: Room, to_joint: Array | None) -> list[str]:
    """The share of the exact rows' speed, what holds it; and how far a motion that limits require moves them."""
    share, start = room.share, room.reduction.start
    by = [named(share.held_by, len(start))] if share.held_by else []
    by += ["the tool's speed"] if share.fast else []
    held = f" (held by {' and '.join(by)})" if by else ""
    words = [f"limits allow {share.value:.3g} of the exact rows' speed{held}"]
    if demand.exact is None or not start.any():
        return words
    T = np.eye(len(start)) if to_joint is None else to_joint
    off = np.abs(demand.exact.A.dot(T.dot((1.0 - share.value) * start)))
    fast = max(SLOWEST, norm(T.dot(share.velocity)))  # slower is rounding of an arm that stands still
    least = BESIDE_TOLERANCE * np.linalg.norm(demand.exact.A, axis=1) * fast
    moved = ", ".join(f"exact row {i} is off by {off[i]:.3g}" for i in np.flatnonzero(off > least))
    return [*words, f"limits require motion beside it: {moved}"] if moved else words


def _is_stuck(demand: Demand, wanted: Array, x: Array, share: float) -> bool:
    """Whether nothing moves towards the twist or along the exact rows, short of both."""
    if demand.exact is not None and share > PROGRESS_SHARE:
        return False
    left = demand.root.dot(demand.s - demand.J.dot(x))
    little = wanted.dot(wanted - left) < PROGRESS_SHARE * wanted.dot(wanted)
    return bool(little) and not is_met(demand.root.dot(demand.J), wanted, x)


def _shortened(demand: Demand, x: Array) -> Array:
    """The velocity shortened until rows and tool speed hold exactly, where only rounding exceeds them."""
    rows, cone = demand.rows, demand.cone
    share = 1.0 if rows is None else rows.share(x)
    if cone is not None:
        share = min(share, cone.limit / max(cone.limit, cone.speed(x)))
    return share * x if 1.0 > share > 1.0 - ACTIVE_TOLERANCE else x


def _multipliers(demand: Demand, answer: Answer) -> tuple[Array | None, Array | None]:
    """Those of the bounds (m,) and of the rows (k,); None where there are none."""
    if answer.found is None:
        return None, None
    y, m = answer.found.multipliers, len(demand.lower)
    if demand.rows is None:
        return y[:m], None
    return y[:m], y[m : m + len(np.asarray(demand.rows.C))]
