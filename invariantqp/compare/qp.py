"""One quadratic program a tick: a loop written by hand, least squares at a point, and scaling.

    minimise |A x - b|^2 + eps |x - x_p|^2 + mu |x|^2    inside the limits, with the exact rows C x = e
    by hand   A = J, b = s with metres and radians alike,  eps = 1e-6,  mu = 0
    else      root J, root s at the given point with the given length,  eps = 1e-9 |A|^2,
              mu = 1/8 dt |b - A x_0| |A|,  x_0 that for mu = 0                                       (Sugihara)

The posture x_p is zero for arms with up to six joints: eps is then the usual damping. Limits that forbid exact rows
slow them down by halves. All are solved by DAQP.

Reference: the examples of Pinocchio (inverse kinematics) and of DAQP; Sugihara 2011.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import daqp
import numpy as np

from invariantqp.compare.method import (
    HAND_WRITTEN,
    POSTURE_COST,
    SCALED_LEAST_SQUARES,
    AccelerationReach,
    LoopSetting,
    Method,
    Solve,
    Takes,
    TickInputs,
    answer,
    in_loop,
    posture_of,
)
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import RobotModelError
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.backends import BoxQP, Daqp, SolverFailure
from invariantqp.velocity.damping import CALM
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.solution import VelocitySolution


class HandWritten:
    """Pinocchio and DAQP as a user writes it by hand: one call after the other, nothing shared with this library."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """For a robot with a Pinocchio model."""
        import pinocchio

        self.pin = pinocchio
        self.model: Any = getattr(robot, "model", None)
        if self.model is None:
            raise RobotModelError("the hand-written loop needs a robot with a Pinocchio model")
        self.data, self.frame = self.model.createData(), self.model.getFrameId(robot.tool)  # type: ignore[attr-defined]
        self.rate, self.gain = 1.0 / law.dt, tracking_gain(law.gain, law.dt, law.delay)
        self.low, self.high, self.speed = robot.position_lower, robot.position_upper, robot.velocity_limit
        self.slowest = -self.speed
        self.middle, pull = posture_of(robot, law)
        self.weight = POSTURE_COST**2  # a usual value in scripts
        self.weighted_pull = self.weight * pull
        m = len(self.middle)
        self.reach = AccelerationReach(law, m)
        self.H = np.empty((m, m))
        self.diagonal = self.H.ravel()[:: m + 1]
        self.exact, self.point = law.exact is not None, np.asarray(law.point)
        self.at_point = np.hstack((np.eye(3), -pinocchio.skew(self.point)))  # from a twist to the velocity of the point
        self.rows, self.still = np.zeros((0, m)), np.zeros(6)
        k = 3 if self.exact else 0
        self.sense = np.concatenate((np.zeros(m), np.full(k, 5))).astype(np.int32)  # 5 is DAQP's mark of an equation
        # Bounds of the joints, and behind them the exact rows' right-hand side: allocated once, as H is.
        self.upper, self.lower = np.zeros((2, m + k))
        self.joint_upper, self.joint_lower = self.upper[:m], self.lower[:m]
        self.rows_wanted = (self.upper[m:], self.lower[m:])

    def target(self, pose: Any) -> Any:
        """A target as such a loop has it."""
        return self.pin.SE3(pose)

    def step(self, q: Any, target: Any, feedforward: Any = None) -> VelocitySolution:
        """One tick."""
        pin, H, upper, lower = self.pin, self.H, self.joint_upper, self.joint_lower
        pin.computeJointJacobians(self.model, self.data, q)
        tool = pin.updateFramePlacement(self.model, self.data, self.frame)
        J = pin.getFrameJacobian(self.model, self.data, self.frame, pin.LOCAL)
        gap = tool.actInv(target if isinstance(target, pin.SE3) else pin.SE3(target.homogeneous))
        ahead = self.still
        if feedforward is not None:
            ahead = tool.actInv(pin.Motion(feedforward[3:], feedforward[:3])).vector
        s = self.gain * pin.log6(gap).vector + ahead
        for side, limit in ((upper, self.high), (lower, self.low)):
            np.subtract(limit, q, out=side)
            np.multiply(side, self.rate, out=side)
            np.minimum(side, self.speed, out=side)
            np.maximum(side, self.slowest, out=side)
        lower[:], upper[:] = self.reach.within(lower, upper)
        rows = self.rows
        if self.exact:
            there = gap.act(self.point)
            rows = self.at_point @ J
            wanted = self.gain * (there - self.point) + ahead[:3] - pin.skew(there) @ ahead[3:]
            for side in self.rows_wanted:
                side[:] = wanted
        np.dot(J.T, J, out=H)
        self.diagonal += self.weight
        f = self.weighted_pull * (q - self.middle) - s @ J
        x, _, flag, _ = daqp.solve(H, f, rows, self.upper, self.lower, self.sense)
        if flag <= 0:
            raise RuntimeError(f"DAQP: exit flag {flag}")
        self.reach.last = x
        return answer(x)


def least_squares(setting: LoopSetting) -> Solve:
    """Least squares inside the limits, at the given point with the given length; mu grows with what is missed."""
    root, solver, eye = root_at(setting.point, setting.length), Daqp(), np.eye(setting.m)

    def velocity(tick: TickInputs) -> Array:
        A, b = root.dot(tick.J), root.dot(tick.s)
        size = float(np.vdot(A, A))
        H, c = A.T.dot(A) + NEGLIGIBLE * size * eye, A.T.dot(b) + NEGLIGIBLE * size * tick.posture

        def best(mu: float) -> Array:
            K = (H + mu * eye) / size
            if not len(tick.C):
                return solver.solve(BoxQP(K, c / size, tick.lower, tick.upper, None))
            return slowed(solver, K, c / size, tick)

        x = best(0.0)
        mu = 0.5 * CALM * setting.dt * float(np.linalg.norm(b - A.dot(x))) * np.sqrt(size)
        return best(mu) if mu > POSTURE_COST**2 * size else x  # less is not worth a second QP

    return velocity


def slowed(solver: Daqp, H: Array, c: Array, tick: TickInputs) -> Array:
    """The minimiser with exact rows, slowed down by halves where limits forbid them."""
    rows = np.vstack((np.eye(len(c)), tick.C))
    for share in (1.0, 0.5, 0.25, 0.125, 0.0):
        e = share * tick.e
        try:
            return solver.solve(BoxQP(H, c, np.append(tick.lower, e), np.append(tick.upper, e), rows))
        except SolverFailure:
            continue
    return np.zeros(len(c))


def scaling(setting: LoopSetting) -> Solve:
    """maximise alpha with J x = alpha s inside the limits, alpha <= 1; the posture in what is left.

    Beside the posture the share weighs a million times as much. Where limits exclude every share, as those of
    accelerations may, it stops.
    """
    m, solver = setting.m, Daqp()
    H = np.diag(np.r_[np.full(m, POSTURE_COST), 1.0 / POSTURE_COST])

    def velocity(tick: TickInputs) -> Array:
        c = np.r_[POSTURE_COST * tick.posture, 1.0 / POSTURE_COST]
        rows = np.vstack((np.eye(m + 1), np.column_stack((tick.J, -tick.s))))
        low, high = np.r_[tick.lower, 0.0, np.zeros(6)], np.r_[tick.upper, 1.0, np.zeros(6)]
        try:
            return solver.solve(BoxQP(H, c, low, high, rows))[:m]
        except SolverFailure:
            return np.zeros(m)

    return velocity


row = partial(Method, family="QP")
METHODS = [
    row(
        name=HAND_WRITTEN,
        why="Pinocchio and DAQP called one after the other in forty lines, least squares with metres and radians alike",
        takes=Takes("in the objective", "equality rows", "inside the QP", "weight 1e-6"),
        loop=HandWritten,
        needs=("pinocchio",),
    ),
    row(
        name=SCALED_LEAST_SQUARES,
        why="with Levenberg and Marquardt's damping (Sugihara 2011), at the given point, and a radian counting as the "
        "arm's reach: the nearest to this library's law",
        takes=Takes("in the objective", "equality rows", "inside the QP", "grows with what is missed (Sugihara 2011)"),
        loop=in_loop(least_squares),
    ),
    row(
        name="scaling",
        why="the largest share of the twist in its own direction inside the limits, as Drake's function does",
        takes=Takes("in what is left", "a part of the twist, with it", "inside; slows the twist down", "none"),
        loop=in_loop(scaling),
    ),
]
