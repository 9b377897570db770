from dataclasses import replace

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.compare.cell import Cell
from invariantqp.compare.measure import failure_map
from invariantqp.compare.measure.failure_map import AXES, SPEED, TICK, TURN, failures
from invariantqp.compare.registry import methods
from invariantqp.control.tracking import TRACKING_SHARE
from invariantqp.velocity.solution import VelocitySolution


def mapped(arm, name, seed=0):
    return failures(Cell("failure_map", arm, (name,), seed=seed, quick=True))[name]


@pytest.fixture
def law(monkeypatch):
    """Puts a law of the test's own under the name "own"."""

    def use(step, limits="inside"):
        class Law:
            def __init__(self, robot, spec):
                self.robot = robot

            def step(self, q, target, feedforward=None):
                return VelocitySolution(step(self.robot, q, target), "", "ok", "", (), q, 1.0, 0.0, 0.0, "")

        own = replace(methods()["DLS"], name="own", limits=limits, make=None, system=Law)
        monkeypatch.setattr(failure_map, "methods", lambda: {"own": own})

    return use


def newton(robot, q, target):
    return TRACKING_SHARE / TICK * np.linalg.solve(robot.jacobian(q), robot.sight(q, target).error)


def test_states_lie_in_their_squares_and_ask_for_the_stated_motion():
    robot = iq.load_robot("so101")
    low, high = robot.position_lower, robot.position_upper
    found = list(failure_map._states(robot, Cell("", "so101", ("any",)), 6, 2))
    assert len(found) == 72
    for state in found:
        for joint, square in zip(AXES["so101"], (state.column, state.row), strict=True):
            share = 6.0 * (state.q[joint] - low[joint]) / (high[joint] - low[joint])
            assert square <= share <= square + 1
        asked = iq.log(np.linalg.inv(robot.pose(state.q)) @ state.target) * TRACKING_SHARE / TICK
        assert np.linalg.norm(asked[:3]) == pytest.approx(TURN)
        assert np.linalg.norm(asked[3:]) == pytest.approx(SPEED)


def test_each_way_to_fail_is_told_apart(law):
    law(lambda robot, q, _: np.full(len(q), np.nan))
    assert mapped("ur5", "own") == mapped("ur5", "own") | {"share": 1.0, "raised": 1.0, "too_fast": 0.0, "astray": 0.0}
    law(lambda robot, q, _: 1.5 * np.sign(q) * robot.velocity_limit)
    assert mapped("ur5", "own")["too_fast"] == 1.0
    law(lambda robot, q, target: 1e-3 * newton(robot, q, target))
    assert mapped("ur5", "own")["share"] == 0.0
    law(lambda robot, q, target: -1e-3 * newton(robot, q, target))
    assert mapped("ur5", "own")["astray"] == 1.0


def test_a_law_that_raises_has_failed(law):
    def step(*_):
        raise ZeroDivisionError

    law(step)
    assert mapped("so101", "own")["raised"] == 1.0


def test_raw_speeds_count_where_somebody_else_clips(law):
    seen = []
    law(lambda robot, q, _: seen.append(np.isinf(robot.velocity_limit).all()) or 0.0 * q, limits="clipped")
    mapped("ur5", "own")
    assert all(seen)


def test_moore_penrose_fails_along_the_ur5s_singularities_and_its_elbow_is_where_they_are():
    theirs, ours = mapped("ur5", "Moore-Penrose, pinv"), mapped("ur5", "invariantqp")
    assert theirs["too_fast"] > 0.1 > 0.02 > ours["share"]
    counts = np.asarray(theirs["map"]) / theirs["samples"]
    (low, high), grid = theirs["ranges"][0], len(counts)
    elbow = low + (np.arange(grid) + 0.5) * (high - low) / grid
    near = np.abs(np.sin(elbow)) < 0.5  # stretched, or folded
    assert counts[:, near].mean() > 2.0 * counts[:, ~near].mean()


def test_every_method_is_asked_the_same():
    first, second = mapped("so101", "Moore-Penrose, pinv", seed=3), mapped("so101", "Moore-Penrose, SVD", seed=3)
    assert first == second
    assert first != mapped("so101", "Moore-Penrose, pinv", seed=4)
