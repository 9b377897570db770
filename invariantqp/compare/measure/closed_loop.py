"""Every method as a controller: how well it tracks, how the joints move, how often it fails, and how long a tick takes.

    closed_loop   the task as it is: tracking errors, total variation of the joint velocities, share of failed ticks
    singular      through a singularity, without speed limits: largest joint speed divided by the limit left out
    hard          tasks that are difficult for velocity control: share of failed ticks
    tick          median and 99th percentile of the time of a whole tick, in states of a run of the task

A tick fails if the method raises, if its answer is not finite, or if the arm is further outside its limits after it
than before.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from invariantqp.compare.cell import Cell, Kind, Result
from invariantqp.compare.measure.rewrite import rewrite
from invariantqp.compare.measure.stability import INSIDE, Watched, quietly, run_watched
from invariantqp.compare.measure.timing import interleaved, spread
from invariantqp.compare.registry import controller_named
from invariantqp.control.controls import Controls
from invariantqp.errors import InvariantQPError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.run import run_task
from invariantqp.runs.taskfile import LawSpec, Task, load_task
from invariantqp.runs.trace import Trace

# Tasks through singularities of the elbow, the shoulder and the wrist, with six joints and with seven.
SINGULAR = tuple(f"stability/{arm}_{where}" for arm in ("ur5", "panda") for where in ("wrist", "elbow", "shoulder"))
# Tasks in which ticks fail: targets out of reach, starts outside the limits, jumps, loss of rank.
HARD = tuple(
    f"stability/{name}"
    for name in (
        "five_joints_out_of_reach",
        "jump",
        "limit_all_along",
        "out_of_reach_fast",
        "outside_limits",
        "panda_wrist",
        "pitch_crossing",
        "rank_one",
        "repeated_joints",
    )
)
# In a quick run ticks are this many times longer, and of the tasks above only these remain.
COARSER = 10.0
QUICK = ("stability/ur5_wrist", "stability/outside_limits")
# How many stretches of how many consecutive ticks are timed, and how often; then the same for a quick run.
STRETCHES, LENGTH, ROUNDS = 10, 20, 5
QUICK_STRETCHES, QUICK_ROUNDS = 4, 2


def task_of(cell: Cell) -> Task:
    """The task of a cell, with longer ticks in a quick run."""
    task = load_task(cell.task)
    if not cell.quick:
        return task
    return task.model_copy(update={"law": task.law.model_copy(update={"dt": COARSER * task.law.dt})})


def tracking(cell: Cell) -> dict[str, Result]:
    """Errors, motion and failures of the task in closed loop."""
    watched, trace = run_watched(task_of(cell), controller_named(cell.method))
    figures = trace.summary()
    return {
        cell.method: {
            "position_mm": figures["position_error_mm"],
            "orientation_deg": figures["orientation_error_deg"],
            "final_position_mm": figures["final_position_error_mm"],
            "limits_active": figures["limits_active"],
            **_motion(trace),
            **_failures(watched, trace),
        }
    }


def without_speed_limits(cell: Cell) -> dict[str, Result]:
    """Joint speeds and failures of the same arm without speed limits, through a singularity."""
    if cell.quick and cell.task not in QUICK:
        return {}
    make = controller_named(cell.method)

    def unlimited(robot: Robot, law: LawSpec) -> Controls:
        return make(rewrite(robot, speed_limits=False), law)

    watched, trace = run_watched(load_task(cell.task), unlimited)
    stopped = (watched.exceptions + watched.not_finite) / len(trace.velocity)
    return {
        cell.method: {**_motion(trace), "stopped": stopped, "final_position_mm": 1e3 * float(trace.position_error[-1])}
    }


def failures(cell: Cell) -> dict[str, Result]:
    """The share of failed ticks of a difficult task."""
    if cell.quick and cell.task not in QUICK:
        return {}
    return {cell.method: _failures(*run_watched(load_task(cell.task), controller_named(cell.method)))}


def _motion(trace: Trace) -> dict[str, float]:
    """Largest joint speed divided by its limit, and total variation of the joint velocities [rad/s, m/s]."""
    return {
        "peak": float((np.abs(trace.velocity) / trace.velocity_limit).max()),
        "variation": float(np.abs(np.diff(trace.velocity, axis=0)).sum()),
    }


def _failures(watched: Watched, trace: Trace) -> dict[str, Any]:
    low, high = trace.position_limits
    outside = np.maximum(np.maximum(low - trace.q, trace.q - high), 0.0)
    left = (np.diff(outside, axis=0) > INSIDE) | (np.abs(trace.velocity) - trace.velocity_limit > INSIDE)
    ticks = len(trace.velocity)
    ways = {
        "raised": watched.exceptions / ticks,
        "not_finite": watched.not_finite / ticks,
        "outside": float(left.any(axis=1).mean()),
    }
    return {"ticks": ticks, **ways, "failed_ticks": sum(ways.values())}


def tick_times(cell: Cell) -> dict[str, Result]:
    """Times of whole ticks of all methods in turn, in stretches of consecutive ticks of a run under our law."""
    task = task_of(cell)
    robot = task.load_robot()
    stretches = QUICK_STRETCHES if cell.quick else STRETCHES
    inputs = _inputs(task, robot, stretches)
    calls: dict[str, Callable[[int], object]] = {}
    found: dict[str, Result] = {}
    for name in cell.methods:
        try:
            calls[name] = partial(_tick, controller_named(name)(robot, task.law), inputs)
        except InvariantQPError as error:
            found[name] = {"failed": str(error)}
    with quietly():
        taken = interleaved(calls, len(inputs), QUICK_ROUNDS if cell.quick else ROUNDS)
    return found | {name: spread(times) for name, times in taken.items()}


def _inputs(task: Task, robot: Robot, stretches: int) -> list[tuple[Array, Any, Array]]:
    """(q, target, feedforward) of stretches of ticks that are spread over a run."""
    dt = task.law.dt
    q = run_task(task).q
    pose = task.path.along(robot, task.start())
    length = min(LENGTH, (len(q) - 1) // stretches)
    firsts = np.linspace(0, len(q) - 1 - length, stretches).astype(int).tolist()
    inputs = []
    for first in firsts:
        wanted = [pose(dt * k) for k in range(first, first + length + 1)]
        for i, (now, then) in enumerate(pairwise(wanted)):
            ahead = np.zeros(6) if task.path.jumps else se3.log(then.dot(se3.inverse(now))) / dt
            inputs.append((q[first + i], robot.target(now), ahead))
    return inputs


def _tick(loop: Controls, inputs: list[tuple[Array, Any, Array]], i: int) -> object:
    try:
        return loop.step(*inputs[i])
    except Exception:  # noqa: BLE001 (`tracking` and `failures` count what fails)
        return None


KINDS = {
    "closed_loop": Kind(tracking),
    "singular": Kind(without_speed_limits, tasks=SINGULAR),
    "hard": Kind(failures, tasks=HARD),
    "tick": Kind(tick_times, alone=True),
}
