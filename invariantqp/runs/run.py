"""A task run in closed loop, a pilot on a plant: the ideal one, q <- q + dt x, or MuJoCo's as an independent referee.

The path waits, and errors count, until the task's contact has had its time to settle ([contact] settle): the same time
on either plant.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ValidationError

from invariantqp.control.controller import Controller
from invariantqp.control.controls import Controls
from invariantqp.control.demands import ExactPoint
from invariantqp.control.own_form import tool_metric
from invariantqp.errors import BadInput, BlindSystem
from invariantqp.force.hybrid import HybridController
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.runs.log import Log, distance
from invariantqp.runs.pilots import Alone, InTouch, Offsets, Pilot, Together, Wish
from invariantqp.runs.plants.ideal import IdealPlant, Plant
from invariantqp.runs.plants.touch import Physics, Truth
from invariantqp.runs.scene import Scene, scene_of
from invariantqp.runs.taskfile import LawSpec, Task
from invariantqp.runs.trace import Trace
from invariantqp.systems.centre import centre
from invariantqp.systems.gram import principal_pitches
from invariantqp.velocity.forms import Form, PitchForm
from invariantqp.velocity.limits.toolspeed import ToolSpeed
from invariantqp.velocity.solution import VelocitySolution

Observer = Callable[[int, Truth, VelocitySolution], None]
MakeController = Callable[[Robot, LawSpec], Controls]
MakeHybrid = Callable[[Robot, LawSpec, Scene, Offsets], Pilot]

# A pitch form whose h comes this close to a principal pitch, relative to h, is worth a warning.
NEAR_PITCH = 0.1
# States looked at for principal pitches; a path is smooth, every tick would only cost time.
PITCH_SAMPLES = 200


def law_form(robot: Robot, law: LawSpec) -> Form | float | None:
    """The form that a task's [law] asks for."""
    if law.form == "carried":
        return tool_metric(robot)
    if law.form == "pitch" and law.pitch is None:
        return centre(robot.jacobian(middle(robot))).length
    return law.pitch


def law_options(robot: Robot, law: LawSpec) -> dict[str, Any]:
    """What a task's [law] says, as `Controller` takes it."""
    return {
        "dt": law.dt,
        "gain": law.gain,
        "form": law_form(robot, law),
        "damping": law.damping,
        "guard": law.guard,
        "posture": law.posture,
        "joint_metric": law.joint_metric,
        "backend": law.backend,
        "exact": None if law.exact is None else ExactPoint(law.point),
        "acceleration_limit": law.acceleration,
        "position_margin": law.margin,
        "tool_speed": None if law.tool_speed is None else ToolSpeed(law.tool_speed, law.tool_speed_point),
    }


def our_controller(robot: Robot, law: LawSpec) -> Controller:
    """The controller that a task's [law] describes."""
    return Controller(robot, **law_options(robot, law))


def our_hybrid(robot: Robot, law: LawSpec, scene: Scene, offsets: Offsets) -> InTouch:
    """The hybrid controller that a task's [law], [contact] and [force] describe, told in displaced frames."""
    task = scene.task
    if not (np.array_equal(offsets.contact, np.eye(4)) and np.array_equal(offsets.tool, np.eye(4))):
        task = task.relabelled(offsets.contact, offsets.tool)
    sensor = scene.sensor.relabelled(offsets.sensor, offsets.tool)
    return InTouch(HybridController(robot, task, sensor=sensor, **law_options(robot, law)), offsets.sensor)


