import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import invariantqp as iq
from invariantqp.velocity.limits import JointBox

INF = np.inf
EXAMPLES = settings(deadline=None, derandomize=True, max_examples=100)

BAD = {
    "crossed": (([0.0, 1.0], [1.0, 0.5]), "lower", "lower 1 above upper 0.5 at joint 1"),
    "nan below": (([np.nan, 0.0], [1.0, 1.0]), "lower", "NaN at index 0"),
    "nan above": (([0.0, 0.0], [1.0, np.nan]), "upper", "NaN at index 1"),
    "lengths": (([0.0], [1.0, 1.0]), "upper", "2 limits"),
    "empty": (([], []), "lower", "shape (0,)"),
    "one number": ((-1.0, 1.0), "lower", "shape ()"),
    "text": ((["a"], ["b"]), "lower", "not numeric"),
    "lower at +inf": (([INF], [INF]), "lower", "+inf"),
    "upper at -inf": (([-INF], [-INF]), "lower", "-inf"),
}


@pytest.mark.parametrize("case", BAD)
def test_bounds_that_are_none(case):
    arguments, argument, found = BAD[case]
    with pytest.raises(iq.BadInput) as caught:
        iq.Bounds(*arguments)
    assert caught.value.argument == argument
    assert found in caught.value.found
    assert caught.value.expected


def test_a_point_and_an_open_box_are_boxes():
    assert iq.Bounds([0.0, -INF], [0.0, INF]).lower.tolist() == [0.0, -INF]


@EXAMPLES
@given(
    st.floats(-2.0, 0.0),
    st.floats(0.0, 2.0),
    st.floats(0.01, 5.0),
    st.sampled_from([1e-3, 1e-2, 0.1]),
    st.floats(-4, 4),
)
def test_the_box_is_what_its_formula_says_and_leads_back(low, high, speed, dt, q):
    box = JointBox(np.array([low]), np.array([high]), np.array([speed]), dt)
    (lower,), (upper,) = box.at(np.array([q]))
    assert lower == pytest.approx(np.clip((low - q) / dt, -speed, speed), rel=1e-12, abs=1e-9)
    assert upper == pytest.approx(np.clip((high - q) / dt, -speed, speed), rel=1e-12, abs=1e-9)
    assert -speed <= lower <= upper <= speed
    if low <= q <= high:
        assert lower <= 1e-12
        assert upper >= -1e-12
    else:
        back = 1.0 if q < low else -1.0
        slowest = min(back * lower, back * upper)
        outside = low - q if q < low else q - high
        assert slowest == pytest.approx(min(speed, outside / dt), rel=1e-9, abs=1e-9)


def test_without_limits_there_is_no_box():
    box = JointBox(np.array([-INF]), np.array([INF]), np.array([INF]), 0.01)
    assert box.at(np.array([1e6])) == (-INF, INF)
