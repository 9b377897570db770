"""What is measured of each method: a function from a cell, one piece of work of a sweep, to the results of its methods.

    loop        the task, with a second of rest at its end: largest errors of the run, largest joint acceleration after
                the first tick, settling time, failed ticks, limits met; and frame, max |q(t) - q'(t)|, q' the same
                motion of a tool frame put elsewhere on the tool, beside control, the same of a start moved by
                1e-12: what is not above that is no dependence
    beyond      the same of targets out of reach, where frames matter most
    everyday    what users meet first, without a frame put elsewhere: stay, jump, turn in place, a singularity, too
                fast, out of reach and back, a late arm; errors beyond those that the target's own jump makes
    calibration an arm whose joints are not where its model says, and a camera that sees the tool
    stability   tasks/stability, at which methods fail; `NaN in q` and its like: the one with a jump, an input broken
    tick        how long a tick takes: pose, Jacobian, law and limits, in states of a run of the task

A tick fails if the method raises, if its answer is not finite, or if the arm is further outside its limits after it.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.frames import displaced, largest_change, moved_start, random_displacement
from invariantqp.compare.method import pose_of
from invariantqp.compare.registry import controller_named
from invariantqp.compare.tables import EVERYDAY, TASKS
from invariantqp.compare.watched import Result, figures, overshoot, quietly, watched_run, with_rest
from invariantqp.control.controller import Controls
from invariantqp.errors import InvariantQPError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import controller_for
from invariantqp.runs.plant import IdealPlant
from invariantqp.runs.prepare import prepare
from invariantqp.runs.run import run
from invariantqp.runs.taskfile import Task, load_task, shipped_tasks
from invariantqp.velocity.solution import VelocitySolution

# In a quick run ticks are this many times longer.
COARSER = 10.0
# Displaced tool frames of a full run and of a quick one.
FRAMES, QUICK_FRAMES = 3, 1
# Standard deviations of how far each joint is turned and shifted, about and along each axis of the base [rad], [m]:
# an arm whose links were measured by a ruler.
TURNED, SHIFTED = 5e-3, 5e-3
CALIBRATION = ("compare/panda", "compare/panda_limits", "compare/ur5_limits", "compare/so101_limits")
# How many stretches of how many consecutive ticks are timed, and how often; then the same for a quick run.
STRETCHES, LENGTH, ROUNDS = 20, 10, 10
QUICK_STRETCHES, QUICK_ROUNDS = 5, 3


@dataclass(frozen=True)
class Cell:
    """One piece of work."""

    kind: str  # the name of a measurement
    task: str  # the name or file of a task
    methods: tuple[str, ...]  # names of methods: a single one, or all of them where time is measured
    seed: int = 0  # seed of everything that is drawn at random
    quick: bool = False  # whether to measure little

    @property
    def method(self) -> str:
        """The method of a cell that has a single one."""
        (name,) = self.methods
        return name

    def load(self) -> Task:
        """Its task, with longer ticks in a quick run."""
        task = load_task(self.task)
        dt = COARSER * task.law.dt
        return task.model_copy(update={"law": task.law.model_copy(update={"dt": dt})}) if self.quick else task


@dataclass(frozen=True)
class Kind:
    """A measurement."""

    measure: Callable[[Cell], dict[str, Result]]  # a cell to {method: result}
    # whether it measures time. Then nothing else runs meanwhile, and one cell has all methods of a task.
    alone: bool = False
    tasks: tuple[str, ...] | None = None  # the measurement's own tasks; None for the tasks of the sweep
    slow: bool = False  # whether a quick run leaves it out
    asked: bool = False  # whether every run leaves it out that does not ask for it by name


def loops(cell: Cell) -> dict[str, Result]:
    """Errors, motion, failures and frame dependence of one method on one task."""
    task, make = cell.load(), controller_named(cell.method)
    setup = with_rest(prepare(task))
    law, trace = watched_run(setup, make)
    changes = []
    for k in range(QUICK_FRAMES if cell.quick else FRAMES):
        other = displaced(with_rest(prepare(task)), random_displacement(cell.seed + k))
        changes.append(largest_change(trace.q, watched_run(other, make)[1].q))
    control = largest_change(trace.q, watched_run(moved_start(task, setup), make)[1].q)
    return {cell.method: {**figures(law, trace), "frame": max(changes), "control": control}}


def everyday(cell: Cell) -> dict[str, Result]:
    """The figures of `loop`, how far errors grow beyond the target's jumps, and how far joints move; never quick."""
    setup = with_rest(prepare(load_task(cell.task)))
    law, trace = watched_run(setup, controller_named(cell.method))
    mm, deg = overshoot(trace, setup.robot) * (1e3, np.degrees(1.0))
    moved = float(np.degrees(np.abs(trace.q - trace.q[0]).max()))
    found = {**figures(law, trace), "grown_mm": float(mm), "grown_deg": float(deg), "joints_deg": moved}
    return {cell.method: found}


def stability(cell: Cell, broken: str = "") -> dict[str, Result]:
    """The figures of `loop`, never quick, in which an input of `step` is sometimes NaN if one is named."""
    run = watched_run(prepare(load_task(cell.task)), controller_named(cell.method), broken)
    return {cell.method: figures(*run)}


class CameraFeedback:
    """A law that is given its target as a camera on the true arm sees it: its model sees it where the camera does.

        q <- q + dt x,   the tool at T(q) by the true screws,   x from the model's J(q) and log(T(q)^-1 T_target)

    The error twist is true, and J is wrong. The true error is what counts.
    """

    def __init__(self, law: Controls, model: Robot, true: Robot) -> None:
        self._law, self._model, self._true = law, model, true

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; the target is the true arm's."""
        seen = np.dot(self._model.pose(q), se3.inverse(self._true.pose(q), check=False))
        ahead = None if feedforward is None else se3.adjoint(seen, check=False).dot(feedforward)
        return self._law.step(q, self._model.target(seen.dot(pose_of(target))), ahead)


