"""Every measurement as a cell: kinds times tasks times methods, run in parallel, kept on disk, gathered in one file.

    DIR/cells/*.json      one finished cell each; an interrupted sweep takes them up again
    DIR/results.json      {"schema": 1, "machine": {...}, "versions": {...}, "seed": 0, "quick": false, "tasks": [...],
                           "methods": [Method.as_json(), ...],
                           "cells": [{"kind": "error", "task": "panda_path", "method": "DLS", "result": {...}}, ...]}

A figure that is no finite number is null. A measurement that could not be made has the result {"failed": "why"}; charts
leave it out and the report lists it.

A **kind** is a measurement: a function from a `Cell` to its results, one JSON-able dict a method, and whether it has to
run alone. Cells that measure time run after all others, one at a time in a process of their own with one BLAS thread,
every method of a task in one cell, so that its rounds interleave the methods and a drift of the clock hits all alike.

All others go through joblib, and joblib's back end is the caller's: with Dask (or Ray) set up,

    with joblib.parallel_config(backend="dask"):
        sweep(tasks, methods, Path("comparison"))

spreads them over that cluster; the parts that measure time stay on this machine.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import joblib
from joblib.externals.loky import ProcessPoolExecutor

from invariantqp.compare.measure.machine import machine, source_digest, versions
from invariantqp.compare.methods import chosen, first_of_groups
from invariantqp.compare.results import SCHEMA, Results
from invariantqp.errors import BadInput, InvariantQPError, UnknownName
from invariantqp.progress import Progress
from invariantqp.runs.taskfile import load_task

Result = dict[str, Any]

# Seven joints whose limits bind, five joints, six joints through a singularity.
DEFAULT_TASKS = ("panda_path", "so101_line", "ur5_wrist")
# Of the figures kept: more than any repeats itself to.
DIGITS = 4
# What BLAS libraries read when they are loaded: times are of one thread.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


@dataclass(frozen=True)
class Cell:
    """One piece of work.

    Attributes:
        kind: a key of `kinds()`.
        task: a task's name or file, or one of the kind's own.
        methods: names from `compare.methods`; a single one in most kinds, all of them where time is measured.
        seed: of whatever is drawn at random.
        quick: a few seconds' worth of states instead of a few minutes'.
    """

    kind: str
    task: str
    methods: tuple[str, ...]
    seed: int = 0
    quick: bool = False

    @property
    def method(self) -> str:
        """The only method."""
        (name,) = self.methods
        return name


@dataclass(frozen=True)
class Kind:
    """A measurement.

    Attributes:
        measure: a cell to {method: result}, for each of the cell's methods that has one.
        alone: whether it measures time: then nothing runs beside it, and one cell has all methods of a task.
        tasks: the kind's own; None for the tasks of the sweep.
        together: whether all methods of a task share a cell though they are not timed (a shared reference, say).
        fits: which methods it is for, by name; all of them by default.
        variants: whether a quick run has all methods of a group, which differ by a setting alone, or the first.
    """

    measure: Callable[[Cell], dict[str, Result]]
    alone: bool = False
    tasks: tuple[str, ...] | None = None
    together: bool = False
    fits: Callable[[str], bool] = lambda _: True
    variants: bool = False


class ReferenceFailure(InvariantQPError):
    """A reference could not be made, or two that should be the same are not: nothing may be concluded."""


class NoReference(ReferenceFailure):
    """The problem has no unique answer on this state: a pitch form that does not see all of an arm, say."""


def kinds() -> dict[str, Kind]:
    """Every kind of measurement."""
    from invariantqp.compare.measure import closed_loop, dependence, failure_map, growth, solves

    return {**solves.KINDS, **closed_loop.KINDS, **dependence.KINDS, **failure_map.KINDS, **growth.KINDS}


def cells(
    tasks: Sequence[str],
    methods: Sequence[str],
    *,
    seed: int = 0,
    quick: bool = False,
    only: Sequence[str] | None = None,
) -> list[Cell]:
    """The cells of a sweep, those that run alone last.

    Raises:
        UnknownName: `only` names no kind of measurement.
    """
    table = kinds()
    for name in only or ():
        if name not in table:
            raise UnknownName("measurement", name, difflib.get_close_matches(name, table), list(table))
    found = []
    for name, kind in sorted(table.items(), key=lambda item: item[1].alone):
        if only is not None and name not in only:
            continue
        fitting = [method for method in methods if kind.fits(method)]
        if quick and not kind.variants:
            fitting = first_of_groups(fitting)
        groups = [tuple(fitting)] if kind.alone or kind.together else [(method,) for method in fitting]
        places = tasks if kind.tasks is None else kind.tasks
        found += [Cell(name, task, group, seed, quick) for task in places for group in groups if group]
    return found


def sweep(
    tasks: Sequence[str],
    methods: str | Sequence[str] | None,
    out: Path,
    *,
    seed: int = 0,
    quick: bool = False,
    jobs: int | None = None,
    only: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Results:
    """Measure every method on every task, taking up what an interrupted run left, and write DIR/results.json.

    Args:
        tasks: names or files.
        methods: as in `compare.methods.chosen`.
        out: the folder, made if it is not there.
        seed: of states, twists and displacements.
        quick: fewer states and ticks.
        jobs: processes; None is what joblib's back end has, one by default.
        only: kinds of measurement; None is all of them.
        progress: called with (cells done, cells in all).

    Raises:
        BadInput, UnknownName: no such task, method or kind, or a method that is not installed.
        ReferenceFailure: two references for one exact answer disagree.
    """
    table = chosen(methods)
    for task in tasks:
        load_task(task)  # a name that is none is told before an hour of work, not after
    work = cells(tasks, list(table), seed=seed, quick=quick, only=only)
    folder = out / "cells"
    folder.mkdir(parents=True, exist_ok=True)
    files = {cell: folder / f"{cell.kind}-{_key(cell)}.json" for cell in work}
    missing = [cell for cell in work if not _finished(files[cell])]
    done = len(work) - len(missing)
    for cell, found in _measured(missing, jobs):
        if isinstance(found, str):
            raise ReferenceFailure(found)
        _write(files[cell], json.dumps(plain(found), allow_nan=False))
        done += 1
        if progress is not None:
            progress(done, len(work))
    results = {
        "schema": SCHEMA,
        "machine": machine(),
        "versions": versions(),
        "seed": seed,
        "quick": quick,
        "tasks": list(tasks),
        "methods": [method.as_json() for method in table.values()],
        "cells": [entry for cell in work for entry in _entries(cell, json.loads(files[cell].read_text("utf-8")))],
    }
    write_results(out / "results.json", results)
    return results


def _entries(cell: Cell, found: dict[str, Result]) -> Iterator[dict[str, Any]]:
    for method, result in found.items():
        yield {"kind": cell.kind, "task": cell.task, "method": method, "result": result}


def _measured(work: list[Cell], jobs: int | None) -> Iterator[tuple[Cell, dict[str, Result] | str]]:
    """Every cell with its results, as they come; a message instead where the sweep has to end."""
    table = kinds()
    beside = [cell for cell in work if not table[cell.kind].alone]
    if beside:
        parallel = joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")
        yield from parallel(joblib.delayed(attempt)(cell) for cell in beside)
    by_itself = [cell for cell in work if table[cell.kind].alone]
    if by_itself:
        with ProcessPoolExecutor(1, env=dict.fromkeys(ONE_THREAD, "1")) as process:
            yield from process.map(attempt, by_itself)


def attempt(cell: Cell) -> tuple[Cell, dict[str, Result] | str]:
    """Measure a cell: what any library throws is its result, but references that disagree end the sweep."""
    try:
        with _silently():
            return cell, kinds()[cell.kind].measure(cell)
    except ReferenceFailure as failure:
        return cell, f"{cell.kind}, {cell.task}: {failure}"
    except Exception as error:  # noqa: BLE001 (a method or a machine that cannot is a row in the report)
        return cell, {method: {"failed": f"{type(error).__name__}: {error}"} for method in cell.methods}


@contextmanager
def _silently() -> Iterator[None]:
    """Without what solvers print whatever they are told."""
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere):
        yield


def _key(cell: Cell) -> str:
    """What a finished cell is found by again: its settings, its task file, this package, the libraries it rests on."""
    task = Path(cell.task)
    file = hashlib.sha256(task.read_bytes()).hexdigest() if task.is_file() else ""
    settings = json.dumps([asdict(cell), file, source_digest(), versions(), machine()], sort_keys=True)
    return hashlib.sha256(settings.encode()).hexdigest()[:20]


def _finished(file: Path) -> bool:
    try:
        return isinstance(json.loads(file.read_text("utf-8")), dict)
    except (OSError, ValueError):
        return False


def _write(file: Path, text: str) -> None:
    """In one piece: a run that is interrupted leaves no half of a file."""
    part = file.with_suffix(".part")
    try:
        part.write_text(text + "\n", encoding="utf-8")
        part.replace(file)
    except OSError as error:
        raise BadInput(str(file), f"{error}", "a folder that can be written to") from error


def write_results(file: Path, results: Results) -> None:
    """Results with a cell a line, so that two files can be told apart line by line."""
    content = plain(results)
    lines = ",\n  ".join(json.dumps(cell, allow_nan=False, separators=(",", ":")) for cell in content.pop("cells"))
    head = json.dumps(content, indent=1, allow_nan=False)
    _write(file, f'{head[:-2]},\n "cells": [\n  {lines}\n ]\n}}')


def plain(value: Any) -> Any:
    """The value with null for every figure that is no finite number, and four digits of every one that is."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
    return value
