"""Least squares inside the limits, and the invariant law's convex QP solved by one QP solver after the other.

    minimise 1/2 |s - Jx|^2 + mu/2 |x|^2      or      minimise 1/2 x'Hx - c'x,    lower <= x <= upper

A solver that finds no answer raises SolverFailure; no second solver takes over. An answer that leaves its bounds by the
solver's tolerance is clipped by the control loop.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from invariantqp.compare.method import Method, Setting, Solve
from invariantqp.compare.names import DAQP, LEAST_SQUARES
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits.rows import Polytope
from invariantqp.velocity.qp.backends import Backend, Daqp, Osqp, QpSolvers, answer
from invariantqp.velocity.qp.cones import Cvxpy

# mu: keeps J'J + mu I positive definite; a usual value in scripts and with Pink.
QP_DAMPING = 1e-6
OSQP_TOLERANCES = (1e-3, 1e-5, 1e-8)


def _least_squares(setting: Setting) -> Solve:
    ridge, daqp = QP_DAMPING * np.eye(setting.m), Daqp()
    return lambda J, s, lower, upper: answer(daqp, J.T.dot(J) + ridge, s.dot(J), Polytope(None, lower, upper))


def _by(make_backend: Callable[[], Backend]) -> Callable[[Setting], Solve]:
    def make(setting: Setting) -> Solve:
        law, backend = VelocityLaw(PitchForm(setting.pitch)), make_backend()

        def velocity(J: Array, s: Array, lower: Array, upper: Array) -> Array:
            problem = law.build(Demand(J, s, lower, upper))
            H, c = problem.convex.qp()
            return answer(backend, H, c, Polytope(None, lower, upper))

        return velocity

    return make


def _method(
    name: str, why: str, make_backend: Callable[[], Backend], needs: tuple[str, ...] = (), group: str = ""
) -> Method:
    return Method(
        name=name,
        family="QP",
        limits="inside",
        why=f"this library's convex QP by {why}",
        make=_by(make_backend),
        frame="base",
        problem="adaptive",
        limited="adaptive box",
        needs=needs,
        extra="compare" if needs else "",
        group=group,
    )


def _osqp(tolerance: float, *, polishing: bool, warm: bool) -> Method:
    start, end = "warm" if warm else "cold", ", polished" if polishing else ""
    return _method(
        f"QP, OSQP {tolerance:.0e}, {start}{end}".replace("e-0", "e-"),
        f"OSQP at {tolerance:.0e} with its workspace kept, {start} started{end}",
        lambda: Osqp(tolerance=tolerance, polishing=polishing, warm=warm),
        group=f"OSQP, {start}{end}",
    )


def _through_qpsolvers(name: str, what: str, solver: str, module: str) -> Method:
    return _method(f"QP, {name}", f"{name}, {what}, through qpsolvers", lambda: QpSolvers(solver), (module,))


METHODS = [
    Method(
        name=LEAST_SQUARES,
        family="QP",
        limits="inside",
        why="least squares inside the limits with mu = 1e-6, by DAQP, as scripts and Pink solve it",
        make=_least_squares,
        problem="ridge",
        limited="least squares box",
    ),
    _method(DAQP, "DAQP, a dual active-set method", Daqp),
    *(_osqp(eps, polishing=p, warm=w) for w, p, eps in product((True, False), (False, True), OSQP_TOLERANCES)),
    _through_qpsolvers("ProxQP", "a proximal augmented Lagrangian method", "proxqp", "proxsuite"),
    _through_qpsolvers("PIQP", "a proximal interior-point method", "piqp", "piqp"),
    _through_qpsolvers("quadprog", "Goldfarb and Idnani's dual active-set method", "quadprog", "quadprog"),
    _through_qpsolvers("Clarabel", "an interior-point method", "clarabel", "clarabel"),
    _through_qpsolvers("HiGHS", "an active-set method", "highs", "highspy"),
    _method("QP, CVXPY", "CVXPY with Clarabel, the problem written once with parameters", Cvxpy, ("cvxpy",)),
]
