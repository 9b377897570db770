"""A Controller whose law is that of velocity/definition.py: to judge that law, and to read one tick of it.

Limits, delay, the approach to a target and what is remembered of the joints are the Controller's; a tick takes some
milliseconds.
"""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from invariantqp.control.controller import Controller, Observed
from invariantqp.errors import NoPseudoinverse
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.linear import TINY
from invariantqp.legacy.damping import Fixed
from invariantqp.legacy.law import Demand, VelocityLaw
from invariantqp.legacy.report import FALLING, MISSED
from invariantqp.legacy.solution import clipped, held
from invariantqp.velocity.backends import SolverFailure
from invariantqp.velocity.definition import Answer, Rows, Tick, velocity
from invariantqp.velocity.exact import whitened
from invariantqp.velocity.reasons import Code, Reason
from invariantqp.velocity.solution import Status, VelocitySolution


class DefinitionController(Controller):
    """A `Controller` by the definition; it takes the same arguments and has the same methods."""

    def __init__(self, robot: Any, **options: Any) -> None:
        """As `Controller`, which see; `engine` is "python"."""
        super().__init__(robot, **{**options, "engine": "python"})
        self._last: Array | None = None
        self._missed = 0.0

    def _solved(self, law: VelocityLaw, demand: Demand) -> VelocitySolution:
        tick = tick_of(law, demand, self._last, self._missed)
        try:
            answer = velocity(tick, law.backend)
        except (SolverFailure, NoPseudoinverse, np.linalg.LinAlgError) as failure:
            self._last, self._missed = None, 0.0
            return held(demand, (Reason(Code.NO_VELOCITY, words=str(failure)),))
        self._last, self._missed = answer.velocity, answer.missed
        return solution_of(demand, tick, answer, law.backend.name)

    def _halted(self, state: Observed, s: Array, reason: Reason) -> VelocitySolution:
        self._last, self._missed = None, 0.0
        return super()._halted(state, s, reason)


def tick_of(law: VelocityLaw, demand: Demand, before: Array | None, missed: float) -> Tick:
    """The data of a tick as the definition has it."""
    chase, m = demand.chase, demand.J.shape[1]
    ahead = demand.s if chase is None else chase.ahead
    free = np.full(m, inf)
    exact = None
    if demand.exact is not None:
        b = np.asarray(demand.exact.b)
        first = b if chase is None or chase.rows_ahead is None else chase.rows_ahead
        M = whitened(demand.exact, demand.root, demand.s)[0]
        exact = M.T.dot(np.asarray(demand.exact.A)), first.dot(M), (b - first).dot(M)
    rows = None
    if demand.rows is not None or demand.cone is not None:
        C, low, high = np.zeros((0, m)), np.zeros(0), np.zeros(0)
        names: tuple[str, ...] = ()
        if demand.rows is not None:
            C, low, high = (np.asarray(a) for a in (demand.rows.C, demand.rows.lower, demand.rows.upper))
            names = tuple(demand.rows.names)
        cone = demand.cone
        rows = Rows(C, low, high, names, None if cone is None else cone.J, inf if cone is None else cone.limit)
    return Tick(
        J=demand.J,
        root=demand.root,
        ahead=ahead,
        error=demand.s - ahead,
        lower=demand.lower,
        upper=demand.upper,
        position_lower=-free if chase is None else chase.lower,
        position_upper=free if chase is None else chase.upper,
        rows=rows,
        exact=exact,
        posture=demand.posture,
        fastest=demand.fastest,
        metric=law.metric,
        held=law.dt + demand.held,
        before=np.zeros(m) if before is None else before,
        missed=missed,
        form=law.form,
        damping=law.damping.value if isinstance(law.damping, Fixed) else 0.0,
        guard=None if law.guard is None else law.guard.fraction,
    )


def solution_of(demand: Demand, tick: Tick, answer: Answer, solver: str) -> VelocitySolution:
    """The solution of a tick, with the status and no more than the worst reason."""
    x, active = clipped(demand, answer.velocity)
    wanted, done = tick.root.dot(tick.ahead + tick.error), tick.root.dot(tick.J.dot(x))
    missed = float(np.linalg.norm(wanted - done)) / max(float(np.linalg.norm(wanted)), TINY)
    status = Status.OK if missed <= MISSED else Status.LIMITED
    if status is Status.LIMITED and tick.error.any():
        e, change = tick.root.dot(tick.error), done - tick.root.dot(tick.ahead)
        falls = [float(change[i].dot(e[i])) >= FALLING * float(e[i].dot(e[i])) for i in (slice(3), slice(3, 6))]
        status = Status.OK if all(falls) else Status.LIMITED
    if answer.share < 1.0 - 1e-6:
        status = Status.SCALED
    reasons: tuple[Reason, ...] = ()
    if answer.gave_way:
        status = Status.DEGRADED
        names, by = zip(*answer.gave_way, strict=True)
        reasons = (Reason(Code.ROWS_CONTRADICT, (), tuple(names), tuple(by)),)
    if answer.guarded < 1.0:
        reasons += (Reason(Code.GUARDED, numbers=(1.0 - answer.guarded,)),)
    residual = demand.s - demand.J.dot(x)
    used = solver if active or answer.pace < 1.0 else ""
    method = "qp" if used else "closed-form"
    return VelocitySolution(x, method, status, reasons, active, residual, answer.share, 0.0, 0.0, used)
