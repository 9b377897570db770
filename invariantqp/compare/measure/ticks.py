"""How long a tick takes: pose, Jacobian, law and limits, in states of a run of the task, all methods in turn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from invariantqp.compare.measure.cell import Cell, Kind, Result
from invariantqp.compare.measure.stability import quietly
from invariantqp.compare.measure.timing import interleaved, spread
from invariantqp.compare.registry import controller_named
from invariantqp.control.controls import Controls
from invariantqp.errors import InvariantQPError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.run import run_task
from invariantqp.runs.taskfile import Task

# How many stretches of how many consecutive ticks are timed, and how often; then the same for a quick run.
STRETCHES, LENGTH, ROUNDS = 20, 10, 10
QUICK_STRETCHES, QUICK_ROUNDS = 5, 3


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


KINDS = {"tick": Kind(tick_times, alone=True)}
