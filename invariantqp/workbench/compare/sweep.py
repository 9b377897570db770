"""Runs a comparison: every installed method on every task. The result is the content of results.json."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from importlib import import_module

from invariantqp.errors import BadInput, UnknownName
from invariantqp.workbench.compare.arms import STARTS
from invariantqp.workbench.compare.drive import Workers, run_all
from invariantqp.workbench.compare.method import FAMILIES, MODULES, OTHER_SETTINGS, Method
from invariantqp.workbench.compare.results import Results, collect
from invariantqp.workbench.compare.tasks import KINDS, BedTask, bed, from_file
from invariantqp.workbench.runs.taskfile import load_task

# All methods; ours is the first.
METHODS: dict[str, Method] = {method.name: method for name in MODULES for method in import_module(name).METHODS}
# The arms of the quick form: seven joints and five.
QUICK = ("panda", "so101")


def chosen(
    words: Sequence[str] | None, known: Iterable[str], what: str, groups: dict[str, list[str]] | None = None
) -> list[str]:
    """The names that words select, in order: by name, by group, or by part of a name; None selects all."""
    names, groups = list(known), groups or {}
    if words is None:
        return names
    selected: dict[str, None] = {}
    for word in words:
        low = word.strip().lower()
        exact = [name for name in names if name.lower() == low]
        matches = exact or groups.get(low) or [name for name in names if low and low in name.lower()]
        if not matches:
            options = [*names, *groups]
            raise UnknownName(what, word, difflib.get_close_matches(word, options), options)
        selected |= dict.fromkeys(matches)
    return list(selected)


def methods_named(words: Sequence[str] | None) -> list[Method]:
    """The methods of names, families or parts of names, in the order of the table.

    Methods of the family "other settings" are selected by their full name or their family only.
    """
    families = {family: [m.name for m in METHODS.values() if m.family == family] for family in FAMILIES}
    others = families[OTHER_SETTINGS]
    found = chosen(
        words,
        [name for name in METHODS if name not in others],
        "method",
        families | {name.lower(): [name] for name in others},
    )
    return [method for name, method in METHODS.items() if name in found]


def tasks_of(
    files: Sequence[str], arms: Sequence[str] | None, kinds: Sequence[str] | None, seed: int, *, quick: bool
) -> list[BedTask]:
    """The tasks of task files, or of the bed if none is given."""
    if files:
        if arms or kinds:
            raise BadInput("TASK", "--arms or --kinds too", "TASK alone: these choose tasks of the bed")
        found = [task for name in dict.fromkeys(files) for task in from_file(load_task(name), seed)]
        names = [task.name for task in found]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise BadInput("TASK", f"two files with the name {twice[0]!r}", "different names in the files")
        return found
    arms = QUICK if quick and arms is None else chosen(arms, STARTS, "arm")
    return bed(arms, chosen(kinds, KINDS, "kind"), seed)


def sweep(
    tasks: Sequence[BedTask],
    methods: Sequence[Method],
    *,
    seed: int = 0,
    quick: bool = False,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Results:
    """Measure every installed method on every task: the content of results.json.

    Args:
        tasks: as `tasks_of` makes them.
        methods: as `methods_named` finds them.
        seed: the seed of the tasks.
        quick: whether slow methods are left out.
        jobs: tasks at a time; -1 is one a core, or one for each worker of the back end of `joblib.parallel_config`. For
            times to quote, 1.
        progress: called with (tasks done, number of tasks).
    """
    requested = [method for method in methods if not (quick and method.slow)]
    with closing(Workers(requested)) as workers:
        versions = workers.installed()
    able = [method for method in requested if method.name in versions]
    if not able:
        names = ", ".join(method.name for method in methods)
        raise BadInput("--methods", f"{names}: none of these can be run", "a method that is installed and not left out")
    found = {}
    for task, runs in run_all(tasks, able, jobs):
        found[task.name] = (task, runs)
        if progress is not None:
            progress(len(found), len(tasks))
    return collect(able, versions, [found[task.name] for task in tasks], seed=seed, quick=quick)
