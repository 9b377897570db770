"""One tick of the law: closed form where it exists and no bound is met, otherwise the convex QP with the same optimum.

no bound met and the twist met            -> closed form, or damped: done
otherwise                                 -> the slow path (`velocity.tick`)
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.systems.pseudoinverse import has_pseudoinverse, pseudoinverse
from invariantqp.velocity.damping import PaperLambda
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.law import Demand, Problem, VelocityLaw
from invariantqp.velocity.paper import paper_velocity
from invariantqp.velocity.regular import regular_velocity
from invariantqp.velocity.solution import VelocitySolution, clipped, damping_reason, held
from invariantqp.velocity.tick import UNMET_TOLERANCE, Tick

# A twist missed by less than this fraction of itself is met: no guard can find anything to gain there.
MET_TOLERANCE = 1e-9
# ... and so is one missed by what rounding leaves of x in J x: an arm rests on its target while its null space moves.
PRODUCT_ROUNDING = 1e-14
# Below this |mu| ratio an undamped solution is computed from the factored J, which keeps the digits that G lost.
FACTORED_RATIO = 1e-4


def solve(law: VelocityLaw, demand: Demand) -> VelocitySolution:
    """The joint velocity for a checked demand."""
    if isinstance(law.damping, PaperLambda):
        return _as_printed(law, law.damping, demand)
    x = regular_velocity(law, demand)
    if x is not None and demand.allows(x):
        residual = _missed(demand, x)
        if residual is not None:
            return VelocitySolution(x, "closed-form", "ok", law.note, (), residual, 1.0, 0.0, 0.0, "")
    problem = law.build(demand)
    convex = problem.convex
    x = problem.unconstrained()
    if convex.damping == 0.0 and convex.smallest < FACTORED_RATIO * convex.largest:
        x = _factored(law, demand, problem, x)
    if problem.reduction.unmet <= UNMET_TOLERANCE and demand.allows(x):
        residual = _missed(demand, x)
        if residual is not None:
            damped = convex.damping > 0.0
            method, reason = ("damped", damping_reason(convex)) if damped else ("closed-form", law.note)
            return VelocitySolution(x, method, "ok", reason, (), residual, 1.0, convex.damping, 0.0, "")
    return Tick(law, demand).solution(problem, x)


def standing(law: VelocityLaw, demand: Demand, reason: str) -> VelocitySolution:
    """At rest; in a box that leaves none on the way back, its joints alone, or all where other limits ask for it."""
    still = held(demand, reason)
    if demand.allows(still.velocity):
        return still
    back = solve(law, demand._replace(s=np.zeros(6), exact=None, posture=None))
    return back._replace(status="held", reason=f"{reason}; on the way back inside the limits".removeprefix("; "))


def _as_printed(law: VelocityLaw, damping: PaperLambda, demand: Demand) -> VelocitySolution:
    """[DS]'s own formula, clipped to the bounds; exact rows are beyond it."""
    if demand.exact is not None:
        return held(demand, "PaperLambda knows no exact rows; use another damping")
    if demand.rows is not None or demand.cone is not None:
        return held(demand, "PaperLambda knows no limits but the bounds; use another damping")
    try:
        x, trouble = paper_velocity(law, damping, demand)
    except np.linalg.LinAlgError:
        return held(demand, "G + Lambda is singular: this is the pole of [DS]'s formula")
    bounded, active = clipped(demand, x)
    reasons = [r for r in (trouble, "" if demand.allows(x) else "clipped to the bounds") if r]
    status = "degraded" if reasons else "ok"
    size = float(np.abs(np.asarray(damping.matrix)).max())
    residual = demand.s - demand.J.dot(bounded)
    return VelocitySolution(bounded, "damped", status, "; ".join(reasons), active, residual, 1.0, size, 0.0, "")


def _missed(demand: Demand, x: Array) -> Array | None:
    """The residual s - J x where it is rounding; None where the twist is missed."""
    s, J = demand.s, demand.J
    residual: Array = s - J.dot(x)
    missed = residual.dot(residual)
    if missed <= MET_TOLERANCE**2 * s.dot(s) or missed <= PRODUCT_ROUNDING**2 * np.vdot(J, J) * x.dot(x):
        return residual
    return None


def _factored(law: VelocityLaw, demand: Demand, problem: Problem, x: Array) -> Array:
    """The undamped closed form from the factored J, where there is one; x otherwise."""
    if demand.exact is not None or not isinstance(law.form, PitchForm) or not has_pseudoinverse(demand.J, law.form.h):
        return x
    accurate: Array = pseudoinverse(demand.J, law.form.h, joint_metric=law.metric).dot(demand.s)
    if demand.posture is None:
        return accurate
    convex, reduction = problem
    null = convex.V.dot(convex.given_up() * reduction.reduced(demand.posture).dot(convex.V))
    return accurate + reduction.joint(null)
