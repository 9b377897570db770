"""How long a tick takes: pose, Jacobian, law and limits, in states of a run of the task, all methods in turn.

Each round calls all functions in turn, so that a change of the clock rate affects all alike. Every call is timed by
itself with the nanosecond counter; medians and percentiles are those of single calls.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise
from time import perf_counter_ns
from typing import Any

import numpy as np

from invariantqp.compare.measure.cell import Cell, Kind, Result
from invariantqp.compare.measure.watched import quietly
from invariantqp.compare.registry import controller_named
from invariantqp.control.controller import Controls
from invariantqp.errors import InvariantQPError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.run import run_task
from invariantqp.runs.taskfile import Task

# How many stretches of how many consecutive ticks are timed, and how often; then the same for a quick run.
STRETCHES, LENGTH, ROUNDS = 20, 10, 10
QUICK_STRETCHES, QUICK_ROUNDS = 5, 3
# First rounds that do not count: they allocate workspaces and fill caches.
WARM_UP = 3


def tick_times(cell: Cell) -> dict[str, Result]:
    """Times of whole ticks of all methods in turn, in stretches of consecutive ticks of a run under our law."""
    task = cell.load()
    robot = task.load_robot()
    inputs = inputs_of(task, robot, QUICK_STRETCHES if cell.quick else STRETCHES)
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


def inputs_of(task: Task, robot: Robot, stretches: int) -> list[tuple[Array, Array, Array]]:
    """(q, target pose, feedforward) of stretches of ticks spread over a run: over its ticks at limits, if any."""
    dt = task.law.dt
    trace = run_task(task)
    pose = task.path.along(robot, task.start())
    length = min(LENGTH, (len(trace.q) - 1) // stretches)
    last = len(trace.q) - 1 - length
    where = np.flatnonzero(trace.limit_active[:last])
    where = where if len(where) else np.arange(last)
    inputs = []
    for first in where[np.linspace(0, len(where) - 1, stretches).astype(int)].tolist():
        wanted = [pose(dt * k) for k in range(first, first + length + 1)]
        for i, (now, then) in enumerate(pairwise(wanted)):
            ahead = np.zeros(6) if task.path.jumps else se3.log(then.dot(se3.inverse(now))) / dt
            inputs.append((trace.q[first + i], now, ahead))
    return inputs


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
        for turn in range(-min(WARM_UP, rounds), rounds):
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


KINDS = {"tick": Kind(tick_times, alone=True)}
