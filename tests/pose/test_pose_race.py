import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.analysis.survey import spread

RACE = SimpleNamespace(**runpy.run_path(str(Path(__file__).parents[2] / "examples" / "shared" / "pose_race.py")))
SO101 = iq.load_robot("so101")


@pytest.mark.parametrize("name", RACE.ROBOTS)
def test_the_toolbox_has_the_same_arm(name):
    pytest.importorskip("roboticstoolbox")
    robot = iq.load_robot(name)
    ets = RACE.ets_of(robot)
    for q in spread(robot, 5):
        np.testing.assert_allclose(ets.eval(q), robot.pose(q), atol=1e-12)


def test_the_toolbox_has_slides_but_no_screws():
    pytest.importorskip("roboticstoolbox")
    slide = iq.robots.Chain(
        np.column_stack([iq.se3.prismatic([1, 2, 0]), iq.revolute([0, 1, 0], [1, 0, 0])]), np.eye(4)
    )
    np.testing.assert_allclose(RACE.ets_of(slide).eval([0.3, 0.7]), slide.pose([0.3, 0.7]), atol=1e-12)
    with pytest.raises(iq.errors.RobotModelError, match="helical"):
        RACE.ets_of(iq.robots.Chain(iq.se3.helical([0, 0, 1], pitch=0.1), np.eye(4)))


def test_everyone_runs_on_the_same_targets():
    calls = []
    outcomes = RACE.race(2, ("so101",), progress=lambda *a: calls.append(a))
    assert [o.solver for o in outcomes] == list(RACE.contestants())
    assert outcomes[0].solver == RACE.SOLVE_POSE
    assert outcomes[0].outside == 0
    assert all(0.0 <= o.success <= 1.0 and 0.0 < o.median_ms <= o.p99_ms for o in outcomes)
    assert calls[-1] == (len(calls), len(calls))
    with pytest.raises(iq.BadInput, match="count: found 0"):
        RACE.race(0)


def test_targets_at_limits_are_at_limits(monkeypatch):
    for name in ("ur5", "kinova"):  # kinova: three of six joints have limits
        robot = iq.load_robot(name)
        seen = []
        monkeypatch.setattr(type(robot), "pose", lambda _, q, seen=seen: seen.append(np.array(q)) or np.eye(4))
        RACE._problems(robot, 5, 2, np.random.default_rng(0))
        assert [int(((q == robot.position_lower) | (q == robot.position_upper)).sum()) for q in seen] == [2] * 5


def test_nobodys_word_is_taken_for_it():
    q = 0.5 * SO101.position_upper
    outside = SO101.position_upper + 0.1
    nearly = q + 1e-5
    problems = [(SO101.pose(q), q), (SO101.pose(outside), q), (SO101.pose(q), q), (SO101.pose(q), q)]
    answers = [q, outside, nearly, q]
    judged = RACE._judged(SO101, "so101", "x", problems, answers, np.array([0.001, 0.002, 0.003, 0.06]))
    assert judged.success == 0.25  # the second is outside, the third is off, the last is late
    assert judged.outside == 1
