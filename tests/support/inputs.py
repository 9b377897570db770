"""Every kind of input to a loop, each of the same motion, and an arm that moves as commanded or stands."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import invariantqp as iq
from support.arms import ready
from support.streams import run

# The inputs of a `Follower`, and the other loops: a path, and the ticks of a Controller.
INPUTS = (
    "chunks of joints",
    "chunks of poses",
    "goal of joints",
    "goal of a pose",
    "function of joints",
    "function of poses",
    "joints",
    "poses",
    "twist",
)
KINDS = (*INPUTS, "path", "step")
# Acceleration and jerk limits.
ARMS = dict.fromkeys(("panda", "ur5", "xarm7"), (10.0, 500.0)) | {"so101": (26.0, 1000.0), "gen3": (10.0, 500.0)}
TICKS = (0.002, 0.01, 0.033)
# A joint goes so far [rad], from rest to rest, in this time [s].
SIZE, TIME = 0.5, 1.5


class Bed:
    """One arm, whose joint is asked to move in one direction by one kind of input."""

    def __init__(self, kind, name, dt, sign, *, joint=0, robot=None, start=None, size=SIZE):
        self.acceleration, self.jerk = ARMS[name]
        self.kind, self.dt, self.size = kind, dt, sign * size
        self.robot = iq.load_robot(name) if robot is None else robot
        self.start = ready(name) if start is None else np.array(start)
        self.axis = np.eye(len(self.start))[joint]
        exact = "position" if len(self.start) < 6 else None
        self.loop = iq.Controller(self.robot, dt=dt, acceleration_limit=self.acceleration, exact=exact)

    def joints(self, t):
        """(m,) where the joints are asked to be."""
        s = np.clip(t / TIME, 0.0, 1.0)
        return self.start + self.size * (s - np.sin(2.0 * np.pi * s) / (2.0 * np.pi)) * self.axis

    def pose(self, t):
        return self.robot.pose(self.joints(t))

    def off(self, q, t):
        """How far the point of the tool is from where it is asked to be [m]."""
        return np.linalg.norm(self.robot.pose(q)[:3, 3] - self.pose(t)[:3, 3])

    def follower(self, q):
        """A follower of one kind of input from joint positions as read (m,), and what is done before each tick."""
        if self.kind == "path":
            follower = iq.PathFollower(self.loop, self.pose, end=TIME, rate=1.0, joint_jerk=self.jerk)
            follower.prepare(q)
            return follower, lambda now: None
        follower, poses = iq.Follower(self.loop, jerk=self.jerk), "pose" in self.kind
        where = self.pose if poses else self.joints
        if self.kind.startswith("goal"):
            follower.follow([where(TIME)])
        if self.kind.startswith("function"):
            follower.follow(where)
        last = [-1.0]

        def feed(now):
            gap = 0.1 if self.kind.startswith("chunks") else max(0.02, self.dt)
            if now < last[0] + gap - 1e-9:
                return
            last[0] = now
            if self.kind.startswith("chunks"):
                stamps = now + 0.05 * np.arange(20)
                follower.follow(np.array([where(t) for t in stamps]), stamps)
            if self.kind in ("joints", "poses"):
                follower.add(where(now), now)
            if self.kind == "twist":
                speed = self.size / TIME * (1.0 - np.cos(2.0 * np.pi * now / TIME)) * (now < TIME)
                follower.twist(self.robot.jacobian(self.joints(now)) @ self.axis * speed, at="base")

        return follower, feed

    def run(self, seconds, *, stands=(np.inf, np.inf), reads=lambda q, k: q, **more):
        """Ticks of an arm that does not move from stands[0] to stands[1] [s]; the rest is as of a follower's run."""
        step = {"dt": self.dt, "reads": reads, "moves": lambda k: not stands[0] <= k * self.dt < stands[1]} | more
        if self.kind == "step":
            loop = SimpleNamespace(step=lambda q, now: self.loop.step(q, self.pose(now)))
            return run(loop, self.start, round(seconds / self.dt), **step)
        follower, feed = self.follower(reads(self.start, 0))
        before = {"before": lambda k, q: feed(k * self.dt)}
        return run(follower, self.start, round(seconds / self.dt), **before | step)


def cases(kinds, each):
    """So many (kind, arm, tick, sign) of each kind, which have all arms, ticks and signs among them."""
    names = tuple(ARMS)
    every = range(each * len(kinds))
    return [(kinds[i // each], names[i % len(names)], TICKS[(i + i // 5) % 3], 1 - 2 * (i // 2 % 2)) for i in every]
