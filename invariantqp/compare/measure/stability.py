"""What breaks velocity control, run under our law and the usual ones: tasks/stability/*.toml and broken inputs.

Every law is watched as a robot's own supervisor does it: an exception, or an answer that is not finite, stops the arm
for that tick and is counted. Figures are of the whole run, failures and all.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.baselines import controller_named
from invariantqp.compare.laws.invariant import OURS, PAPER_LAMBDA
from invariantqp.compare.laws.pink_law import PinkLaw, has_pink
from invariantqp.control.controller import Controller
from invariantqp.control.controls import Controls
from invariantqp.errors import MissingExtra, RobotModelError
from invariantqp.geometry.arrays import Array
from invariantqp.progress import Progress
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController, our_controller
from invariantqp.runs.run import run_task
from invariantqp.runs.taskfile import LawSpec, Task, load_task, shipped_tasks
from invariantqp.runs.trace import Trace
from invariantqp.velocity.damping import PaperLambda
from invariantqp.velocity.solution import VelocitySolution

# The yardstick of chatter: least squares with the same limits in the same run.
YARDSTICK = "least-squares QP"
# The share of a run that counts as its tail.
TAIL = 0.1
# Ticks in which a broken input is broken: every third in the first half, so that there is time to recover.
BROKEN_EVERY = 3
# More than this past a limit is outside [rad, m] and [rad/s, m/s].
INSIDE = 1e-9


class Case(NamedTuple):
    """A task of the library, and which input to `step` is NaN now and then: "", "q", "target" or "feedforward"."""

    task: str
    broken: str = ""

    @property
    def name(self) -> str:
        """How tables call it."""
        short = self.task.removeprefix("stability/")
        return f"{short}, NaN in {self.broken}" if self.broken else short


@dataclass(frozen=True)
class Outcome:
    """How one law did in one case.

    Attributes:
        case: its name.
        law: its name.
        ticks: in all.
        exceptions: ticks in which it raised.
        not_finite: ticks in which its answer was not finite.
        excess: largest growth beyond a position limit in a tick, or what is left of it at the end, or largest excess
            over a velocity limit; 0 inside [rad, m; rad/s, m/s].
        peak: largest joint velocity over its limit.
        error_mm: position error at the end.
        error_deg: orientation error at the end.
        tail: largest joint velocity in the last tenth [rad/s, m/s].
        variation: total variation of the joint velocities [rad/s, m/s].
        chatter: that over the least-squares QP's in the same case.
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
    tail: float
    variation: float
    chatter: float = float("nan")

    @property
    def finite(self) -> bool:
        """Whether every answer was."""
        return self.not_finite == 0

    @property
    def inside(self) -> bool:
        """Whether no limit was exceeded."""
        return self.excess <= INSIDE

    def as_json(self) -> dict[str, Any]:
        """Every figure; one that is no number is null."""
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in asdict(self).items()}


def paper_law(robot: Robot, law: LawSpec) -> Controller:
    """[DS]'s own formula with Lambda = lambda I, clipped, with our form and posture of nothing else."""
    pitch = law.form if isinstance(law.form, float) else None
    return Controller(robot, dt=law.dt, gain=law.gain, form=pitch, damping=PaperLambda(PAPER_LAMBDA))


def laws() -> dict[str, MakeController]:
    """The laws compared, ours first; Pink where it is installed."""
    table: dict[str, MakeController] = {
        OURS: our_controller,
        YARDSTICK: controller_named(YARDSTICK),
        "Moore-Penrose": controller_named("Moore-Penrose, pinv"),
        "DLS": controller_named("DLS"),
        "SDLS": controller_named("SDLS"),
        "[DS] Lambda": paper_law,
    }
    if has_pink():
        table["Pink, DAQP"] = PinkLaw
    return table


def cases() -> list[Case]:
    """Every stability task, and the jump with NaN in each input."""
    broken = [Case("stability/jump", name) for name in ("q", "target", "feedforward")]
    return [*(Case(name) for name in shipped_tasks("stability")), *broken]


