"""One tick of the law, by the compiled core or by Python; an answer is always a number, or status "held".

The compiled core, where there is one, is asked first (`compiled`): it computes the same as `tick`, sooner.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

import numpy as np

from invariantqp.geometry.arrays import NEGLIGIBLE
from invariantqp.geometry.forms import pitch_form
from invariantqp.legacy.compiled import compiled
from invariantqp.legacy.damping import PaperLambda
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.report import reported
from invariantqp.legacy.solution import clipped, held
from invariantqp.legacy.tick import answered, posed
from invariantqp.velocity.backends import SolverFailure
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.reasons import Code, Reason
from invariantqp.velocity.solution import Status, VelocitySolution


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
        return held(demand, (Reason(Code.NO_VELOCITY, words=str(failure)),))
    except (ArithmeticError, np.linalg.LinAlgError) as failure:
        return held(demand, (Reason(Code.NO_NUMBERS, words=str(failure)),))
    return found if all(map(isfinite, found.velocity.tolist())) else held(demand, (Reason(Code.NO_NUMBERS),))


def _answer(law: VelocityLaw, demand: Demand) -> VelocitySolution:
    """By this package's own Python."""
    damping = law.damping
    if isinstance(damping, PaperLambda):
        return _as_printed(law, damping, demand)
    problem = posed(law, demand, damping)
    return reported(demand, problem, answered(law, problem), law.to_joint)


def standing(law: VelocityLaw, demand: Demand, reasons: tuple[Reason, ...]) -> VelocitySolution:
    """Standing still or, where limits do not allow that, the least motion back inside them."""
    still = held(demand, reasons)
    if demand.allows(still.velocity):
        return still
    back = solve(law, demand._replace(s=np.zeros(6), exact=None, posture=None, chase=None))
    return back._replace(status=Status.HELD, reasons=(*reasons, Reason(Code.MOVING_BACK)))


def _as_printed(law: VelocityLaw, damping: PaperLambda, demand: Demand) -> VelocitySolution:
    """[DS]'s own formula x = (G + Lambda)^-1 g, clipped to the bounds; no other limits and no exact rows.

    The closed-loop gains are the eigenvalues of (G + Lambda)^-1 G; those outside [0, 1] are reported.
    """
    if demand.exact is not None:
        return held(demand, (Reason(Code.PAPER_EXACT),))
    if demand.rows is not None or demand.cone is not None:
        return held(demand, (Reason(Code.PAPER_LIMITS),))
    if not isinstance(law.form, PitchForm):
        return held(demand, (Reason(Code.PAPER_FORM),))
    Lambda = damping.of_size(demand.J.shape[1])
    if law.metric is not None:
        Lambda = law.metric.dot(Lambda)
    QJ = pitch_form(law.form.h).dot(demand.J)
    G, g = demand.J.T.dot(QJ), demand.s.dot(QJ)
    total = G + Lambda
    try:
        x = np.linalg.solve(total, g if demand.posture is None else g + Lambda.dot(demand.posture))
        gains = np.linalg.eigvals(np.linalg.solve(total, G)).real
    except np.linalg.LinAlgError:
        return held(demand, (Reason(Code.PAPER_POLE),))
    reasons = []
    bad = np.sort(gains[(gains < -NEGLIGIBLE) | (gains > 1.0 + NEGLIGIBLE)])
    if len(bad):
        reasons.append(Reason(Code.PAPER_GAINS, words=", ".join(f"{gain:.3g}" for gain in bad)))
    if not demand.allows(x):
        reasons.append(Reason(Code.PAPER_CLIPPED))
    bounded, active = clipped(demand, x)
    size = float(np.abs(np.asarray(damping.matrix)).max())
    residual = demand.s - demand.J.dot(bounded)
    status = Status.DEGRADED if reasons else Status.OK
    return VelocitySolution(bounded, "damped", status, tuple(reasons), active, residual, 1.0, size, 0.0, "")
