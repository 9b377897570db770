"""A speed slider and limits that change: the same way, slower; inside acceleration limits; from the next tick."""

import numpy as np
import pytest
from support.arms import ready
from support.loops import drive

import invariantqp as iq

PANDA = ready("panda")
DT = 0.002
LIMITED = {"acceleration_limit": 5.0}
# What makes a tick of a loop another: each is kept by the slider.
LOOPS = {
    "plain": {},
    "point": {"exact": "position"},
    "tool speed": {"tool_speed": 0.1},
    "joint": {"exact": iq.control.ExactJoints(np.eye(7)[6:], 0.2)},
}


@pytest.fixture(scope="module")
def robot():
    return iq.load_robot("panda")


@pytest.fixture(scope="module")
def goal(robot):
    return iq.transform(translation=[0.05, 0.1, -0.1]) @ robot.pose(PANDA) @ iq.exp([0.3, 0.4, 0.1, 0.0, 0.0, 0.0])


def speed_of_tool(robot, q, v):
    J = robot.jacobian(q)
    return np.linalg.norm(J[3:] @ v + np.cross(J[:3] @ v, robot.pose(q)[:3, 3]))


def driven(robot, goal, ticks, options=lambda _: {}, **more):
    return drive(iq.Controller(robot, dt=DT, gain=3.0, **more), PANDA, goal, ticks, options)


@pytest.mark.cases(2)
@pytest.mark.parametrize("name", LOOPS)
def test_the_speed_override_keeps_the_path_and_slows_it_down(robot, goal, name):
    whole, fast, _ = driven(robot, goal, 300, **LOOPS[name])
    part, slow, _ = driven(robot, goal, 1200, lambda _: {"speed": 0.25}, **LOOPS[name])
    np.testing.assert_allclose(slow[0], 0.25 * fast[0], atol=1e-6 * np.abs(fast[0]).max())
    # Four ticks lead as far at a quarter of the speed: but for their length, the joints are in the same places.
    way = np.abs(whole[-2] - PANDA).max()
    assert np.abs(part[:-1:4] - whole[:-1]).max() < 0.02 * way


@pytest.mark.parametrize("options", [{}, {"acceleration_limit": 40.0}])
def test_a_twist_is_slowed_down_too(robot, options):
    twist = np.array([0.1, 0.0, 0.2, 0.02, 0.0, 0.03])
    whole, part = (iq.Controller(robot, dt=0.02, **options) for _ in range(2))
    full = whole.follow(PANDA, twist).velocity
    np.testing.assert_allclose(part.follow(PANDA, twist, speed=0.3).velocity, 0.3 * full, atol=1e-6)


def test_the_feedforward_is_slowed_down_with_the_approach(robot):
    twist = np.array([0.0, 0.0, 0.0, 0.05, 0.0, 0.02])
    here = robot.pose(PANDA)
    full = iq.Controller(robot, dt=DT).step(PANDA, here, twist).velocity
    part = iq.Controller(robot, dt=DT).step(PANDA, here, twist, speed=0.5).velocity
    np.testing.assert_allclose(part, 0.5 * full, atol=1e-9)


def test_a_speed_override_of_zero_brakes_and_stands_still(robot, goal):
    changes = [{"speed": 1.0}, {"speed": 0.0}, {"speed": 0.3}]
    _, v, solutions = driven(robot, goal, 600, lambda k: changes[k // 200], **LIMITED)
    change = np.abs(np.diff(v, axis=0)).max() / DT
    assert change <= 5.0 * (1.0 + 1e-9)
    fastest = np.abs(v[199]).max()
    assert fastest > 0.3
    stopped = 200 + int(np.ceil(fastest / (5.0 * DT)))
    assert not v[stopped:400].any()
    assert v[stopped - 2].any()
    assert {(s.status, s.reason) for s in solutions[stopped:400]} == {("held", "speed is 0")}
    assert v[599].any()
    assert {s.status for s in solutions[:200]} <= {"ok", "limited"}


def test_without_acceleration_limits_it_stands_still_at_once(robot, goal):
    _, v, _ = driven(robot, goal, 20, lambda k: {"speed": float(k < 10)})
    assert v[9].any()
    assert not v[10:].any()


@pytest.mark.parametrize("options", [{}, LIMITED, {**LIMITED, "tool_speed": 0.3}])
def test_a_tool_speed_of_a_tick_holds_as_soon_as_joints_can(robot, goal, options):
    q, v, solutions = driven(robot, goal, 500, lambda k: {"tool_speed": 0.05} if k >= 150 else {}, **options)
    speeds = np.array([speed_of_tool(robot, *both) for both in zip(q[:-1], v, strict=True)])
    assert speeds[149] > 0.15
    late = 150
    if options:
        assert np.abs(np.diff(v, axis=0)).max() / DT <= 5.0 * (1.0 + 1e-9)
        # Along the way it goes, the tool could stop within this.
        late += int(np.ceil(np.abs(v[149]).max() / (5.0 * DT)))
        assert (np.diff(speeds[150:late]) <= 1e-9).all()
    assert speeds[late:].max() <= 0.05 * (1.0 + 1e-6)
    assert "degraded" not in {s.status for s in solutions}


@pytest.mark.parametrize("options", [{}, LIMITED])
def test_a_velocity_limit_of_a_tick_holds_as_soon_as_joints_can(robot, goal, options):
    limit = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.05, np.inf])
    _, v, solutions = driven(robot, goal, 400, lambda k: {"velocity_limit": limit} if k >= 150 else {}, **options)
    late = 150 + (int(np.ceil(np.abs(v[149]).max() / (5.0 * DT))) if options else 0)
    assert (np.abs(v[149]) > limit).any()
    assert (np.abs(v[late:]) <= limit * (1.0 + 1e-9)).all()
    assert "degraded" not in {s.status for s in solutions}
    if options:
        assert np.abs(np.diff(v, axis=0)).max() / DT <= 5.0 * (1.0 + 1e-9)


def test_neutral_changes_leave_the_tick_unchanged(robot, goal):
    plain = iq.Controller(robot, dt=DT).step(PANDA, goal)
    told = iq.Controller(robot, dt=DT).step(PANDA, goal, speed=1, velocity_limit=np.inf)
    assert told == plain
    wide = iq.Controller(robot, dt=DT).step(PANDA, goal, tool_speed=30.0)
    np.testing.assert_allclose(wide.velocity, plain.velocity, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"speed": 1.2}, "speed: found 1.2; expected a share"),
        ({"speed": -0.1}, "speed: found -0.1"),
        ({"velocity_limit": -1.0}, "velocity_limit: found -1"),
        ({"tool_speed": 0.0}, "tool_speed: found 0"),
    ],
)
def test_bad_changes_of_a_tick_are_refused(robot, goal, changes, said):
    loop = iq.Controller(robot, dt=DT)
    with pytest.raises(iq.BadInput, match=said):
        loop.step(PANDA, goal, **changes)
    with pytest.raises(iq.BadInput, match=said):
        loop.follow(PANDA, np.zeros(6), **changes)
