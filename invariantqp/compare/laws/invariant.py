"""Our law as it is shipped, and its parts: the closed forms, the damped forms, and the law with a metric of the tool.

    closed forms   Gram + LDL'  (J'Q_h J) x = J'Q_h s,   factored  J^{+h} s,   eigen  V diag(1/mu) V'J'Q_h s
    damped         V diag(mu / (mu^2 + lambda^2)) V'J'Q_h s
    body inertia   the same law with J'WJ, where W is the inertia of the tool

Reference: [DS] Theorem 2.2, (2.14), (6.4).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from invariantqp.compare.method import Method, Setting, Solve
from invariantqp.compare.names import FACTORED, GRAM, OURS, UNGUARDED
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.runs.controllers import our_controller
from invariantqp.systems.pseudoinverse import pseudoinverse
from invariantqp.velocity.damping import Damping, Fixed, PaperLambda, Selective
from invariantqp.velocity.forms import CarriedMetric, PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.solve import solve

# lambda of the fixed filter [m]: the square of the usual damping of least squares, since mu is like sigma^2.
FIXED_DAMPING = 0.0025
# lambda in Lambda = lambda I of [DS] [m]: the value that scripts use in damped least squares.
PAPER_LAMBDA = 0.05


def _by(law: VelocityLaw) -> Solve:
    return lambda J, s, lower, upper: solve(law, Demand(J, s, lower, upper)).velocity


def _ours(setting: Setting) -> Solve:
    return _by(VelocityLaw(PitchForm(setting.pitch), dt=setting.dt))


def _unguarded(setting: Setting) -> Solve:
    return _by(VelocityLaw(PitchForm(setting.pitch), guard=None))


def _inertia(setting: Setting) -> Solve:
    return _by(VelocityLaw(CarriedMetric(setting.inertia, setting.body), guard=None))


def _unlimited(setting: Setting, damping: Damping) -> Solve:
    """V diag(filter(mu)) V'J'Q_h s without limits, guard or any later step of the law."""
    law = VelocityLaw(PitchForm(setting.pitch), damping=damping)
    return lambda J, s, lower, upper: law.build(Demand(J, s, lower, upper)).unconstrained()


def _eigen(setting: Setting) -> Solve:
    return _unlimited(setting, Fixed(0.0))


def _fixed(setting: Setting) -> Solve:
    return _unlimited(setting, Fixed(FIXED_DAMPING * setting.unit))


def _selective(setting: Setting) -> Solve:
    return _unlimited(setting, Selective())


def _gram(setting: Setting) -> Solve:
    Q = pitch_form(setting.pitch)

    def symmetric(A: Array, b: Array) -> Array:
        _, _, x, info = lapack.dsysv(A, b)
        if info != 0:
            raise np.linalg.LinAlgError("LDL' found a zero pivot: h is a principal pitch, or the arm is singular")
        return np.asarray(x)

    def velocity(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
        if setting.m > 6:  # J'QJ has rank 6 at most: by [DS] (2.14) the answer is J'(JJ')^-1 s, whatever h is
            return np.asarray(symmetric(J.dot(J.T), s).dot(J))
        QJ = Q.dot(J)
        return symmetric(J.T.dot(QJ), s.dot(QJ))

    return velocity


def _factored(setting: Setting) -> Solve:
    h = setting.pitch
    return lambda J, s, _lower, _upper: np.asarray(pseudoinverse(J, h).dot(s))


def _as_printed(setting: Setting) -> Solve:
    return _by(VelocityLaw(PitchForm(setting.pitch), damping=PaperLambda(PAPER_LAMBDA * setting.unit)))


METHODS = [
    Method(
        name=OURS,
        family="invariant",
        limits="inside",
        why="this library's law as it is shipped: closed form, or convex QP with prices and descent guard",
        make=_ours,
        frame="base",
        problem="adaptive",
        limited="adaptive box",
        system=our_controller,
    ),
    Method(
        name=UNGUARDED,
        family="invariant",
        limits="inside",
        why="the same without descent guard and residual damping: the optimum of the form, or of the convex QP",
        make=_unguarded,
        frame="base",
        problem="adaptive",
        limited="adaptive box",
    ),
    Method(
        name=GRAM,
        family="invariant",
        limits="clipped",
        why="(J'Q_h J) x = J'Q_h s by LDL', with JJ' for more than six joints; it squares cond(J) ([DS] 3.1)",
        make=_gram,
        frame="base",
        problem="pitch",
        limited="adaptive box",
        group="h, closed form",
    ),
    Method(
        name=FACTORED,
        family="invariant",
        limits="clipped",
        why="J^{+h} s from an orthonormal basis of the span of J, which does not square cond(J)",
        make=_factored,
        frame="base",
        problem="pitch",
        limited="adaptive box",
        group="h, closed form",
    ),
    Method(
        name="h, eigen",
        family="invariant",
        limits="clipped",
        why="V diag(1/mu) V'J'Q_h s from the eigenvalues of the Gram matrix",
        make=_eigen,
        frame="base",
        problem="pitch",
        limited="adaptive box",
        group="h, closed form",
    ),
    Method(
        name="h, damped",
        family="invariant",
        limits="clipped",
        why="the invariant filter mu / (mu^2 + lambda^2) with lambda = 0.0025 m in every state",
        make=_fixed,
        frame="base",
        problem="filter",
        group="h, damped",
    ),
    Method(
        name="h, selectively damped",
        family="invariant",
        limits="clipped",
        why="each eigendirection damped on its own, so that it asks for at most 1 rad/s",
        make=_selective,
        frame="base",
        group="h, damped",
    ),
    Method(
        name="h, [DS] Lambda",
        family="invariant",
        limits="clipped",
        why="(J'Q_h J + lambda I)^-1 J'Q_h s with lambda = 0.05 m as in [DS] (6.4), which is not always a damping",
        make=_as_printed,
        frame="base",
        group="h, damped",
    ),
    Method(
        name="body inertia",
        family="invariant",
        limits="inside",
        why="least squares in the metric of the tool's inertia: no frame changes it, but the choice of a body does",
        make=_inertia,
        problem="inertia",
        limited="inertia box",
    ),
]
