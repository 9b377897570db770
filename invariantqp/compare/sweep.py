"""Every measurement as a cell: kinds times tasks times methods, run in parallel, kept on disk, gathered in one file.

    DIR/cells/*.json      one finished cell each; an interrupted sweep takes them up again
    DIR/results.json      {"schema": 1, "machine": {...}, "versions": {...}, "seed": 0, "quick": false, "tasks": [...],
                           "methods": [Method.as_json(), ...],
                           "cells": [{"kind": "error", "task": "panda_path", "method": "DLS", "result": {...}}, ...]}

A figure that is no finite number is null. A measurement that could not be made has the result {"failed": "why"}; charts
leave it out and the report lists it.

A **kind** is a measurement: a function from a `Cell` to its results, one JSON-able dict a method, and whether it has to
run alone. Cells that measure time run after all others, one at a time, every method of a task in one cell, so that
its rounds interleave the methods and a drift of the clock hits all alike.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

Result = dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """One piece of work.

    Attributes:
        kind: a key of KINDS.
        task: a task's name or file; what a kind of its own makes of it where it needs no task ("" is fine).
        methods: names from `compare.methods`; a single one in most kinds, all of them where time is measured.
        seed: of whatever is drawn at random.
        quick: a few minutes' worth of states, or a few seconds'.
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
        per_task: whether there is a cell for each task; otherwise one with task "".
        together: whether all methods of a task share a cell though they are not timed (a shared reference, say).
    """

    measure: Callable[[Cell], dict[str, Result]]
    alone: bool = False
    per_task: bool = True
    together: bool = False


KINDS: dict[str, Kind] = {}


def cells(kinds: Sequence[str], tasks: Sequence[str], methods: Sequence[str], seed: int, quick: bool) -> list[Cell]:
    """The cells of a sweep, those that run alone last."""
    found = []
    for name in sorted(kinds, key=lambda k: KINDS[k].alone):
        kind = KINDS[name]
        groups = [tuple(methods)] if kind.alone or kind.together else [(m,) for m in methods]
        found += [
            Cell(name, task, group, seed, quick) for task in (tasks if kind.per_task else [""]) for group in groups
        ]
    return found
