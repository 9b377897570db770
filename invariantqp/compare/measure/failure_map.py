"""Where in the joint range a method fails: a map over two joints, with the other joints at random.

The tool is asked to move at 0.25 m/s and 0.5 rad/s in a random direction, an ordinary motion for an arm of this size. A
state counts as failed in three cases:

    raised      the method raises, or its answer is not finite
    too fast    the answer exceeds the speed limit of a joint, before anything clips it
    astray      after the tick the tool is further from its target, both in position and in orientation

The last case asks for both, so that it does not depend on how position is weighed against orientation.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from invariantqp.compare.cell import Cell, Kind, Result
from invariantqp.compare.laws.baselines import controller_of
from invariantqp.compare.measure.rewrite import rewrite
from invariantqp.compare.measure.stability import quietly
from invariantqp.compare.measure.states import joint_range
from invariantqp.compare.registry import methods
from invariantqp.control.tracking import TRACKING_SHARE
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import load_robot
from invariantqp.runs.log import distance
from invariantqp.runs.taskfile import LawSpec

# The two joints of the map of each arm: those on which its singularities depend.
AXES = {"ur5": (2, 4), "so101": (2, 3)}
# Squares along each axis and states in each square, of a full map and of a quick one.
GRID, SAMPLES = 20, 6
QUICK_GRID, QUICK_SAMPLES = 12, 1
# The wanted angular and linear speed [rad/s], [m/s], and the duration of a tick [s].
TURN, SPEED, TICK = 0.5, 0.25, 0.002
# A speed over its limit, or an error that grew, counts if it does so by more than this fraction: less is rounding.
OVER = 1e-6


class MapState(NamedTuple):
    """One state of a map: its square, its joint positions (m,), and the target pose (4, 4)."""

    row: int
    column: int
    q: Array
    target: Array


def failures(cell: Cell) -> dict[str, Result]:
    """The map of one method for one arm: failures out of `samples` in each square; rows run along the second joint."""
    method = methods()[cell.method]
    robot = load_robot(cell.task)
    law = LawSpec(dt=TICK)
    # A method that knows limits has to keep them; of any other method we look at the speed before it is clipped.
    arm = robot if method.limits == "inside" else rewrite(robot, speed_limits=False)
    loop = controller_of(method)(arm, law)
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


def _states(robot: Robot, cell: Cell, grid: int, samples: int) -> Iterator[MapState]:
    """The states, the same for every method: uniformly distributed in each square and over the other joints."""
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
        yield MapState(row, column, q, robot.pose(q).dot(se3.exp(ahead, check=False)))


def _ways(robot: Robot, loop: Any, state: MapState) -> list[str]:
    try:
        x = np.asarray(loop.step(state.q, robot.target(state.target)).velocity, dtype=np.float64)
    except Exception:  # noqa: BLE001 (whatever a method raises makes the state a failed one)
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
