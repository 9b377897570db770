"""The loop of a follower, and streams as policies and hands send them: late, overlapping, disagreeing, lost."""

from collections import deque
from typing import NamedTuple

import numpy as np

import invariantqp as iq
from support.arms import LIMITS, ready

DT = 0.004


class Run(NamedTuple):
    """Joint positions before every tick and after the last (n + 1, m), commanded velocities (n, m), and solutions."""

    Q: np.ndarray
    V: np.ndarray
    answers: list

    @property
    def statuses(self):
        return [str(answer.status) for answer in self.answers]


def run(
    follower,
    q,
    ticks,
    *,
    dt,
    before=None,
    options=None,
    reads=None,
    moves=None,
    late=0,
    lag=None,
    clock=0.0,
    until=(),
    **fixed,
):
    """A run of an arm that does what is commanded `late` ticks later, until a solution has one of the statuses.

    Each tick `before` (tick, q) acts, and may return other joint positions, `options` (tick, q) gives arguments of
    the step beside the fixed ones, `reads` (q, tick) what is measured, `moves` (tick) which joints move. With a lag
    [s] the velocity of the arm is that of a first order.
    """
    Q, answers, pending, speed = [q], [], deque([np.zeros(len(q))] * late), np.zeros(len(q))
    for k in range(ticks):
        pushed = None if before is None else before(k, q)
        q = q if pushed is None else pushed
        more = fixed | ({} if clock is None else {"now": clock + k * dt}) | ({} if options is None else options(k, q))
        answers.append(follower.step(q if reads is None else reads(q, k), **more))
        pending.append(answers[-1].velocity)
        command = pending.popleft()
        speed = command if lag is None else speed + dt / lag * (command - speed)
        q = q + dt * speed if moves is None else q + dt * np.where(moves(k), speed, 0.0)
        Q.append(q)
        if answers[-1].status in until:
            break
    return Run(np.array(Q), np.array([answer.velocity for answer in answers]), answers)


class Arm:
    """An arm with limits, and what was commanded to it."""

    def __init__(self, name, dt=DT, **options):
        acceleration, rise = LIMITS[name]
        self.robot = iq.load_robot(name)
        self.start = ready(name)
        self.acceleration = np.array(acceleration, dtype=float)
        self.jerk = rise * self.acceleration
        self.dt = dt
        self.options = options
        self.exact = "position" if len(self.start) < 6 else None

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


def driven(arm, follower, events, T, q=None, **options):
    """Joint positions and solutions of ticks until T; events are (time, function of the follower), or as of `run`."""
    if not callable(events):
        coming = deque(events)

        def due(k, q):
            while coming and coming[0][0] <= k * arm.dt:
                coming.popleft()[1](follower)

    before = events if callable(events) else due
    made = run(follower, arm.start if q is None else q, round(T / arm.dt), dt=arm.dt, **{"before": before} | options)
    return made.Q, made.answers
