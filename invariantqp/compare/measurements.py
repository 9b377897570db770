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

A law is watched as the supervisor of a robot would: the arm stops in a tick in which it raises or its answer is not
finite. Such a tick has failed, and one after which the arm is further outside its limits. Figures are of the whole run.
"""

from __future__ import annotations

import gc
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter_ns
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.compare.frames import displaced, largest_change, moved_start, random_displacement
from invariantqp.compare.method import answer, pose_of
from invariantqp.compare.registry import controller_named
from invariantqp.compare.tables import EVERYDAY, TASKS
from invariantqp.control.controller import Controls
from invariantqp.errors import InvariantQPError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController, controller_for
from invariantqp.runs.plant import IdealPlant
from invariantqp.runs.prepare import Setup, prepare
from invariantqp.runs.run import run
from invariantqp.runs.taskfile import Task, load_task, shipped_tasks
from invariantqp.runs.trace import Trace, distance
from invariantqp.velocity.solution import Status, VelocitySolution

# The figures of one method, ready for JSON.
Result = dict[str, Any]
# A broken input is NaN in every third tick of the first half of a run; the second half is time to recover.
BROKEN_EVERY = 3
# How long the target is at rest after a path, for the tool to settle [s].
REST = 1.0
# A tool nearer to its target than this has settled [m], [rad]; a first look at a run says as much.
SETTLED = 1e-3, np.radians(1.0)
# The last part of a run, in which the arm should be at rest, as a share of it.
TAIL = 0.1
# Standard deviation of how far each joint is turned and shifted, about and along each axis of the base [rad], [m]: an
# arm whose links were measured by a ruler.
OFF = 5e-3
CALIBRATION = ("compare/panda", "compare/panda_limits", "compare/ur5_limits", "compare/so101_limits")


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
        """Its task, with ticks ten times as long in a quick run."""
        task = load_task(self.task)
        dt = 10.0 * task.law.dt
        return task.model_copy(update={"law": task.law.model_copy(update={"dt": dt})}) if self.quick else task


@dataclass(frozen=True)
class Kind:
    """A measurement."""

    measure: Callable[[Cell], dict[str, Result]]  # a cell to {method: result}
    # whether it measures time. Then nothing else runs meanwhile, and one cell has all methods of a task.
    alone: bool = False
    tasks: tuple[str, ...] | None = None  # the measurement's own tasks; None for the tasks of the sweep
    slow: bool = False  # whether a quick run leaves it out
    on_request: bool = False  # whether only a run that names it has it


class Watched:
    """A law whose arm stops for a tick if the law raises, or if its answer is not finite; such ticks are counted."""

    def __init__(self, law: Controls, broken: str = "", ticks: int = 0) -> None:
        """The input named `broken` is NaN in every third tick of the first half of `ticks`; none if it is empty."""
        self._law = law
        self._broken = broken
        self._last = ticks // 2
        self._tick = 0
        self.exceptions = 0
        self.not_finite = 0

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; never raises."""
        still = np.zeros(len(np.asarray(q)))
        self._tick += 1
        if self._broken and self._tick < self._last and self._tick % BROKEN_EVERY == 0:
            q, target, feedforward = _with_nan(self._broken, q, target, feedforward)
        try:
            solution = self._law.step(q, target, feedforward)
        except Exception as error:  # noqa: BLE001 (exceptions are counted)
            self.exceptions += 1
            return answer(still, Status.HELD, f"{type(error).__name__}: {error}")
        if np.isfinite(solution.velocity).all():
            return solution
        self.not_finite += 1
        return answer(still, Status.HELD, "the answer was not finite")


def _with_nan(broken: str, q: ArrayLike, target: Any, feedforward: ArrayLike | None) -> tuple[Any, Any, Any]:
    """The inputs with NaN in one of them; a target keeps its class, which checked it before."""
    if broken == "q":
        return np.full(len(np.asarray(q)), np.nan), target, feedforward
    if broken == "feedforward":
        return q, target, np.full(6, np.nan)
    pose = target.pose.copy()
    pose[:3, 3] = np.nan
    return q, target._replace(pose=pose), feedforward


def watched_run(setup: Setup, make: MakeController, broken: str = "") -> tuple[Watched, Trace]:
    """A run under a law that is watched, in which an input is sometimes NaN if one is named."""
    with quietly():
        law = Watched(make(setup.problem.robot, setup.problem.law), broken, len(setup.noise))
        return law, run(setup, controller_for(setup.problem, lambda *_: law))


def with_rest(setup: Setup) -> Setup:
    """The setup with a second more, in which the target is at rest."""
    problem, more = setup.problem, round(REST / setup.task.law.dt)
    time = setup.task.law.dt * np.arange(len(problem.time) + more, dtype=np.float64)
    still = np.vstack((problem.feedforward, np.zeros((more, 6))))
    wanted, poses = (np.concatenate((T, np.repeat(T[-1:], more, axis=0))) for T in (setup.wanted, problem.poses))
    noise = np.resize(setup.noise, (len(setup.noise) + more, setup.noise.shape[1]))
    given = replace(problem, time=time, poses=poses, feedforward=still)
    return replace(setup, wanted=wanted, noise=noise, problem=given)


