"""One piece of work of a sweep, and what a measurement is: a function from a cell to the results of its methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

# The figures of one method, ready for JSON.
Result = dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """One piece of work.

    Attributes:
        kind: the name of a measurement.
        task: the name or file of a task, or one of the measurement's own places.
        methods: names of methods; a single one in most measurements, all of them where time is measured.
        seed: seed of everything that is drawn at random.
        quick: whether to measure a few states instead of many.
    """

    kind: str
    task: str
    methods: tuple[str, ...]
    seed: int = 0
    quick: bool = False

    @property
    def method(self) -> str:
        """The method of a cell that has a single one."""
        (name,) = self.methods
        return name


@dataclass(frozen=True)
class Kind:
    """A measurement.

    Attributes:
        measure: a cell to {method: result}, for each of the cell's methods that has a result.
        alone: whether it measures time. Then nothing else runs meanwhile, and one cell has all methods of a task.
        tasks: the measurement's own tasks; None for the tasks of the sweep.
        together: whether all methods of a task share a cell though no time is measured, for a shared reference say.
        fits: whether it is for the method of this name.
        variants: whether a quick run has all methods of a group, and not the first alone.
        needs: Python modules that it needs besides those of the methods; the extra `compare` installs them.
    """

    measure: Callable[[Cell], dict[str, Result]]
    alone: bool = False
    tasks: tuple[str, ...] | None = None
    together: bool = False
    fits: Callable[[str], bool] = lambda _: True
    variants: bool = False
    needs: tuple[str, ...] = ()
