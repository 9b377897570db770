"""Limits in the loop: what the controller keeps, what it says, and that a refused call leaves it as it was."""

import numpy as np
import pytest
from invariantqp._core import FollowerState, TrackedMotion
from scipy.optimize import minimize
from support.arms import ready
from support.loops import drive

import invariantqp as iq
from invariantqp.paths.joint_limits import JointLimits
from invariantqp.paths.reference import Motion

DT = 0.005


def arm(m=6, seed=0, reach=2.0, speed=1.5):
    """Revolute joints about random lines, tool somewhere near."""
    rng = np.random.default_rng(seed)
    screws = np.column_stack([iq.revolute(rng.normal(size=3), 0.5 * rng.normal(size=3)) for _ in range(m)])
    tool = iq.transform(translation=0.5 * rng.normal(size=3))
    return iq.robots.Chain(screws, tool, position_lower=-reach, position_upper=reach, velocity_limit=speed)


@pytest.mark.parametrize("seed", range(4))
def test_acceleration_velocity_and_position_limits_hold_on_the_way_to_a_target_out_of_reach(seed):
    robot = arm(seed=seed, reach=1.0)
    controller = iq.Controller(robot, dt=DT, acceleration_limit=4.0, position_margin=0.05)
    run = drive(controller, np.zeros(6), iq.transform(translation=(3.0, 0.0, 1.0)), 400)
    assert np.abs(run.changes).max() <= 4.0 * DT * (1.0 + 1e-9)
    assert np.abs(run.x).max() <= 1.5
    assert np.abs(run.q).max() <= 0.95 + 1e-9
    assert np.abs(run.q[-1]).max() > 0.9  # it got to a limit
    assert not any(s.reason.startswith("joint ") for s in run.solutions)  # nothing contradicted itself


def test_limits_that_contradict_each_other_are_named_by_joint():
    robot = arm()
    controller = iq.Controller(robot, dt=DT, acceleration_limit=4.0)
    q = np.zeros(6)
    q[2] = 1.99
    x = np.zeros(6)
    x[2] = 1.5
    solution = controller.step(q, robot.pose(q), velocity=x)
    assert solution.status == "degraded"
    assert solution.reason.startswith(f"joint 2 ({robot.names[2]}): ")
    assert "above its limit 4" in solution.reason
    q[2] = 2.1
    solution = controller.step(q, robot.pose(q), velocity=np.zeros(6))
    assert "0.1 outside its position range" in solution.reason
    assert solution.velocity[2] == pytest.approx(-4.0 * DT)  # on its way back, no jump


def test_joints_at_their_limits_are_called_by_their_names():
    robot = iq.load_robot("ur5")
    loop = iq.Controller(robot, dt=0.01)
    q = np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.3])
    solution = loop.step(q, robot.pose(q + 1.0))
    joints = solution.active
    assert ", ".join(f"{i} ({robot.names[i]})" for i in joints) in solution.reason
    assert solution.reasons[-1].names == tuple(robot.names[i] for i in joints) != ()
    assert f"2 ({robot.names[2]})" in loop.follow(q, 20.0 * robot.jacobian(q)[:, 2]).reason


def test_a_joint_outside_its_range_is_named_under_any_limits():
    robot = arm()
    q = np.zeros(6)
    q[2] = 2.1
    target = robot.pose(q)
    for limits in ({}, {"rows": lambda _: None}, {"acceleration_limit": 4.0}):
        controller = iq.Controller(robot, dt=DT, **limits)
        solution = controller.step(q, target)
        assert solution.reason.startswith(f"joint 2 ({robot.names[2]}): 0.1 outside its position range")
        q[2] = 2.0 + 1e-4  # noise
        assert "outside" not in controller.step(q, target).reason
        q[2] = 2.1


def test_a_measured_velocity_replaces_the_remembered_one():
    robot = arm()
    controller = iq.Controller(robot, dt=DT, acceleration_limit=1.0)
    x = np.full(6, 0.7)
    solution = controller.step(np.zeros(6), robot.pose(np.zeros(6)), velocity=x)
    np.testing.assert_allclose(np.abs(solution.velocity - x), DT, atol=1e-12)  # as hard as it may, from there


def test_a_task_file_can_limit_acceleration_and_keep_a_margin():
    task = iq.load_task("arm_3r")
    free = iq.run_task(task, dt=0.02)
    assert free.acceleration_violation is None
    trace = iq.run_task(task, acceleration_limit=[2.0, 2.0, 2.0], position_margin=0.01, dt=0.01)
    assert trace.acceleration_violation < 1e-9
    assert trace.summary()["acceleration_violation"] < 1e-9
    jumps = np.abs(np.diff(trace.velocity, axis=0)).max() / 0.01
    assert jumps <= 2.0 + 1e-9


