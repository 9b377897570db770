"""The table of all methods, how a user names some of them, and what of them and of tasks is not installed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from invariantqp.compare import libraries, linear, ours, qp
from invariantqp.compare.method import FAMILIES, Method, controller_of
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
    """The methods that some names stand for, in the order of the table, without those that are not installed.

    A name is that of a method, a family ("damped"), or part of a name ("pink"), in upper or lower case; None is every
    method. One given by its full name has to be installed.
    """
    meant, given = _selected(names), {word.lower() for word in _words(names)}
    for method in meant:
        if method.name.lower() in given and not method.installed:
            raise BadInput(
                "--methods",
                f"{method.name}, which needs {' and '.join(method.needs)}",
                "installed methods",
                f"Run: {install_command(method.extra)}",
            )
    return {method.name: method for method in meant if method.installed}


def left_out(names: str | Iterable[str] | None = None) -> list[Method]:
    """The methods that the same names stand for and that `chosen` leaves out, since they are not installed."""
    return [method for method in _selected(names) if not method.installed]


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
    """The tasks whose robot is not installed, each with what says so."""
    found = {}
    for task in tasks:
        try:
            load_task(task).load_robot()
        except MissingExtra as error:
            found[task] = error
    return found


def with_robot(tasks: Sequence[str]) -> list[str]:
    """The tasks whose robot is installed; `MissingExtra` if there are tasks, and the robot of none is."""
    immobile = without_robot(dict.fromkeys(tasks))
    kept = [task for task in tasks if task not in immobile]
    if immobile and not kept:
        raise next(iter(immobile.values()))
    return kept


def _words(names: str | Iterable[str] | None) -> list[str]:
    return [word.strip() for word in ([names] if isinstance(names, str) else names or ()) if word.strip()]


def _selected(names: str | Iterable[str] | None) -> list[Method]:
    """The methods that the names stand for, in the order of the table."""
    words = _words(names)
    if names is not None and not words:
        raise BadInput("--methods", "no method", "methods, families or parts of names")
    meant = {method for word in words for method in _meant(word)}
    return [method for method in _METHODS.values() if names is None or method in meant]


def _meant(word: str) -> list[Method]:
    """The method of this name; or the methods of this family; or those with this in their name."""
    low, table = word.lower(), _METHODS.values()
    found = [method for method in table if method.name.lower() == low]
    found = found or [method for method in table if method.family.lower() == low]
    found = found or [method for method in table if low in method.name.lower()]
    if not found:
        known = [*_METHODS, *FAMILIES]
        raise UnknownName("method", word, difflib.get_close_matches(word, known), known)
    return found
