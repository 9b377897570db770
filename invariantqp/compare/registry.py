"""The table of all methods, how a user names some of them, and which of them are not installed."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from invariantqp.compare import libraries, linear, ours, qp
from invariantqp.compare.method import FAMILIES, Method
from invariantqp.errors import BadInput, UnknownName
from invariantqp.extras import require
from invariantqp.runs.controllers import MakeController

# Every method by its name, installed or not; ours is the first.
METHODS: dict[str, Method] = {
    method.name: method for family in (ours, qp, linear, libraries) for method in family.METHODS
}


def controller_named(name: str) -> MakeController:
    """The control loop of a method, by the method's name; `MissingExtra` where it is not installed."""
    method = METHODS[name]
    require(method.extra, *method.needs)
    return method.loop


def chosen(names: Sequence[str] | None = None) -> list[Method]:
    """The methods that some names stand for, in the order of the table, installed or not.

    A name is that of a method, a family ("damped"), or part of a name ("pink"), in upper or lower case; None is every
    method. One given by its full name has to be installed.
    """
    if names is None:
        return list(METHODS.values())
    words = [word.strip() for word in names if word.strip()]
    if not words:
        raise BadInput("--methods", "no method", "methods, families or parts of names")
    meant = {method for word in words for method in _meant(word)}
    return [method for method in METHODS.values() if method in meant]


def not_installed(methods: Iterable[Method]) -> dict[str, list[str]]:
    """The names of those that are not installed, by the extra that would install them."""
    found: dict[str, list[str]] = {}
    for method in methods:
        if not method.installed:
            found.setdefault(method.extra, []).append(method.name)
    return found


def _meant(word: str) -> list[Method]:
    """The method of this name; or the methods of this family; or those with this in their name."""
    low = word.lower()
    named = {method.name.lower(): method for method in METHODS.values()}
    if low in named:
        require(named[low].extra, *named[low].needs)
        return [named[low]]
    found = [method for method in METHODS.values() if method.family.lower() == low]
    found = found or [method for name, method in named.items() if low in name]
    if not found:
        known = list(dict.fromkeys([*METHODS, *FAMILIES]))
        raise UnknownName("method", word, difflib.get_close_matches(word, known), known)
    return found