@contextmanager
def quietly() -> Iterator[None]:
    """Suppress warnings, which a failing law would give in every tick."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def figures(law: Watched, trace: Trace) -> Result:
    """What a run is judged by.

    `excess` is the largest of three: how much further a joint went beyond a position limit in a tick, how far beyond
    one it is at the end, and by how much a velocity exceeded its limit; `peak` is the largest joint velocity over its
    limit, `tail` the largest in the last tenth of the run.
    """
    low, high = trace.position_limits
    speed, ticks = np.abs(trace.velocity), len(trace.velocity)
    at_speed = speed >= trace.velocity_limit * (1.0 - NEGLIGIBLE)
    at_end = (trace.q[1:] <= low + NEGLIGIBLE) | (trace.q[1:] >= high - NEGLIGIBLE)
    further, faster = np.diff(trace.outside, axis=0), speed - trace.velocity_limit
    failed = {
        "raised": law.exceptions / ticks,
        "not_finite": law.not_finite / ticks,
        "outside": float(((further > NEGLIGIBLE) | (faster > NEGLIGIBLE)).any(axis=1).mean()),
    }
    return {
        "position_mm": 1e3 * float(trace.position_error.max()),
        "orientation_deg": float(np.degrees(trace.orientation_error.max())),
        "final_mm": 1e3 * float(trace.position_error[-1]),
        "final_deg": float(np.degrees(trace.orientation_error[-1])),
        "limits_met": float((at_speed | at_end).any(axis=1).mean()),
        "acceleration": float(np.abs(trace.acceleration[1:]).max(initial=0.0)),
        "settling_s": settling_time(trace),
        "variation": float(np.abs(np.diff(trace.velocity, axis=0)).sum()),
        "peak": float((speed / trace.velocity_limit).max()),
        "excess": max(0.0, *(float(x.max()) for x in (further, trace.outside[-1], faster))),
        "tail": float(speed[-max(1, round(TAIL * ticks)) :].max()),
        "ticks": ticks,
        **failed,
        "failed_ticks": sum(failed.values()),
    }


def settling_time(trace: Trace) -> float:
    """When the tool is within a millimetre and a degree of its target for good, from when that came to rest on [s].

    inf where it is not at the end of the run.
    """
    off = (trace.position_error > SETTLED[0]) | (trace.orientation_error > SETTLED[1])
    if off[-1]:
        return float("inf")
    came = int(_jumps(trace.wanted).max(initial=0))
    settled = int(np.flatnonzero(off).max(initial=-2)) + 2  # errors start with that after the first tick
    return trace.task.law.dt * max(0, settled - came)


def overshoot(trace: Trace, robot: Robot) -> Array:
    """(2,) the largest errors [m], [rad] beyond those that the target made by jumping: how far the tool swings."""
    first = distance(robot.pose(trace.q[0]), trace.wanted[0])
    errors = np.vstack((first, np.column_stack((trace.position_error, trace.orientation_error))))
    if trace.task.path.jumps:
        since = np.zeros(len(errors), dtype=int)
        since[_jumps(trace.wanted)] = _jumps(trace.wanted)
        errors = errors - errors[np.maximum.accumulate(since)]
    return np.asarray(errors.max(axis=0))


def _jumps(wanted: Array) -> NDArray[np.intp]:
    """Indices of the poses (n, 4, 4) that differ from the one before."""
    return np.flatnonzero((wanted[1:] != wanted[:-1]).any(axis=(1, 2))) + 1


def loops(cell: Cell) -> dict[str, Result]:
    """Errors, motion, failures and frame dependence of one method on one task."""
    task, make = cell.load(), controller_named(cell.method)
    setup = with_rest(prepare(task))
    law, trace = watched_run(setup, make)
    changes = []
    for k in range(1 if cell.quick else 3):
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
    off = OFF * rng.normal(size=(m, 6))
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
    inputs = inputs_of(task, 5 if cell.quick else 20)
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
        taken = interleaved(calls, len(inputs), 3 if cell.quick else 10)
    for name, times in taken.items():
        median, p99 = np.percentile(times, (50.0, 99.0)).tolist()
        found[name] = {"median_us": median, "p99_us": p99}
    return found


def inputs_of(task: Task, stretches: int) -> list[tuple[Array, Array, Array]]:
    """(q, target pose, feedforward) of stretches of ten ticks spread over a run: over its ticks at limits, if any."""
    setup = prepare(task)
    trace, given = run(setup, controller_for(setup.problem)), setup.problem
    length = min(10, (len(trace.q) - 1) // stretches)
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
        for turn in range(-3, rounds):  # the first allocate workspaces and fill caches
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


KINDS = {
    "loop": Kind(loops),
    "beyond": Kind(loops, tasks=tuple(name for name in TASKS if name.startswith("stability/"))),
    "everyday": Kind(everyday, tasks=tuple(EVERYDAY)),
    "calibration": Kind(calibration, tasks=CALIBRATION, slow=True),
    "tick": Kind(tick_times, alone=True),
    "stability": Kind(stability, tasks=tuple(shipped_tasks("stability")), on_request=True),
    **{
        f"NaN in {name}": Kind(partial(stability, broken=name), tasks=("stability/jump",), on_request=True)
        for name in ("q", "target", "feedforward")
    },
}
# What breaks velocity control.
STABILITY = tuple(name for name, kind in KINDS.items() if kind.on_request)