def miscalibrated(robot: Robot, seed: int) -> Chain:
    """The arm with every joint turned and shifted at random."""
    rng = np.random.default_rng(seed)
    m = len(robot.names)
    off = rng.normal(size=(m, 6)) * np.repeat((TURNED, SHIFTED), 3)
    screws = robot.jacobian(np.zeros(m))
    moved = np.column_stack([se3.adjoint(se3.exp(d)).dot(s) for d, s in zip(off, screws.T, strict=True)])
    limits = (robot.position_lower, robot.position_upper, robot.velocity_limit)
    return Chain(moved, robot.pose(np.zeros(m)), robot.names, *limits)


def calibration(cell: Cell) -> dict[str, Result]:
    """Largest true error of the run, and the variation of the joint velocities."""
    setup = prepare(cell.load())
    model, law, start = setup.robot, setup.problem.law, np.asarray(setup.task.start())
    true = miscalibrated(model, cell.seed)
    moved = true.pose(start).dot(se3.inverse(model.pose(start)))  # the path begins where the tool is
    poses, ahead = moved @ setup.wanted, setup.problem.feedforward.dot(se3.adjoint(moved).T)
    problem = replace(setup.problem, robot=true, poses=poses, feedforward=ahead)
    other = replace(setup, robot=true, plant=IdealPlant(true, start, law.dt), wanted=poses, problem=problem)
    found = figures(
        *watched_run(other, lambda *_: CameraFeedback(controller_named(cell.method)(model, law), model, true))
    )
    return {cell.method: {key: found[key] for key in ("position_mm", "orientation_deg", "variation", "failed_ticks")}}


def tick_times(cell: Cell) -> dict[str, Result]:
    """Times of whole ticks of all methods in turn, in stretches of consecutive ticks of a run under our law.

    Each round calls all of them, so that a change of the clock rate affects all alike. Every call is timed by itself
    with the nanosecond counter; medians and percentiles are those of single calls.
    """
    task = cell.load()
    robot = task.load_robot()
    inputs = inputs_of(task, QUICK_STRETCHES if cell.quick else STRETCHES)
    calls: dict[str, Callable[[int], object]] = {}
    found: dict[str, Result] = {}
    for name in cell.methods:
        try:
            loop = controller_named(name)(robot, task.law)
            take = getattr(loop, "target", robot.target)  # its own kind of pose is made outside the tick
            calls[name] = partial(_tick, loop, [(q, take(pose), ahead) for q, pose, ahead in inputs])
        except InvariantQPError as error:
            found[name] = {"failed": str(error)}
    with quietly():
        taken = interleaved(calls, len(inputs), QUICK_ROUNDS if cell.quick else ROUNDS)
    return found | {name: spread(times) for name, times in taken.items()}


def inputs_of(task: Task, stretches: int) -> list[tuple[Array, Array, Array]]:
    """(q, target pose, feedforward) of stretches of ticks spread over a run: over its ticks at limits, if any."""
    setup = prepare(task)
    trace, given = run(setup, controller_for(setup.problem)), setup.problem
    length = min(LENGTH, (len(trace.q) - 1) // stretches)
    last = len(trace.q) - 1 - length
    where = np.flatnonzero(trace.limit_active[:last])
    where = where if len(where) else np.arange(last)
    firsts = where[np.linspace(0, len(where) - 1, stretches).astype(int)].tolist()
    ticks = [k for first in firsts for k in range(first, first + length)]
    return [(trace.q[k], given.poses[k], given.feedforward[k]) for k in ticks]


def _tick(loop: Controls, inputs: list[tuple[Array, Any, Array]], i: int) -> object:
    try:
        return loop.step(*inputs[i])
    except Exception:  # noqa: BLE001 (`loops` counts what fails)
        return None


def interleaved(calls: Mapping[str, Callable[[int], object]], count: int, rounds: int) -> dict[str, Array]:
    """Times [us] of call(i) for i in 0..count-1, with each call made `rounds` times: {name: (rounds * count,)}."""
    taken: dict[str, list[int]] = {name: [] for name in calls}
    before = gc.isenabled()
    gc.disable()
    try:
        for turn in range(-min(QUICK_ROUNDS, rounds), rounds):  # the first allocate workspaces and fill caches
            for name, call in calls.items():
                times = []
                for i in range(count):
                    start = perf_counter_ns()
                    call(i)
                    times.append(perf_counter_ns() - start)
                if turn >= 0:
                    taken[name] += times
    finally:
        if before:
            gc.enable()
    return {name: np.array(times) / 1e3 for name, times in taken.items()}


def spread(times: Array) -> dict[str, float]:
    """Median and 99th percentile [us], with the keys of results.json."""
    return {"median_us": float(np.median(times)), "p99_us": float(np.percentile(times, 99.0))}


KINDS = {
    "loop": Kind(loops),
    "beyond": Kind(loops, tasks=tuple(name for name in TASKS if name.startswith("stability/"))),
    "everyday": Kind(everyday, tasks=tuple(EVERYDAY)),
    "calibration": Kind(calibration, tasks=CALIBRATION, slow=True),
    "tick": Kind(tick_times, alone=True),
    "stability": Kind(stability, tasks=tuple(shipped_tasks("stability")), asked=True),
    **{
        f"NaN in {name}": Kind(partial(stability, broken=name), tasks=("stability/jump",), asked=True)
        for name in ("q", "target", "feedforward")
    },
}
# What breaks velocity control.
STABILITY = tuple(name for name, kind in KINDS.items() if kind.asked)
