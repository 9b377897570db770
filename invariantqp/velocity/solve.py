"""One tick of the law: closed form where no limit is met, otherwise the optimum of the same problem inside them.

    six joints or more, far from singular, no limit met    one Cholesky factor (`regular`)
    no limit met                                           the spectrum, filtered (`objective`)
    otherwise                                              stage by stage (`stages`)

Continuity. Each answer is the optimum of one strictly convex problem whose data are continuous in (J, s, limits): the
first two are its optimum without limits, which is the third's wherever it is inside them.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.calm import spoilt
from invariantqp.velocity.damping import Damping, PaperLambda
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.objective import Objective
from invariantqp.velocity.posed import Posed, posed
from invariantqp.velocity.qp.backends import SolverFailure
from invariantqp.velocity.qp.polytope import ACTIVE_TOLERANCE, named
from invariantqp.velocity.regular import regular_velocity
from invariantqp.velocity.solution import VelocitySolution, clipped, held
from invariantqp.velocity.stages import UNMET_TOLERANCE, Answer, answered, unkept
from invariantqp.velocity.stationary import printed

# A twist missed by less than this fraction of itself is achieved ...
MET_TOLERANCE = 1e-9
# ... and so is one missed by what rounding leaves of x in J x: an arm rests on its target while its null space moves.
PRODUCT_ROUNDING = 1e-14
# Damping that takes more than this share of a twist that the joints could do is said.
LOSS_TOLERANCE = 1e-6
# Exact rows at this share of their speed are not called slowed down: what makes the share unique takes 1e-7 of it.
WHOLE_SPEED = 1.0 - 1e-6
# Less than this share of what is asked is no progress: the loop is at rest short of its target.
PROGRESS_SHARE = 1e-4


def solve(law: VelocityLaw, demand: Demand) -> VelocitySolution:
    """The joint velocity for a checked demand."""
    damping = law.damping
    if isinstance(damping, PaperLambda):
        return _as_printed(law, damping, demand)
    quick = _quick(law, demand, damping) if law.metric is None and not _is_convexified(law) else None
    if quick is not None:
        return quick
    try:
        return _general(law, demand, damping)
    except SolverFailure as failure:
        return held(demand, f"no velocity found: {failure}")
    except np.linalg.LinAlgError as failure:
        return held(demand, f"the numbers are beyond any scale: {failure}")


def _quick(law: VelocityLaw, demand: Demand, damping: Damping) -> VelocitySolution | None:
    """The closed form by one Cholesky factor where nothing is damped, no limit met, nothing spoilt; None elsewhere."""
    A, b = demand.root.dot(demand.J), demand.root.dot(demand.s)
    x = regular_velocity(A, b, demand.posture, damping.threshold)
    if x is None or not (demand.allows(x) and demand.achieves(x) and _is_rounding(A, b, x)):
        return None
    if spoilt(A, b, sqrt(float(x.dot(x))), law.dt) > 0.0:
        return None
    residual = demand.s - demand.J.dot(x)
    return VelocitySolution(x, "closed-form", "ok", law.note, (), residual, 1.0, 0.0, 0.0, "")


def standing(law: VelocityLaw, demand: Demand, reason: str) -> VelocitySolution:
    """At rest; in a box that leaves none on the way back, its joints alone, or all where other limits ask for it."""
    still = held(demand, reason)
    if demand.allows(still.velocity):
        return still
    back = solve(law, demand._replace(s=np.zeros(6), exact=None, posture=None))
    return back._replace(status="held", reason=f"{reason}; on the way back inside the limits".removeprefix("; "))


def damping_reason(objective: Objective) -> str:
    """Why lambda is not zero, "" where it is."""
    if objective.damping == 0.0:
        return ""
    return f"near a singularity: the weakest direction has {objective.ratio:.1e} of the strongest, damped"


def _general(law: VelocityLaw, demand: Demand, damping: Damping) -> VelocitySolution:
    problem = posed(law, demand, damping)
    answer = answered(law, demand, problem)
    if law.to_joint is not None:
        answer = answer._replace(y=law.to_joint.dot(answer.y))
    return _told(law, demand, problem, answer)


def _told(law: VelocityLaw, demand: Demand, problem: Posed, answer: Answer) -> VelocitySolution:
    """The answer as it may be commanded, with its status and reason."""
    slow = answer.share < WHOLE_SPEED
    met = answer.found is not None or slow
    method = "qp" if met else "damped" if answer.objective.damping > 0.0 else "closed-form"
    x, active = clipped(demand, _shortened(demand, answer.y))
    residual = demand.s - demand.J.dot(x)
    troubles = list(answer.troubles)
    objective = answer.objective
    if direction := unkept(problem.reduction):
        troubles.append(direction)
    beyond = 0.0 if problem.reduction is None else problem.reduction.beyond
    if beyond > UNMET_TOLERANCE:
        troubles.append(
            f"this arm can keep {demand.row_rank} of the exact rows: {beyond:.1e} of the demand is beyond it"
        )
    wanted, missed = demand.root.dot(demand.s), demand.root.dot(residual)
    size = float(np.linalg.norm(wanted))
    lost = objective.lost > LOSS_TOLERANCE * size
    rows_move = demand.exact is not None and answer.share > PROGRESS_SHARE
    stuck = (
        not rows_move
        and wanted.dot(wanted - missed) < PROGRESS_SHARE * size * size
        and not _is_rounding(demand.root.dot(demand.J), wanted, x)
    )
    if stuck:
        troubles.append("no way to reduce the error: it is at its least for these joints and limits")
    said = [law.note, *troubles] if law.note else troubles[:]
    if slow:
        by = f" (held by {answer.held_by})" if answer.held_by else ""
        said.append(f"limits allow {answer.share:.3g} of the exact rows' speed{by}")
    if answer.blended > 0.0:
        said.append(f"descent guard: {answer.blended:.3g} of least squares blended in")
    if objective.damping > 0.0:
        said.append(
            damping_reason(objective) + (f": {objective.lost / size:.2g} of the twist is given up" if lost else "")
        )
    if active:
        said.append(f"at the limits of {named(list(active), len(demand.lower))}")
    status = "degraded" if troubles or lost else "scaled" if slow else "ok"
    m, k = len(x), 0 if demand.rows is None else len(np.asarray(demand.rows.C))
    costs = None if answer.found is None else answer.found.multipliers
    return VelocitySolution(
        velocity=x,
        method=method,
        status="guarded" if status == "ok" and answer.blended > 0.0 else status,
        reason="; ".join(said),
        active=active,
        residual=residual,
        scale=answer.share,
        damping=objective.damping,
        guard=answer.blended,
        backend="" if answer.found is None else answer.found.backend,
        multipliers=None if costs is None else costs[:m],
        row_multipliers=None if costs is None or not k else costs[m : m + k],
    )


def _is_convexified(law: VelocityLaw) -> bool:
    return isinstance(law.form, PitchForm) and law.form.convexified


def _is_rounding(A: Array, b: Array, x: Array) -> bool:
    """Whether what x leaves of the twist is rounding."""
    r = b - A.dot(x)
    missed = float(r.dot(r))
    return bool(missed <= MET_TOLERANCE**2 * b.dot(b) or missed <= PRODUCT_ROUNDING**2 * np.vdot(A, A) * x.dot(x))


def _shortened(demand: Demand, x: Array) -> Array:
    """The velocity shortened by what rounding is over rows and cone, where standing still is inside them."""
    rows, cone = demand.rows, demand.cone
    share = 1.0 if rows is None else rows.share(x)
    if cone is not None:
        share = min(share, cone.limit / max(cone.limit, cone.speed(x)))
    return share * x if 1.0 > share > 1.0 - ACTIVE_TOLERANCE else x


def _as_printed(law: VelocityLaw, damping: PaperLambda, demand: Demand) -> VelocitySolution:
    """[DS]'s own formula, clipped to the bounds; exact rows are beyond it."""
    if demand.exact is not None:
        return held(demand, "PaperLambda knows no exact rows; use another damping")
    if demand.rows is not None or demand.cone is not None:
        return held(demand, "PaperLambda knows no limits but the bounds; use another damping")
    if not isinstance(law.form, PitchForm):
        return held(demand, "PaperLambda goes with a pitch form; give form = h")
    Lambda = damping.of_size(demand.J.shape[1])
    if law.metric is not None:
        Lambda = law.metric.dot(Lambda)
    try:
        x, trouble = printed(demand.J, demand.s, law.form.h, Lambda, demand.posture)
    except np.linalg.LinAlgError:
        return held(demand, "G + Lambda is singular: this is the pole of [DS]'s formula")
    bounded, active = clipped(demand, x)
    reasons = [r for r in (trouble, "" if demand.allows(x) else "clipped to the bounds") if r]
    size = float(np.abs(np.asarray(damping.matrix)).max())
    residual = demand.s - demand.J.dot(bounded)
    status = "degraded" if reasons else "ok"
    return VelocitySolution(bounded, "damped", status, "; ".join(reasons), active, residual, 1.0, size, 0.0, "")
