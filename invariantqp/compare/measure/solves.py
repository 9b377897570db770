"""Single solves: error and time, in states without active limits, with active limits, and close to a singularity.

    error    |x - x*| / |x*|,   x* the exact answer of the problem that the method solves; with active limits, of the
             problem that it solves or that clipping approximates
    missed   |s - Jx| / |s|     in the tool frame, with metres and radians alike: what Moore-Penrose minimises

Results: {"free": {"error", "error_max", "missed", "failed", "agreement"}, "limited": {...}, "singular": {...}} and
{"free": {"median_us", "p99_us"}, "limited": {...}, "singular": {...}}.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from invariantqp.compare.cell import Cell, Kind, Result
from invariantqp.compare.exact.failure import NoReference
from invariantqp.compare.laws.setting import setting_of
from invariantqp.compare.measure.states import SORTS, SolveState, states
from invariantqp.compare.measure.timing import interleaved, spread
from invariantqp.compare.method import Method, Question, Setting, Solve
from invariantqp.compare.registry import methods
from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.runs.taskfile import load_task

# States of each sort, and rounds in which they are timed, of a full run and of a quick one.
COUNT, QUICK_COUNT = 20, 4
ROUNDS, QUICK_ROUNDS = 50, 6


def _arm(cell: Cell) -> tuple[Setting, dict[str, list[SolveState]]]:
    """What methods may know of the arm of a cell's task, and states of each sort."""
    task = load_task(cell.task)
    robot = task.load_robot()
    setting = setting_of(robot, task.law)
    count = QUICK_COUNT if cell.quick else COUNT
    return setting, {kind: states(robot, kind, count, cell.seed, setting) for kind in SORTS}


def _solver(method: Method, setting: Setting) -> Solve:
    if method.make is None:
        raise BadInput("method", f"{method.name}, which has a control loop only", "a method with a solver")
    return method.make(setting)


def clipped_answer(solve: Solve, question: Question) -> Array | None:
    """A method's velocity clipped to the limits; None if it raises or its answer is not finite."""
    try:
        with np.errstate(all="ignore"):
            x = np.asarray(solve(*question), dtype=np.float64)
    except Exception:  # noqa: BLE001 (whatever a solver raises is counted as a failure)
        return None
    return np.minimum(np.maximum(x, question.lower), question.upper) if np.isfinite(x).all() else None


def errors(cell: Cell) -> dict[str, Result]:
    """The error of every method; methods with the same problem share its exact answers."""
    setting, drawn = _arm(cell)
    exact = _Exact(setting)
    table = methods()
    return {
        name: {kind: _error(table[name], kind, drawn[kind], setting, exact) for kind in SORTS} for name in cell.methods
    }


class _Exact:
    """Exact answers, computed once for all methods with the same problem in the same frame."""

    def __init__(self, setting: Setting) -> None:
        self._setting = setting
        self._kept: dict[tuple[str, str, int], Any] = {}

    def of(self, method: Method, kind: str, state: SolveState) -> Any:
        """The reference; None if the method has no exact problem, or the problem no unique answer in this state."""
        from invariantqp.compare.exact.references import reference

        problem = method.limited if kind == "limited" else method.problem
        if not problem:
            return None
        key = (problem, method.frame, id(state))
        if key not in self._kept:
            try:
                self._kept[key] = reference(problem, state.question(method), self._setting)
            except NoReference:
                self._kept[key] = None
        return self._kept[key]


def _error(method: Method, kind: str, drawn: list[SolveState], setting: Setting, exact: _Exact) -> Result:
    solve = _solver(method, setting)
    found, missed, agreements, failed = [], [], [], 0
    for state in drawn:
        x = clipped_answer(solve, state.question(method))
        truth = exact.of(method, kind, state)
        if truth is not None:
            agreements.append(truth.agreement)
        if x is None:
            failed += 1
            continue
        s = state.to_tool.dot(state.s)
        missed.append(float(np.linalg.norm(s - state.to_tool.dot(state.J).dot(x)) / np.linalg.norm(s)))
        if truth is not None:
            found.append(float(np.linalg.norm(x - truth.x) / np.linalg.norm(truth.x)))
    return {
        "error": float(np.median(found)) if found else None,
        "error_max": max(found) if found else None,
        "missed": float(np.median(missed)) if missed else None,
        "failed": failed / max(1, len(drawn)),
        "agreement": max(agreements) if agreements else None,
    }


def times(cell: Cell) -> dict[str, Result]:
    """The time of a solve of every method, measured in turn."""
    setting, drawn = _arm(cell)
    table = methods()
    rounds = QUICK_ROUNDS if cell.quick else ROUNDS
    found: dict[str, Result] = {name: {} for name in cell.methods}
    for kind in SORTS:
        calls = {name: _call(table[name], drawn[kind], setting) for name in cell.methods}
        for name, taken in interleaved(calls, len(drawn[kind]), rounds).items():
            found[name][kind] = spread(taken)
    return found


def _call(method: Method, drawn: list[SolveState], setting: Setting) -> Callable[[int], object]:
    solve = _solver(method, setting)
    questions = [state.question(method) for state in drawn]

    def call(i: int) -> object:
        try:
            return solve(*questions[i])
        except Exception:  # noqa: BLE001 (`errors` counts what fails)
            return None

    return call


def has_solver(name: str) -> bool:
    """Whether a method is a function of J and s."""
    return methods()[name].make is not None


KINDS: dict[str, Kind] = {
    "error": Kind(errors, together=True, fits=has_solver, variants=True, needs=("mpmath",)),
    "time": Kind(times, alone=True, fits=has_solver, variants=True),
}
