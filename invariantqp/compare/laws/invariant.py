"""Our law and its parts: what is commanded, the closed forms by themselves, the damped family, the body-inertia metric.

    closed forms   Gram + LDL'  (J'Q_h J) x = J'Q_h s,   factored  J^{+h} s,   eigen  V diag(1/mu) V'J'Q_h s
    damped         V diag(mu / (mu^2 + lambda^2)) V'J'Q_h s
    body inertia   the same law with J'WJ, W the tool's inertia carried along

Reference: [DS] Theorem 2.2, (2.14), (6.4).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from invariantqp.compare.methods import Method, Setting, Solve
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.runs.controllers import our_controller
from invariantqp.systems.pseudoinverse import pseudoinverse
from invariantqp.velocity.damping import Damping, Fixed, None_, PaperLambda, Selective
from invariantqp.velocity.forms import CarriedMetric, PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.solve import solve

OURS = "invariantqp"
# lambda of the fixed filter, about the square of what damped least squares has [m].
FIXED_DAMPING = 0.0025
# [DS]'s Lambda = lambda I, with a lambda that a reader of the paper would try [m].
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
    """The spectrum of G, filtered, and nothing after it."""
    law = VelocityLaw(PitchForm(setting.pitch), damping=damping)
    return lambda J, s, lower, upper: law.build(Demand(J, s, lower, upper)).unconstrained()


def _eigen(setting: Setting) -> Solve:
    return _unlimited(setting, None_)


def _fixed(setting: Setting) -> Solve:
    return _unlimited(setting, Fixed(FIXED_DAMPING * setting.unit))


def _selective(setting: Setting) -> Solve:
    return _unlimited(setting, Selective())


def _gram(setting: Setting) -> Solve:
    Q = pitch_form(setting.pitch)

    def symmetric(A: Array, b: Array) -> Array:
        _, _, x, info = lapack.dsysv(A, b)
        if info != 0:
            raise np.linalg.LinAlgError("LDL' met a zero pivot: h is a principal pitch, or the arm is singular")
        return np.asarray(x)

    def velocity(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
        if setting.m > 6:  # J'QJ has rank 6 at most; by [DS] (2.14) the answer is J'(JJ')^-1 s for every h
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
        why="the law as it is commanded: closed form, or convex QP with prices and descent guard",
        make=_ours,
        frame="base",
        problem="adaptive",
        limited="adaptive box",
        system=our_controller,
    ),
    Method(
        name="invariantqp, no guard",
        family="invariant",
        limits="inside",
        why="the same without the descent guard: the stationary point of the form, or of the convex QP, itself",
        make=_unguarded,
        frame="base",
        problem="adaptive",
        limited="adaptive box",
    ),
    Method(
        name="h, Gram + LDL'",
        family="invariant",
        limits="clipped",
        why="(J'Q_h J) x = J'Q_h s by LDL', JJ' in its place above six joints; it squares cond(J) ([DS] 3.1)",
        make=_gram,
        frame="base",
        problem="pitch",
        limited="adaptive box",
        group="h, closed form",
    ),
    Method(
        name="h, factored",
        family="invariant",
        limits="clipped",
        why="J^{+h} s from an orthonormal basis of J's span, which keeps the digits that the Gram matrix loses",
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
        why="V diag(1/mu) V'J'Q_h s from the spectrum of the Gram matrix",
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
        why="the invariant filter mu / (mu^2 + lambda^2) with lambda = 0.0025 m everywhere",
        make=_fixed,
        frame="base",
        problem="filter",
        group="h, damped",
    ),
    Method(
        name="h, selectively damped",
        family="invariant",
        limits="clipped",
        why="each direction of the spectrum damped by itself, to at most 1 rad/s",
        make=_selective,
        frame="base",
        group="h, damped",
    ),
    Method(
        name="h, [DS] Lambda",
        family="invariant",
        limits="clipped",
        why="(J'Q_h J + lambda I)^-1 J'Q_h s with lambda = 0.05 m as [DS] (6.4) prints it, which is not damping",
        make=_as_printed,
        frame="base",
        group="h, damped",
    ),
    Method(
        name="body inertia",
        family="invariant",
        limits="inside",
        why="least squares in the tool's own inertia: invariant too, but tied to the choice of a body",
        make=_inertia,
        problem="inertia",
        limited="inertia box",
    ),
]
