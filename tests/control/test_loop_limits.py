"""Limits by one door: rows, functions of q, a tool speed and Pink's, in the order in which they are given."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.limits import LimitRows, ToolSpeed

PANDA = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
ROWS = LimitRows([[1.0, 1.0, 0, 0, 0, 0, 0]], [-0.01], [0.01])
MORE = LimitRows([[0, 0, 0, 1.0, 0, 1.0, 0]], [-0.02], [0.02])


def together(q):
    return LimitRows(np.vstack((ROWS.C, MORE.C)), [-0.01, -0.02], [0.01, 0.02])


@pytest.fixture(scope="module")
def robot():
    return iq.load_robot("panda")


def answer(robot, **options):
    goal = iq.transform(translation=[0.1, 0.2, -0.1]) @ robot.pose(PANDA)
    return iq.Controller(robot, dt=0.002, **options).step(PANDA, goal)


@pytest.mark.parametrize(
    "options",
    [
        {"limits": [ROWS, MORE]},
        {"rows": ROWS, "limits": [MORE]},
        {"limits": [together]},
        {"limits": (lambda _: ROWS, MORE)},
        {"rows": lambda _: ROWS, "limits": [lambda _: None, MORE]},
    ],
)
def test_rows_are_the_same_by_either_door(robot, options):
    found, wanted = answer(robot, **options), answer(robot, rows=together)
    assert np.abs(ROWS.C @ wanted.velocity).max() == pytest.approx(0.01)
    np.testing.assert_allclose(found.velocity, wanted.velocity, atol=1e-9)
    np.testing.assert_allclose(found.row_multipliers, wanted.row_multipliers, rtol=1e-6, atol=1e-9)


@pytest.mark.skipif(not iq.native, reason="no compiled core here")
def test_fixed_rows_by_this_door_are_the_cores_too(robot):
    assert iq.Controller(robot, dt=0.002, limits=[ROWS, MORE]).compiled is not None


def test_a_tool_speed_by_this_door(robot):
    assert answer(robot, limits=[ToolSpeed(0.1)]) == answer(robot, tool_speed=0.1)
    for options in ({"tool_speed": 0.1, "limits": [ToolSpeed(0.1)]}, {"limits": [ToolSpeed(0.1), ToolSpeed(0.2)]}):
        with pytest.raises(iq.BadInput, match="limits: found two tool speeds"):
            answer(robot, **options)


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (ROWS, "limits: found .*; expected a list"),
        ([0.25], "limits: found 0.25; expected LimitRows, a function of q that returns them, ToolSpeed"),
        ([None], "limits: found None"),
        ([LimitRows([[1.0, 0.0]], [0.0], [1.0])], "limits: found rows on 2 joints; expected rows on 7"),
    ],
)
def test_what_is_no_limit_is_refused(robot, limits, said):
    with pytest.raises(iq.BadInput, match=said):
        iq.Controller(robot, dt=0.002, limits=limits)


def test_a_function_that_returns_something_else_is_named(robot):
    loop = iq.Controller(robot, dt=0.002, limits=[lambda _: 3])
    with pytest.raises(iq.BadInput, match="limits: found int; expected LimitRows"):
        loop.step(PANDA, robot.pose(PANDA))
