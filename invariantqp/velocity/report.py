"""The solution that a tick returns: the velocity as it may be commanded, its status, and the reason in words.

"degraded"   demands contradict limits or the arm, damping gives up part of the twist, or no velocity reduces the error
"scaled"     limits slow the exact rows down
"guarded"    the descent guard blended in least squares
"ok"         none of these
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm
from invariantqp.velocity.law import Demand
from invariantqp.velocity.objective import Objective
from invariantqp.velocity.posed import Posed
from invariantqp.velocity.qp.quadratic import ACTIVE_TOLERANCE, named
from invariantqp.velocity.solution import VelocitySolution, clipped
from invariantqp.velocity.stages import UNMET_TOLERANCE, Answer, unkept

# A twist is met where the residual is less than this share of it ...
MET_TOLERANCE = 1e-9
# ... or less than the rounding of J x itself: an arm rests on its target while its null space moves.
PRODUCT_ROUNDING = 1e-14
# The solution is "degraded" where damping gives up more than this share of a twist that the joints could do.
LOSS_TOLERANCE = 1e-6
# Exact rows at this share of their speed count as not slowed down: regularising the share takes 1e-7 of it.
WHOLE_SPEED = 1.0 - 1e-6
# A velocity that achieves less than this share of the twist makes no progress.
PROGRESS_SHARE = 1e-4


def reported(demand: Demand, problem: Posed, answer: Answer) -> VelocitySolution:
    """The solution for an answer in joint velocities x."""
    objective, found = answer.objective, answer.found
    slow = answer.share < WHOLE_SPEED
    x, active = clipped(demand, _shortened(demand, answer.y))
    residual = demand.s - demand.J.dot(x)
    size = sqrt(float(problem.wanted.dot(problem.wanted)))
    lost = objective.lost > LOSS_TOLERANCE * size
    troubles = [*answer.troubles, *_row_troubles(demand, problem)]
    if _is_stuck(demand, problem.wanted, x, answer.share):
        troubles.append("no velocity reduces the error: it is the least that these joints and limits allow")
    words = list(troubles)
    if slow:
        by = f" (held by {answer.held_by})" if answer.held_by else ""
        words.append(f"limits allow {answer.share:.3g} of the exact rows' speed{by}")
        words.extend(filter(None, [answer.beside]))
    if answer.blended > 0.0:
        words.append(f"descent guard: {answer.blended:.3g} of least squares blended in")
    if objective.damping > 0.0:
        words.append(damping_reason(objective) + (_loss_words(objective.lost, size) if lost else ""))
    if active:
        words.append(f"at the limits of {named(list(active), len(x))}")
    multipliers, row_multipliers = _multipliers(demand, answer)
    return VelocitySolution(
        velocity=x,
        method="qp" if slow or found is not None else "damped" if objective.damping > 0.0 else "closed-form",
        status=_status(degraded=bool(troubles) or lost, slow=slow, guarded=answer.blended > 0.0),
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


def _status(*, degraded: bool, slow: bool, guarded: bool) -> str:
    return "degraded" if degraded else "scaled" if slow else "guarded" if guarded else "ok"


def _loss_words(lost: float, size: float) -> str:
    """How much damping gives up; without a wanted twist, it is of what the exact rows leave to correct."""
    return f": {lost / size:.2g} of the twist is given up" if size > 0.0 else ": part of the motion is given up"


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
