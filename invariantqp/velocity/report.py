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
from invariantqp.velocity.law import Demand
from invariantqp.velocity.objective import NULL_RATIO, Objective
from invariantqp.velocity.posed import Posed
from invariantqp.velocity.qp.quadratic import ACTIVE_TOLERANCE, named
from invariantqp.velocity.solution import Status, VelocitySolution, clipped
from invariantqp.velocity.stages import UNMET_TOLERANCE, Answer, unkept

# A twist is met where the residual is less than this share of it ...
MET_TOLERANCE = 1e-9
# ... or less than the rounding of J x itself: an arm rests on its target while its null space moves.
PRODUCT_ROUNDING = 1e-14
# What "ok" promises.
MISSED = 0.05
FALLING = 0.5
# An error within slack may grow at this share of the slack: less is rounding, or a loop that comes to rest.
GROWING = 0.01
# Exact rows at this share of their speed count as not slowed down: regularising the share takes 1e-7 of it.
WHOLE_SPEED = 1.0 - 1e-6
STUCK = "no velocity reduces the error: it is the least that these joints and limits allow"
# A velocity that achieves less than this share of the twist makes no progress.
PROGRESS_SHARE = 1e-4


def reported(demand: Demand, problem: Posed, answer: Answer) -> VelocitySolution:
    """The solution for an answer in joint velocities x."""
    objective, found = answer.objective, answer.found
    slow = answer.share < WHOLE_SPEED
    x, active = clipped(demand, _shortened(demand, answer.y))
    residual = demand.s - demand.J.dot(x)
    missed = _missed(demand, problem, x)
    stuck = _is_stuck(demand, problem.wanted, x, answer.share)
    limited = stuck or (missed > MISSED and not _falls(demand, x))
    troubles = [*answer.troubles, *_row_troubles(demand, problem)]
    words = [*troubles, *([STUCK] if stuck else [])]
    if slow:
        by = f" (held by {answer.held_by})" if answer.held_by else ""
        words.append(f"limits allow {answer.share:.3g} of the exact rows' speed{by}")
        words.extend(filter(None, [answer.beside]))
    if answer.pace < WHOLE_SPEED:
        words.append(f"limits allow {answer.pace:.3g} of the approach's speed")
    if answer.blended > 0.0:
        words.append(f"descent guard: {answer.blended:.3g} of least squares blended in")
    if objective.damping > 0.0:
        words.append(damping_reason(objective))
    status = _status(degraded=bool(troubles), slow=slow, guarded=answer.blended > 0.0, limited=limited)
    if status is Status.LIMITED and not stuck and answer.pace >= WHOLE_SPEED:
        words.append(f"{missed:.2g} of the twist is missed")
    if active:
        words.append(f"at the limits of {named(list(active), len(x))}")
    multipliers, row_multipliers = _multipliers(demand, answer)
    return VelocitySolution(
        velocity=x,
        method="qp" if slow or found is not None else "damped" if objective.damping > 0.0 else "closed-form",
        status=status,
        reason="; ".join(words),
        active=active,
        residual=residual,
        scale=answer.share,
        damping=objective.damping,
        guard=answer.blended,
        backend="" if found is None else found.backend,
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
    return left <= MET_TOLERANCE * norm(b) or left <= PRODUCT_ROUNDING * sqrt(float(np.vdot(A, A))) * norm(x)


def _status(*, degraded: bool, slow: bool, guarded: bool, limited: bool) -> Status:
    if degraded:
        return Status.DEGRADED
    if slow:
        return Status.SCALED
    return Status.GUARDED if guarded else Status.LIMITED if limited else Status.OK


def _missed(demand: Demand, problem: Posed, x: Array) -> float:
    """The share of the measured twist that x misses, 0 where it is met but for rounding.

    Of fewer than six joints, and beside exact rows, the share of what is left for them to do.
    """
    wanted, A = problem.wanted, demand.root.dot(demand.J)
    if is_met(A, wanted, x):
        return 0.0
    if (problem.reduction is not None or A.shape[1] < 6) and problem.spectrum is not None:
        U, sigma, _, largest = problem.spectrum
        fixed = np.zeros(6) if problem.reduction is None else problem.A.dot(problem.reduction.full)
        done = U[:, : len(sigma)][:, sigma > NULL_RATIO * largest]
        wanted = fixed + done.dot((wanted - fixed).dot(done))
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


def _row_troubles(demand: Demand, problem: Posed) -> list[str]:
    """What of the exact rows no velocity meets, here or anywhere."""
    troubles = list(filter(None, [unkept(problem.reduction)]))
    beyond = 0.0 if problem.reduction is None else problem.reduction.beyond
    if beyond > UNMET_TOLERANCE:
        troubles.append(f"this arm can keep {demand.row_rank} of the exact rows: {beyond:.1e} of the demand is unmet")
    return troubles


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
