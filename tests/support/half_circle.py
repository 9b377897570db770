"""A Panda at a share of its speed with a pen on paper, and half a circle to draw."""

import numpy as np

import invariantqp as iq
from support.plane import PANDA, Bench, circle, pen

DT, RADIUS, PERIOD, SETTLED = 4e-3, 0.03, 0.4, 75


def slow_bench(share=1.0 / 15.0, dt=DT, **task):
    """A Panda at a fifteenth of its speed, with a pen on paper."""
    robot = iq.load_robot("panda")
    limits = (robot.position_lower, robot.position_upper, share * robot.velocity_limit)
    return Bench(
        iq.robots.Chain(robot.screws, robot.home, robot.names, *limits),
        PANDA,
        pen(**task),
        dt=dt,
        acceleration_limit=5.0,
    )


def prepared(yields=0.0, **given):
    """That bench, half a circle on the paper, and a follower that has looked along it."""
    bench = slow_bench(yields=yields)
    path = circle(bench.start, RADIUS, PERIOD)
    follower = iq.PathFollower(bench.loop, lambda t: path(t)[0], end=PERIOD / 2, **given)
    follower.prepare(bench.q)
    return bench, path, follower


def off_circle(bench):
    return abs(np.linalg.norm(bench.robot.pose(bench.q)[:2, 3] - bench.start[:2, 3] + [RADIUS, 0.0]) - RADIUS)


class Drive:
    """A follower on half a circle, the solutions so far, and how far off the circle the tool was."""

    def __init__(self, yields=0.0, **given):
        self.bench, self.path, self.follower = prepared(yields=yields, **given)
        self.solutions, self.off = [], []

    def tick(self, count=1, **more):
        for _ in range(count):
            self.solutions.append(self.follower.step(self.bench.q, wrench=self.bench.wrench(), **more))
            self.bench.q = self.bench.q + DT * self.solutions[-1].velocity
            self.off.append(off_circle(self.bench))
        return self.solutions[-1]

    def until(self, *statuses, most=2000, **more):
        for _ in range(most):
            if self.tick(**more).status in statuses:
                return self.solutions[-1]
        raise AssertionError(self.solutions[-1])

    def tip(self):
        return self.bench.robot.pose(self.bench.q)[:3, 3]

    def check(self, force=0.08):
        """Limits are kept all the time; once settled the force is, and the tool is on the circle."""
        velocity = np.array([s.velocity for s in self.solutions])
        assert (np.abs(velocity) <= self.bench.robot.velocity_limit + 1e-9).all()
        jumps = np.abs(np.diff(velocity, axis=0, prepend=np.zeros((1, 7)))) / DT
        assert jumps.max() <= 5.0 * (1.0 + 1e-9)
        first = next(k for k, s in enumerate(self.solutions) if s.status != "waiting") + SETTLED
        assert max(abs(s.hybrid.intensities[0] / 5.0 - 1.0) for s in self.solutions[first:]) < force
        assert max(self.off[first:]) < 5e-5
