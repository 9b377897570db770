"""Least squares inside the limits, and our law's QP as one QP solver after the other answers it.

    minimise 1/2 |s - Jx|^2 + mu/2 |x|^2      or      minimise 1/2 |K (x - x*)|^2,    lower <= x <= upper

Our law takes from a solver which limits are active and computes the numbers itself; here the solver's numbers are
taken. A solver that finds no answer raises SolverFailure; no second solver takes over. An answer that leaves its bounds
by the solver's tolerance is clipped by the control loop.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from invariantqp.compare.laws.least_squares_law import LeastSquaresLaw
from invariantqp.compare.method import Method, Setting, Solve
from invariantqp.compare.names import DAQP, LEAST_SQUARES, TOLD_LEAST_SQUARES
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.damping import Adaptive
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.objective import least_squares, spectrum_of
from invariantqp.velocity.qp.backends import Backend, Daqp, Osqp, QpSolvers
from invariantqp.velocity.qp.cones import Cvxpy
from invariantqp.velocity.qp.scaling import BoxQP, scaled

# mu: keeps J'J + mu I positive definite; a usual value in scripts and with Pink.
QP_DAMPING = 1e-6
OSQP_TOLERANCES = (1e-3, 1e-5, 1e-8)


def _least_squares(setting: Setting) -> Solve:
    ridge, daqp = QP_DAMPING * np.eye(setting.m), Daqp()
    return lambda J, s, lower, upper: daqp.solve(BoxQP(J.T.dot(J) + ridge, s.dot(J), lower, upper, None))


def _by(make_backend: Callable[[], Backend]) -> Callable[[Setting], Solve]:
    def make(setting: Setting) -> Solve:
        backend, damping, root = make_backend(), Adaptive(), root_at(setting.point, setting.length)

        def velocity(J: Array, s: Array, lower: Array, upper: Array) -> Array:
            objective = least_squares(spectrum_of(root.dot(J)), root.dot(s), None, damping)
            centre = objective.centre()
            if (centre >= lower).all() and (centre <= upper).all():
                return centre
            qp, size = scaled(objective.quadratic().K, None, lower - centre, upper - centre)
            return centre + size * backend.solve(qp)

        return velocity

    return make


def _method(
    name: str, why: str, make_backend: Callable[[], Backend], needs: tuple[str, ...] = (), group: str = ""
) -> Method:
    return Method(
        name=name,
        family="QP",
        limits="inside",
        why=f"the QP of this library's law, with the numbers of {why}",
        make=_by(make_backend),
        problem="measured",
        limited="measured",
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
    Method(
        name=TOLD_LEAST_SQUARES,
        family="QP",
        limits="inside",
        why="a hand-written least-squares QP told all that our law is told: point, length, posture, exact rows; damped "
        "by what is missed (Sugihara 2011)",
        system=LeastSquaresLaw,
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
