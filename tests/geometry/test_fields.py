"""Frozen values with arrays: copies, comparison, hash and repr."""

import copy
import pickle
from dataclasses import dataclass

import numpy as np
import pytest
from attrs import evolve, field, frozen

from invariantqp.geometry import arrays
from invariantqp.geometry.fields import Compared, Value, own, same


@frozen(init=False, eq=False, repr=False, slots=False)
class Plane(Value):
    normal: np.ndarray = field(converter=own)
    height: float

    def __init__(self, normal, height=0.0):
        self.__attrs_init__(arrays.direction(normal, "normal"), arrays.number(height, "height"))


@frozen(eq=False, repr=False, slots=False)
class Answer(Compared):
    q: np.ndarray
    parts: tuple
    note: str = field(eq=False, repr=False)


@dataclass(frozen=True, eq=False)
class Old:
    a: np.ndarray


def test_a_value_checks_and_copies_its_arguments():
    normal = np.array([0.0, 0.0, 1.0])
    plane = Plane(normal, 2)
    normal[0] = 9.0
    assert plane.normal.tolist() == [0.0, 0.0, 1.0]
    assert evolve(plane, height=3.0) == Plane([0, 0, 5], 3.0)


def test_equal_values_are_equal_and_hash_alike():
    assert Plane([0, 0, 1]) == Plane([0, 0, 2])
    assert Plane([0, -0.0, 1]) == Plane([0, 0.0, 1])
    assert hash(Plane([0, -0.0, 1])) == hash(Plane([0, 0.0, 1]))
    assert Plane([0, 0, 1]) != Plane([0, 1, 0])
    assert Plane([0, 0, 1]) != 3
    assert len({Plane([0, 0, 1]), Plane([0, 0, 1]), Plane([1, 0, 0])}) == 2


@pytest.mark.parametrize("travel", [copy.copy, copy.deepcopy, lambda v: pickle.loads(pickle.dumps(v))])
def test_a_copied_or_pickled_value_is_read_only(travel):
    there = travel(Plane([0, 0, 1]))
    assert there == Plane([0, 0, 1])
    with pytest.raises(ValueError, match="read-only"):
        there.normal[0] = 1.0


def test_comparison_of_arrays_in_tuples_without_excluded_fields():
    one, two = (Answer(np.ones(2), (np.zeros(3), Old(np.ones(2))), note) for note in ("one", "two"))
    assert one == two
    assert one != Answer(np.ones(2), (np.zeros(3), Old(np.zeros(2))), "one")
    assert "note" not in repr(one)
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)
    one.q[0] = 2.0  # a result's arrays are its owner's


def test_arrays_of_other_shapes_are_not_equal():
    assert not same(np.ones(3), np.ones((3, 1)))
    assert not same(np.ones(3), [1.0, 1.0, 1.0])
    assert not same((np.ones(3),), (np.ones(3), 1))


def test_a_repr_is_one_short_line():
    assert repr(Plane([0, 0, 1], 0.5)) == "Plane(normal=[0., 0., 1.], height=0.5)"
    assert repr(Answer(np.eye(6), (), "")) == "Answer(q=<array of shape (6, 6)>, parts=())"
