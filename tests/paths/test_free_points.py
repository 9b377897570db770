"""Streams and chunks of targets that leave something free: followed like poses, and nothing is turned for nothing."""

import numpy as np
import pytest
from support.arms import LIMITS
from support.streams import Arm, driven

import invariantqp as iq


def kinds(pose):
    return {"point": pose[:3, 3], "target": iq.Target(pose[:3, 3]), "both": iq.Target(pose[:3, 3], pose[:3, 2])}


def off(arm, q, pose, kind):
    """How far the point, and in radians the axis, is from that of a pose."""
    found = arm.robot.pose(q)
    axis = np.linalg.norm(found[:3, 2] - pose[:3, 2]) if kind == "both" else 0.0
    return max(np.linalg.norm(found[:3, 3] - pose[:3, 3]), axis)


@pytest.mark.parametrize("kind", ["target", "both"])
@pytest.mark.parametrize("name", LIMITS)
def test_a_hand_is_followed(name, kind):
    arm = Arm(name)
    truth = arm.motion(np.random.default_rng(3), 0.4)
    stamps = np.arange(0.0, 2.0, 1.0 / 50.0)
    poses = [arm.robot.pose(truth(t)) for t in stamps]
    points = [kinds(T)[kind] for T in poses]
    events = [(t, lambda f, p=p, t=t: f.add(p, t)) for t, p in zip(stamps, points, strict=True)]
    Q, answers = driven(arm, arm.follower(), events, 1.9)
    arm.held(Q)
    whole, _ = driven(
        arm, arm.follower(), [(t, lambda f, T=T, t=t: f.add(T, t)) for t, T in zip(stamps, poses, strict=True)], 1.9
    )
    late = [min(off(arm, q, T, kind) for T in poses) for q in Q[250:]]
    assert max(late) < 0.02
    assert np.abs(np.diff(Q, axis=0)).sum() <= 1.05 * np.abs(np.diff(whole, axis=0)).sum()
    assert answers[-1].status == "moving"


@pytest.mark.parametrize("kind", ["point", "both"])
@pytest.mark.parametrize("name", LIMITS)
def test_chunks_are_met_at_their_stamps(name, kind):
    arm = Arm(name)
    truth, stamps = arm.motion(np.random.default_rng(4), 0.3), np.arange(0.0, 2.0, 0.05)
    poses = [arm.robot.pose(truth(t)) for t in stamps]
    follower = arm.follower(cutoff=np.inf)
    follower.follow([kinds(T)[kind] for T in poses], stamps)
    Q, _ = driven(arm, follower, [], 1.9)
    arm.held(Q)
    for t in (0.8, 1.2, 1.6):
        assert off(arm, Q[round(t / arm.dt)], arm.robot.pose(truth(t)), kind) < 3e-3


def test_one_goal_and_a_function_of_time():
    arm = Arm("ur5")
    goal = arm.robot.pose(arm.start)[:3, 3] + [0.05, 0.05, 0.1]
    follower = arm.follower()
    follower.follow([goal])
    Q, _ = driven(arm, follower, [], 3.0)
    np.testing.assert_allclose(arm.robot.pose(Q[-1])[:3, 3], goal, atol=1e-6)
    follower = arm.follower()
    follower.follow(lambda t: goal + np.array([0.02 * np.sin(t), 0.0, 0.0]))
    Q, _ = driven(arm, follower, [], 4.0)
    arm.held(Q)
    at = goal + np.array([0.02 * np.sin(4.0), 0.0, 0.0])
    np.testing.assert_allclose(arm.robot.pose(Q[-1])[:3, 3], at, atol=2e-3)


def test_a_point_out_of_reach_is_reported_and_the_nearest_held():
    arm = Arm("panda")
    far = np.array([1.5, 0.2, 0.5])
    follower = arm.follower()
    follower.follow([far])
    Q, answers = driven(arm, follower, [], 6.0)
    near = iq.solve_pose(arm.robot, far, q0=Q[-1], restarts=0)
    assert np.linalg.norm(arm.robot.pose(Q[-1])[:3, 3] - far) == pytest.approx(near.position_error, abs=1e-4)
    assert "reach" in " ".join(a.reason for a in answers)


def test_invalid_points_are_refused_by_name():
    arm = Arm("ur5")
    follower = arm.follower()
    for point in ([np.nan, 0.0, 0.0], [0.0, 0.0], [1e3, 0.0, 0.0], iq.Target([1e3, 0.0, 0.0])):
        with pytest.raises(iq.BadInput) as refused:
            follower.add(point)
        assert refused.value.argument == "point"
    with pytest.raises(iq.BadInput) as refused:
        follower.follow([iq.Target([0.3, 0.2, 0.3]), np.eye(4)], [0.0, 1.0])
    assert refused.value.argument == "points"


def test_samples_are_followed_without_a_cutoff():
    """The first sample has no interval to wait by."""
    arm = Arm("ur5", dt=0.01)
    follower, goal = iq.Follower(arm.controller(), cutoff=np.inf), arm.robot.pose(arm.start + 0.05)
    Q, _ = driven(arm, follower, lambda k, q: follower.add(goal, k * arm.dt) if k % 3 == 0 else None, 1.5)
    np.testing.assert_allclose(arm.robot.pose(Q[-1]), goal, atol=1e-5)
