import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.arms import READY
from support.random_systems import motion
from support.task_files import content, run_displaced

import invariantqp as iq
from invariantqp.workbench.runs.controllers import our_controller
from invariantqp.workbench.runs.path import minimum_jerk
from invariantqp.workbench.runs.taskfile import shipped_tasks, task_from
from invariantqp.workbench.runs.trace import PathTrace

READY = list(READY["panda"])


def panda(**changes):
    return task_from(content(**changes), "t.toml")


# Those in contact have a file of their own, test_contact_tasks.


@cache
def run_of(name):
    """The run of a shipped task, computed once."""
    return iq.run_task(iq.load_task(name))


ALONE = [name for name in shipped_tasks() if iq.load_task(name).contact is None]


@pytest.mark.parametrize("name", ALONE)
def test_shipped_tasks_are_accepted(name):
    task = iq.load_task(name)
    trace = run_of(name)
    assert trace.passed, trace.shortfalls
    assert trace.limit_violation <= 1e-9
    assert "held" not in trace.statuses
    assert trace.clearance is None or trace.clearance.distance.min() < 1.01 * trace.clearance.required  # it is needed
    shorter = task.path.model_copy(update={"duration": 0.3 * task.path.duration})
    hurried = iq.run_task(task.model_copy(update={"path": shorter}), dt=0.01)  # limits bind, and hold
    assert hurried.limit_violation <= 1e-9
    assert "held" not in hurried.statuses


def test_the_trace_records_the_run():
    done = []
    trace = iq.run_task(panda(), observer=lambda k, *_: done.append(k))
    n = 25
    assert done == list(range(n))
    assert trace.q.shape == (n + 1, 7)
    np.testing.assert_array_equal(trace.q[0], READY)
    np.testing.assert_allclose(np.diff(trace.q, axis=0), 0.002 * trace.velocity, atol=1e-15)
    np.testing.assert_allclose(trace.time, 0.002 * np.arange(n + 1))
    robot = iq.load_robot("panda")
    moved = robot.pose(trace.q[-1])[:3, 3] - robot.pose(READY)[:3, 3]
    np.testing.assert_allclose(moved, [0.001, 0, 0], atol=1e-6)
    assert trace.passed
    assert trace.shortfalls == []


def test_the_figures_of_a_run():
    trace = iq.run_task(panda())
    figures = json.loads(json.dumps(trace.as_json()))
    for key in ("position_error_mm", "orientation_error_deg"):
        assert set(figures[key]) == {"median", "p99", "max"}
    assert {"median", "p99"} <= set(figures["tick_us"])
    assert sum(figures["methods"].values()) == pytest.approx(1.0)
    assert sum(figures["statuses"].values()) == pytest.approx(1.0)
    assert figures["force_error_relative_rms"] is None
    assert figures["ticks"] == len(figures["q"]) - 1 == 25
    assert figures["peak_speed"] == pytest.approx(np.abs(trace.velocity).max())
    assert figures["peak_acceleration"] == pytest.approx(np.abs(trace.acceleration).max())
    assert figures["position_error_mm"]["max"] == pytest.approx(1e3 * trace.position_error.max())


def test_accelerations_are_changes_of_velocity_and_the_first_is_from_rest():
    trace = iq.run_task(panda())
    x = np.zeros_like(trace.velocity)  # ticks of 2 ms
    x[:, 2], x[3:, 5] = 0.05, -0.03
    drawn = replace(trace, velocity=x)
    assert drawn.acceleration.shape == x.shape
    assert drawn.summary()["peak_acceleration"] == pytest.approx(25.0)
    x[0, 2] = 0.0  # a tick later, and a sixth joint that turns round
    x[4, 5] = 0.04
    assert replace(trace, velocity=x).summary()["peak_acceleration"] == pytest.approx(35.0)


