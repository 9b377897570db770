"""`run_task`: a closed-loop run of a task on the ideal plant or on MuJoCo's; in every tick measure, step, command.

In contact the path waits, and errors do not count, until [contact] settle has passed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import perf_counter_ns
from typing import Any

import numpy as np

from invariantqp.errors import BlindSystem
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.systems.gram import principal_pitches
from invariantqp.velocity.forms import Form, PitchForm
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.workbench.runs.clearancespec import ObstacleScene
from invariantqp.workbench.runs.controllers import ElasticPathController, MakeController, TaskController, controller_for
from invariantqp.workbench.runs.plant import PlantState
from invariantqp.workbench.runs.prepare import Setup, prepare
from invariantqp.workbench.runs.taskfile import Task
from invariantqp.workbench.runs.trace import ClearanceTrace, Trace, contact_trace, errors, is_limit_active, path_trace

# A warning is given where a principal pitch is this close to h, relative to h.
PITCH_MARGIN = 0.1
# The longest duration of an elastic path over that of its timing.
MAX_DURATION_RATIO = 10
Observer = Callable[[int, PlantState, VelocitySolution], None]


def warnings_of(robot: Robot, form: Form | None, q: Array, solutions: Sequence[VelocitySolution]) -> list[str]:
    """Warnings about a run with joint positions q (n + 1, m), under a law with this form."""
    n = len(solutions)
    damped = sum(getattr(s, "damping", 0.0) > 0.0 for s in solutions)  # laws of other controllers may lack it
    warnings = [f"{damped} of {n} ticks were damped, near a singularity or a principal pitch"] if damped else []
    for status in ("limited", "guarded", "scaled", "degraded", "held", "overload", "fault"):
        hits = [s for s in solutions if s.status == status]
        if hits:
            noun = f"{status}s" if status in ("overload", "fault") else status
            warnings.append(f"{len(hits)} of {n} ticks were {noun}; the first: {hits[0].reason}")
    if isinstance(form, PitchForm) and len(robot.names) < 6:
        warnings += _about_pitches(robot, form.h, q)
    return warnings


def _about_pitches(robot: Robot, h: float, q: Array) -> list[str]:
    """A warning where a principal pitch along the path is close to h, or no pitch form works."""
    try:
        pitches = [p for state in q for p in principal_pitches(robot.jacobian(state)).tolist()]
    except BlindSystem as blind:
        return [f"no pitch form sees all of this arm: {blind}"]
    nearest = min(pitches, key=lambda p: abs(p - h), default=None)
    if nearest is None or abs(nearest - h) > PITCH_MARGIN * abs(h):
        return []
    return [f"h = {h:.4g} m comes near the principal pitch {nearest:.4g} m on this path"]


def run_task(
    task: Task,
    *,
    physics: str = "ideal",
    controller: MakeController | None = None,
    observer: Observer | None = None,
    **overrides: Any,
) -> Trace:
    """Run a task in closed loop.

    Args:
        task: from `load_task`.
        physics: the plant: "ideal", or "mujoco" with friction, lag and noise (extra `sim`).
        controller: makes the controller from robot and law: an object with step(q, target, feedforward=None) that
            returns a `VelocitySolution` or has its attributes. None is ours. Not for tasks in contact.
        observer: called after each tick with its number, the plant's state and the solution.
        overrides: keys of the task's [law] to change: dt, gain, form, damping, exact, guard, acceleration_limit, ...

    Returns:
        Trace: trajectory, errors, methods, statuses, times.

    Raises:
        RobotModelError, UnknownName, MissingExtra: the robot cannot be loaded.
    """
    setup = prepare(task, physics, **overrides)
    return run(setup, controller_for(setup.problem, controller), observer)


def run(setup: Setup, controller: TaskController, observer: Observer | None = None) -> Trace:
    """Run a setup, whose plant moves, under a controller, until the last goal or, on an elastic path, its end."""
    plant, goals = setup.plant, setup.problem.goals()
    states, solutions = [plant.state()], []
    n = len(goals)
    tick_ns, wrenches = [], []
    for k in range(n if setup.problem.elastic is None else MAX_DURATION_RATIO * n):
        if setup.problem.obstacle_scene is not None:
            setup.problem.obstacle_scene.move(k * setup.task.law.dt)
        measured = plant.measure()
        measured = measured._replace(q=measured.q + setup.noise[k % n])
        before = perf_counter_ns()
        solution = controller.step(measured, goals[min(k, n - 1)])
        tick_ns.append(perf_counter_ns() - before)
        wrenches.append(controller.wrench)
        plant.command(solution.velocity)
        solutions.append(solution)
        states.append(plant.state())
        if observer is not None:
            observer(k, states[-1], solution)
        if controller.is_done:
            break
    return _trace(setup, controller, states, solutions, np.array(tick_ns), np.array(wrenches))


def _trace(
    setup: Setup,
    controller: TaskController,
    states: list[PlantState],
    solutions: list[VelocitySolution],
    tick_ns: Array,
    wrenches: Array,
) -> Trace:
    """The trace of a run."""
    robot, scene, after = setup.robot, setup.scene, states[1:]
    along = path_trace(setup.path, controller.followed) if isinstance(controller, ElasticPathController) else None
    wanted, time = setup.wanted, setup.problem.time
    if along is not None:
        wanted, time = along.poses, np.asarray(setup.task.law.dt * np.arange(len(states)), np.float64)
    q = np.array([state.q for state in states])
    contacts = [] if scene is None else [scene.task.contact_at(state.pose) for state in after]
    position_error, orientation_error = errors(scene, contacts, after, wanted[1:], setup.task.part).T
    return Trace(
        task=setup.task,
        names=robot.names,
        time=time,
        q=q,
        velocity=np.array([s.velocity for s in solutions]),
        position_error=position_error,
        orientation_error=orientation_error,
        position_limits=np.stack((robot.position_lower, robot.position_upper)),
        velocity_limit=robot.velocity_limit,
        methods=[s.method for s in solutions],
        statuses=[s.status for s in solutions],
        limit_active=[is_limit_active(s) for s in solutions],
        tick_ns=tick_ns,
        wanted=wanted,
        form="" if controller.form is None else controller.form.describe(),
        warnings=warnings_of(robot, controller.form, q, solutions),
        physics=setup.physics,
        counted_from=setup.counted_from,
        contact=None if scene is None else contact_trace(scene, contacts, after, wrenches, setup.wanted[1:]),
        along=along,
        clearance=None
        if setup.problem.obstacle_scene is None
        else _clearance(setup.problem.obstacle_scene, q, setup.task.law.dt),
    )


def _clearance(obstacle_scene: ObstacleScene, q: Array, dt: float) -> ClearanceTrace | None:
    """The least distances at q (n + 1, m), and their bodies; None where no pair is kept apart."""
    nearest = []
    for k, state in enumerate(q):
        obstacle_scene.move(k * dt)
        nearest.append(obstacle_scene.clearance.at(state))
    distances = np.array([near.distance for near in nearest])
    pairs = [f"{near.first} and {near.second}" for near in nearest]
    return ClearanceTrace(distances, pairs, obstacle_scene.clearance.distance) if np.isfinite(distances).any() else None
