from unittest import mock

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.compare import measurements
from invariantqp.compare.frames import moved_start, random_displacement
from invariantqp.compare.measurements import (
    EVERYDAY,
    REST,
    Cell,
    Watched,
    everyday,
    figures,
    inputs_of,
    loops,
    overshoot,
    settling_time,
    watched_run,
    with_rest,
)
from invariantqp.compare.registry import controller_named
from invariantqp.runs.prepare import prepare
from invariantqp.runs.taskfile import load_task


@pytest.fixture(scope="module")
def limited():
    """What a quick run of two methods finds at the limits of five joints."""
    return {
        name: loops(Cell("loop", "compare/so101_limits", (name,), quick=True))[name]
        for name in ("invariantqp", "hand-written loop", "QP with length and LM")
    }


def test_a_frame_changes_who_measures_in_it_and_nobody_else(limited):
    assert limited["invariantqp"]["frame"] < 1e-11
    assert limited["QP with length and LM"]["frame"] < 1e-11  # told point and length, a QP is free of frames too
    assert limited["hand-written loop"]["frame"] > 1e-3
    assert all(found["control"] < 1e-10 for found in limited.values())
    assert all(found["limits_met"] > 0.5 for found in limited.values())


def test_chaos_is_seen_by_the_control():
    """Gradient projection without a posture drifts: rounding in the start grows as another frame does."""
    task = load_task("compare/panda_limits")
    task = task.model_copy(update={"law": task.law.model_copy(update={"posture": False})})
    setup = prepare(task)
    _, plain = watched_run(setup, controller_named("Moore-Penrose"))
    _, nudged = watched_run(moved_start(task, setup), controller_named("Moore-Penrose"))
    assert np.abs(plain.q - nudged.q).max() > 1e8 * 1e-12  # 4e11 to 4e12 of five starts


def test_a_moved_start_is_the_same_motion_of_the_tool():
    task = load_task("compare/panda")
    setup = prepare(task)
    moved = moved_start(task, setup)
    assert (moved.problem.poses == setup.problem.poses).all()
    assert np.abs(moved.plant.measure().q - setup.plant.measure().q).max() == pytest.approx(1e-12, rel=1e-3)


def test_the_largest_error_jump_and_failures_are_those_of_the_whole_run():
    task = load_task("compare/panda")
    task = task.model_copy(update={"law": task.law.model_copy(update={"dt": 0.02})})
    law, trace = watched_run(prepare(task), controller_named("DLS"))
    trace.position_error[5], trace.velocity[7, 2] = 0.25, np.nan_to_num(trace.velocity_limit[2]) + 5.0
    found = figures(law, trace)
    assert found["position_mm"] == 250.0
    assert found["acceleration"] > 4.0 / 0.02
    assert found["failed_ticks"] == found["outside"] == pytest.approx(1.0 / len(trace.velocity))
    broken = Watched(law)
    broken.exceptions = 3
    assert figures(broken, trace)["raised"] == pytest.approx(3.0 / len(trace.velocity))


def test_ticks_are_timed_at_limits_where_the_run_meets_some():
    task = load_task("compare/panda_limits")
    task = task.model_copy(update={"law": task.law.model_copy(update={"dt": 0.005})})
    robot = task.load_robot()
    near = [(np.minimum(robot.position_upper - q, q - robot.position_lower)).min() for q, *_ in inputs_of(task, 5)]
    assert np.median(near) < 0.02


def test_a_displacement_is_a_rigid_motion_of_about_the_length_of_a_tool():
    for seed in range(3):
        X = random_displacement(seed)
        np.testing.assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-12)
        assert 0.05 < np.linalg.norm(X[:3, 3]) < 1.5


def coarse(name, **law):
    """A shipped task with its law changed, prepared and with_rest."""
    task = load_task(name)
    return with_rest(prepare(task.model_copy(update={"law": task.law.model_copy(update=law)})))


@pytest.fixture
def jumped():
    """A trace of a target that jumps by 150 mm at once; ticks of 10 ms."""
    setup = coarse("compare/jump")
    return watched_run(setup, controller_named("DLS"))[1], setup.robot


def test_a_run_has_settled_after_its_last_tick_outside(jumped):
    trace, _ = jumped
    trace.position_error[:], trace.orientation_error[:] = 0.0, 0.0
    assert settling_time(trace) == 0.0
    trace.position_error[41] = 1.1e-3  # off after 42 ticks, back after 43
    assert settling_time(trace) == pytest.approx(0.43)
    trace.orientation_error[60] = np.radians(0.99)
    assert settling_time(trace) == pytest.approx(0.43)
    trace.orientation_error[60] = np.radians(1.01)
    assert settling_time(trace) == pytest.approx(0.62)
    trace.position_error[-1] = 1.1e-3
    assert settling_time(trace) == np.inf


def test_settling_counts_from_when_the_target_is_at_rest():
    setup = coarse("stability/reach_and_back")  # back after 2 s
    trace = watched_run(setup, controller_named("DLS"))[1]
    trace.position_error[:], trace.orientation_error[:] = 0.0, 0.0
    trace.position_error[150] = 1.0
    assert settling_time(trace) == 0.0
    trace.position_error[249] = 1.0
    assert settling_time(trace) == pytest.approx(0.51)


