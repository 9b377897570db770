"""The base class of the tables of a task file, the types of their numbers, and one-line messages for errors.

Numbers are neither text nor booleans, and small enough to be squared. Units are SI and radians. A message has the
key's path, what was found, and what is expected:

    $.law.gian: extra inputs are not permitted (did you mean 'gain'?)
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator
from copy import deepcopy
from itertools import takewhile
from math import isnan
from typing import Annotated, Any, ClassVar, NamedTuple

from pydantic import AfterValidator, AllowInfNan, BaseModel, ConfigDict, Field, Strict, ValidationError

from invariantqp.geometry.arrays import NEGLIGIBLE
from invariantqp.geometry.sizes import LENGTH_LIMIT

Number = Annotated[float, Strict(), AllowInfNan(False), Field(ge=-LENGTH_LIMIT, le=LENGTH_LIMIT)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Vector3 = tuple[Number, Number, Number]
Vector6 = tuple[Number, Number, Number, Number, Number, Number]
Models = list[type[BaseModel]]


class Section(BaseModel):
    """A table of a task file. Unknown keys are refused."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True)


def checked_number(number: float) -> float:
    """The number, infinite or not, but not NaN."""
    if isnan(number):
        raise ValueError("a limit or a pitch is a number, or inf or -inf")
    return number


# Infinity means no limit, or the pitch of a prismatic joint.
OpenNumber = Annotated[float, Strict(), AfterValidator(checked_number)]


def checked_direction(vector: Vector3) -> Vector3:
    """The vector, if it has a direction."""
    if sum(x * x for x in vector) < NEGLIGIBLE**2:
        raise ValueError("a direction cannot be the zero vector")
    return vector


# A direction in space; its length does not matter.
Direction = Annotated[Vector3, AfterValidator(checked_direction)]


class _Place(NamedTuple):
    """The place of an error: its keys, and the tables that the last key may belong to."""

    keys: tuple[int | str, ...]
    tables: Models

    @property
    def path(self) -> str:
        """As in messages."""
        return "$" + "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in self.keys)


def problems(error: ValidationError, root: type[BaseModel]) -> list[str]:
    """A message for each place in a file for `root` where pydantic found an error."""
    messages: dict[str, list[str]] = {}
    advice: dict[str, str] = {}
    for one in error.errors():
        unknown = one["type"] == "extra_forbidden"
        place = _place(one["loc"], root, unknown)
        single = one["type"] == "list_type" and isinstance(one["input"], dict)
        messages.setdefault(place.path, []).append(
            f"write [[{place.path[2:]}]], of which there may be several" if single else message(one)
        )
        advice[place.path] = _advice(place, unknown)
    return [f"{path}: {' or '.join(texts)}{advice[path]}" for path, texts in messages.items()]


def without_errors(content: dict[str, Any], error: ValidationError, root: type[BaseModel]) -> dict[str, Any] | None:
    """The content of a file without the keys in error; None where a key is missing, or a whole table is in error."""
    left = deepcopy(content)
    for one in error.errors():
        unknown = one["type"] == "extra_forbidden"
        place = _place(one["loc"], root, unknown)
        keys = [str(key) for key in takewhile(lambda key: isinstance(key, str), place.keys)]
        about_a_table = not unknown and (len(place.keys) < 2 or isinstance(one["input"], dict))
        if one["type"] == "missing" or about_a_table:
            return None
        table = left
        for key in keys[:-1]:
            table = table[key]
        table.pop(keys[-1], None)
    return left


def message(error: Any) -> str:
    """The text of one of pydantic's errors, as part of a sentence."""
    words = str(error["msg"]).removeprefix("Value error, ")
    return words if words[1:2].isupper() else words[:1].lower() + words[1:]


def _place(location: tuple[int | str, ...], root: type[BaseModel], unknown: bool) -> _Place:
    """The place of an error whose last key may be unknown, without the names of union members that pydantic adds."""
    keys: tuple[int | str, ...] = ()
    tables: Models = []
    below: Models = [root]
    for part in location:
        if isinstance(part, int):
            keys += (part,)
        elif any(part in table.model_fields for table in below) or (unknown and part == location[-1]):
            fields = [table.model_fields[part] for table in below if part in table.model_fields]
            keys, tables, below = (*keys, part), below, [t for field in fields for t in models_in(field.annotation)]
        else:  # the kind of that name, of several that may stand at a place: a path has kind = "line"
            kinds = {table: getattr(table.model_fields.get("kind"), "annotation", None) for table in below}
            below = [table for table, kind in kinds.items() if part in getattr(kind, "__args__", ())] or below
    return _Place(keys, tables)


def _advice(place: _Place, unknown: bool) -> str:
    """A key similar to an unknown one, or an example of a value."""
    fields = {name: field for table in place.tables for name, field in table.model_fields.items()}
    key = next((key for key in reversed(place.keys) if isinstance(key, str)), "")
    if unknown:
        near = difflib.get_close_matches(key, list(fields), 1)
        return f" (did you mean {near[0]!r}?)" if near else f" (known keys: {', '.join(sorted(fields))})"
    examples = fields[key].examples if key in fields else None
    return f" (for example: {key} = {toml(examples[0])})" if examples else ""


def toml(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {toml(inner)}' for key, inner in value.items())} }}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml, value))}]"
    return str(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)  # inf as well


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """The tables in an annotation, such as the kinds of a path."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from models_in(inner)
