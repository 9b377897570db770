"""Our law as it is shipped, the same with a pitch form or a body's metric, and what [DS] has: closed and damped forms.

    closed forms   Gram + LDL'  (J'Q_h J) x = J'Q_h s,   factored  J^{+h} s,   eigen  V diag(1/mu) V'J'Q_h s
    damped         V diag(mu / (mu^2 + lambda^2)) V'J'Q_h s
    convexified    minimise (x - x*)'V diag(sqrt(mu^2 + lambda^2)) V'(x - x*) inside the limits, x* the damped form

Reference: [DS] Theorem 2.2, (2.14), (6.4).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from invariantqp.compare.laws.setting import pitch_of
from invariantqp.compare.method import Method, Setting, Solve
from invariantqp.compare.names import CONVEXIFIED, FACTORED, GRAM, OURS, OURS_PITCH
from invariantqp.control.controller import Controller
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import our_controller
from invariantqp.runs.taskfile import LawSpec
from invariantqp.systems.pseudoinverse import pseudoinverse
from invariantqp.velocity.damping import Damping, Fixed, PaperLambda, Selective
from invariantqp.velocity.forms import CarriedMetric, PitchForm
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.solve import solve
from invariantqp.velocity.stationary import convexified

# lambda of the fixed filter [m]: the square of the usual damping of least squares, since mu is like sigma^2.
FIXED_DAMPING = 0.0025
# lambda in Lambda = lambda I of [DS] [m]: the value that scripts use in damped least squares.
PAPER_LAMBDA = 0.05


def _by(law: VelocityLaw, root: Array) -> Solve:
    return lambda J, s, lower, upper: solve(law, Demand(J, s, root, lower, upper)).velocity


def _at_point(setting: Setting) -> Array:
    return root_at(setting.point, setting.length)


def _ours(setting: Setting) -> Solve:
    return _by(VelocityLaw(metric=setting.joint_metric, dt=setting.dt), _at_point(setting))


def _ours_pitch(setting: Setting) -> Solve:
    law = VelocityLaw(PitchForm(setting.pitch), metric=setting.joint_metric, dt=setting.dt)
    return _by(law, _at_point(setting))


def pitch_controller(robot: Robot, law: LawSpec) -> Controller:
    """Our controller with the pitch of the comparison."""
    return our_controller(robot, law.model_copy(update={"form": pitch_of(robot, law)}))


def _inertia(setting: Setting) -> Solve:
    root = CarriedMetric(setting.inertia, setting.body).root()
    return _by(VelocityLaw(metric=setting.joint_metric), root)


def _convexified(setting: Setting) -> Solve:
    return _by(VelocityLaw(PitchForm(setting.pitch, convexified=True)), np.eye(6))


def _unlimited(setting: Setting, damping: Damping) -> Solve:
    """V diag(filter(mu)) V'J'Q_h s, without limits."""
    return lambda J, s, _lower, _upper: convexified(J, s, setting.pitch, None, damping).centre()


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
    law = VelocityLaw(PitchForm(setting.pitch), damping=PaperLambda(PAPER_LAMBDA * setting.unit))
    return _by(law, np.eye(6))


METHODS = [
    Method(
        name=OURS,
        family="invariant",
        limits="inside",
        why="this library's law as it is shipped: least squares at the told point, in closed form or inside the limits",
        make=_ours,
        problem="law",
        limited="law",
        system=our_controller,
    ),
    Method(
        name=OURS_PITCH,
        family="invariant",
        limits="inside",
        why="the same with a pitch form, which says what is attempted of a twist beyond the joints, and its guard",
        make=_ours_pitch,
        system=pitch_controller,
    ),
    Method(
        name=CONVEXIFIED,
        family="invariant",
        limits="inside",
        why="[DS]'s own problem made convex: |J'Q_h J| in the place of a metric at a point",
        make=_convexified,
        frame="base",
        problem="convexified",
        limited="convexified",
    ),
    Method(
        name=GRAM,
        family="invariant",
        limits="clipped",
        why="(J'Q_h J) x = J'Q_h s by LDL', with JJ' for more than six joints; it squares cond(J) ([DS] 3.1)",
        make=_gram,
        frame="base",
        problem="pitch",
        limited="convexified",
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
        limited="convexified",
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
        limited="convexified",
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
        limited="inertia",
    ),
]
