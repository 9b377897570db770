import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.workbench.analysis.survey import spread

RACE = SimpleNamespace(**runpy.run_path(str(Path(__file__).parents[2] / "examples" / "shared" / "pose_race.py")))
SO101 = iq.load_robot("so101")


@pytest.mark.parametrize("name", RACE.ROBOTS)
def test_the_toolbox_has_the_same_arm(name):
    pytest.importorskip("roboticstoolbox")
    robot = iq.load_robot(name)
    ets = RACE.ets_of(robot)
    for q in spread(robot, 5):
        np.testing.assert_allclose(ets.eval(q), robot.pose(q), atol=1e-12)


def test_all_solvers_have_the_same_targets():
    calls = []
    outcomes = RACE.race(2, ("so101",), progress=lambda *a: calls.append(a))
    assert [o.solver for o in outcomes] == list(RACE.solver_factories())
    assert outcomes[0].solver == RACE.SOLVE_POSE
    assert outcomes[0].outside == 0
    assert all(0.0 <= o.success <= 1.0 and 0.0 < o.median_ms <= o.p99_ms for o in outcomes)
    assert calls[-1] == (len(calls), len(calls))
    with pytest.raises(iq.BadInput, match="count: found 0"):
        RACE.race(0)


def test_solutions_are_checked_whatever_solvers_report():
    q = 0.5 * SO101.position_upper
    outside = SO101.position_upper + 0.1
    nearly = q + 1e-5
    problems = [(SO101.pose(q), q), (SO101.pose(outside), q), (SO101.pose(q), q), (SO101.pose(q), q)]
    solutions = [q, outside, nearly, q]
    outcome = RACE._outcome(SO101, "so101", "x", problems, solutions, np.array([0.001, 0.002, 0.003, 0.06]))
    assert outcome.success == 0.25  # the second is outside, the third is off, the last is late
    assert outcome.outside == 1
