"""Damped least squares as a controller of `run_task`: the reference that our law is compared with.

    minimise |A x - b|^2 + eps |x - x_p|^2 + mu |x|^2   inside the joint limits, with the exact rows C x = e
    A = root J, b = root s     at the law's point, a radian counting as the law's length
    eps = 1e-9 |A|^2           x_p is the velocity towards the posture
    mu = 1/8 dt |b - A x_0| |A|, where x_0 is the solution for mu = 0

If the limits exclude the exact rows, e is halved up to three times, and then set to zero. Solved by DAQP.

Reference: Sugihara 2011, for damping that grows with the residual.
"""

import numpy as np

from invariantqp.control.controller import posture_of
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import tracking_gain
from invariantqp.velocity.backends import BoxQP, Daqp, SolverFailure
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.solution import Status, VelocitySolution

REGULARISATION = 1e-9
# Damping below this share of |A|^2 does not change the solution: no second QP is solved for it.
LEAST_DAMPING = 1e-6


class LeastSquares:
    """The control loop. Of a law it reads dt, gain, posture, posture_gain, point, length and exact."""

    def __init__(self, robot, law):
        self.robot, self.dt, self.gain = robot, law.dt, tracking_gain(law.gain, law.dt)
        self.point, self.exact = np.array(law.point), law.exact is not None
        self.measure = ToolMeasure(robot, self.point, law.length)
        self.posture, self.pull = posture_of(law.posture, law.posture_gain, robot)
        limits = robot.position_lower, robot.position_upper, robot.velocity_limit
        self.box, self.solver = JointBox(*limits, 1.0 / law.dt), Daqp()

    def step(self, q, target, feedforward=None):
        """One tick; raises ValueError if an input is not finite."""
        ahead = np.zeros(6) if feedforward is None else np.asarray(feedforward)
        if not all(np.isfinite(x).all() for x in (q, target.homogeneous, ahead)):
            raise ValueError("an input is not finite")
        state = self.robot.state(q, target)
        root = self.measure.root_for(state.J, state.pose)
        A, b = root @ state.J, root @ (self.gain * state.error + ahead)
        C, e = A[:0], b[:0]
        if self.exact:
            here, there = self.robot.points(state, target, self.point)
            C, e = A[3:], self.gain * (there - here) + ahead[3:] + np.cross(ahead[:3], there)
        return answer(self.velocity(A, b, C, e, q))

    def velocity(self, A, b, C, e, q):
        """The joint velocities (m,), damped by the residual."""
        eye, size = np.eye(len(q)), np.vdot(A, A)
        eps = REGULARISATION * size
        H, c = A.T @ A + eps * eye, A.T @ b + eps * self.pull * (self.posture - q)
        x = self.minimiser(H / size, c / size, C, e, q)
        mu = 0.125 * self.dt * np.linalg.norm(b - A @ x) * np.sqrt(size)
        return self.minimiser((H + mu * eye) / size, c / size, C, e, q) if mu > LEAST_DAMPING * size else x

    def minimiser(self, H, c, C, e, q):
        """(m,) the minimiser of 1/2 x'Hx - c'x inside the limits, with the largest feasible share of e."""
        lower, upper = self.box.at(q)
        rows = np.vstack((np.eye(len(c)), C)) if len(C) else None
        for share in (1.0, 0.5, 0.25, 0.125, 0.0):
            ends = np.append(lower, share * e), np.append(upper, share * e)
            try:
                return np.clip(self.solver.solve(BoxQP(H, c, *ends, rows)), lower, upper)
            except SolverFailure:
                if rows is None:
                    raise
        return np.zeros(len(c))


def answer(velocity, status=Status.OK):
    """Joint velocities (m,) as the solution of a tick."""
    return VelocitySolution(velocity, "", status, (), (), np.full(6, np.nan), 1.0, 0.0, 0.0, "")
