"""A commanded twist is the velocity of the tool point, along the axes of the base; `at="base"` is a screw."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.arms import ready
from support.fuzz_ticks import random_chain
from support.repeats import repeats

import invariantqp as iq

ARMS = ("panda", "ur5", "xarm7", "gen3")
TURN, BOTH = np.array([0.2, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array([0.1, -0.05, 0.2, 0.03, -0.02, 0.04])


def at_tool(robot, q, x):
    """(6,) the angular velocity and the velocity of the tool point for joint velocities x (m,), by differences."""
    here, there = robot.pose(q), robot.pose(q + 1e-6 * x)
    turn = iq.log(iq.transform(there[:3, :3] @ here[:3, :3].T))[:3]
    return np.concatenate((turn, there[:3, 3] - here[:3, 3])) / 1e-6


def settled(tick):
    """The velocity of some ticks: a loop sets off softly."""
    return [tick().velocity for _ in range(8)][-1]


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("twist", [TURN, BOTH], ids=["turn", "both"])
def test_the_tool_point_moves_as_asked(name, twist):
    robot, q = iq.load_robot(name), ready(name)
    for options in ({}, {"acceleration_limit": 1e3}, {"exact": "position"}, {"limits": [lambda q: None]}):
        loop = iq.Controller(robot, dt=0.002, posture=False, **options)
        x = settled(lambda loop=loop: loop.follow(q, twist))
        np.testing.assert_allclose(at_tool(robot, q, x), twist, atol=2e-6)
        x = settled(lambda loop=loop: loop.follow(q, twist, at="base"))
        np.testing.assert_allclose(robot.jacobian(q) @ x, twist, atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_a_turn_leaves_the_tool_point_where_it_is(name):
    """Two seconds of 0.2 rad/s, as a joystick sends them: taken at the base they moved the tool by 190 to 278 mm."""
    robot, q = iq.load_robot(name), ready(name)
    follower, start = iq.Follower(iq.Controller(robot, dt=0.002, acceleration_limit=8.0), jerk=200.0), robot.pose(q)
    for _ in range(1000):
        follower.twist(TURN)
        q = q + 0.002 * follower.step(q).velocity
    moved = robot.pose(q) @ iq.inverse(start)
    assert np.linalg.norm(robot.pose(q)[:3, 3] - start[:3, 3]) < 5e-4
    assert np.linalg.norm(iq.log(moved)[:3]) == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("name", ARMS)
def test_a_feedforward_is_the_twist_at_the_base(name):
    """As its docstring says: with the target where the tool is, the twist alone is left."""
    robot, q = iq.load_robot(name), ready(name)
    carry, loop = iq.adjoint(iq.transform(translation=robot.pose(q)[:3, 3])), iq.Controller(robot, dt=0.01)
    led = settled(lambda: loop.step(q, robot.pose(q), carry @ BOTH))
    np.testing.assert_allclose(at_tool(robot, q, led), BOTH, atol=2e-6)


def test_a_follower_takes_both_and_a_change_between_them():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    carry = iq.adjoint(iq.transform(translation=robot.pose(q)[:3, 3]))
    tracks = []
    for second in ({"v": BOTH}, {"v": carry @ BOTH, "at": "base"}):
        follower = iq.Follower(iq.Controller(robot, dt=0.002, acceleration_limit=8.0), jerk=500.0)
        follower.twist(0.5 * BOTH)
        x = [follower.step(q).velocity]
        for _ in range(3):  # not as far as the tool's own motion tells them apart
            follower.twist(**second)
            x.append(follower.step(q).velocity)
        tracks.append(x)
    np.testing.assert_allclose(tracks[0], tracks[1], atol=1e-4)


@settings(max_examples=repeats(200, 20), deadline=None)
@given(st.integers(0, 2**63))
def test_on_any_chain(seed):
    rng = np.random.default_rng(seed)
    robot, twist = random_chain(rng), rng.normal(size=6)
    q = np.clip(rng.normal(size=len(robot.names)), robot.position_lower, robot.position_upper)
    tool = robot.pose(q)[:3, 3]
    screw = iq.adjoint(iq.transform(translation=tool)) @ twist
    found = [iq.Controller(robot, dt=0.01).follow(q, given, at=at) for given, at in ((twist, "tool"), (screw, "base"))]
    for one in found[1:]:
        np.testing.assert_allclose(one.residual, found[0].residual, rtol=0.0, atol=1e-6 * np.linalg.norm(screw))
        assert one.status == found[0].status


def test_another_point_is_refused():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    loop = iq.Controller(robot, dt=0.01, acceleration_limit=8.0)
    for at in ("world", [0.1, 0.2, 0.3], None, 1):
        with pytest.raises(iq.BadInput, match=r"^at: found .*expected 'tool' or 'base'"):
            loop.follow(q, TURN, at=at)
        with pytest.raises(iq.BadInput, match=r"^at: found .*expected 'tool' or 'base'"):
            iq.Follower(loop).twist(TURN, at=at)
