"""Frozen values with arrays in them: their own copies, read-only, compared number by number.

    @frozen(init=False, eq=False, repr=False, slots=False)
    class Plane(Value):
        normal: Array = field(converter=own)
        height: float

        def __init__(self, normal: ArrayLike, height: float = 0.0) -> None:
            self.__attrs_init__(arrays.direction(normal, "normal"), arrays.number(height, "height"))

The constructor says what is accepted and checks it once, by the names the caller knows; the fields, what is stored.
"""

from __future__ import annotations

from dataclasses import fields as dataclass_fields
from dataclasses import is_dataclass
from typing import Any, cast

import attrs
import numpy as np

from invariantqp.geometry.arrays import Array

# A repr shows arrays up to this many numbers, the twists and points; of larger ones the shape.
SHOWN = 6


def own(a: Array) -> Array:
    """A read-only copy: what the caller does to the array afterwards changes nothing."""
    copy = np.array(a)
    copy.flags.writeable = False
    return copy


def same(a: object, b: object) -> bool:
    """Whether two values are equal, arrays number by number, in tuples and dataclasses as well."""
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and np.array_equal(a, b)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if is_dataclass(a) and type(a) is type(b):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclass_fields(a))
    return bool(a == b)


class Compared:
    """Base of frozen attrs classes with arrays: `==` compares them number by number, `repr` shows them in short.

    Fields with `eq=False` or `repr=False` are left out.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, f.name), getattr(other, f.name)) for f in _fields(self) if f.eq)

    __hash__ = None  # type: ignore[assignment]  # its arrays may be written to

    def __repr__(self) -> str:
        shown = ", ".join(f"{f.name}={_short(getattr(self, f.name))}" for f in _fields(self) if f.repr)
        return f"{type(self).__name__}({shown})"


class Value(Compared):
    """A `Compared` whose arrays are all its `own`: it can be hashed, and is read-only after unpickling as well."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((type(self), *(_hashable(getattr(self, f.name)) for f in _fields(self) if f.eq)))

    def __getstate__(self) -> dict[str, Any]:
        """What a pickle is made from: the fields, without what has been computed from them."""
        return {f.name: getattr(self, f.name) for f in _fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
        vars(self).update(state)


def _fields(value: object) -> tuple[attrs.Attribute[Any], ...]:
    fields: tuple[attrs.Attribute[Any], ...] = attrs.fields(cast("Any", type(value)))
    return fields


def _hashable(value: object) -> object:
    return (value.shape, *value.ravel().tolist()) if isinstance(value, np.ndarray) else value


def _short(value: object) -> str:
    if not isinstance(value, np.ndarray):
        return repr(value)
    if value.size > SHOWN:
        return f"<array of shape {value.shape}>"
    return np.array2string(value, precision=4, suppress_small=True, separator=", ").replace("\n", "")