class Watched:
    """A law that is stopped for a tick where it raises or answers with what is not finite."""

    def __init__(self, law: Controls, broken: str = "", ticks: int = 0) -> None:
        """`broken` input is NaN in every third of the first half of `ticks`."""
        self._law = law
        self._broken = broken
        self._last = ticks // 2
        self._tick = 0
        self.exceptions = 0
        self.not_finite = 0

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick, whatever happens."""
        still = np.zeros(len(np.asarray(q)))
        self._tick += 1
        if self._broken and self._tick < self._last and self._tick % BROKEN_EVERY == 0:
            q, target, feedforward = _spoilt(self._broken, q, target, feedforward)
        try:
            solution = self._law.step(q, target, feedforward)
        except Exception as error:  # noqa: BLE001 (whatever a law throws is what the table is about)
            self.exceptions += 1
            return _stopped(still, f"{type(error).__name__}: {error}")
        if np.isfinite(solution.velocity).all():
            return solution
        self.not_finite += 1
        return _stopped(still, "answer that is not finite")


def _spoilt(broken: str, q: ArrayLike, target: Any, feedforward: ArrayLike | None) -> tuple[Any, Any, Any]:
    """The inputs with NaN in one of them; the target's own class keeps what it checked before."""
    if broken == "q":
        return np.full(len(np.asarray(q)), np.nan), target, feedforward
    if broken == "feedforward":
        return q, target, np.full(6, np.nan)
    spoilt = target.copy()
    spoilt.translation = np.full(3, np.nan)
    return q, spoilt, feedforward


def _stopped(still: Array, reason: str) -> VelocitySolution:
    return VelocitySolution(still, "hold", "held", reason, (), np.full(6, np.nan), 0.0, 0.0, 0.0, "")


def run_case(case: Case, law: str, make: MakeController, progress: Progress | None = None) -> tuple[Outcome, Trace]:
    """One case under one law.

    Raises:
        RobotModelError, MissingExtra: the law cannot have this robot.
    """
    watched, trace = watched_run(load_task(case.task), make, broken=case.broken, progress=progress)
    return _outcome(case, law, watched, trace), trace


def watched_run(
    task: Task, make: MakeController, *, broken: str = "", progress: Progress | None = None, **overrides: Any
) -> tuple[Watched, Trace]:
    """A task under a law that is stopped for a tick where it fails; as in `run_task` otherwise."""
    watched: list[Watched] = []

    def watch(robot: Robot, spec: LawSpec) -> Watched:
        watched.append(Watched(make(robot, spec), broken, round(task.path.duration / spec.dt)))
        return watched[0]

    with quietly():
        trace = run_task(task, controller=watch, progress=progress, **overrides)
    return watched[0], trace


@contextmanager
def quietly() -> Iterator[None]:
    """Without a warning in every tick: what a law thinks of its arithmetic is in its figures."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _outcome(case: Case, law: str, watched: Watched, trace: Trace) -> Outcome:
    low, high = trace.position_limits
    outside = np.maximum(np.maximum(low - trace.q, trace.q - high), 0.0)
    speed = np.abs(trace.velocity)
    excess = (np.diff(outside, axis=0).max(), outside[-1].max(), (speed - trace.velocity_limit).max())
    last = max(1, round(TAIL * len(speed)))
    return Outcome(
        case=case.name,
        law=law,
        ticks=len(speed),
        exceptions=watched.exceptions,
        not_finite=watched.not_finite,
        excess=max(0.0, *(float(x) for x in excess)),
        peak=float((speed / trace.velocity_limit).max()),
        error_mm=1e3 * float(trace.position_error[-1]),
        error_deg=float(np.degrees(trace.orientation_error[-1])),
        tail=float(speed[-last:].max()),
        variation=float(np.abs(np.diff(trace.velocity, axis=0)).sum()),
    )


def compare_stability(
    progress: Progress | None = None, chosen: Callable[[Case], bool] = lambda _: True
) -> list[Outcome]:
    """Every case under every law that can have its robot, chatter measured against the least-squares QP.

    Args:
        progress: called with (runs done, runs in all).
        chosen: which cases.
    """
    picked = [case for case in cases() if chosen(case)]
    table = laws()
    outcomes: list[Outcome] = []
    total = len(picked) * len(table)
    for i, case in enumerate(picked):
        runs: dict[str, Outcome] = {}
        for j, (name, make) in enumerate(table.items()):
            try:
                runs[name] = run_case(case, name, make)[0]
            except (RobotModelError, MissingExtra):
                continue  # Pink has no robot made of screws
            finally:
                if progress is not None:
                    progress(i * len(table) + j + 1, total)
        least = runs[YARDSTICK].variation
        outcomes.extend(replace(run, chatter=run.variation / least) for run in runs.values())
    return outcomes