def run_task(
    task: Task,
    *,
    physics: str = "ideal",
    tool_offset: ArrayLike | None = None,
    sensor_offset: ArrayLike | None = None,
    contact_offset: ArrayLike | None = None,
    controller: MakeController = our_controller,
    hybrid: MakeHybrid = our_hybrid,
    progress: Progress | None = None,
    observer: Observer | None = None,
    **overrides: Any,
) -> Trace:
    """Run a task in closed loop.

    Args:
        task: from `load_task`.
        physics: the plant: "ideal", or "mujoco" with friction, lag and noise (extra `sim`).
        tool_offset: (4, 4) displacement of the tool frame in itself; the same physical motion is asked of it.
        sensor_offset: likewise of the frame that wrenches are read in.
        contact_offset: likewise of the frame that the contact is told in.
        controller: makes the controller from robot and law; ours by default.
        hybrid: makes the one for tasks with contact; ours by default.
        progress: called with (ticks done, ticks in all).
        observer: called after each tick with (its number, what was so then, the solution).
        overrides: keys of the task's [law] to change: dt, gain, form, pitch, damping, exact, guard, acceleration, ...

    Returns:
        Trace: trajectory, errors, methods, statuses, times.

    Raises:
        BadInput: an override that no law has, a start outside any sense, shapes that do not fit.
        RobotModelError, UnknownName, MissingExtra: the robot cannot be had.
    """
    law = _overridden(task.law, overrides)
    task = task.model_copy(update={"law": law})
    robot = task.load_robot()
    start = task.start()
    scene = None
    if task.contact is not None and task.force is not None:
        scene = scene_of(task.contact, task.force, robot.pose(start))
    plant = _plant(task, robot, scene, physics)
    offsets = Offsets(
        *(
            np.eye(4) if given is None else arrays.pose(given, name)
            for name, given in (
                ("tool_offset", tool_offset),
                ("sensor_offset", sensor_offset),
                ("contact_offset", contact_offset),
            )
        )
    )
    offset = offsets.tool
    moved = robot if tool_offset is None else robot.with_tool(offset)
    back = se3.inverse(offset)
    points = {key: back.dot([*getattr(law, key), 1.0])[:3] for key in ("point", "tool_speed_point")}
    law = law.model_copy(update={key: tuple(p.tolist()) for key, p in points.items()})
    pilot = _alone(task, law, controller(moved, law)) if scene is None else hybrid(moved, law, scene, offsets)
    settle = 0.0 if task.contact is None else task.contact.settle
    first, n = round(settle / law.dt), max(1, round((settle + task.path.duration) / law.dt))
    time: Array = law.dt * np.arange(n + 1, dtype=np.float64)
    wanted = _wanted(task, robot, scene, time - settle)
    targets = [moved.target(T.dot(offset)) for T in wanted]
    ahead = [np.zeros(6) if task.path.jumps else se3.log(b.dot(se3.inverse(a))) / law.dt for a, b in pairwise(wanted)]
    noise = np.random.default_rng(0).normal(0.0, task.encoder_noise or 0.0, (n, len(start)))
    log = None if scene is None else Log(scene)
    q = np.empty((n + 1, len(start)))
    ticks = np.empty(n)
    solutions: list[VelocitySolution] = []
    for k in range(n):
        sensed = plant.sense()
        q[k] = sensed.q
        sensed = sensed._replace(q=sensed.q + noise[k])
        wish = Wish(targets[k], ahead[k], time[k])
        before = perf_counter_ns()
        solution = pilot.step(sensed, wish)
        ticks[k] = perf_counter_ns() - before
        solutions.append(solution)
        plant.command(solution.velocity)
        if log is not None:
            log.add(plant.truth(), wanted[k + 1], pilot.measured)
        if observer is not None:
            observer(k, plant.truth(), solution)
        if progress is not None:
            progress(k + 1, n)
    q[n] = plant.sense().q
    if log is not None:
        errors = np.array(log.errors)
    else:
        errors = np.array([distance(robot.pose(q[k + 1]), wanted[k + 1]) for k in range(n)])
    return Trace(
        task=task,
        names=robot.names,
        time=time,
        q=q,
        velocity=np.array([s.velocity for s in solutions]),
        position_error=errors[:, 0],
        orientation_error=errors[:, 1],
        position_limits=np.stack((robot.position_lower, robot.position_upper)),
        velocity_limit=robot.velocity_limit,
        methods=[s.method for s in solutions],
        statuses=[s.status for s in solutions],
        bound=[bool(s.active) for s in solutions],
        tick_ns=ticks,
        wanted=np.array(wanted),
        form="" if pilot.form is None else pilot.form.describe(),
        warnings=_warnings(robot, pilot.form, q, solutions),
        physics=physics,
        settled=first,
        contact=None if log is None else log.contact(),
    )


def _plant(task: Task, robot: Robot, scene: Scene | None, physics: str) -> Plant:
    touch, wrist = (None, None) if scene is None else (scene.touch, scene.wrist)
    if physics == "ideal":
        return IdealPlant(robot, task.start(), task.law.dt, touch, wrist)
    if physics != "mujoco":
        raise BadInput("physics", repr(physics), '"ideal" or "mujoco"')
    from invariantqp.runs.plants.mujoco import MujocoPlant  # only where it is asked for

    given = Physics(**task.physics.model_dump())
    return MujocoPlant(task.urdf(), robot, task.start(), task.law.dt, touch, wrist, given)


def _alone(task: Task, law: LawSpec, loop: Controls) -> Pilot:
    if task.operator is not None and isinstance(loop, Controller):
        return Together(loop, task.operator, np.array(law.point))
    return Alone(loop)


def _wanted(task: Task, robot: Robot, scene: Scene | None, time: Array) -> list[Array]:
    """Tool poses (4, 4) at times since the path began; before that it waits."""
    pose = task.path.along(robot, task.start())
    path = [pose(t) for t in np.maximum(time, 0.0).tolist()]
    return path if scene is None else [scene.drop(T) for T in path]


def _overridden(law: LawSpec, overrides: dict[str, Any]) -> LawSpec:
    unknown = sorted(set(overrides) - set(LawSpec.model_fields))
    if unknown:
        raise BadInput("overrides", ", ".join(unknown), f"some of {', '.join(LawSpec.model_fields)}")
    try:
        return LawSpec.model_validate({**law.model_dump(), **overrides})
    except ValidationError as error:
        wrong = error.errors()[0]
        key = str(wrong["loc"][0])
        expected = wrong["msg"][0].lower() + wrong["msg"][1:]
        raise BadInput(key, repr(overrides[key]), expected) from error


def _warnings(robot: Robot, form: Form | None, q: Array, solutions: list[VelocitySolution]) -> list[str]:
    said = []
    n = len(solutions)
    damped = [s for s in solutions if s.damping > 0.0]
    if damped:
        said.append(f"{len(damped)} of {n} ticks were damped, near a singularity or a principal pitch")
    for status in ("guarded", "scaled", "degraded", "held"):
        hits = [s for s in solutions if s.status == status]
        if hits:
            said.append(f"{len(hits)} of {n} ticks were {status}; the first: {hits[0].reason}")
    if isinstance(form, PitchForm) and len(robot.names) < 6:
        said.extend(_pitch_warnings(robot, form.h, q))
    return said


def _pitch_warnings(robot: Robot, h: float, q: Array) -> list[str]:
    nearest = None
    for state in q[:: max(1, len(q) // PITCH_SAMPLES)]:
        try:
            pitches = principal_pitches(robot.jacobian(state))
        except BlindSystem as blind:
            return [f"no pitch form sees all of this arm: {blind}"]
        for p in pitches.tolist():
            if nearest is None or abs(p - h) < abs(nearest - h):
                nearest = p
    if nearest is None or abs(nearest - h) > NEAR_PITCH * abs(h):
        return []
    return [f"h = {h:.4g} m comes near the principal pitch {nearest:.4g} m on this path"]
