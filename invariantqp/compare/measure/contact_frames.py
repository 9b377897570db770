"""How much a run in contact changes when the frames of tool, sensor and contact are chosen differently.

    change = max |x(t) - x'(t)|,    T_tool' = T_tool X,  T_sensor' = T_sensor Y,  T_contact' = T_contact Z

Only the description changes, the physical task is the same. Our controller is compared with the hybrid controller of
textbooks, whose task frame keeps its axes along the surface, as a user would see to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invariantqp.compare.laws.raibert_craig import RaibertCraig
from invariantqp.compare.measure.frames import random_displacement
from invariantqp.control.controller import TRACKING_SHARE
from invariantqp.errors import BadInput
from invariantqp.geometry import se3
from invariantqp.progress import Progress
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.pilots import Offsets, Wish
from invariantqp.runs.plants.touch import Sensed
from invariantqp.runs.run import MakeHybrid, our_hybrid, run_task
from invariantqp.runs.scene import Scene
from invariantqp.runs.taskfile import LawSpec, Task
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


class Textbook:
    """Raibert and Craig's controller for the contact of a task file.

    Attributes:
        measured: (6,) the wrench that the tool exerts according to the sensor, base frame.
    """

    form = None

    def __init__(self, robot: Robot, law: LawSpec, scene: Scene, offsets: Offsets) -> None:
        """Take the arguments of `our_hybrid`; of the displaced frames only those of tool and sensor matter here."""
        self._back = se3.inverse(offsets.tool, check=False)
        self._scene = scene
        self._sensor = scene.sensor.relabelled(offsets.sensor, offsets.tool)
        self._reading = se3.coadjoint(se3.inverse(offsets.sensor, check=False))
        self._loop = RaibertCraig(
            robot,
            SELECTIONS[scene.touch.shape],
            np.eye(3),
            scene.wanted,
            dt=law.dt,
            gain=TRACKING_SHARE / law.dt if law.gain is None else law.gain,
            compliance=np.diag(np.asarray(scene.task.compliance)),
            sensor_axes=np.asarray(self._sensor.mount)[:3, :3],
        )
        self.measured = np.zeros(6)

    def step(self, sensed: Sensed, wish: Wish) -> VelocitySolution:
        """One tick."""
        if sensed.wrench is None:
            raise BadInput("plant", "no force sensor", "a plant that measures the wrench at the tool")
        tool = self._loop.robot.pose(sensed.q)
        exerted = self._sensor.load(self._reading.dot(sensed.wrench), tool)
        self.measured = self._sensor.in_base(exerted, tool)
        self._loop.axes = np.asarray(self._scene.task.contact_at(tool.dot(self._back)).pose)[:3, :3]
        return self._loop.step(sensed.q, wish.target, exerted, wish.ahead)


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
    laws: dict[str, MakeHybrid] = {"invariantqp": our_hybrid, "Raibert-Craig": Textbook}
    tool, sensor, contact = (random_displacement(seed + i) for i in range(3))
    checks = []
    runs = 0

    def count(done: int, total: int) -> None:
        if progress is not None:
            progress(runs * total + done, 2 * len(laws) * total)

    for name, make in laws.items():
        plain = run_task(task, physics=physics, hybrid=make, progress=count)
        runs += 1
        moved = run_task(
            task,
            physics=physics,
            hybrid=make,
            progress=count,
            tool_offset=tool,
            sensor_offset=sensor,
            contact_offset=contact,
        )
        runs += 1
        change = float(np.abs(plain.velocity - moved.velocity).max())
        errors = (1e3 * float(run.position_error[run.settled :].max()) for run in (plain, moved))
        as_told, displaced = errors
        checks.append(ContactFrameCheck(name, change, as_told, plain.force_error, displaced, moved.force_error))
    return checks
