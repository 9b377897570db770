"""Tasks that are difficult for velocity control, and inputs with NaN, under our law and the usual ones.

The tasks are tasks/stability/*.toml; `watched` has what happens to a law that fails.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

from invariantqp.compare.method import SCALED_LEAST_SQUARES, Method
from invariantqp.compare.registry import chosen, controller_named
from invariantqp.compare.watched import Result, figures, watched_run
from invariantqp.errors import RobotModelError
from invariantqp.progress import Progress
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.prepare import prepare
from invariantqp.runs.taskfile import load_task, shipped_tasks
from invariantqp.runs.trace import Trace

# Chatter is measured relative to least squares that is given the same and calm, in the same run.
YARDSTICK = SCALED_LEAST_SQUARES


class Case(NamedTuple):
    """A shipped task, and the input of `step` that is sometimes NaN: "q", "target", "feedforward", or "" for none."""

    task: str
    broken: str = ""

    @property
    def name(self) -> str:
        """Its name in tables."""
        short = self.task.removeprefix("stability/")
        return f"{short}, NaN in {self.broken}" if self.broken else short


# A row beside those of the first table.
ALSO = "[DS] Lambda"


def rows() -> list[Method]:
    """The rows of the first table and one more, installed or not; ours is the first."""
    return [row for row in chosen() if row.shown or row.name == ALSO]


def laws() -> dict[str, MakeController]:
    """The loops of the rows that are installed, by name."""
    return {row.name: controller_named(row.name) for row in rows() if row.installed}


def cases() -> list[Case]:
    """Every stability task, and the task with a jump with NaN in each of the inputs."""
    broken = [Case("stability/jump", name) for name in ("q", "target", "feedforward")]
    return [*(Case(name) for name in shipped_tasks("stability")), *broken]


def run_case(case: Case, make: MakeController) -> tuple[Result, Trace]:
    """The figures of one case under one law, and its run."""
    watched, trace = watched_run(prepare(load_task(case.task)), make, case.broken)
    return figures(watched, trace), trace


def compare_stability(progress: Progress | None = None) -> list[Result]:
    """Run every case under every law that can control it.

    Returns:
        The figures of each run, with the names of "case" and "law", and "chatter": the variation of the joint
        velocities divided by that of the yardstick in the same case.
    """
    for case in cases():
        load_task(case.task).load_robot()  # what is not installed ends it before the first run
    work = [(case, law) for case in cases() for law in laws().items()]
    outcomes: list[Result] = []
    for i, (case, (law, make)) in enumerate(work, 1):
        with suppress(RobotModelError):  # Pink cannot control a robot that is given by joint screws
            outcomes.append({"case": case.name, "law": law, **run_case(case, make)[0]})
        if progress is not None:
            progress(i, len(work))
    least = {run["case"]: run["variation"] for run in outcomes if run["law"] == YARDSTICK}
    return [{**run, "chatter": run["variation"] / least[run["case"]]} for run in outcomes]
