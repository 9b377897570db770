"""A hand-written loop around a least-squares QP that is told all that our controller is told: the fair yardstick.

    minimise |A x - b|^2 + mu |x|^2 + eps |A|^2 |x - x_p|^2    inside the limits,    A = root J,  b = root s
    mu = 1/8 dt |b - A x_0| |A|,   x_0 the same with mu = 0                          (Levenberg-Marquardt)

root measures twists at the told point of the tool, with the told length; x_p is the way to the middle of the joint
ranges. A point to be met exactly is an equality, slowed down by halves where limits forbid it. One QP by DAQP, a second
one where mu counts.

Reference: Sugihara 2011 for mu; Escande, Mansard & Wieber 2014 for least squares inside limits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.setting import setting_of
from invariantqp.control.posture import joint_gains, posture_gain
from invariantqp.control.tracking import tracking_gain
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits.box import JointBox
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.qp.backends import Daqp, SolverFailure
from invariantqp.velocity.qp.scaling import BoxQP
from invariantqp.velocity.solution import VelocitySolution

# Sugihara's factor, as measured to be calm and quick: of 1/2 dt |missed| |A|.
CALM = 0.25
# eps: the posture's weight, far below what the twist weighs.
POSTURE_WEIGHT = 1e-9
# mu below this share of |A|^2 is not worth a second QP.
NEGLIGIBLE = 1e-6
# Shares of the exact rows' speed that are tried one after the other.
SHARES = (1.0, 0.5, 0.25, 0.125, 0.0)


class LeastSquaresLaw:
    """The loop for one arm."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """Everything that `law` says of gain, point, posture, exactness and margins is used, but no form or damping."""
        self._robot = robot
        self._dt = law.dt
        self._gain = tracking_gain(law.gain, law.dt)
        setting = setting_of(robot, law)
        self._point, self._length = setting.point, setting.length
        self._exact = law.exact is not None
        self._pull = joint_gains(robot, posture_gain(law.posture, setting.m))
        self._middle = middle(robot)
        self._box = JointBox(
            robot.position_lower, robot.position_upper, robot.velocity_limit, law.dt, law.position_margin
        )
        self._daqp = Daqp()

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises SolverFailure where DAQP finds nothing."""
        positions = arrays.vector(q, len(self._middle), "q")
        ahead = np.zeros(6) if feedforward is None else arrays.twist(feedforward)
        sighting = self._robot.sight(positions, target)
        s = self._gain * sighting.error + ahead
        here, there = self._robot.points(sighting, target, self._point)
        root = root_at(here, self._length)
        A, b = root.dot(sighting.J), root.dot(s)
        lower, upper = self._box.at(positions)
        C = e = np.empty((0, len(positions)))
        if self._exact:
            still = root_at(here, 1.0)[3:]
            C, e = still.dot(sighting.J), self._gain * (there - here) + still.dot(ahead)
        size = float(np.vdot(A, A))
        towards = POSTURE_WEIGHT * size * (self._middle - positions) * self._pull

        def best(mu: float) -> Array:
            H = A.T.dot(A) + (mu + POSTURE_WEIGHT * size) * np.eye(len(positions))
            c = A.T.dot(b) + towards
            if not len(C):
                return self._daqp.solve(BoxQP(H / size, c / size, lower, upper, None))
            rows = np.vstack((np.eye(len(positions)), C))
            for share in SHARES:
                low, high = np.append(lower, share * e), np.append(upper, share * e)
                try:
                    return self._daqp.solve(BoxQP(H / size, c / size, low, high, rows))
                except SolverFailure:
                    continue
            return np.zeros(len(positions))

        x = best(0.0)
        mu = 0.5 * CALM * self._dt * float(np.linalg.norm(b - A.dot(x))) * np.sqrt(size)
        if mu > NEGLIGIBLE * size:
            x = best(mu)
        x = np.minimum(np.maximum(x, lower), upper)
        residual = s - sighting.J.dot(x)
        return VelocitySolution(x, "least squares", "ok", "", (), residual, 1.0, 0.0, 0.0, "daqp")
