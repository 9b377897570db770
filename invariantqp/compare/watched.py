"""A law that is watched as the supervisor of a robot would, and what its run is judged by.

An exception or an answer that is not finite stops the arm for that tick, and is counted. The figures are those of the
whole run, failed ticks included.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.compare.method import answer
from invariantqp.control.controller import Controls
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController, controller_for
from invariantqp.runs.prepare import Setup
from invariantqp.runs.run import run
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
            q, target, feedforward = _spoilt(self._broken, q, target, feedforward)
        try:
            solution = self._law.step(q, target, feedforward)
        except Exception as error:  # noqa: BLE001 (exceptions are counted)
            self.exceptions += 1
            return answer(still, "hold", status=Status.HELD, reason=f"{type(error).__name__}: {error}")
        if np.isfinite(solution.velocity).all():
            return solution
        self.not_finite += 1
        return answer(still, "hold", status=Status.HELD, reason="the answer was not finite")


def _spoilt(broken: str, q: ArrayLike, target: Any, feedforward: ArrayLike | None) -> tuple[Any, Any, Any]:
    """The inputs with NaN in one of them; a target keeps its class, which checked it before."""
    if broken == "q":
        return np.full(len(np.asarray(q)), np.nan), target, feedforward
    if broken == "feedforward":
        return q, target, np.full(6, np.nan)
    spoilt = target.pose.copy()
    spoilt[:3, 3] = np.nan
    return q, target._replace(pose=spoilt), feedforward


def watched_run(setup: Setup, make: MakeController, broken: str = "") -> tuple[Watched, Trace]:
    """A run under a law that is watched, in which an input is sometimes NaN if one is named."""
    with quietly():
        law = Watched(make(setup.problem.robot, setup.problem.law), broken, len(setup.noise))
        return law, run(setup, controller_for(setup.problem, lambda *_: law))


def with_rest(setup: Setup) -> Setup:
    """The setup with a second more, in which the target is at rest; a path that may be late and contact as they are."""
    problem, more = setup.problem, round(REST / setup.task.law.dt)
    if setup.scene is not None or problem.elastic is not None:
        return setup
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
    left = (np.diff(trace.outside, axis=0) > NEGLIGIBLE) | (speed - trace.velocity_limit > NEGLIGIBLE)
    beyond = (np.diff(trace.outside, axis=0), trace.outside[-1], speed - trace.velocity_limit)
    ways: dict[str, Any] = {
        "raised": law.exceptions / ticks,
        "not_finite": law.not_finite / ticks,
        "outside": float(left.any(axis=1).mean()),
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
        "excess": max(0.0, *(float(x.max()) for x in beyond)),
        "tail": float(speed[-max(1, round(TAIL * ticks)) :].max()),
        "ticks": ticks,
        **ways,
        "failed_ticks": sum(ways.values()),
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
