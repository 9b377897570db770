"""How much a run in contact changes when the frames of tool, sensor and contact are chosen differently.

    change = max |x(t) - x'(t)|,    T_tool' = T_tool X,  T_sensor' = T_sensor Y,  T_contact' = T_contact Z

Only the description changes, the physical task is the same. Our controller is compared with the hybrid controller of
textbooks, whose task frame keeps its axes along the surface, as a user would see to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from invariantqp.compare.laws.raibert_craig import RaibertCraig
from invariantqp.compare.measure.displaced import displaced
from invariantqp.compare.measure.frames import random_displacement
from invariantqp.compare.names import OURS
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import BadInput
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.runs.brief import Goal
from invariantqp.runs.pilots import Pilot, pilot_of
from invariantqp.runs.plants.plant import Measurement
from invariantqp.runs.prepare import Setup, prepare
from invariantqp.runs.run import run
from invariantqp.runs.taskfile import Task
from invariantqp.velocity.solution import VelocitySolution

# Diagonal of the selection matrix for each shape of contact, rotations first: 1 for motion, 0 for force.
SELECTIONS = {
    "point": (1.0, 1.0, 1.0, 1.0, 1.0, 0.0),
    "edge": (1.0, 0.0, 1.0, 1.0, 1.0, 0.0),
    "face": (0.0, 0.0, 1.0, 1.0, 1.0, 0.0),
    "hinge": (0.0, 0.0, 1.0, 0.0, 1.0, 0.0),
}


@dataclass(frozen=True)
class ContactFrameCheck:
    """What other frames changed for one controller.

    Attributes:
        law: its name.
        change: largest change of a joint velocity during the run [rad/s, m/s].
        error_mm: largest path error after the contact has settled, with the frames of the task file [mm].
        force_error: rms error of the true force divided by the wanted force, with the frames of the task file.
        displaced_error_mm: the same path error with displaced frames [mm].
        displaced_force_error: the same force error with displaced frames.
    """

    law: str
    change: float
    error_mm: float
    force_error: float | None
    displaced_error_mm: float
    displaced_force_error: float | None


class Textbook(Pilot):
    """Raibert and Craig's controller as a pilot, for the contact of a task file."""

    def __init__(self, setup: Setup, tool: Array | None = None) -> None:
        """For a run in displaced frames, of which it knows the sensor's, and the tool's by its (4, 4) displacement."""
        brief, scene = setup.brief, setup.scene
        if scene is None or brief.sensor is None:
            raise BadInput("setup", "a task without contact", "one with [contact] and [force]")
        law = brief.law
        self._back = np.eye(4) if tool is None else se3.inverse(tool)
        self._contact_at = scene.task.contact_at
        self._sensor = brief.sensor
        self._loop = RaibertCraig(
            brief.robot,
            np.array(SELECTIONS[scene.springs.shape]),
            np.eye(3),
            scene.wanted,
            dt=law.dt,
            gain=tracking_gain(law.gain, law.dt),
            compliance=np.diag(np.asarray(scene.task.compliance)),
            sensor_axes=np.asarray(self._sensor.mount)[:3, :3],
        )

    def step(self, measured: Measurement, goal: Goal) -> VelocitySolution:
        """One tick."""
        if measured.wrench is None:
            raise BadInput("plant", "no force sensor", "a plant that measures the wrench at the tool")
        tool = self._loop.robot.pose(measured.q)
        exerted = self._sensor.load(measured.wrench, tool)
        self.wrench = self._sensor.in_base(exerted, tool)
        self._loop.axes = np.asarray(self._contact_at(tool.dot(self._back)).pose)[:3, :3]
        return self._loop.step(measured.q, goal.target, exerted, goal.feedforward)


def contact_frame_check(
    task: Task, seed: int = 0, physics: str = "ideal", progress: Progress | None = None
) -> list[ContactFrameCheck]:
    """Run a task with contact in its own frames and in frames displaced at random, under our controller and another.

    Args:
        task: a task with contact, from `load_task`.
        seed: seed of the three displacements.
        physics: the plant, "ideal" or "mujoco".
        progress: called with (ticks done, ticks in all).

    Returns:
        One ContactFrameCheck for each controller; ours is the first.

    Raises:
        BadInput: no such plant, or one without a force sensor.
    """
    laws: dict[str, Callable[[Setup, Array | None], Pilot]] = {
        OURS: lambda setup, _: pilot_of(setup.brief),  # it needs to be told of no displacement
        "Raibert-Craig": Textbook,
    }
    tool, sensor, contact = (random_displacement(seed + i) for i in range(3))
    checks = []
    runs = 0

    def count(done: int, total: int) -> None:
        if progress is not None:
            progress(runs * total + done, 2 * len(laws) * total)

    for name, make in laws.items():
        as_told, moved = prepare(task, physics), displaced(prepare(task, physics), tool, sensor, contact)
        plain = run(as_told, make(as_told, None), count)
        runs += 1
        other = run(moved, make(moved, tool), count)
        runs += 1
        change = float(np.abs(plain.velocity - other.velocity).max())
        errors = [1e3 * float(trace.position_error[trace.counted_from :].max()) for trace in (plain, other)]
        checks.append(ContactFrameCheck(name, change, errors[0], plain.force_error, errors[1], other.force_error))
    return checks
