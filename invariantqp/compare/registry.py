"""The table of all methods, how a user names some of them, and what of them and of tasks is not installed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from invariantqp.compare import libraries, linear, ours, qp
from invariantqp.compare.loop import controller_of
from invariantqp.compare.method import FAMILIES, Method
from invariantqp.errors import BadInput, MissingExtra, UnknownName, install_command
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.taskfile import load_task

_METHODS = {method.name: method for family in (ours, qp, linear, libraries) for method in family.METHODS}


def methods() -> dict[str, Method]:
    """Every method by its name, installed or not; ours is the first."""
    return dict(_METHODS)


def controller_named(name: str) -> MakeController:
    """The control loop of a method, by the method's name."""
    return controller_of(_METHODS[name])


def chosen(names: str | Iterable[str] | None = None) -> dict[str, Method]:
    """The methods that some names stand for, without those that are not installed.

    Args:
        names: each the name of a method, a family such as "damped", or part of a name ("pink" is every row of
            Pink); upper and lower case are the same. None stands for every method.

    Returns:
        {name: method} in the order of the table.

    Raises:
        UnknownName: one name stands for no method.
        BadInput: several names stand for no method, a method given by its full name is not installed, or no name.
    """
    meant, given = _selected(names), {word.lower() for word in _words(names)}
    for method in meant.values():
        if method.name.lower() in given and not method.installed:
            raise BadInput(
                "--methods",
                f"{method.name}, which needs {' and '.join(method.needs)}",
                "installed methods",
                f"Run: {install_command(method.extra)}",
            )
    return {name: method for name, method in meant.items() if method.installed}


def left_out(names: str | Iterable[str] | None = None) -> list[Method]:
    """The methods that the same names stand for and that `chosen` leaves out, since they are not installed."""
    return [method for method in _selected(names).values() if not method.installed]


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


def _words(names: str | Iterable[str] | None) -> list[str]:
    if names is None:
        return []
    return [word.strip() for word in ([names] if isinstance(names, str) else names) if word.strip()]


def _selected(names: str | Iterable[str] | None) -> dict[str, Method]:
    """The methods that the names stand for, in the order of the table."""
    if names is None:
        return methods()
    words = _words(names)
    if not words:
        raise BadInput(
            "--methods", "no method", "methods, families or parts of names", f"Methods: {_quoted(_METHODS)}."
        )
    found = {word: _matches(word) for word in words}
    unknown = [word for word, matches in found.items() if not matches]
    if unknown:
        raise _unknown(unknown)
    meant = {name for matches in found.values() for name in matches}
    return {name: method for name, method in _METHODS.items() if name in meant}


def _matches(word: str) -> list[str]:
    """The method of this name; or the methods of this family; or those with this in their name."""
    low = word.lower()
    by_name = [name for name in _METHODS if name.lower() == low]
    by_family = [name for name, method in _METHODS.items() if method.family.lower() == low]
    return by_name or by_family or [name for name in _METHODS if low in name.lower()]


def _unknown(words: list[str]) -> BadInput | UnknownName:
    """The error for names that stand for no method."""
    known = [*_METHODS, *FAMILIES]
    near = {word: difflib.get_close_matches(word, known) for word in words}
    if len(words) == 1 and "," not in words[0]:
        return UnknownName("method", words[0], near[words[0]], known)
    found = [f"{word!r}" + (f" (similar: {_quoted(names)})" if names else "") for word, names in near.items()]
    remedy = f"Give each name a --methods of its own. Methods: {_quoted(_METHODS)}. Families: {_quoted(FAMILIES)}."
    return BadInput(
        "--methods", f"no method called {' or '.join(found)}", "methods, families or parts of names", remedy
    )


def _quoted(names: Iterable[str]) -> str:
    """Names in quotes, since some of them contain a comma."""
    return ", ".join(f"'{name}'" for name in names)
