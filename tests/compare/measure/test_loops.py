import numpy as np
import pytest

from invariantqp.compare.measure.cell import Cell
from invariantqp.compare.measure.frames import moved_start, random_displacement
from invariantqp.compare.measure.loops import loops, noise, turns
from invariantqp.compare.measure.ticks import inputs_of
from invariantqp.compare.measure.watched import Watched, figures, watched_run
from invariantqp.compare.registry import controller_named
from invariantqp.runs.prepare import prepare
from invariantqp.runs.taskfile import load_task


@pytest.fixture(scope="module")
def limited():
    """What a quick run of two methods finds at the limits of five joints."""
    return {
        name: loops(Cell("loop", "compare/so101_limits", (name,), quick=True))[name]
        for name in ("invariantqp", "least-squares QP", "QP with length")
    }


def test_a_frame_changes_who_measures_in_it_and_nobody_else(limited):
    assert limited["invariantqp"]["frame"] < 1e-11
    assert limited["QP with length"]["frame"] < 1e-11  # told the point and the length, a QP is free of frames too
    assert limited["least-squares QP"]["frame"] > 1e-3
    assert all(found["control"] < 1e-10 for found in limited.values())
    assert all(found["limits_met"] > 0.5 for found in limited.values())


def test_chaos_is_seen_by_the_control():
    """Gradient projection without a posture drifts: rounding in the start grows as another frame does."""
    task = load_task("compare/panda_limits")
    task = task.model_copy(update={"law": task.law.model_copy(update={"posture": False})})
    setup = prepare(task)
    _, plain = watched_run(setup, controller_named("Moore-Penrose"))
    _, nudged = watched_run(moved_start(task, setup), controller_named("Moore-Penrose"))
    assert np.abs(plain.q - nudged.q).max() > 1e6 * 1e-12


def test_a_moved_start_is_the_same_motion_of_the_tool():
    task = load_task("compare/panda")
    setup = prepare(task)
    moved = moved_start(task, setup)
    assert (moved.brief.poses == setup.brief.poses).all()
    assert np.abs(moved.plant.measure().q - setup.plant.measure().q).max() == pytest.approx(1e-12, rel=1e-3)


def test_the_largest_error_jump_and_failures_are_those_of_the_whole_run():
    task = load_task("compare/panda")
    task = task.model_copy(update={"law": task.law.model_copy(update={"dt": 0.02})})
    law, trace = watched_run(prepare(task), controller_named("DLS"))
    trace.position_error[5], trace.velocity[7, 2] = 0.25, np.nan_to_num(trace.velocity_limit[2]) + 5.0
    found = figures(law, trace)
    assert found["position_mm"] == 250.0
    assert found["jump"] > 4.0
    assert found["failed_ticks"] == found["outside"] == pytest.approx(1.0 / len(trace.velocity))
    broken = Watched(law)
    broken.exceptions = 3
    assert figures(broken, trace)["raised"] == pytest.approx(3.0 / len(trace.velocity))


def test_without_a_posture_joints_drift_over_turns_of_the_same_path():
    found = turns(Cell("turns", "compare/panda", ("Moore-Penrose",), quick=True))["Moore-Penrose"]
    assert found["none"]["last_turn"] > 10.0 * found["posture"]["last_turn"]


def test_noise_is_worse_than_none(limited):
    found = noise(Cell("noise", "compare/so101_limits", ("invariantqp",), quick=True))["invariantqp"]
    assert found["variation"] > 1.2 * limited["invariantqp"]["variation"]


def test_ticks_are_timed_at_limits_where_the_run_meets_some():
    task = load_task("compare/panda_limits")
    task = task.model_copy(update={"law": task.law.model_copy(update={"dt": 0.01})})
    robot = task.load_robot()
    near = [
        (np.minimum(robot.position_upper - q, q - robot.position_lower)).min() for q, *_ in inputs_of(task, robot, 5)
    ]
    assert np.median(near) < 0.02


def test_a_displacement_is_a_rigid_motion_of_about_the_length_of_a_tool():
    for seed in range(3):
        X = random_displacement(seed)
        np.testing.assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)
        assert 0.05 < np.linalg.norm(X[:3, 3]) < 1.5
