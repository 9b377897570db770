"""One piece of work of a sweep, and what a measurement is: a function from a cell to the results of its methods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from invariantqp.compare.method import Method
from invariantqp.errors import MissingExtra
from invariantqp.extras import is_installed
from invariantqp.runs.taskfile import Task, load_task

# The figures of one method, ready for JSON.
Result = dict[str, Any]
# In a quick run ticks are this many times longer.
COARSER = 10.0


@dataclass(frozen=True)
class Cell:
    """One piece of work."""

    kind: str  # the name of a measurement
    task: str  # the name or file of a task
    # names of methods; a single one in most measurements, all of them where they share something
    methods: tuple[str, ...]
    seed: int = 0  # seed of everything that is drawn at random
    quick: bool = False  # whether to measure little

    @property
    def method(self) -> str:
        """The method of a cell that has a single one."""
        (name,) = self.methods
        return name

    def load(self) -> Task:
        """Its task, with longer ticks in a quick run."""
        task = load_task(self.task)
        return with_law(task, dt=COARSER * task.law.dt) if self.quick else task


@dataclass(frozen=True)
class Kind:
    """A measurement."""

    # a cell to {method: result}, for each of the cell's methods that has a result
    measure: Callable[[Cell], dict[str, Result]]
    # whether it measures time. Then nothing else runs meanwhile, and one cell has all methods of a task.
    alone: bool = False
    tasks: tuple[str, ...] | None = None  # the measurement's own tasks; None for the tasks of the sweep
    # whether all methods of a task share a cell though no time is measured, for a shared reference say
    together: bool = False
    fits: Callable[[str], bool] = lambda _: True  # whether it is for the method of this name
    slow: bool = False  # whether a quick run leaves it out
    # Python modules that it needs besides those of the methods; the extra `compare` installs them
    needs: tuple[str, ...] = ()

    @property
    def installed(self) -> bool:
        """Whether every module that it needs is installed."""
        return all(map(is_installed, self.needs))


def absent(methods: Iterable[Method], tasks: Iterable[str]) -> dict[str, list[str]]:
    """What is left out by the extra that would install it: these methods, and the tasks whose robot is missing."""
    found: dict[str, list[str]] = {}
    for method in methods:
        found.setdefault(method.extra, []).append(method.name)
    immobile: dict[str, list[str]] = {}
    for task, error in without_robot(dict.fromkeys(tasks)).items():
        immobile.setdefault(error.extra, []).append(task)
    for extra, names in immobile.items():
        found.setdefault(extra, []).append(f"the robots of {', '.join(names)}")
    return found


def without_robot(tasks: Iterable[str]) -> dict[str, MissingExtra]:
    """The tasks whose robot is not installed, each with what says so.

    Raises:
        UnknownName: there is no such task.
    """
    found = {}
    for task in tasks:
        try:
            load_task(task).load_robot()
        except MissingExtra as error:
            found[task] = error
    return found


def with_robot(tasks: Sequence[str]) -> list[str]:
    """The tasks whose robot is installed.

    Raises:
        UnknownName: there is no such task.
        MissingExtra: there are tasks, and the robot of none is installed.
    """
    immobile = without_robot(dict.fromkeys(tasks))
    kept = [task for task in tasks if task not in immobile]
    if immobile and not kept:
        raise next(iter(immobile.values()))
    return kept


def with_law(task: Task, **changes: Any) -> Task:
    """The task with keys of its [law] changed."""
    return task.model_copy(update={"law": task.law.model_copy(update=changes)})
