"""What a hybrid loop keeps from tick to tick: values, and the numbers that the compiled core has for them.

Numbers come in the order of the fields, as `csrc/press.h` has them: a bool is 0 or 1, None is NaN, and what there are
several of is a count and room for the most.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from itertools import chain, islice, repeat
from math import isnan, nan, prod
from typing import Any, NamedTuple

import numpy as np

from invariantqp.force.estimate import Noise, Stiffness, Touch
from invariantqp.force.law import Drive, Stand
from invariantqp.force.monitor import (
    Answers,
    Approach,
    Dead,
    Evidence,
    Monitor,
    Overload,
    Pulls,
    Settling,
)
from invariantqp.geometry.arrays import Array


class Pressing(NamedTuple):
    """What a controller remembers of its constraints, each by itself.

    Attributes:
        touches: of each press.
        known: stiffness of each constraint.
        drives: of each constraint.
        ways: unit way commanded until now as it shows, and what of it does not show yet [length].
        lag: of the arm, with which it shows [s].
        along: speed along the contact, the highest of the last time [length/s].
        steep: the fastest slope of its laws of the last time [length/s].
        eased: share of the gain, less than 1 after chatter.
        free: whether the last tick did all that the law asked for.
    """

    touches: tuple[Touch, ...] = ()
    known: tuple[Stiffness, ...] = ()
    drives: tuple[Drive, ...] = ()
    ways: tuple[tuple[float, float], ...] = ()
    lag: float = 0.0
    along: float = 0.0
    steep: float = 0.0
    eased: float = 1.0
    free: bool = True


class Memory(NamedTuple):
    """The state between ticks, but for the normal, the delay, and what was commanded and does not act yet.

    Attributes:
        pressing: of each constraint.
        monitor: all checks.
        noise: of readings in the air.
        stand: of the motion along the contact.
        tool: (4, 4) its pose in the last tick; None before the first.
        out: (3,) the way out in the last tick; None in the air.
        last: (6,) reading; None before the first.
        coming: (3,) way of the place of contact that does not show yet [length].
        smooth: (6,) wrench in the sensor's frame; None before the first.
    """

    pressing: Pressing = Pressing()
    monitor: Monitor = Monitor()
    noise: Noise = Noise()
    stand: Stand = Stand()
    tool: Array | None = None
    out: Array | None = None
    last: Array | None = None
    coming: Array = np.zeros(3)
    smooth: Array | None = None


class Numbers(NamedTuple):
    """An array of a shape."""

    shape: tuple[int, ...]


class Maybe(NamedTuple):
    """A kind, or None."""

    kind: Any


class Several(NamedTuple):
    """A tuple of up to so many of a kind."""

    kind: Any
    most: int


class Fields(NamedTuple):
    """A NamedTuple by the kinds of its fields."""

    made: Any
    kinds: tuple[Any, ...]


def _fields(made: Any, *kinds: Any) -> Fields:
    return Fields(made, kinds)


# Kinds: float, int, bool, a tuple of kinds, None for what no memory of numbers has, and the above.
THREE, FOUR, SIX = Numbers((3,)), Numbers((4,)), Numbers((6,))
PAIR, AGES, PARTS = (float, float), Several(float, 12), 6
STIFFNESS = _fields(
    Stiffness,
    *(THREE, THREE, float, float, float, FOUR, FOUR, float, Numbers((3, 3)), THREE, float, (float, float, float)),
    *(bool, bool, float, float, Maybe(float), Maybe(float), bool, float),
)
EVIDENCE = _fields(Evidence, Maybe((float, float, float)), FOUR, Numbers((4, 4)), PAIR)
ANSWERS = _fields(
    Answers,
    *(float, float, float, (THREE, THREE), PAIR, float, EVIDENCE, float, Maybe((float, float, float, float))),
    *(float, float, Maybe(PAIR), Maybe(float), float, float),
)
SETTLING = _fields(Settling, AGES, Maybe(float), Maybe(float), float, AGES, bool, float, float, float)
MONITOR = _fields(
    Monitor,
    _fields(Overload, PAIR),
    _fields(Dead, Maybe(SIX), float, bool),
    _fields(Pulls, float),
    _fields(Approach, float, PAIR, float),
    Several(ANSWERS, PARTS),
    SETTLING,
    None,
    float,
    float,
    PAIR,
)
PRESSING = _fields(
    Pressing,
    Several(_fields(Touch, float, bool, float), PARTS),
    Several(STIFFNESS, PARTS),
    Several(_fields(Drive, float, float), PARTS),
    Several(PAIR, PARTS),
    *(float, float, float, float, bool),
)
MEMORY = _fields(
    Memory,
    PRESSING,
    MONITOR,
    _fields(Noise, int, float, float),
    _fields(Stand, float),
    *(Maybe(Numbers((4, 4))), Maybe(THREE), Maybe(SIX), THREE, Maybe(SIX)),
)


@lru_cache(maxsize=64)
def size_of(kind: Any) -> int:
    """How many numbers a kind has."""
    if isinstance(kind, Numbers):
        return prod(kind.shape)
    if isinstance(kind, Maybe):
        return size_of(kind.kind)
    if isinstance(kind, Several):
        return 1 + kind.most * size_of(kind.kind)
    if isinstance(kind, (Fields, tuple)):
        return sum(map(size_of, kind.kinds if isinstance(kind, Fields) else kind))
    return 0 if kind is None else 1


def numbers_of(value: Any, kind: Any = MEMORY) -> Iterator[float]:
    """The numbers of a value of a kind.

    Raises:
        ValueError: more of something than there is room for, or something that is never remembered so.
    """
    if isinstance(kind, Maybe):
        return iter((nan,) * size_of(kind)) if value is None else numbers_of(value, kind.kind)
    if isinstance(kind, Numbers):
        return iter(value.ravel().tolist())
    if isinstance(kind, Several):
        if len(value) > kind.most:
            raise ValueError("more than there is room for")
        rest = (kind.most - len(value)) * size_of(kind.kind)
        each = chain.from_iterable(numbers_of(one, kind.kind) for one in value)
        return chain((float(len(value)),), each, repeat(0.0, rest))
    if isinstance(kind, (Fields, tuple)):
        kinds = kind.kinds if isinstance(kind, Fields) else kind
        return chain.from_iterable(numbers_of(one, of) for one, of in zip(value, kinds, strict=True))
    if kind is None:
        if value is not None:
            raise ValueError("not remembered as numbers")
        return iter(())
    return iter((float(value),))


def made_of(numbers: Iterator[float], kind: Any = MEMORY) -> Any:
    """The value of a kind that these numbers are."""
    if isinstance(kind, Maybe):
        first = list(islice(numbers, size_of(kind)))
        return None if isnan(first[0]) else made_of(iter(first), kind.kind)
    if isinstance(kind, Numbers):
        return np.array(list(islice(numbers, size_of(kind)))).reshape(kind.shape)
    if isinstance(kind, Several):
        count, room = int(next(numbers)), list(islice(numbers, size_of(kind) - 1))
        return tuple([made_of(one, kind.kind) for one in repeat(iter(room), count)])
    if isinstance(kind, Fields):
        return kind.made._make([made_of(numbers, one) for one in kind.kinds])
    if isinstance(kind, tuple):
        return tuple([made_of(numbers, one) for one in kind])
    return None if kind is None else kind(next(numbers))