def test_the_first_tick_is_no_acceleration_and_every_other_is(jumped):
    trace, _ = jumped
    trace.velocity[:] = 0.3
    assert figures(Watched(None), trace)["acceleration"] == 0.0
    trace.velocity[5, 1] = 0.5
    assert figures(Watched(None), trace)["acceleration"] == pytest.approx(0.2 / 0.01)


def test_errors_grow_from_what_a_jump_makes(jumped):
    trace, robot = jumped
    mm, deg = overshoot(trace, robot)
    assert mm == 0.0
    assert deg == pytest.approx(trace.orientation_error.max(), rel=1e-12)
    trace.position_error[7] = 0.2
    assert overshoot(trace, robot)[0] == pytest.approx(0.05, rel=1e-9)
    back = watched_run(coarse("stability/jump"), controller_named("hand-written loop"))[1]
    assert back.position_error[0] == 0.0
    assert back.position_error.max() > 0.3
    assert overshoot(back, robot)[0] < 1e-3  # two jumps, each with an error of its own
    path = watched_run(coarse("compare/too_fast"), controller_named("DLS"))[1]
    assert overshoot(path, robot)[0] == path.position_error.max()


def test_after_a_path_the_target_rests_for_a_second():
    before, after = prepare(load_task("compare/too_fast")), coarse("compare/too_fast")
    more = round(REST / 0.005)
    assert len(after.problem.goals()) == len(before.problem.goals()) + more == len(after.noise)
    np.testing.assert_array_equal(after.wanted[: len(before.wanted)], before.wanted)
    assert (after.wanted[-more:] == before.wanted[-1]).all()
    assert not after.problem.feedforward[-more:].any()


def test_everyday_figures_of_an_arm_that_is_told_to_stay_turned_in_place_and_late():
    def found(task, method="invariantqp"):
        return everyday(Cell("everyday", task, (method,), quick=True))[method]

    stays, follows = found("compare/stay"), found("compare/stay", "Moore-Penrose")
    assert stays["ticks"] == 1100  # its own ticks, in a quick run too
    assert stays["joints_deg"] < 0.1 < 5.0 < follows["joints_deg"]
    turned, swung = found("compare/turn"), found("compare/turn", "hand-written loop")
    assert turned["grown_mm"] < 30.0 < swung["grown_mm"]
    assert 0.0 < turned["settling_s"] < swung["settling_s"] < 1.0
    late = found("compare/late")
    assert late["acceleration"] == pytest.approx(10.0)
    assert late["settling_s"] < 1.0


@pytest.mark.cases(3)
@pytest.mark.parametrize("method", ["hand-written loop", "scaling", "Moore-Penrose", "Pink", "mink"])
def test_others_are_told_delay_and_acceleration_limits_too(method):
    found = everyday(Cell("everyday", "compare/late", (method,)))[method]
    assert found["failed_ticks"] == 0.0
    assert found["acceleration"] <= 10.0 * (1.0 + 1e-9)
    assert found["settling_s"] < 1.0
    assert (found["grown_deg"] < 1.0) == (method in {"hand-written loop", "Pink"})  # what bounds, and what cuts


def test_the_late_arm_is_late():
    plant = coarse("compare/late").plant
    q = plant.measure().q
    for moved in (False, False, False, True):
        plant.command(np.ones(6))
        assert (plant.measure().q != q).all() == moved


def test_everyday_tasks_ship_and_say_what_they_are():
    assert len(EVERYDAY) == 7
    for name in EVERYDAY:
        assert load_task(name).about
        assert load_task(name).name == name


# A wrong model and a camera: the error that a law sees is the true one, and the arm in its motion is another.
WRONG = Cell("calibration", "compare/ur5_limits", ("invariantqp",), quick=True)


def test_an_arm_that_is_where_its_model_says_is_the_ordinary_run():
    with mock.patch.multiple(measurements, OFF=0.0):
        found = measurements.calibration(WRONG)["invariantqp"]
    plain = figures(*watched_run(prepare(WRONG.load()), controller_named("invariantqp")))
    for name, value in found.items():
        assert value == pytest.approx(plain[name], rel=1e-6, abs=1e-9), name


def test_what_the_law_sees_is_the_true_error():
    model = iq.load_robot("ur5")
    true = measurements.miscalibrated(model, 3)
    q, target = np.array([0.1, -1.1, 1.5, -0.5, -1.1, 0.2]), iq.transform(translation=[0.4, 0.2, 0.5])
    law = mock.Mock()
    measurements.CameraFeedback(law, model, true).step(q, true.target(target), np.arange(6.0))
    _, seen, ahead = law.step.call_args.args
    np.testing.assert_allclose(
        np.linalg.inv(model.pose(q)) @ seen.pose, np.linalg.inv(true.pose(q)) @ target, atol=1e-12
    )
    in_tool = [iq.adjoint(np.linalg.inv(T)) for T in (model.pose(q), true.pose(q))]
    np.testing.assert_allclose(in_tool[0] @ ahead, in_tool[1] @ np.arange(6.0), atol=1e-12)


def test_joints_are_off_by_millimetres_and_the_run_is_worse():
    model, q = iq.load_robot("ur5"), np.array([0.1, -1.1, 1.5, -0.5, -1.1, 0.2])
    off = np.linalg.norm(measurements.miscalibrated(model, 3).pose(q)[:3, 3] - model.pose(q)[:3, 3])
    assert 1e-3 < off < 5e-2
    wrong, right = (measure(WRONG)["invariantqp"]["position_mm"] for measure in (measurements.calibration, loops))
    assert wrong > 2.0 * right
