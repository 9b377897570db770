"""A plane that pushes back, and a tool that is pressed on it: the world of the hybrid tests."""

from __future__ import annotations

from collections import deque
from math import cos, exp, sin
from typing import NamedTuple

import numpy as np

import invariantqp as iq
from invariantqp.geometry.se3 import cross
from support.arms import ready
from support.wrist import wrist

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


class Pressed(NamedTuple):
    """Of each tick the true press [N], height above the plane and distance from the target along it [m], solutions."""

    press: np.ndarray
    height: np.ndarray
    off: np.ndarray
    solutions: list
    dt: float
    loop: iq.HybridController

    @property
    def reports(self):
        return [(str(s.status), s.reason) for s in self.solutions]

    def statuses(self, start=0):
        return [str(s.status) for s in self.solutions[start:]]

    @property
    def touch(self):
        return int(np.argmax(self.press > 0.0)) if self.press.max() > 0.0 else len(self.press)

    @property
    def stopped(self):
        """The tick from which the tool stands still or retreats until reset; None for none."""
        return next((k for k, s in enumerate(self.solutions) if s.status in STOPPED), None)

    def rms(self, press, since):
        """The error of the press from a time on, as a share of it."""
        return float(np.sqrt(np.mean((self.press[round(since / self.dt) :] / press - 1.0) ** 2)))


class Dead:
    """A sensor that repeats its last reading."""

    def __init__(self):
        self.last = None

    def __call__(self, reading, normal):
        self.last = reading if self.last is None else self.last
        return self.last


# What happens to a reading, for the outward normal in the tool frame; the status and a part of the reason then.
FAULTS = {
    "dead": (Dead, "fault", "has not changed"),
    "unplugged": (lambda: lambda reading, normal: np.zeros(6), "fault", "has not changed"),
    "order": (lambda: lambda reading, normal: np.roll(reading, 3), "overload", "N m of"),
    "sign": (lambda: lambda reading, normal: -reading, "fault", "pulls with"),
    "falls by 12 N": (lambda: lambda reading, normal: reading - np.r_[0, 0, 0, 12 * normal], "fault", "pulls with"),
    "rises by 30 N": (lambda: lambda reading, normal: reading + np.r_[0, 0, 0, 30 * normal], "overload", "N of 25"),
}
STOPPED = ("overload", "fault")  # the tool stands still or retreats until reset
SUBSTEP = 5e-4  # [s]


def press_on_plane(
    press=10.0,
    *,
    arm="panda",
    stiffness=1e4,
    damping=0.0,
    friction=0.0,
    noise=0.2,
    declared_noise=None,
    drift=0.0,
    dt=0.002,
    seconds=3.0,
    gap=0.002,
    tilt=0.0,
    delay=0.0,
    lag=0.0,
    declared_delay=0.0,
    radius=0.03,
    period=3.0,
    speed=0.0,
    slides_from=0.0,
    slope=0.0,
    moves=(0.0, 1.0),
    drops=(0.0, np.inf, np.inf),
    drives=np.inf,
    reads=None,
    fault=None,
    since=np.inf,
    after_stop=np.inf,
    seed=0,
    **task,
):
    """An arm presses with a pen whose normal is declared wrong by a tilt, and slides on a circle or straight on.

    `stiffness` is a number or makes a press of a depth. From `since` on `reads` (press, t) makes what is read of the
    press, and `fault` (reading, outward normal in the tool frame) the reading of the sensor. The plane moves by a
    height [m], so many times a second, and is lower by another from one time to another. Drives of a stiffness
    [N m/rad] give way to the force, which joints then measure. Commands act after a dead time and a first-order lag.
    The run ends `after_stop` seconds after the tool stands still or retreats until reset.
    """
    random = np.random.default_rng(seed)
    robot = gantry() if arm == "gantry" else iq.load_robot(arm)
    q = np.zeros(6) if arm == "gantry" else ready(arm)
    start, path = robot.pose(q), circle(robot.pose(q), radius, period)
    plane, pushes = start[2, 3] - gap, stiffness if callable(stiffness) else lambda depth: stiffness * depth
    made = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], [0.0, sin(tilt), cos(tilt)]), [press], **task)
    sensor = wrist(noise=noise if declared_noise is None else declared_noise, cutoff=50.0, drift=drift)
    loop = iq.HybridController(robot, made, dt=dt, sensor=sensor, delay=declared_delay)
    steps = max(1, round(dt / SUBSTEP))
    h, kept = dt / steps, 0.0 if lag == 0.0 else exp(-dt / steps / lag)
    late = kept * (1.0 - kept**steps) / (1.0 - kept)  # how many substeps a tick's change of velocity comes late
    commands = deque([np.zeros(len(q))] * round(delay / dt))
    velocity, force, rubs, bent = np.zeros(len(q)), 0.0, np.zeros(3), np.zeros(len(q))
    ticks, solutions, left = [], [], after_stop
    for k in range(round(seconds / dt)):
        t, tool = k * dt, robot.pose(q)
        value = force if reads is None or t < since else reads(force, t)
        exerts = tool[:3, :3].T @ (value * UP + rubs) + random.normal(0.0, noise, 3)
        reading = np.concatenate((random.normal(0.0, 0.03 * noise, 3), exerts))
        if fault is not None and t >= since:
            reading = fault(reading, tool[:3, :3].T @ UP)
        target, ahead = path(max(0.0, t - slides_from))
        target[0, 3] += speed * max(0.0, t - slides_from)
        ahead[3] += speed
        solutions.append(loop.step(q + bent, target, reading, ahead * (t >= slides_from)))
        commands.append(solutions[-1].velocity)
        command = commands.popleft()
        change, velocity = velocity - command, command + kept**steps * (velocity - command)
        q = q + h * (steps * command + late * change)
        place, before = robot.pose(q)[:3, 3], robot.pose(q - h * velocity)[:3, 3]
        level = plane - drops[0] * (drops[1] <= t < drops[2]) + moves[0] * sin(2.0 * np.pi * moves[1] * t)
        depth, shallower = (level + slope * (p[0] - start[0, 3]) - p[2] for p in (place, before))
        share = 1.0
        if drives < np.inf:
            J = robot.jacobian(q)
            gives = UP @ (J[3:] + np.cross(J[:3].T, place).T) / drives
            share = 1.0 / (1.0 + stiffness * drives * float(gives @ gives))
        force = max(0.0, share * pushes(depth) + damping * (depth - shallower) / h) if depth > 0.0 else 0.0
        if drives < np.inf:
            bent = gives * force
        if friction:
            slide = (place - tool[:3, 3])[:2] / dt
            rubs[:2] = -friction * force * slide / max(np.linalg.norm(slide), 1e-3)
        ticks.append((force, -depth, np.linalg.norm((tool - target)[:2, 3])))
        left -= dt * (solutions[-1].status in STOPPED)
        if left < 0.0:
            break
    return Pressed(*np.array(ticks).T, solutions, dt, loop)


def press_on_damper(arm="gantry", **given):
    """A press on a spring and a damper, f = k x + b x', of an arm that lags; it slides from 2 s on."""
    usual = {"stiffness": 2e4, "noise": 0.1, "dt": 0.004, "lag": 0.005, "declared_delay": 0.005, "seconds": 4.0}
    usual |= {"period": np.inf, "slides_from": 2.0, "after_stop": 0.05}
    return press_on_plane(arm=arm, **usual | given)
