"""Pinocchio and DAQP in a loop as a user writes it by hand: one call after the other, nothing shared with this library.

    minimise |s - J x|^2 + 1e-6 |x - x_p|^2    inside the limits, the exact point as equality rows

Reference: the examples of Pinocchio (inverse kinematics) and of DAQP.
"""

from __future__ import annotations

from typing import Any

import daqp
import numpy as np

from invariantqp.compare.laws.quadratic import EQUALITY, FIXED, IN_OBJECTIVE, INSIDE
from invariantqp.compare.laws.ramp import RampBounds
from invariantqp.compare.method import Method, Takes, posture_of
from invariantqp.compare.names import HAND_WRITTEN
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import RobotModelError
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import Status, VelocitySolution

WEIGHT = 1e-6


class HandWritten:
    """The loop for one arm."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """Of `law`, dt, gain, delay, acceleration_limit, posture, exact and point are used.

        Raises:
            RobotModelError: the robot has no Pinocchio model.
        """
        import pinocchio

        self.pin = pinocchio
        self.model: Any = getattr(robot, "model", None)
        if self.model is None:
            raise RobotModelError("the hand-written loop needs a robot with a Pinocchio model")
        self.data, self.frame = self.model.createData(), self.model.getFrameId(robot.tool)  # type: ignore[attr-defined]
        self.dt, self.gain = law.dt, tracking_gain(law.gain, law.dt, law.delay)
        self.low, self.high, self.speed = robot.position_lower, robot.position_upper, robot.velocity_limit
        self.slowest = -self.speed
        self.middle, self.pull = posture_of(robot, law)
        m = len(self.middle)
        self.ramp = RampBounds(law, m)
        self.damping = WEIGHT * np.eye(m)
        self.rows = np.zeros((0, m))
        self.exact, self.point = law.exact is not None, np.asarray(law.point)
        self.at_point = np.hstack((np.eye(3), -pinocchio.skew(self.point)))  # from a twist to the velocity of the point
        k = 3 if self.exact else 0
        self.sense = np.concatenate((np.zeros(m), np.full(k, 5))).astype(np.int32)
        # Bounds of the joints, and behind them the exact rows' right-hand side: allocated once.
        self.upper, self.lower = np.zeros((2, m + k))

    def target(self, pose: Any) -> Any:
        """A target as such a loop has it."""
        return self.pin.SE3(pose)

    def step(self, q: Any, target: Any, feedforward: Any = None) -> VelocitySolution:
        """One tick."""
        pin = self.pin
        pin.forwardKinematics(self.model, self.data, q)
        tool = pin.updateFramePlacement(self.model, self.data, self.frame)
        J = pin.computeFrameJacobian(self.model, self.data, q, self.frame, pin.LOCAL)
        gap = tool.actInv(target if isinstance(target, pin.SE3) else pin.SE3(target.homogeneous))
        ahead = np.zeros(6)
        if feedforward is not None:
            ahead = tool.actInv(pin.Motion(feedforward[3:], feedforward[:3])).vector
        s = self.gain * pin.log6(gap).vector + ahead
        m = len(q)
        np.maximum(np.minimum((self.high - q) / self.dt, self.speed), self.slowest, out=self.upper[:m])
        np.minimum(np.maximum((self.low - q) / self.dt, self.slowest), self.speed, out=self.lower[:m])
        self.lower[:m], self.upper[:m] = self.ramp.within(self.lower[:m], self.upper[:m])
        rows = self.rows
        if self.exact:
            there = gap.act(self.point)
            e = self.gain * (there - self.point) + ahead[:3] - pin.skew(there) @ ahead[3:]
            rows = self.at_point @ J
            self.upper[m:] = self.lower[m:] = e
        H = J.T @ J + self.damping
        f = -J.T @ s - WEIGHT * self.pull * (self.middle - q)
        x, _, flag, _ = daqp.solve(H, f, rows, self.upper, self.lower, self.sense)
        if flag <= 0:
            raise RuntimeError(f"DAQP: exit flag {flag}")
        self.ramp.last = x
        return VelocitySolution(x, "hand-written", Status.OK, "", (), np.full(6, np.nan), 1.0, 0.0, 0.0, "daqp")


METHODS = [
    Method(
        name=HAND_WRITTEN,
        family="QP",
        why="Pinocchio and DAQP called one after the other in forty lines, least squares with metres and radians alike",
        takes=Takes(IN_OBJECTIVE, EQUALITY, INSIDE, FIXED),
        system=HandWritten,
        needs=("pinocchio",),
        extra="pin",
    ),
]
