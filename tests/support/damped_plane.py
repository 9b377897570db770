"""An arm that lags and presses on a plane with a spring and a damper, and a sensor that can fail: f = k x + b x'."""

from math import exp
from typing import NamedTuple

import numpy as np

import invariantqp as iq
from support.arms import ready
from support.spring_plane import PANDA, UP, gantry

ARMS = {"gantry": np.zeros(6), "panda": PANDA, "ur5": ready("ur5"), "xarm7": ready("xarm7")}
SUBSTEP = 5e-4  # [s]


class Pressed(NamedTuple):
    """Of each tick the true press [N], height above the plane [m], status and reason; and the controller."""

    press: np.ndarray
    height: np.ndarray
    reports: list
    dt: float
    loop: iq.HybridController

    @property
    def stopped(self):
        """The tick of the first overload or fault; None for none."""
        return next((k for k, (status, _) in enumerate(self.reports) if status in ("overload", "fault")), None)


def robot_of(arm):
    return gantry() if arm == "gantry" else iq.load_robot(arm)


def press_on_damper(
    arm="gantry",
    *,
    stiffness=2e4,
    damping=0.0,
    press=10.0,
    noise=0.1,
    dt=0.004,
    lag=0.005,
    declared_delay=0.005,
    gap=0.002,
    seconds=4.0,
    speed=0.0,
    circle=0.0,
    slope=0.0,
    moves=(0.0, 1.0),
    drops=(0.0, np.inf, np.inf),
    slides_from=2.0,
    reads=None,
    since=np.inf,
    seed=0,
    drives=np.inf,
    drift=0.0,
    **task,
):
    """Press, and slide with a speed from a time on, straight or on a circle; `reads` makes a reading of the true press.

    It does so from `since` on. The plane moves by a height [m], so many times a second, and is lower by
    another from one time to another. Drives of a stiffness [N m/rad]
    give way to the force, which joints then measure. The run ends 0.05 s after it has stopped.
    """
    random, robot, q = np.random.default_rng(seed), robot_of(arm), ARMS[arm].copy()
    start = robot.pose(q)
    plane = start[2, 3] - gap
    made = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], UP), [press], **task)
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=noise, drift=drift)
    loop = iq.HybridController(robot, made, dt=dt, sensor=sensor, delay=declared_delay)
    steps = max(1, round(dt / SUBSTEP))
    h, kept = dt / steps, 0.0 if lag == 0.0 else exp(-dt / steps / lag)
    late = kept * (1.0 - kept**steps) / (1.0 - kept)  # how many substeps a tick's change of velocity comes late
    velocity, force, bent = np.zeros(len(q)), 0.0, np.zeros(len(q))
    presses, heights, reports, left = [], [], [], round(0.05 / dt)
    for k in range(round(seconds / dt)):
        t, tool = k * dt, robot.pose(q)
        value = force if reads is None or t < since else reads(force, t)
        push = tool[:3, :3].T @ (value * UP) + random.normal(0.0, noise, 3)
        target, ahead = start.copy(), np.zeros(6)
        way, pace = speed * max(0.0, t - slides_from), speed * (t >= slides_from)
        angle = way / circle if circle else 0.0
        target[:2, 3] += (circle * np.array([np.sin(angle), 1.0 - np.cos(angle)])) if circle else (way, 0.0)
        ahead[3:5] = pace * np.cos(angle), pace * np.sin(angle)
        solution = loop.step(q + bent, target, np.concatenate((random.normal(0.0, 0.03 * noise, 3), push)), ahead)
        reports.append((str(solution.status), solution.reason))
        change = velocity - solution.velocity
        velocity = solution.velocity + kept**steps * change
        q = q + h * (steps * solution.velocity + late * change)
        low = drops[0] * (drops[1] <= t < drops[2])
        depth, before = (
            plane - low + slope * (p[0] - start[0, 3]) + moves[0] * np.sin(2.0 * np.pi * moves[1] * t) - p[2]
            for p in (robot.pose(q)[:3, 3], robot.pose(q - h * velocity)[:3, 3])
        )
        gives = UP @ (robot.jacobian(q)[3:] + np.cross(robot.jacobian(q)[:3].T, robot.pose(q)[:3, 3]).T) / drives
        share = 1.0 / (1.0 + stiffness * drives * float(gives @ gives)) if drives < np.inf else 1.0
        force = max(0.0, stiffness * share * depth + damping * (depth - before) / h) if depth > 0.0 else 0.0
        bent = gives * force
        presses.append(force)
        heights.append(-depth)
        left -= reports[-1][0] in ("overload", "fault")
        if left < 0:
            break
    return Pressed(np.array(presses), np.array(heights), reports, dt, loop)
