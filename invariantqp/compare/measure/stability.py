"""Tasks that are difficult for velocity control, and inputs with NaN, under our law and the usual ones.

The tasks are tasks/stability/*.toml. As the supervisor of a robot would do, an exception or an answer that is not
finite stops the arm for that tick, and is counted. The figures are those of the whole run, failed ticks included.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.names import TOLD_LEAST_SQUARES
from invariantqp.compare.registry import chosen, controller_named
from invariantqp.control.controls import Controls
from invariantqp.errors import MissingExtra, RobotModelError
from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.run import run_task
from invariantqp.runs.taskfile import LawSpec, load_task, shipped_tasks
from invariantqp.runs.trace import Trace
from invariantqp.velocity.solution import VelocitySolution

# Chatter is measured relative to least squares that is told the same and calm, in the same run.
YARDSTICK = TOLD_LEAST_SQUARES
# The last part of a run in which the arm should be at rest, as a share of it.
TAIL = 0.1
# A broken input is NaN in every third tick of the first half of a run; the second half is time to recover.
BROKEN_EVERY = 3
# An excess over a limit up to this is rounding [rad, m] and [rad/s, m/s].
INSIDE = 1e-9


class Case(NamedTuple):
    """A shipped task, and the input of `step` that is sometimes NaN: "q", "target", "feedforward", or "" for none."""

    task: str
    broken: str = ""

    @property
    def name(self) -> str:
        """Its name in tables."""
        short = self.task.removeprefix("stability/")
        return f"{short}, NaN in {self.broken}" if self.broken else short


@dataclass(frozen=True)
class StabilityOutcome:
    """How one law did in one case.

    Attributes:
        case: name of the case.
        law: name of the law.
        ticks: number of ticks.
        exceptions: number of ticks in which the law raised an exception.
        not_finite: number of ticks in which its answer was not finite.
        excess: the largest of three: how much further a joint went beyond a position limit in a tick, how far beyond
            one it is at the end, and by how much a velocity exceeded its limit [rad, m; rad/s, m/s].
        peak: largest joint velocity divided by its limit.
        error_mm: position error at the end [mm].
        error_deg: orientation error at the end [deg].
        largest_mm: largest position error of the run [mm].
        largest_deg: largest orientation error of the run [deg].
        tail: largest joint velocity in the last tenth of the run [rad/s, m/s].
        variation: total variation of the joint velocities [rad/s, m/s].
        chatter: the variation divided by that of the yardstick in the same case.
    """

    case: str
    law: str
    ticks: int
    exceptions: int
    not_finite: int
    excess: float
    peak: float
    error_mm: float
    error_deg: float
    largest_mm: float
    largest_deg: float
    tail: float
    variation: float
    chatter: float = float("nan")

    @property
    def finite(self) -> bool:
        """Whether every answer was finite."""
        return self.not_finite == 0

    @property
    def inside(self) -> bool:
        """Whether no limit was exceeded."""
        return self.excess <= INSIDE

    def as_json(self) -> dict[str, Any]:
        """All figures; None for one that is not finite."""
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()}


# Rows beside those of the first table.
ALSO = ("SDLS", "[DS] Lambda")


def laws() -> dict[str, MakeController]:
    """The loops by name, as far as they are installed: the rows of the first table and two more; ours is the first."""
    return {name: controller_named(name) for name, row in chosen().items() if row.shown or name in ALSO}


def cases() -> list[Case]:
    """Every stability task, and the task with a jump with NaN in each of the inputs."""
    broken = [Case("stability/jump", name) for name in ("q", "target", "feedforward")]
    return [*(Case(name) for name in shipped_tasks("stability")), *broken]


class Watched:
    """A law whose arm stops for a tick if the law raises, or if its answer is not finite.

    Attributes:
        exceptions: number of ticks in which it raised.
        not_finite: number of ticks in which its answer was not finite.
    """

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
            return _stopped(still, f"{type(error).__name__}: {error}")
        if np.isfinite(solution.velocity).all():
            return solution
        self.not_finite += 1
        return _stopped(still, "the answer was not finite")


def _spoilt(broken: str, q: ArrayLike, target: Any, feedforward: ArrayLike | None) -> tuple[Any, Any, Any]:
    """The inputs with NaN in one of them; a target keeps its class, which checked it before."""
    if broken == "q":
        return np.full(len(np.asarray(q)), np.nan), target, feedforward
    if broken == "feedforward":
        return q, target, np.full(6, np.nan)
    spoilt = target.pose.copy()
    spoilt[:3, 3] = np.nan
    return q, target._replace(pose=spoilt), feedforward


def _stopped(still: Array, reason: str) -> VelocitySolution:
    return VelocitySolution(still, "hold", "held", reason, (), np.full(6, np.nan), 0.0, 0.0, 0.0, "")


def run_case(case: Case, law: str, make: MakeController) -> tuple[StabilityOutcome, Trace]:
    """Run one case under one law.

    Raises:
        RobotModelError, MissingExtra: the law cannot control this robot.
    """
    task, watched = load_task(case.task), []

    def watch(robot: Robot, spec: LawSpec) -> Watched:
        watched.append(Watched(make(robot, spec), case.broken, round(task.path.duration / spec.dt)))
        return watched[0]

    with quietly():
        trace = run_task(task, controller=watch)
    return _outcome(case, law, watched[0], trace), trace


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


def _outcome(case: Case, law: str, watched: Watched, trace: Trace) -> StabilityOutcome:
    low, high = trace.position_limits
    outside = np.maximum(np.maximum(low - trace.q, trace.q - high), 0.0)
    speed = np.abs(trace.velocity)
    excess = (np.diff(outside, axis=0).max(), outside[-1].max(), (speed - trace.velocity_limit).max())
    last = max(1, round(TAIL * len(speed)))
    return StabilityOutcome(
        case=case.name,
        law=law,
        ticks=len(speed),
        exceptions=watched.exceptions,
        not_finite=watched.not_finite,
        excess=max(0.0, *(float(x) for x in excess)),
        peak=float((speed / trace.velocity_limit).max()),
        error_mm=1e3 * float(trace.position_error[-1]),
        error_deg=float(np.degrees(trace.orientation_error[-1])),
        largest_mm=1e3 * float(trace.position_error.max()),
        largest_deg=float(np.degrees(trace.orientation_error.max())),
        tail=float(speed[-last:].max()),
        variation=float(np.abs(np.diff(trace.velocity, axis=0)).sum()),
    )


def compare_stability(progress: Progress | None = None) -> list[StabilityOutcome]:
    """Run every case under every law that can control its robot.

    Args:
        progress: called with (runs done, runs in all).

    Raises:
        MissingExtra: the robot models are not installed; raised before the first run.
    """
    picked = cases()
    for name in dict.fromkeys(case.task for case in picked):
        load_task(name).load_robot()
    table = laws()
    outcomes: list[StabilityOutcome] = []
    total = len(picked) * len(table)
    for i, case in enumerate(picked):
        runs: dict[str, StabilityOutcome] = {}
        for j, (name, make) in enumerate(table.items()):
            try:
                runs[name] = run_case(case, name, make)[0]
            except (RobotModelError, MissingExtra):
                continue  # Pink cannot control a robot that is given by joint screws
            finally:
                if progress is not None:
                    progress(i * len(table) + j + 1, total)
        least = runs[YARDSTICK].variation
        outcomes.extend(replace(run, chatter=run.variation / least) for run in runs.values())
    return outcomes
