"""Base classes of frozen values with arrays as fields: read-only copies, compared number by number.

    @frozen(init=False, eq=False, repr=False, slots=False)
    class Plane(Value):
        normal: Array = field(converter=own)
        height: float

        def __init__(self, normal: ArrayLike, height: float = 0.0) -> None:
            self.__attrs_init__(arrays.direction(normal, "normal"), arrays.number(height, "height"))

The constructor checks its arguments, once.
"""

from __future__ import annotations

from dataclasses import fields as dataclass_fields
from dataclasses import is_dataclass
from typing import Any, cast

import attrs
import numpy as np

from invariantqp.geometry.arrays import Array

# Largest array that a repr prints, a twist; of larger ones it prints the shape.
LARGEST_PRINTED = 6


def own(a: Array) -> Array:
    """A read-only copy."""
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
    """Base of frozen attrs classes with arrays: `==` compares them number by number, `repr` abbreviates them.

    Fields with `eq=False` or `repr=False` are left out.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(same(getattr(self, f.name), getattr(other, f.name)) for f in _fields(self) if f.eq)

    __hash__ = None  # type: ignore[assignment]  # its arrays are writeable

    def __repr__(self) -> str:
        printed = ", ".join(f"{f.name}={_short(getattr(self, f.name))}" for f in _fields(self) if f.repr)
        return f"{type(self).__name__}({printed})"


class Value(Compared):
    """A `Compared` whose arrays are read-only copies by `own`, also after unpickling; it can be hashed."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash((type(self), *(_hashable(getattr(self, f.name)) for f in _fields(self) if f.eq)))

    def __getstate__(self) -> dict[str, Any]:
        """The fields, without cached properties."""
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
    if value.size > LARGEST_PRINTED:
        return f"<array of shape {value.shape}>"
    return np.array2string(value, precision=4, suppress_small=True, separator=", ").replace("\n", "")
