"""Tasks that are difficult for velocity control, and inputs with NaN, under our law and the usual ones.

The tasks are tasks/stability/*.toml; `watched` has what happens to a law that fails.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from invariantqp.compare.method import SCALED_LEAST_SQUARES, Method
from invariantqp.compare.registry import absent, chosen, controller_named, left_out, with_robot
from invariantqp.compare.watched import INSIDE, Watched, figures, watched_run
from invariantqp.errors import RobotModelError
from invariantqp.progress import Progress
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.prepare import prepare
from invariantqp.runs.taskfile import load_task, shipped_tasks
from invariantqp.runs.trace import Trace

# Chatter is measured relative to least squares that is given the same and calm, in the same run.
YARDSTICK = SCALED_LEAST_SQUARES
# The last part of a run in which the arm should be at rest, as a share of it.
TAIL = 0.1


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
    """How one law did in one case."""

    case: str
    law: str
    ticks: int
    exceptions: int  # ticks in which the law raised an exception
    not_finite: int  # ticks in which its answer was not finite
    # the largest of three: how much further a joint went beyond a position limit in a tick, how far beyond one it is at
    # the end, and by how much a velocity exceeded its limit [rad, m; rad/s, m/s]
    excess: float
    peak: float  # largest joint velocity divided by its limit
    error_mm: float  # at the end
    error_deg: float
    largest_mm: float  # of the run
    largest_deg: float
    tail: float  # largest joint velocity in the last tenth of the run [rad/s, m/s]
    variation: float  # total, of the joint velocities [rad/s, m/s]
    chatter: float = float("nan")  # the variation divided by that of the yardstick in the same case

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


# A row beside those of the first table.
ALSO = "[DS] Lambda"


def laws() -> dict[str, MakeController]:
    """The loops by name, as far as they are installed: the rows of the first table and one more; ours is the first."""
    return {name: controller_named(name) for name, row in chosen().items() if _compared(row)}


def _compared(row: Method) -> bool:
    return row.shown or row.name == ALSO


def not_installed() -> dict[str, list[str]]:
    """What a comparison leaves out, by the extra that would install it: laws, and cases whose robot is missing."""
    return absent(filter(_compared, left_out()), [case.task for case in cases()])


def cases() -> list[Case]:
    """Every stability task, and the task with a jump with NaN in each of the inputs."""
    broken = [Case("stability/jump", name) for name in ("q", "target", "feedforward")]
    return [*(Case(name) for name in shipped_tasks("stability")), *broken]


def run_case(case: Case, law: str, make: MakeController) -> tuple[StabilityOutcome, Trace]:
    """Run one case under one law.

    Raises:
        RobotModelError: the law cannot control this robot.
    """
    watched, trace = watched_run(prepare(load_task(case.task)), make, case.broken)
    return _outcome(case, law, watched, trace), trace


def _outcome(case: Case, law: str, watched: Watched, trace: Trace) -> StabilityOutcome:
    found, speed = figures(watched, trace), np.abs(trace.velocity)
    outside, beyond = trace.outside, (speed - trace.velocity_limit).max()
    last = max(1, round(TAIL * len(speed)))
    return StabilityOutcome(
        case=case.name,
        law=law,
        ticks=found["ticks"],
        exceptions=watched.exceptions,
        not_finite=watched.not_finite,
        excess=max(0.0, *(float(x) for x in (np.diff(outside, axis=0).max(), outside[-1].max(), beyond))),
        peak=float((speed / trace.velocity_limit).max()),
        error_mm=found["final_mm"],
        error_deg=float(np.degrees(trace.orientation_error[-1])),
        largest_mm=found["position_mm"],
        largest_deg=found["orientation_deg"],
        tail=float(speed[-last:].max()),
        variation=found["variation"],
    )


def compare_stability(progress: Progress | None = None) -> list[StabilityOutcome]:
    """Run every case whose robot is installed under every law that can control it.

    Args:
        progress: called with (runs done, runs in all).

    Raises:
        MissingExtra: no robot is installed; raised before the first run.
    """
    there = with_robot([case.task for case in cases()])
    picked = [case for case in cases() if case.task in there]
    table = laws()
    outcomes: list[StabilityOutcome] = []
    total = len(picked) * len(table)
    for i, case in enumerate(picked):
        runs: dict[str, StabilityOutcome] = {}
        for j, (name, make) in enumerate(table.items()):
            try:
                runs[name] = run_case(case, name, make)[0]
            except RobotModelError:
                continue  # Pink cannot control a robot that is given by joint screws
            finally:
                if progress is not None:
                    progress(i * len(table) + j + 1, total)
        least = runs[YARDSTICK].variation
        outcomes.extend(replace(run, chatter=run.variation / least) for run in runs.values())
    return outcomes
