"""One tick of the law: closed form where no limit is met, otherwise the optimum of the same problem inside them.

    no limit active    singular values, damped (`objective`)
    otherwise          QPs, stage by stage (`stages`)

The compiled core, where there is one, is asked first (`compiled`): it computes the same, sooner.

Continuity. Each answer is the optimum of one strictly convex problem whose data are continuous in (J, s, limits). The
first case computes its optimum without limits, which is the optimum of the second wherever it is inside them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

import numpy as np

from invariantqp.velocity.compiled import compiled
from invariantqp.velocity.damping import Damping, PaperLambda
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.posed import posed
from invariantqp.velocity.qp.backends import SolverFailure
from invariantqp.velocity.report import reported
from invariantqp.velocity.solution import Status, VelocitySolution, clipped, held
from invariantqp.velocity.stages import answered
from invariantqp.velocity.stationary import printed

NO_NUMBERS = "the numbers are too large or too small to compute with"


def solve(law: VelocityLaw, demand: Demand) -> VelocitySolution:
    """The joint velocity for a checked demand."""
    answer = compiled(law, demand)
    if answer is not None:
        return answer
    return computed(demand, lambda: _answer(law, demand))


def computed(demand: Demand, answer: Callable[[], VelocitySolution]) -> VelocitySolution:
    """An answer that is a number; status "held" where none is found, or the arithmetic overflows or divides by zero."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            found = answer()
    except SolverFailure as failure:
        return held(demand, f"no velocity found: {failure}")
    except (ArithmeticError, np.linalg.LinAlgError) as failure:
        return held(demand, f"{NO_NUMBERS}: {failure}")
    return found if all(map(isfinite, found.velocity.tolist())) else held(demand, NO_NUMBERS)


def _answer(law: VelocityLaw, demand: Demand) -> VelocitySolution:
    """By this package's own Python."""
    damping = law.damping
    if isinstance(damping, PaperLambda):
        return _as_printed(law, damping, demand)
    return _general(law, demand, damping)


def standing(law: VelocityLaw, demand: Demand, reason: str) -> VelocitySolution:
    """Standing still or, where limits do not allow that, the least motion back inside them."""
    still = held(demand, reason)
    if demand.allows(still.velocity):
        return still
    back = solve(law, demand._replace(s=np.zeros(6), exact=None, posture=None, chase=None))
    return back._replace(status=Status.HELD, reason=f"{reason}; moving back inside the limits".removeprefix("; "))


def _general(law: VelocityLaw, demand: Demand, damping: Damping) -> VelocitySolution:
    problem = posed(law, demand, damping)
    answer = answered(law, demand, problem)
    if law.to_joint is not None:
        answer = answer._replace(y=law.to_joint.dot(answer.y))
    return reported(demand, problem, answer)


def _as_printed(law: VelocityLaw, damping: PaperLambda, demand: Demand) -> VelocitySolution:
    """[DS]'s own formula, clipped to the bounds; it supports no other limits and no exact rows."""
    if demand.exact is not None:
        return held(demand, "PaperLambda does not support exact rows; use another damping")
    if demand.rows is not None or demand.cone is not None:
        return held(demand, "PaperLambda supports no limits but the bounds; use another damping")
    if not isinstance(law.form, PitchForm):
        return held(demand, "PaperLambda needs a pitch form: give form=h")
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
    status = Status.DEGRADED if reasons else Status.OK
    return VelocitySolution(bounded, "damped", status, "; ".join(reasons), active, residual, 1.0, size, 0.0, "")
