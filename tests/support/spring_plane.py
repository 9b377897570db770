"""A plane that pushes back in proportion to how far a tool is in it, and a pen on it: the world of the hybrid tests."""

from __future__ import annotations

from math import cos, sin

import numpy as np

import invariantqp as iq
from invariantqp.geometry.se3 import cross
from support.arms import ready

UP = np.array([0.0, 0.0, 1.0])
PANDA = ready("panda")
SO101 = np.array([0.1, -0.4, 0.5, 0.6, 0.2])
DT = 1e-3


def exerted(points, height, stiffness):
    """The wrench (m; f), base frame, that a tool exerts with its corners (n, 3) on the plane z = height."""
    turn_x = turn_y = force = 0.0  # in floats: worlds are a good part of these tests' time
    for x, y, z in np.asarray(points).tolist():
        push = -stiffness * max(0.0, height - z)
        turn_x, turn_y, force = turn_x + push * y, turn_y - push * x, force + push
    return np.array((turn_x, turn_y, 0.0, 0.0, 0.0, force))


def force_at(point, force):
    """The wrench (m; f) of a force (3,) at a point."""
    return np.concatenate((cross(point, np.asarray(force)), force))


def in_tool(pose, wrench):
    """A wrench of the base frame in that of the tool, unchecked."""
    R, f = pose[:3, :3].T, wrench[3:]
    return np.concatenate((R.dot(wrench[:3] - cross(pose[:3, 3], f)), R.dot(f)))


def corners(pose, half):
    """The four corners of a square face in the xy-plane of the tool frame."""
    return [pose[:3, :3] @ [x, y, 0.0] + pose[:3, 3] for x in (-half, half) for y in (-half, half)]


def circle(start, radius, period):
    """A target that goes round a horizontal circle from `start`, and its twist, as functions of time."""

    def at(t):
        a, rate = 2 * np.pi * t / period, 2 * np.pi / period * radius
        sine, cosine = sin(a), cos(a)
        T = start.copy()
        T[:2, 3] += (radius * (cosine - 1.0), radius * sine)
        return T, np.array((0.0, 0.0, 0.0, -rate * sine, rate * cosine, 0.0))

    return at


def gantry():
    """Three slides and three turns about the tool's origin: joint velocities held for a tick move the tip exactly."""
    slides = [iq.se3.prismatic(a) for a in np.eye(3)]
    turns = [iq.revolute(a) for a in np.eye(3)[::-1]]
    return iq.robots.Chain(np.column_stack(slides + turns), np.eye(4))


def tip(tool):
    return iq.point_contact(tool[:3, 3], UP)


def pen(press=5.0, contact=tip, **options):
    return iq.HybridTask(contact, [press], **options)


class Bench:
    """A tool on a spring plane, or that exerts `world(pose)`; `tick` is one tick of the loop and of the world."""

    def __init__(self, robot, q, task, *, stiffness=1e4, depth=0.0, half=0.0, dt=DT, world=None, **options):
        self.robot, self.q, self.dt = robot, np.array(q), dt
        if "sensor" not in options:
            options["order"] = "moment first"
        self.loop = iq.HybridController(robot, task, dt=dt, **options)
        self.start = robot.pose(q)
        self.stiffness, self.half, self.world = stiffness, half, world
        self.height = self.start[2, 3] + depth

    def wrench(self):
        pose = self.robot.pose(self.q)
        if self.world is not None:
            return self.world(pose)
        points = corners(pose, self.half) if self.half else [pose[:3, 3]]
        return exerted(points, self.height, self.stiffness)

    def tick(self, target=None, ahead=None, **more):
        target = self.start if target is None else target
        solution = self.loop.step(self.q, target, self.wrench(), ahead, **more)
        self.q = self.q + self.dt * solution.velocity
        return solution

    def run(self, ticks, path=None):
        return [self.tick(*path(k * self.dt)) if path else self.tick() for k in range(ticks)]


def carried(rule, contact):
    """The rule told in the base frame; none is the complement Z = C W of the default compliance."""
    B = iq.coadjoint(contact.pose)
    M = rule.get("metric", None if rule else np.repeat([0.05**2, 1.0], 3))
    return rule if "h" in rule else {"metric": B @ np.diag(M) @ B.T}
