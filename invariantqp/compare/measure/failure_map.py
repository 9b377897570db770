"""Where over the joint range a method fails, drawn over two joints, the others at random.

A motion is asked that any arm of this size makes in a day's work: the tool at 0.25 m/s and 0.5 rad/s, in a random
direction. A state has failed when the answer

    raised      raises, or is not finite
    too fast    asks a joint for more than its speed limit (before anything clips it)
    astray      has the tool further from its target after the tick than before, in position and in orientation

The last asks for both, so that no weighing of one against the other takes a side.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from invariantqp.compare.laws.baselines import controller_of
from invariantqp.compare.measure.rewritten import rewritten
from invariantqp.compare.measure.stability import quietly
from invariantqp.compare.measure.states import joint_range
from invariantqp.compare.methods import methods
from invariantqp.compare.sweep import Cell, Kind, Result
from invariantqp.control.controller import TRACKING_SHARE
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import load_robot
from invariantqp.runs.log import distance
from invariantqp.runs.taskfile import LawSpec

# The two joints drawn over, by arm: those that make it singular.
AXES = {"ur5": (2, 4), "so101": (2, 3)}
# Squares along each axis, states in each: of a full map, of a quick one.
GRID, SAMPLES = 20, 6
QUICK_GRID, QUICK_SAMPLES = 12, 1
# The motion asked for [rad/s], [m/s], and the tick [s].
TURN, SPEED, TICK = 0.5, 0.25, 0.002
# Speeds this much over a limit, relative, are over it; an error must grow by this much, relative, to have grown.
OVER = 1e-6


class State(NamedTuple):
    """One state: its square in the grid, joint positions, and the target pose."""

    row: int
    column: int
    q: Array
    target: Array


def failures(cell: Cell) -> dict[str, Result]:
    """One method's map for one arm; counts out of `samples` in each square, rows along the second joint."""
    method = methods()[cell.method]
    robot = load_robot(cell.task)
    law = LawSpec(dt=TICK)
    # A method that is told of limits has to keep them by itself; of what will be clipped we ask the raw speed.
    asked = robot if method.limits == "inside" else rewritten(robot, speed_limits=False)
    loop = controller_of(method)(asked, law)
    grid, samples = (QUICK_GRID, QUICK_SAMPLES) if cell.quick else (GRID, SAMPLES)
    failed = np.zeros((grid, grid), dtype=int)
    ways = dict.fromkeys(("raised", "too_fast", "astray"), 0)
    with quietly():
        for state in _states(robot, cell, grid, samples):
            found = _ways(robot, loop, state)
            failed[state.row, state.column] += bool(found)
            for way in found:
                ways[way] += 1
    total = grid * grid * samples
    low, high = joint_range(robot)
    first, second = AXES[cell.task]
    return {
        cell.method: {
            "axes": [robot.names[first], robot.names[second]],
            "ranges": [[float(low[i]), float(high[i])] for i in (first, second)],
            "samples": samples,
            "map": failed.tolist(),
            "share": float(failed.sum()) / total,
            **{way: count / total for way, count in ways.items()},
        }
    }


def _states(robot: Robot, cell: Cell, grid: int, samples: int) -> Iterator[State]:
    """The same states for every method: uniform in each square and in the other joints."""
    rng = np.random.default_rng([cell.seed, 3])
    low, high = joint_range(robot)
    first, second = AXES[cell.task]
    for row, column, _ in np.ndindex(grid, grid, samples):
        q = rng.uniform(low, high)
        for joint, square in ((first, column), (second, row)):
            q[joint] = low[joint] + (high[joint] - low[joint]) * (square + rng.uniform()) / grid
        w, v = (
            size * d / np.linalg.norm(d) for size, d in zip((TURN, SPEED), rng.standard_normal((2, 3)), strict=True)
        )
        ahead = TICK / TRACKING_SHARE * np.concatenate((w, v))
        yield State(row, column, q, robot.pose(q).dot(se3.exp(ahead, check=False)))


def _ways(robot: Robot, loop: Any, state: State) -> list[str]:
    try:
        x = np.asarray(loop.step(state.q, robot.target(state.target)).velocity, dtype=np.float64)
    except Exception:  # noqa: BLE001 (whatever a law throws is a failed state)
        return ["raised"]
    if not np.isfinite(x).all():
        return ["raised"]
    found = []
    limit = robot.velocity_limit
    if (np.abs(x) > limit * (1.0 + OVER)).any():
        found.append("too_fast")
    before = distance(robot.pose(state.q), state.target)
    after = distance(robot.pose(state.q + TICK * np.clip(x, -limit, limit)), state.target)
    if all(then > now * (1.0 + OVER) for now, then in zip(before, after, strict=True)):
        found.append("astray")
    return found


KINDS = {"failure_map": Kind(failures, tasks=tuple(AXES))}
