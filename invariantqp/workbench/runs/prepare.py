"""A run prepared from a task: its plant, its desired poses, and the problem that its controller gets."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from invariantqp.control.target import Target
from invariantqp.errors import BadInput, InvariantQPError, TaskFileError
from invariantqp.force.contact import HybridTask
from invariantqp.force.sensor import WrenchSensor
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.workbench.runs.clearancespec import ObstacleScene
from invariantqp.workbench.runs.contactspec import OperatorSpec
from invariantqp.workbench.runs.path import PoseAt
from invariantqp.workbench.runs.plant import IdealPlant, Plant
from invariantqp.workbench.runs.scene import ContactScene, scene_of
from invariantqp.workbench.runs.section import message
from invariantqp.workbench.runs.taskfile import LawSpec, Task, checked_start


class Goal(NamedTuple):
    """The goal of a tick."""

    target: Any  # tool pose, as `robot.target` returned it; a `Target` where the path leaves something free
    feedforward: Array  # (6,) twist of the target, base frame [rad/s, m/s]
    time: float  # [s]


@dataclass(frozen=True, eq=False)
class ControlProblem:
    """What a controller gets before a run; it may be expressed in other frames than the task file, see `frames.py`."""

    robot: Robot  # the arm, with the tool frame that targets are for
    law: LawSpec  # the [law] table; its points are in that tool frame
    time: Array  # (n + 1,) [s]
    poses: Array  # (n + 1, 4, 4) desired tool poses
    feedforward: Array  # (n, 6) their twists, base frame [rad/s, m/s]
    contact_task: HybridTask | None = None  # None without contact
    sensor: WrenchSensor | None = None  # the force sensor's model; None without contact
    operator: OperatorSpec | None = None  # None without an operator
    obstacle_scene: ObstacleScene | None = None  # obstacles and clearance; None without
    part: Target | None = None  # the constrained part of the poses; None where all is
    elastic: Array | None = None  # (m,) start of an elastic path; None for fixed timing

    def goals(self) -> list[Goal]:
        """The goals of all ticks."""
        target = self.robot.target if self.part is None else self.part.met_by
        ticks = zip(self.poses, self.feedforward, self.time.tolist(), strict=False)
        return [Goal(target(T), twist, t) for T, twist, t in ticks]


@dataclass(frozen=True, eq=False)
class Setup:
    """Everything that one run needs."""

    task: Task  # with the overrides in its law
    robot: Robot  # the arm, with the task's tool frame, where errors are measured
    scene: ContactScene | None  # None without contact
    physics: str  # the name of the plant, "ideal" or "mujoco"
    plant: Plant  # at its start; a second run needs a second setup
    path: PoseAt  # desired tool pose at the path's own time [s]
    wanted: Array  # (n + 1, 4, 4) the same, tick by tick
    noise: Array  # (n, m) what the controller's joint positions are off by [rad, m]
    counted_from: int  # the first tick whose errors count; 0 without contact
    problem: ControlProblem  # what the controller is given


def prepare(task: Task, physics: str = "ideal", **overrides: Any) -> Setup:
    """Prepare a run of a task; arguments and errors as in `run_task`."""
    arrays.instance(task, Task, "task", "a Task, such as load_task returns")
    task = task.model_copy(update={"law": with_overrides(task.law, overrides)})
    try:
        return _prepared(task, physics)
    except InvariantQPError:
        errors = task.mismatches()
        if len(errors) > 1:
            raise TaskFileError(task.name, errors) from None
        raise


def _prepared(task: Task, physics: str) -> Setup:
    """Prepare a run of a task whose law is final."""
    law, n = task.law, task.ticks
    robot = task.load_robot()
    start = checked_start(robot, task.start())
    scene = scene_of(task, robot.pose(start), task.physics.force_noise if physics == "mujoco" else 0.0)
    time: Array = law.dt * np.arange(n + 1, dtype=np.float64)
    pose = task.path.along(robot, start)
    path = [pose(t) for t in np.maximum(time - task.settle, 0.0).tolist()]  # it waits until contact has settled
    wanted = np.array(path if scene is None else [scene.on_surface(T) for T in path])
    return Setup(
        task=task,
        robot=robot,
        scene=scene,
        physics=physics,
        plant=_plant(task, robot, scene, physics),
        path=pose,
        wanted=wanted,
        noise=np.random.default_rng(0).normal(0.0, task.encoder_noise or 0.0, (n, len(start))),
        counted_from=round(task.settle / law.dt),
        problem=ControlProblem(
            robot=robot,
            law=law,
            time=time,
            poses=wanted,
            feedforward=np.zeros((n, 6)) if task.path.jumps else twists_between(wanted, law.dt),
            contact_task=None if scene is None else scene.task,
            sensor=None if scene is None else scene.sensor,
            operator=task.operator,
            obstacle_scene=task.obstacle_scene(robot),
            part=task.part,
            elastic=task.start() if task.path.timing == "elastic" else None,
        ),
    )


def twists_between(poses: Array, dt: float) -> Array:
    """(n - 1, 6) twists that lead from each of (n, 4, 4) poses to the next in dt, base frame [rad/s, m/s]."""
    return np.array([se3.displacement(a, b) / dt for a, b in pairwise(poses)])


def with_overrides(law: LawSpec, overrides: dict[str, Any]) -> LawSpec:
    """A law with some of its keys changed, checked as those of a file."""
    keys = LawSpec.model_fields
    for name in overrides:
        if name not in keys:
            raise BadInput("overrides", name, f"some of {', '.join(keys)}")
    try:
        return LawSpec.model_validate({**law.model_dump(), **overrides})
    except ValidationError as error:
        wrong = error.errors()[0]
        key = str(wrong["loc"][0])
        raise BadInput(key, repr(overrides[key]), message(wrong)) from error


def _plant(task: Task, robot: Chain, scene: ContactScene | None, physics: str) -> Plant:
    springs, sensor = (None, None) if scene is None else (scene.springs, scene.simulated_sensor)
    if physics == "ideal":
        return IdealPlant(robot, task.start(), task.law.dt, springs, sensor, task.physics.delay)
    if physics != "mujoco":
        raise BadInput("physics", repr(physics), '"ideal" or "mujoco"')
    from invariantqp.workbench.runs.mujoco import MujocoPlant  # MuJoCo is loaded only here

    return MujocoPlant(task.urdf(), robot, task.start(), task.law.dt, springs, sensor, task.physics)
