"""A pen on a spring plane as a robot's cell is: a noisy sensor, dead time, a normal declared wrong, faults."""

from collections import deque
from typing import NamedTuple

import numpy as np

import invariantqp as iq
from support.spring_plane import PANDA, circle, exerted, in_tool
from support.wrist import wrist

EACH = np.repeat((0.03, 1.0), 3)  # noise of a moment and a force beside each other
STOPPED = ("overload", "fault")  # the tool stands still or retreats until reset


class Run(NamedTuple):
    """Ticks of a run: the true press [N], the tip's height [m], solutions."""

    press: np.ndarray
    height: np.ndarray
    solutions: list
    dt: float

    def statuses(self, start=0):
        return [s.status for s in self.solutions[start:]]

    def touch(self):
        return int(np.argmax(self.press > 0.0)) if self.press.max() > 0.0 else len(self.press)

    def stopped(self):
        """The tick from which the tool stands still or retreats until reset."""
        return next((k for k, s in enumerate(self.solutions) if s.status in STOPPED), None)


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


def press_on_plane(
    press=10.0,
    *,
    stiffness=1e4,
    noise=0.2,
    declared_noise=None,
    dt=0.002,
    seconds=3.0,
    gap=0.002,
    tilt=0.0,
    delay=0.0,
    declared_delay=0.0,
    removed=np.inf,
    fault=None,
    since=np.inf,
    period=3.0,
    seed=0,
    after_stop=np.inf,
    **task,
):
    """A Panda draws a circle with a pen; `fault` changes readings (6,) from `since` on, given the outward normal.

    The run ends after `seconds`, or `after_stop` seconds after the tool stands still or retreats until reset.
    """
    rng, robot, q = np.random.default_rng(seed), iq.load_robot("panda"), PANDA.copy()
    start = robot.pose(q)
    normal = [0.0, np.sin(tilt), np.cos(tilt)]
    made = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], normal), [press], **task)
    sensor = wrist(noise=noise if declared_noise is None else declared_noise, cutoff=50.0)
    loop = iq.HybridController(robot, made, dt=dt, sensor=sensor, delay=declared_delay)
    path, late = circle(start, 0.03, period), deque([np.zeros(7)] * round(delay / dt))
    presses, heights, solutions, stopped = [], [], [], 0
    for k in range(round(seconds / dt)):
        t, pose = k * dt, robot.pose(q)
        exerts = exerted([pose[:3, 3]], start[2, 3] - gap - (0.05 if t >= removed else 0.0), stiffness)
        reading = noise * rng.normal(size=6) * EACH - in_tool(pose, exerts)
        if fault is not None and t >= since:
            reading = fault(reading, pose[:3, :3].T @ [0.0, 0.0, 1.0])
        target, ahead = path(t)
        solutions.append(loop.step(q, target, reading, ahead))
        presses.append(-exerts[5])
        heights.append(pose[2, 3])
        late.append(solutions[-1].velocity)
        q = q + dt * late.popleft()
        stopped += solutions[-1].status in STOPPED
        if stopped * dt > after_stop:
            break
    return Run(np.array(presses), np.array(heights), solutions, dt)
