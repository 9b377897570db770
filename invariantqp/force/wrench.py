"""Wrenches and their order: a moment and a force by name, or six numbers whose order is declared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own

Order = Literal["moment first", "force first"]

# Names of the parts: here, in ROS (geometry_msgs/Wrench), in Pinocchio.
MOMENT_NAMES = ("moment", "torque", "angular")
FORCE_NAMES = ("force", "linear")


@frozen(init=False, eq=False, repr=False, slots=False)
class Wrench(Value):
    """A moment (3,) about the origin of a frame [N length] and a force (3,) [N]."""

    moment: Array = field(converter=own)
    force: Array = field(converter=own)

    def __init__(self, *, moment: ArrayLike, force: ArrayLike) -> None:
        """A wrench.

        Args:
            moment: (3,) about the frame's origin [N length].
            force: (3,) [N].

        Raises:
            BadInput: NaN, shapes.
        """
        self.__attrs_init__(arrays.vector(moment, 3, "moment"), arrays.vector(force, 3, "force"))


def wrench_of(reading: Any, order: str | None, argument: str) -> Array:
    """(6,) moment first, from a reading whose parts have names, or six numbers in a declared order.

    Named are a `Wrench`, a `pinocchio.Force`, a `geometry_msgs/Wrench`, an object with one in `.wrench`, and a mapping
    with the same names. BadInput names the argument.
    """
    if are_numbers(reading):
        numbers = arrays.vector(reading, 6, argument)
        if order is None:
            raise BadInput(
                argument,
                "six numbers without a declared order",
                'a sensor with order="moment first" or order="force first", or iq.Wrench(moment=..., force=...)',
                "ROS, Pinocchio's arrays and most sensors have forces first.",
            )
        return ordered(numbers, order)
    if isinstance(reading, Wrench):
        return np.concatenate((reading.moment, reading.force))
    whole = _part(reading, ("wrench",))
    named = reading if whole is None else whole
    moment, force = _part(named, MOMENT_NAMES), _part(named, FORCE_NAMES)
    if moment is None or force is None:
        expected = (
            "iq.Wrench(moment=..., force=...), pinocchio.Force, a geometry_msgs/Wrench, or six numbers in an order"
        )
        raise BadInput(argument, excerpt(reading), expected)
    return np.concatenate((_vector(moment, argument), _vector(force, argument)))


def ordered(wrench: Array, order: str | None) -> Array:
    """(6,) moment first from numbers in an order, or the other way round; None is moment first."""
    return np.concatenate((wrench[3:], wrench[:3])) if order == "force first" else wrench


def by_name(wrench: Array) -> Wrench:
    """A `Wrench` from (6,) moment first."""
    return Wrench(moment=wrench[:3], force=wrench[3:])


def desired_wrench_of(wrench: Any, constraints: Callable[[], int], argument: str = "wrench") -> Array:
    """(6,) moment first of a named reading, or (n,) parts in the constraints of a contact.

    Six numbers, if not all zero, need a contact with six `constraints`, which are asked for then.
    """
    if isinstance(wrench, Real):
        raise BadInput(argument, excerpt(wrench), "a list, one number a constraint of the contact, such as [5.0]")
    if are_numbers(wrench):
        parts = arrays.vector(wrench, None, argument)
        if len(parts) == 6 and parts.any() and constraints() != 6:
            wrench_of(parts, None, argument)
        return parts
    return wrench_of(wrench, None, argument)


def order_of(order: str | None) -> str | None:
    """A checked order, or None for wrenches with named parts."""
    return None if order is None else arrays.choice(order, "order", get_args(Order))


def are_numbers(value: Any) -> bool:
    """Whether a value is a row of numbers: a NumPy array, a list, an `array.array` as in ROS 2 messages."""
    return isinstance(value, (np.ndarray, Sequence)) and not isinstance(value, str)


def _part(value: Any, names: tuple[str, ...]) -> Any:
    """The first part of a mapping or an object with one of the names, else None."""
    for name in names:
        part = value.get(name) if isinstance(value, Mapping) else getattr(value, name, None)
        if part is not None:
            return part
    return None


def _vector(part: Any, argument: str) -> Array:
    """(3,) from numbers, or from x, y, z by name."""
    named = [_part(part, (axis,)) for axis in "xyz"]
    return arrays.vector(part if None in named else named, 3, argument)