def test_rows_that_are_none_are_refused_and_rows_of_nan_hold_the_arm():
    robot = arm()
    for bad in (iq.limits.LimitRows([[1.0, 2.0]], [0.0], [1.0]), 3.0):
        with pytest.raises(iq.BadInput, match="rows"):
            iq.Controller(robot, dt=DT, rows=bad)
    with pytest.raises(iq.BadInput, match="rows on 2 joints"):
        iq.Controller(robot, dt=DT, rows=lambda q: iq.limits.LimitRows([[1.0, 2.0]], [0.0], [1.0])).step(
            np.zeros(6), np.eye(4)
        )
    with pytest.raises(iq.BadInput, match="rows: found ndarray"):
        iq.Controller(robot, dt=DT, rows=lambda q: q).step(np.zeros(6), np.eye(4))
    lost = iq.Controller(robot, dt=DT, rows=lambda q: iq.limits.LimitRows(np.ones((1, 6)), [-np.inf], [np.nan * q[0]]))
    solution = lost.step(np.zeros(6), np.eye(4))
    assert solution.status == "held"
    assert solution.reason.startswith("rows: upper: found NaN")
    assert not solution.velocity.any()


@pytest.mark.parametrize("acceleration", [None, 20.0])
@pytest.mark.parametrize("late", [1, 3, 6])
def test_an_arm_that_answers_late_comes_to_rest_at_its_limits(late, acceleration):
    """A target behind limits: without an allowance for the delay, joints go beyond them, and to and fro for ever."""
    robot = arm(reach=1.0, speed=np.inf)
    controller = iq.Controller(robot, dt=DT, delay=late * DT, acceleration_limit=acceleration, posture=False)
    q = drive(controller, np.zeros(6), robot.pose([1.3, 0.2, -0.4, 0.9, -1.2, 0.5]), 1200, late=late).q
    assert np.abs(q[-1]).max() > 0.99  # it is at a limit
    assert np.abs(q).max() < 1.0 + (1e-9 if acceleration is None else 0.5 * acceleration * (late * DT) ** 2)
    assert np.abs(np.diff(q[-200:], axis=0)).max() < (0.01 if acceleration is None else acceleration * DT) * DT


def nearest(loop, q, before, wanted):
    """The command of a follower at rest at q that is to move at a velocity in the next tick."""
    wide = np.full(6, np.inf)
    limits = JointLimits(-wide, wide, wide, np.full(6, 1e9), np.full(6, 1e15), DT)
    motion = Motion((0.0, 1.0), np.array([[q, wanted]]))
    tracked = TrackedMotion(limits, motion, None, np.zeros((6, 6)), 0.0, 0.0, 0.0, keeps_shape=False, pushed_beyond=1.0)
    state = FollowerState(6, loop.delay, DT)
    state.position, state.velocity, state.command = q, before, before
    state.begin(q)
    goal = "motion", None, False, 1.0, 0.0, 0.0, None
    return loop.in_engine.follower(0.0).drive(state, tracked, goal, q, None, has_waited=False)[0]


@pytest.mark.cases(2)
@pytest.mark.parametrize("exact", [None, "position"])
def test_joint_velocities_give_way_to_limits_by_the_least(exact):
    rng, rows = np.random.default_rng(0), iq.limits.LimitRows(np.eye(6)[:2] + 0.3, [-0.2, -0.3], [0.2, 0.1])
    options = {"acceleration_limit": 20.0, "tool_speed": 0.3, "limits": [rows], "exact": exact}
    loop = iq.Controller(arm(), dt=DT, delay=0.01, **options)
    box = [(-20.0 * DT, 20.0 * DT)] * 6
    held = 0
    for _ in range(20):
        q, before = 0.5 * rng.normal(size=6), 0.1 * rng.normal(size=6)
        J = loop.robot.jacobian(q)
        before *= min(1.0, 0.1 / np.linalg.norm(J[3:] @ before))
        change = DT * rng.uniform(-19.0, 19.0, 6)
        x = nearest(loop, q, before, before + change)
        inside = [
            {"type": "ineq", "fun": lambda y, b=before: rows.upper - rows.C @ (b + y)},
            {"type": "ineq", "fun": lambda y, b=before: rows.C @ (b + y) - rows.lower},
            {"type": "ineq", "fun": lambda y, b=before, J=J: 0.3**2 - np.sum((J[3:] @ (b + y)) ** 2)},
        ]
        best = minimize(lambda y, c=change: np.sum((y - c) ** 2), 0.0 * q, bounds=box, constraints=inside, tol=1e-14)
        held += np.abs(best.x - change).max() > 1e-3
        assert all((limit["fun"]((1.0 - 1e-9) * x - before) >= -1e-9).all() for limit in inside)
        assert np.abs(x - before).max() <= 20.0 * DT * (1.0 + 1e-9)
        if exact is None:
            assert np.abs(before + best.x - x).max() < 1e-5
    assert held > 5


@pytest.mark.parametrize(
    "exact",
    [
        None,
        pytest.param("position", marks=pytest.mark.xfail(strict=False, reason="0.01 rad/s at the edge of its reach")),
    ],
)
def test_no_joint_swings_where_a_twist_cannot_be_done(exact):
    """Joints that brake slowly go on for longer than a tick: the law knows for how long a velocity is held."""
    robot = iq.load_robot("so101" if exact else "ur5")
    q = ready("so101" if exact else "ur5")
    loop, V = iq.Controller(robot, dt=DT, acceleration_limit=3.0, exact=exact), []
    for _ in range(1400):
        answer = loop.follow(q, [0.0, 0.0, 0.0, 0.3, 0.0, 0.0])
        V.append(answer.velocity)
        q = q + DT * answer.velocity
    assert answer.status == ("scaled" if exact else "limited")
    assert np.abs(np.diff(V[-400:], axis=0)).max() / DT < 0.3
