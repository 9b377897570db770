"""Least squares inside the limits, and the invariant law's own convex QP by each solver, with no second one behind it.

    minimise 1/2 |s - Jx|^2 + mu/2 |x|^2      and      minimise 1/2 x'Hx - c'x,    lower <= x <= upper

A solver that finds nothing raises SolverFailure; what leaves its bounds by a loose tolerance is clipped by the loop.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from invariantqp.compare.methods import Method, Setting, Solve
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.forms import PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits.rows import Polytope
from invariantqp.velocity.qp.backends import Backend, Daqp, Osqp, QpSolvers, answer
from invariantqp.velocity.qp.cones import Cvxpy

# What keeps J'J positive definite in a least-squares QP, as scripts and Pink's users choose it.
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
        name=f"QP, {name}",
        family="QP",
        limits="inside",
        why=f"the invariant law's convex QP by {why}",
        make=_by(make_backend),
        frame="base",
        problem="adaptive",
        limited="adaptive box",
        needs=needs,
        group=group,
    )


def _osqp(tolerance: float, *, polishing: bool, warm: bool) -> Method:
    start, end = "warm" if warm else "cold", ", polished" if polishing else ""
    return _method(
        f"OSQP {tolerance:.0e}, {start}{end}".replace("e-0", "e-"),
        f"OSQP at {tolerance:.0e} with its workspace kept, {start} started{end}",
        lambda: Osqp(tolerance=tolerance, polishing=polishing, warm=warm),
        group=f"OSQP, {start}{end}",
    )


METHODS = [
    Method(
        name="least-squares QP",
        family="QP",
        limits="inside",
        why="least squares inside the limits with mu = 1e-6, by DAQP: what Pink and scripts solve",
        make=_least_squares,
        problem="ridge",
        limited="least squares box",
    ),
    _method("DAQP", "DAQP, a dual active set", Daqp),
    *(_osqp(eps, polishing=p, warm=w) for w, p, eps in product((True, False), (False, True), OSQP_TOLERANCES)),
    _method(
        "ProxQP",
        "ProxQP, a proximal augmented Lagrangian, through qpsolvers",
        lambda: QpSolvers("proxqp"),
        ("proxsuite",),
    ),
    _method("PIQP", "PIQP, a proximal interior point, through qpsolvers", lambda: QpSolvers("piqp"), ("piqp",)),
    _method(
        "quadprog",
        "quadprog, Goldfarb and Idnani's dual active set, through qpsolvers",
        lambda: QpSolvers("quadprog"),
        ("quadprog",),
    ),
    _method("Clarabel", "Clarabel, an interior point, through qpsolvers", lambda: QpSolvers("clarabel"), ("clarabel",)),
    _method("HiGHS", "HiGHS, an active set, through qpsolvers", lambda: QpSolvers("highs"), ("highspy",)),
    _method("CVXPY", "CVXPY with Clarabel, written once in parameters", Cvxpy, ("cvxpy",)),
]