def test_more_than_the_acceleration_limit_is_not_accepted():
    trace = iq.run_task(panda(law__acceleration_limit=30.0))
    assert trace.passed
    trace.velocity[10:, 1] = 0.0628  # 1.4 rad/s^2 too much, 2.8e-3 rad/s in a tick
    trace.velocity[:10, 1] = 0.0
    assert trace.limit_violation == pytest.approx(2.8e-3)
    assert "limit violation 0.0028" in trace.shortfalls[0]


def test_panda_path_keeps_the_makers_acceleration_limits():
    task = iq.load_task("panda_path")
    assert task.law.acceleration_limit == [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
    trace = run_of("panda_path")
    allowed = np.array(task.law.acceleration_limit)
    share = np.abs(np.diff(trace.velocity, axis=0, prepend=0.0)) / task.law.dt / allowed
    assert share.max() < 1.0 + 1e-9
    assert share.max() > 0.99  # limits bind on the way, a position limit too
    low, high = trace.position_limits
    assert (np.minimum(trace.q - low, high - trace.q) < 1e-3).any()
    assert 0.02 < np.mean(trace.limit_active) < 0.5
    speed = [np.abs(np.diff(T[:, :3, 3], axis=0)).max() / task.law.dt for T in (trace.wanted[:2], trace.wanted[-2:])]
    assert max(speed) < 1e-6  # the path begins and ends at rest [m/s]


def test_missed_acceptance_limits_are_named():
    trace = iq.run_task(panda(accept__position_error_mm=1e-9))
    assert not trace.passed
    assert "largest position error" in trace.shortfalls[0]
    assert "at most 1e-09 mm accepted" in trace.shortfalls[0]


BAD = {
    "dt": -0.001,
    "gain": 0.0,
    "form": float("nan"),
    "position_margin": -0.1,
    "acceleration_limit": 0.0,
    "damping": -1.0,
    "exact": "tool",
    "guard": "yes",
    "backend": 3,
}


@pytest.mark.parametrize("key", BAD)
def test_overrides_are_checked_as_the_file_is(key):
    with pytest.raises(iq.BadInput, match=f"^{key}: found .*; expected ") as caught:
        iq.run_task(panda(), **{key: BAD[key]})
    assert caught.value.argument == key


def test_invalid_overrides_and_arguments_are_refused():
    with pytest.raises(iq.BadInput, match="overrides: found pitches; expected some of dt, gain, form, damping"):
        iq.run_task(panda(), pitches=0.3)
    with pytest.raises(iq.BadInput, match="task: found 'panda_path'; expected a Task, such as load_task returns"):
        iq.run_task("panda_path")
    with pytest.raises(iq.BadInput, match="controller: found a velocity controller for a task in contact"):
        iq.run_task(iq.load_task("pen_on_paper"), controller=our_controller)
    with pytest.raises(iq.BadInput, match="controller: found 3; expected a function of robot and law"):
        iq.run_task(panda(), controller=3)
    with pytest.raises(iq.errors.UnknownName, match="did you mean daqp"):
        iq.run_task(panda(), backend="dapq")
    with pytest.raises(iq.BadInput, match=r"path\.waypoints\[0\]: found 2 numbers; expected 7, one for each joint"):
        iq.run_task(panda(path={"kind": "joints", "duration": 1.0, "waypoints": [[0.0, 0.1]]}))
    with pytest.raises(iq.BadInput, match=r"path\.centre: found the start itself"):
        iq.run_task(panda(path={"kind": "circle", "duration": 1.0, "centre": [0.0, 0.0, 0.0]}))
    with pytest.raises(iq.BadInput, match="at most 1/dt"):
        iq.run_task(panda(law__gain=501.0))


def limited_panda():
    """A fast swing with a start near limits: velocity and position limits bind."""
    far = [2.85, 1.2, 0.0, -0.6, 0.0, 2.5, 0.8]
    return panda(
        robot__start=[2.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8],
        path={"kind": "joints", "duration": 1.2, "waypoints": [far, READY]},
        law={"dt": 0.01},
    )


def test_displaced_frames_do_not_change_our_controller():
    """The same physical motion, asked of another frame on the same body, under active limits."""
    task = limited_panda()
    plain = iq.run_task(task)
    assert np.mean(plain.limit_active) > 0.1
    (ours,) = iq.workbench.frame_check(task, seed=1)
    assert (ours.law, ours.force_error) == ("invariantqp", None)
    assert ours.change < 1e-8
    assert ours.displaced_error_mm == pytest.approx(ours.error_mm)  # both at the task's own tool frame
    assert ours.error_mm == pytest.approx(1e3 * plain.position_error.max())


def test_turned_frames_at_an_exact_point_change_no_joint():
    plain = iq.run_task(limited_panda(), exact="position")
    turned = run_displaced(limited_panda(), motion(np.random.default_rng(0), 0.0), exact="position")
    assert np.abs(plain.q - turned.q).max() < 1e-8
    assert turned.methods == plain.methods


def test_a_start_outside_the_limits_recovers():
    start = [2.8973 + 0.2, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]
    path = {"kind": "line", "duration": 0.5, "move": [0.0, 0.0, 0.0]}
    trace = iq.run_task(panda(robot__start=start, path=path))
    assert np.abs(trace.velocity).max() <= iq.load_robot("panda").velocity_limit.max() + 1e-12
    assert (np.diff(trace.q[:40, 0]) < 0.0).all()
    assert trace.q[-1, 0] <= 2.8973 + 1e-9
    assert "held" not in trace.statuses


def test_a_start_in_degrees_is_refused():
    with pytest.raises(iq.BadInput, match=r"start: found joint 3 \(panda_joint4\): -115 rad is .*degrees\?; expected"):
        iq.run_task(panda(robot__start=[0.0, -30.0, 0.0, -115.0, 0.0, 90.0, 45.0]))


def test_a_near_principal_pitch_gives_a_warning():
    task = iq.load_task("so101_line")
    near = iq.principal_pitches(task.load_robot().jacobian(task.start()))
    h = float(near[np.abs(near).argmax()]) * 1.02
    trace = iq.run_task(task, dt=0.05, form=h)
    assert any("principal pitch" in w for w in trace.warnings)


def test_motion_starts_and_ends_at_rest():
    u = np.linspace(-0.5, 1.5, 2001)
    sigma = np.array([minimum_jerk(x) for x in u])
    assert sigma[0] == 0.0
    assert sigma[-1] == 1.0
    assert (np.diff(sigma) >= 0.0).all()
    rate = np.gradient(sigma, u)
    assert abs(rate[np.abs(u).argmin()]) < 1e-4
    assert abs(rate[np.abs(u - 1.0).argmin()]) < 1e-4


def test_an_elastic_path_is_late_but_accurate():
    trace = run_of("ur5_elastic")
    figures = trace.summary()
    assert figures["path_lag"] == pytest.approx(0.001 * figures["ticks"] - trace.task.path.duration, abs=0.002)
    assert figures["path_lag"] > 0.1
    assert any(name.startswith("velocity of joint") for name in figures["slowed_by"])
    assert 0.0 < figures["path_speed"]["median"] < 1.0


def test_slowdowns_are_counted_while_the_tool_moves():
    ruling = ["velocity of joint 0", "the rate asked for", "settling", "settling", "the path's end"]
    speed = np.array([0.5, 1.0, 0.0, 0.0, 0.0])
    along = PathTrace(np.zeros(5), speed, np.zeros(5), ruling, np.zeros((6, 4, 4)), "done")
    assert along.slowdowns == {"velocity of joint 0": 0.5}
    assert along.moving_speed.tolist() == [0.5, 1.0]


def test_an_elastic_path_is_the_same_in_any_frame_of_the_tool():
    task = iq.load_task("ur5_elastic")
    task = task.model_copy(update={"law": task.law.model_copy(update={"dt": 0.004})})
    (ours,) = iq.workbench.frame_check(task, seed=2)
    assert ours.change < 1e-10
