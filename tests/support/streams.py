"""Streams as policies and hands send them, from a seed: late, overlapping, disagreeing, lost, in the wrong order."""

import numpy as np

import invariantqp as iq
from support.arms import READY

# Start, acceleration and jerk limits.
ARMS = {
    "panda": (READY["panda"], [15, 7.5, 10, 12.5, 15, 20, 20], 500.0),
    "ur5": ([0.3, -1.4, 1.8, -1.9, -1.5, 0.3], [8.0] * 6, 50.0),
    "so101": (READY["so101"], [30.0] * 5, 50.0),
}
DT = 0.004


class Arm:
    """An arm with limits, and what was commanded to it."""

    def __init__(self, name, dt=DT, **options):
        start, acceleration, rise = ARMS[name]
        self.robot = iq.load_robot(name)
        self.start = np.array(start)
        self.acceleration = np.array(acceleration, dtype=float)
        self.jerk = rise * self.acceleration
        self.dt = dt
        self.options = options
        self.exact = "position" if len(start) < 6 else None

    def controller(self, **more):
        return iq.Controller(
            self.robot, dt=self.dt, acceleration_limit=self.acceleration, exact=self.exact, **self.options, **more
        )

    def follower(self, **options):
        return iq.Follower(self.controller(), jerk=self.jerk, **options)

    def motion(self, rng, size=0.3):
        """A smooth joint motion q(t) from the start on, well inside the limits."""
        f = rng.uniform(0.1, 0.5, (4, len(self.start)))
        phase = rng.uniform(0.0, 2.0 * np.pi, f.shape)
        a = size * rng.uniform(-1.0, 1.0, f.shape) / 4.0 / (1.0 + f)

        def at(t):
            ease = np.clip(t, 0.0, 1.0) ** 3 * (10 - 15 * np.clip(t, 0.0, 1.0) + 6 * np.clip(t, 0.0, 1.0) ** 2)
            return self.start + ease * (a * (np.sin(2 * np.pi * f * t + phase) - np.sin(phase))).sum(axis=0)

        return at

    def held(self, Q, tolerance=1.001):
        """Assert that joint positions, tick by tick, keep every limit, and are numbers."""
        Q = np.asarray(Q)
        assert np.isfinite(Q).all()
        v = np.diff(Q, axis=0, prepend=Q[:1]) / self.dt
        a = np.diff(v, axis=0, prepend=v[:1]) / self.dt
        j = np.diff(a, axis=0, prepend=a[:1]) / self.dt
        assert (np.abs(v) <= tolerance * np.asarray(self.robot.velocity_limit)).all()
        assert (np.abs(a) <= tolerance * self.acceleration).all()
        assert (np.abs(j) <= tolerance * self.jerk).all()
        assert (self.robot.position_upper + 1e-9 >= Q).all()
        assert (self.robot.position_lower - 1e-9 <= Q).all()


def chunks(arm, rng, T, *, poses):
    """(arrival, points, stamps) of chunks that disagree by centimetres, in order of arrival; some never arrive."""
    truth = arm.motion(rng)
    f, n, late = float(rng.choice([10, 20, 30])), int(rng.integers(8, 40)), rng.uniform(0.02, 0.4)
    out, t = [], 0.0
    while t < T:
        stamps = t + np.arange(n) / f
        q = (
            np.array([truth(s) for s in stamps])
            + 0.03 * rng.normal(size=len(arm.start))
            + 1e-3 * rng.normal(size=(n, 1))
        )
        q = np.clip(q, arm.robot.position_lower, arm.robot.position_upper)
        points = np.array([arm.robot.pose(x) for x in q]) if poses else q
        if rng.random() > 0.15:
            out.append((t + late * rng.uniform(0.3, 3.0), points, stamps))
        t += rng.uniform(0.1, 0.6) * n / f
    return sorted(out, key=lambda c: c[0])


def driven(arm, follower, events, T, q=None, **more):
    """Joint positions and solutions of ticks until T; events are (time, function of the follower)."""
    q = arm.start.copy() if q is None else q
    Q, answers, k = [q], [], 0
    for i in range(round(T / arm.dt)):
        t = i * arm.dt
        while k < len(events) and events[k][0] <= t:
            events[k][1](follower)
            k += 1
        answer = follower.step(q, now=t, **more)
        q = q + arm.dt * answer.velocity
        Q.append(q)
        answers.append(answer)
    return np.array(Q), answers
