"""The table of all methods, how a user names some of them, and which of them are not installed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from invariantqp.compare import libraries, linear, ours, qp
from invariantqp.compare.method import FAMILIES, Method, controller_of
from invariantqp.errors import BadInput, UnknownName
from invariantqp.extras import require
from invariantqp.runs.controllers import MakeController

_METHODS = {method.name: method for family in (ours, qp, linear, libraries) for method in family.METHODS}


def methods() -> dict[str, Method]:
    """Every method by its name, installed or not; ours is the first."""
    return dict(_METHODS)


def controller_named(name: str) -> MakeController:
    """The control loop of a method, by the method's name."""
    return controller_of(_METHODS[name])


def chosen(names: Sequence[str] | None = None) -> list[Method]:
    """The methods that some names stand for, in the order of the table, installed or not.

    A name is that of a method, a family ("damped"), or part of a name ("pink"), in upper or lower case; None is every
    method. One given by its full name has to be installed.
    """
    if names is None:
        return list(_METHODS.values())
    words = [word.strip() for word in names if word.strip()]
    if not words:
        raise BadInput("--methods", "no method", "methods, families or parts of names")
    meant = {method for word in words for method in _meant(word)}
    return [method for method in _METHODS.values() if method in meant]


def not_installed(methods: Iterable[Method]) -> dict[str, list[str]]:
    """The names of those that are not installed, by the extra that would install them."""
    found: dict[str, list[str]] = {}
    for method in methods:
        if not method.installed:
            found.setdefault(method.extra, []).append(method.name)
    return found


def _meant(word: str) -> list[Method]:
    """The method of this name; or the methods of this family; or those with this in their name."""
    low, table = word.lower(), _METHODS.values()
    found = [method for method in table if method.name.lower() == low]
    for method in found:
        require(method.extra, *method.needs)
    found = found or [method for method in table if method.family.lower() == low]
    found = found or [method for method in table if low in method.name.lower()]
    if not found:
        known = [*_METHODS, *FAMILIES]
        raise UnknownName("method", word, difflib.get_close_matches(word, known), known)
    return found
