"""A hybrid tick in the compiled core, as long as nothing stops the tool: a check that finds something is Python's.

What the core is told of a task, a sensor and a split are tables of `csrc/fields.h`, by name. What is kept from tick to
tick it has as numbers, in the order of the fields of Python's values (`csrc/press.h`): a bool is 0 or 1, None is NaN,
and what there are several of is a count and room for the most. Shapes and the most are said where a field is,
`Annotated[Array, 3, 3]`, `Annotated[tuple[Touch, ...], 6]`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate, chain
from math import isnan, nan, prod
from struct import Struct
from types import GetSetDescriptorType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np

from invariantqp.engine import core
from invariantqp.force.contact import HybridTask, Split
from invariantqp.force.sensor import WrenchSensor
from invariantqp.legacy.loop import LegacyLoop

if TYPE_CHECKING:
    from invariantqp.engine import Press
    from invariantqp.engine import Split as CoreSplit

# A hybrid tick by the core (`csrc/press.c` says what it takes and gives); None where Python has to answer.
compiled_press: Callable[..., tuple[Any, ...] | None] = getattr(core, "press", lambda *_, **__: None)


class Coding(NamedTuple):
    """How values of a type become numbers, and come back from them.

    Attributes:
        size: how many numbers.
        write: from a value.
        read: from so many.
    """

    size: int
    write: Callable[[Any], list[float]]
    read: Callable[[list[float]], Any]


def coding_of(hint: Any) -> Coding:
    """The coding of a type: float, int, bool, an array, a NamedTuple or a tuple of them, several of one, or None."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Annotated:
        several = get_args(parts[0])[0] if get_origin(parts[0]) is tuple else None
        return _array(parts[1:]) if several is None else _several(coding_of(several), parts[1])
    if origin in (Union, UnionType):
        return _maybe(coding_of(parts[0]))
    if origin is tuple:
        return _fields(tuple, parts)
    if hasattr(hint, "_make"):
        return _fields(hint._make, tuple(get_type_hints(hint, include_extras=True).values()))
    return Coding(1, lambda value: [float(value)], lambda numbers: hint(numbers[0]))


def _array(shape: tuple[int, ...]) -> Coding:
    return Coding(prod(shape), lambda value: value.ravel().tolist(), lambda numbers: np.array(numbers).reshape(shape))


def _maybe(coding: Coding) -> Coding:
    none = [nan] * coding.size
    return Coding(
        coding.size,
        lambda value: none if value is None else coding.write(value),
        lambda numbers: None if not numbers or isnan(numbers[0]) else coding.read(numbers),
    )


def _several(coding: Coding, most: int) -> Coding:
    size = coding.size

    def write(value: Any) -> list[float]:
        if len(value) > most:
            raise ValueError("more than there is room for")
        return [len(value), *chain.from_iterable(map(coding.write, value)), *[0.0] * (size * (most - len(value)))]

    def read(numbers: list[float]) -> Any:
        return tuple([coding.read(numbers[k : k + size]) for k in range(1, 1 + int(numbers[0]) * size, size)])

    return Coding(1 + most * size, write, read)


def _fields(made: Callable[[list[Any]], Any], hints: tuple[Any, ...]) -> Coding:
    if str in hints:  # words are no numbers
        return Coding(0, _refused, _refused)
    codings = [coding_of(hint) for hint in hints]
    ends = list(accumulate(coding.size for coding in codings))

    def write(value: Any) -> list[float]:
        return [number for coding, one in zip(codings, value, strict=True) for number in coding.write(one)]

    def read(numbers: list[float]) -> Any:
        return made([coding.read(numbers[end - coding.size : end]) for coding, end in zip(codings, ends, strict=True)])

    return Coding(ends[-1], write, read)


def _refused(value: Any) -> Any:
    raise ValueError(f"not remembered as numbers: {value}")


class Packing:
    """The numbers of values of one NamedTuple, as the core has them: bytes."""

    def __init__(self, made: type) -> None:
        """Of this one."""
        self._coding = coding_of(made)
        self._struct = Struct(f"{self._coding.size}d")

    def packed(self, value: Any) -> bytes | None:
        """The numbers of a value; None for one that the core does not have."""
        try:
            return self._struct.pack(*self._coding.write(value))
        except ValueError:
            return None

    def unpacked(self, numbers: bytes) -> Any:
        """The value that these numbers are."""
        return self._coding.read(list(self._struct.unpack(numbers)))


def _fields_of(table: type, *values: Any) -> dict[str, Any]:
    """The fields of a table of the core that these values have by the same name; None is the table's own default."""
    names = [name for name, kind in vars(table).items() if isinstance(kind, GetSetDescriptorType)]
    return {name: getattr(value, name) for value in values for name in names if hasattr(value, name)}


def core_split(split: Split) -> CoreSplit | None:
    """A split as the core takes it; None for one without constraints."""
    if core is None or not len(split.unit_parts):
        return None
    fields = _fields_of(core.Split, split, split.kind, split.projectors)
    fields |= {"constraints": np.array(split.kind.constraints).T, "load_force": split.load[0]}
    made: CoreSplit = core.Split(load_moment=split.load[1], **fields)
    return made


def core_press(
    task: HybridTask,
    sensor: WrenchSensor | None,
    loop: LegacyLoop,
    *,
    order: str | None,
    **fields: Any,
) -> Press | None:
    """What does not change in a hybrid loop, as the core takes it; None for a loop that it does not have.

    Args:
        task: the task.
        sensor: or None.
        loop: that follows its twists.
        order: of plain readings.
        fields: more fields of `csrc/fields.h`.
    """
    if core is None or loop.compiled is None or loop.varies:
        return None
    made: Press = core.Press(
        moment_first=order != "force first",
        reaction=sensor is None or sensor.reads == "reaction",
        has_compliance=task.compliance is not None,
        **_fields_of(core.Press, task, sensor),
        **fields,
    )
    return made
