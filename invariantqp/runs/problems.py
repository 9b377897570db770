"""What is wrong with a task file, one line a problem: its path, what was found, and what would be right.

$.law.gian: extra inputs are not permitted (did you mean 'gain'?)
$.law.margin: is now position_margin
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from invariantqp.runs.section import Section

Models = list[type[BaseModel]]


class _Place(NamedTuple):
    """Where a problem is: the path in the file, its last key, and the tables that this key may be in."""

    path: str
    key: str
    tables: Models


def problems(error: ValidationError, root: type[BaseModel]) -> list[str]:
    """A line for each place in a file, which should decode to `root`, where pydantic found something wrong."""
    found: dict[str, list[str]] = {}
    advice: dict[str, str] = {}
    for one in error.errors():
        unknown = one["type"] == "extra_forbidden"
        place = _place(one["loc"], root, unknown)
        now = _renamed(place) if unknown else ""
        found.setdefault(place.path, []).append(now or said(one))
        advice[place.path] = "" if now else _advice(place, unknown)
    return [f"{path}: {' or '.join(texts)}{advice[path]}" for path, texts in found.items()]


def said(found: Any) -> str:
    """One of pydantic's errors in its own words, as part of a sentence."""
    words = str(found["msg"]).removeprefix("Value error, ")
    return words if words[1:2].isupper() else words[:1].lower() + words[1:]


def _place(location: tuple[int | str, ...], root: type[BaseModel], unknown: bool) -> _Place:
    """A place as the file has it, whose last key may be unknown. pydantic also names the members of unions: no keys."""
    path, key = "$", ""
    tables: Models = []
    below: Models = [root]
    for part in location:
        if isinstance(part, int):
            path += f"[{part}]"
        elif _is_key(part, below) or (unknown and part == location[-1]):
            path, key, tables, below = f"{path}.{part}", part, below, _tables_at(part, below)
        else:
            below = [table for table in below if _is_kind(table, part)] or below
    return _Place(path, key, tables)


def _is_key(name: str, tables: Models) -> bool:
    return any(name in table.model_fields for table in tables)


def _tables_at(key: str, tables: Models) -> Models:
    """The tables that may be the value of a key."""
    fields = [table.model_fields[key] for table in tables if key in table.model_fields]
    return [table for field in fields for table in _models_in(field.annotation)]


def _renamed(place: _Place) -> str:
    """What an old key is called now; "" for a key that never was one."""
    renamed = [table.RENAMED for table in place.tables if issubclass(table, Section)]
    return next((f"is now {names[place.key]}" for names in renamed if place.key in names), "")


def _advice(place: _Place, unknown: bool) -> str:
    """A key like an unknown one, or an example of a value."""
    fields = {name: field for table in place.tables for name, field in table.model_fields.items()}
    if unknown:
        near = difflib.get_close_matches(place.key, list(fields), 1)
        return f" (did you mean {near[0]!r}?)" if near else f" (known keys: {', '.join(sorted(fields))})"
    examples = fields[place.key].examples if place.key in fields else None
    return f" (for example: {place.key} = {toml(examples[0])})" if examples else ""


def toml(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {toml(inner)}' for key, inner in value.items())} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml, value))}]"
    return str(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)  # inf as well


def _is_kind(table: type[BaseModel], name: str) -> bool:
    """Whether a table is the kind of that name, of several that may stand at a place: a path has kind = "line"."""
    kind = table.model_fields.get("kind")
    return kind is not None and name in getattr(kind.annotation, "__args__", ())


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables in an annotation, such as the kinds of a path."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _models_in(inner)
