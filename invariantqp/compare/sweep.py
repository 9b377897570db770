"""A sweep: every measurement of every method on every task, in parallel.

Cells that measure time run after all others, one at a time, in a process of their own with one BLAS thread. Such a cell
has all methods of a task: they are timed in turn, so that a change of the clock rate affects all alike.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from pathlib import Path

import joblib
from joblib.externals.loky import ProcessPoolExecutor

from invariantqp.compare.measurements import KINDS, Cell, Kind, Result
from invariantqp.compare.method import kinematics
from invariantqp.compare.registry import chosen
from invariantqp.compare.results import SCHEMA, Results, machine, plain, versions
from invariantqp.compare.tables import TASKS
from invariantqp.errors import BadInput, UnknownName
from invariantqp.runs.taskfile import load_task

# Seven, six and five joints, each on a path that meets no limit and on one that meets some.
DEFAULT_TASKS = tuple(name for name in TASKS if not name.startswith("stability/"))
# Environment variables that BLAS libraries read when they are loaded.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


def cells(
    tasks: Sequence[str],
    methods: Sequence[str],
    *,
    seed: int = 0,
    quick: bool = False,
    only: Sequence[str] | None = None,
) -> list[Cell]:
    """The cells of a sweep, with those that run alone at the end; `only` names measurements, None is the usual ones."""
    for name in only or ():
        if name not in KINDS:
            raise UnknownName("measurement", name, difflib.get_close_matches(name, KINDS), list(KINDS))
    usual = {name for name, kind in KINDS.items() if not (kind.on_request or (quick and kind.slow))}
    wanted = usual if only is None else set(only)
    found = []
    for name, kind in sorted(KINDS.items(), key=lambda item: item[1].alone):
        if name in wanted:
            groups = [tuple(methods)] if kind.alone else [(method,) for method in methods]
            places = tasks if kind.tasks is None else kind.tasks
            found += [Cell(name, task, group, seed, quick) for task in places for group in groups]
    return found


def sweep(
    tasks: Sequence[str],
    methods: Sequence[str] | None,
    *,
    seed: int = 0,
    quick: bool = False,
    jobs: int = 1,
    only: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Results:
    """Measure every method on every task: the content of results.json.

    Methods that are not installed are left out. A wrong name, a robot that is not installed, or a task in contact or
    with elastic timing, which other methods do not have, ends it before the first measurement.

    Args:
        tasks: names or files of tasks.
        methods: names of methods, as `registry.chosen` takes them; None is every one that is installed.
        seed: seed of states, twists and displacements.
        quick: whether to measure fewer states and longer ticks.
        jobs: number of processes; -1 is one a core.
        only: names of measurements; None is the usual ones.
        progress: called with (cells done, cells in all).
    """
    rows = [method for method in chosen(methods) if method.installed and (method.shown or not quick or methods)]
    work = cells(tasks, [method.name for method in rows], seed=seed, quick=quick, only=only)
    for name in dict.fromkeys(cell.task for cell in work):
        task = load_task(name)
        task.load_robot()
        if task.contact is not None or task.path.timing == "elastic":
            found = f"{name}, {'in contact' if task.contact else 'with elastic timing'}"
            raise BadInput(
                "TASK", found, "a task without contact whose path keeps its timing: other methods have no other"
            )
    measured: dict[Cell, dict[str, Result]] = {}
    for cell, result in _attempts(work, jobs):
        measured[cell] = result
        if progress is not None:
            progress(len(measured), len(work))
    return {
        "schema": SCHEMA,
        "machine": machine(),
        "versions": versions(),
        "kinematics": kinematics(),
        "seed": seed,
        "quick": quick,
        "tasks": list(tasks),
        "methods": [{**m.as_json(), "shown": m.shown or methods is not None} for m in rows],
        "cells": [
            {"kind": cell.kind, "task": cell.task, "method": method, "result": plain(result)}
            for cell in work
            for method, result in measured[cell].items()
        ],
    }


def _attempts(work: list[Cell], jobs: int) -> Iterator[tuple[Cell, dict[str, Result]]]:
    """The results of every cell in the order in which they are finished; see `attempt`."""
    beside = [cell for cell in work if not KINDS[cell.kind].alone]
    if beside:
        work_beside = (joblib.delayed(attempt)(KINDS[cell.kind], cell) for cell in beside)
        yield from joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(work_beside)
    alone = [cell for cell in work if KINDS[cell.kind].alone]
    if alone:
        with ProcessPoolExecutor(1, env=dict.fromkeys(ONE_THREAD, "1")) as process:
            yield from process.map(attempt, [KINDS[cell.kind] for cell in alone], alone)


def attempt(kind: Kind, cell: Cell) -> tuple[Cell, dict[str, Result]]:
    """A cell and what its measurement finds; what a method raises is its result, what solvers print goes nowhere."""
    try:
        with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
            return cell, kind.measure(cell)
    except Exception as error:  # noqa: BLE001 (a measurement that fails is a row of the report)
        return cell, {method: {"failed": f"{type(error).__name__}: {error}"} for method in cell.methods}
