"""The scenes of examples/22 in closed loop: springs, and a wrist sensor with 0.1 N of noise."""

import runpy
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import invariantqp as iq

SHARED = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "shared" / "contact_scenes.py"))


class Tick(NamedTuple):
    """Pose of the tool and wrench on the surroundings, the solution, and the joint positions after the tick."""

    tool: np.ndarray
    wrench: np.ndarray
    solution: Any
    q: np.ndarray

    @property
    def report(self):
        return self.solution.status, self.solution.reason

    @property
    def force(self):
        return np.linalg.norm(self.wrench[3:])

    @property
    def moment(self):
        return np.linalg.norm(self.wrench[:3] - np.cross(self.tool[:3, 3], self.wrench[3:]))


def loop_of(robot, task, dt=0.004, noise=0.1, **options):
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=noise)
    return iq.HybridController(robot, task, dt=dt, sensor=sensor, **options)


def in_scene(
    robot, q, scene, count, *, starts=0.0, rests=False, change=None, delay=0.0, lags=False, dt=0.004, **options
):
    """Yield ticks of a controller of the scene's task; `change` makes a reading of (tick, tool, reading).

    The target follows the scene's path after `starts` [s], or `rests`; commands act after a delay [s], or joints lag.
    """
    loop = loop_of(robot, iq.HybridTask(scene.told, scene.wanted, **scene.options), dt, delay=delay, **options)
    random, start, velocity = np.random.default_rng(0), robot.pose(q), np.zeros(len(q))
    late, kept = deque([] if lags else [velocity] * round(delay / dt)), np.exp(-dt / delay) if lags else 0.0
    for k in range(count):
        tool = robot.pose(q)
        target, ahead = (start, None) if rests else scene.path(max(0.0, dt * k - starts))
        wrench = scene.world(tool, np.zeros(6))
        reading = iq.coadjoint(iq.inverse(tool)) @ wrench
        reading[3:] += random.normal(0.0, 0.1, 3)
        if change is not None:
            reading = change(k, tool, reading)
        solution = loop.step(q, target, reading, ahead)
        late.append(solution.velocity)
        command = late.popleft()
        velocity = command + kept * (velocity - command)
        q = q + dt * velocity
        yield Tick(tool, wrench, solution, q)
