"""LeRobot's kinematics calls: exact in reach, inside velocity limits, compared with the optima of placo and SciPy."""

import copy
import pickle

import numpy as np
import pytest
from scipy.optimize import least_squares

import invariantqp as iq
from invariantqp.lerobot import ActionFollower, RobotKinematics

JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
Q = np.array([0.0, -35.0, 35.0, 35.0, 0.0, 33.0])
STEP = np.degrees(10.0) / 30.0  # of a joint of the SO-101 in a frame


@pytest.fixture
def so101():
    return RobotKinematics("so101", joint_names=JOINTS)


def error(kinematics, q, target):
    """Distance [m] and angle [rad]."""
    pose = kinematics.forward_kinematics(q)
    apart = pose[:3, :3].T @ target[:3, :3]
    return np.linalg.norm(pose[:3, 3] - target[:3, 3]), np.arccos(np.clip((np.trace(apart) - 1.0) / 2.0, -1.0, 1.0))


def test_forward_kinematics_is_in_degrees_and_in_the_given_order(so101):
    robot = iq.load_robot("so101")
    np.testing.assert_array_equal(so101.forward_kinematics(Q), robot.pose(np.radians(Q[:5])))
    order = [5, 3, 0, 4, 1, 2]
    mixed = RobotKinematics("so101", joint_names=[JOINTS[i] for i in order])
    np.testing.assert_array_equal(mixed.forward_kinematics(Q[order]), so101.forward_kinematics(Q))
    target = so101.forward_kinematics(Q + 3.0)
    answer = mixed.inverse_kinematics([*Q[order], 7.0], target)
    np.testing.assert_allclose(answer[:6], so101.inverse_kinematics(Q, target)[order], atol=1e-9)
    assert (answer[0], answer[6]) == (33.0, 7.0)  # the gripper and what follows pass through
    assert RobotKinematics("so101").joint_names == JOINTS[:5]


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize(
    ("source", "frame"), [("so101", "gripper_frame_link"), ("ur5", "tool0"), ("panda", "panda_hand_tcp")]
)
def test_a_pose_in_reach_is_reached_within_a_frame(source, frame, first):
    kinematics, rng = RobotKinematics(source, frame, position_first=first), np.random.default_rng(0)
    robot = kinematics.robot
    low, high = np.degrees(np.maximum(robot.position_lower, -2.0)), np.degrees(np.minimum(robot.position_upper, 2.0))
    for _ in range(10):
        q = rng.uniform(low + 10.0, high - 10.0)
        if np.linalg.cond(robot.jacobian(np.radians(q))) > 40.0:
            continue
        target = kinematics.forward_kinematics(q + rng.uniform(-2.0, 2.0, len(q)))
        far, turned = error(kinematics, kinematics.inverse_kinematics(q, target), target)
        assert far < 1e-5
        assert turned < 1e-4
        assert kinematics.position_error == pytest.approx(far, abs=1e-12)


def turned_beyond_reach(so101):
    """A yaw of 0.3 rad that five joints cannot do at this point, 2 cm away."""
    target = so101.forward_kinematics(np.degrees([0.0, -0.6, 0.6, 0.6, 0.0, 0.0]))
    target[:3, :3] = iq.exp([0.0, 0.0, 0.3, 0.0, 0.0, 0.0])[:3, :3] @ target[:3, :3]
    target[0, 3] += 0.02
    return target


def test_by_the_weights_it_reaches_placos_optimum(so101):
    """placo 0.10.2, 200 steps: joints [rad], distance [mm] and angle [rad]."""
    target = turned_beyond_reach(so101)
    kinematics = RobotKinematics("so101", joint_names=JOINTS, position_first=False)
    for weights, wanted, far, angle in (
        ((1.0, 0.01), [-0.0289, -0.4078, 0.4338, 0.592, 0.1609], 6.5765, 0.22295),
        ((1.0, 1e-4), [-0.0053, -0.404, 0.4276, 0.5978, 0.1754], 0.0712, 0.24211),
    ):
        q = np.degrees([0.0, -0.6, 0.6, 0.6, 0.0, 0.0])
        for _ in range(40):
            q = kinematics.inverse_kinematics(q, target, *weights)
        np.testing.assert_allclose(np.radians(q[:5]), wanted, atol=2e-4)
        distance, turned = error(kinematics, q, target)
        assert 1e3 * distance == pytest.approx(far, rel=1e-2)
        assert turned == pytest.approx(angle, abs=1e-4)


def test_the_position_is_exact_and_the_orientation_error_minimal(so101):
    target, q = turned_beyond_reach(so101), np.degrees([0.0, -0.6, 0.6, 0.6, 0.0, 0.0])
    q = so101.inverse_kinematics(q, target)
    assert so101.position_error < 1e-5  # in the first frame
    for _ in range(8):
        q = so101.inverse_kinematics(q, target)
    assert so101.position_error < 1e-10
    best = iq.solve_pose(so101.robot, target, q0=np.radians(q[:5]), exact="position")
    assert error(so101, q, target)[1] <= error(so101, [*np.degrees(best.q), 0.0], target)[1] + 1e-6
    free = so101.inverse_kinematics(Q, target, 1.0, 0.0)
    assert error(so101, free, target)[0] < 1e-9
    turn = so101.forward_kinematics(np.add(Q, (0.0, 2.0, 1.0, -2.0, 3.0, 0.0)))
    turn[:3, 3] = 9.0
    for _ in range(3):
        free = so101.inverse_kinematics(free, turn, 0.0, 1.0)
    assert error(so101, free, turn)[1] < 1e-6


@pytest.mark.parametrize("first", [True, False])
def test_joints_keep_their_velocity_limits_and_move_no_farther_outside_their_range(first):
    kinematics, rng = RobotKinematics("so101", position_first=first), np.random.default_rng(1)
    low, high = (np.degrees(limit) for limit in (kinematics.robot.position_lower, kinematics.robot.position_upper))
    fastest = 0.0
    for i in range(60):
        q = rng.uniform(low - 4.0, high + 4.0) if i % 5 else np.zeros(5)
        target = kinematics.forward_kinematics(rng.uniform(low, high))
        target[:3, 3] *= (1.0, 1.0, 0.1, 8.0)[i % 4]
        if i % 7 == 0:
            target = kinematics.forward_kinematics(q) @ iq.exp([np.pi, 0.0, 0.0, 0.0, 0.0, 0.0])
        step = kinematics.inverse_kinematics(q, target, 1.0, (0.0, 0.01, 1.0)[i % 3]) - q
        fastest = max(fastest, np.abs(step).max())
        assert (step <= np.maximum(high - q, 0.0) + 1e-9).all()
        assert (step >= np.minimum(low - q, 0.0) - 1e-9).all()
    assert fastest == pytest.approx(STEP, rel=1e-9)


def test_a_joint_measured_outside_its_range_is_not_moved_back(so101):
    q = Q.copy()
    q[1] = -103.0  # the URDF says -100
    wanted = np.add(q, (5.0, 0.0, 3.0, -2.0, 4.0, 0.0))
    np.testing.assert_allclose(so101.inverse_kinematics(q, so101.forward_kinematics(wanted)), wanted, atol=1e-3)
    target = so101.forward_kinematics(q)
    target[2, 3] += 0.01
    answer = so101.inverse_kinematics(q, target)
    assert answer[1] >= -103.0
    assert np.abs(answer - q).max() < 0.5 * STEP
    assert so101.position_error < 1e-6


@pytest.mark.cases(2)
@pytest.mark.parametrize("far", [1.0, 3.0])
@pytest.mark.parametrize("first", [True, False])
def test_out_of_reach_it_comes_to_rest_at_the_weighted_optimum_and_returns(first, far):
    so101 = RobotKinematics("so101", joint_names=JOINTS, position_first=first)
    robot, q, target = so101.robot, Q.copy(), so101.forward_kinematics(Q)
    target[:3, 3] = far * np.array([0.5, 0.3, 0.3])
    for _ in range(150):
        before, q = q, so101.inverse_kinematics(q, target)
    assert np.abs(q - before).max() < 0.01

    def off(x):
        pose = robot.pose(x)
        turn = iq.log(iq.transform(rotation=target[:3, :3] @ pose[:3, :3].T))[:3]
        return np.concatenate((target[:3, 3] - pose[:3, 3], 0.1 * turn))

    bounds = (robot.position_lower, robot.position_upper)
    nearest = least_squares(off, np.radians(q[:5]), bounds=bounds, xtol=1e-12)
    np.testing.assert_allclose(
        np.linalg.norm(off(np.radians(q[:5]))), np.linalg.norm(nearest.fun), rtol=5e-3 if first else 0.0, atol=1e-6
    )
    back = so101.forward_kinematics(Q)  # into the workspace again
    for _ in range(30):
        q = so101.inverse_kinematics(q, back)
    assert so101.position_error < 1e-6


def test_a_rotation_of_nearly_pi_keeps_its_direction():
    kinematics = RobotKinematics("so101", joint_names=JOINTS)
    q, home, moved = Q.copy(), kinematics.forward_kinematics(Q), []
    axis = kinematics.robot.jacobian(np.radians(Q[:5]))[:3, 4]
    for angle in (3.0, 3.3):
        target = home.copy()
        target[:3, :3] = iq.exp([*(angle * axis), 0.0, 0.0, 0.0])[:3, :3] @ home[:3, :3]
        moved.append(kinematics.inverse_kinematics(q, target)[4] - q[4])
    assert moved == pytest.approx([STEP, STEP])


def test_velocity_limits_and_frame_time_can_be_given(so101):
    slow = RobotKinematics("so101", joint_names=JOINTS, frame_time=0.1, velocity_limit=[10, 20, 30, 40, 50])
    target = so101.forward_kinematics(np.add(Q, (40.0, 30.0, -40.0, 40.0, 60.0, 0.0)))
    step = np.abs(slow.inverse_kinematics(Q, target) - Q)
    assert (step <= np.array([1, 2, 3, 4, 5, 0]) + 1e-9).all()
    assert step[0] == pytest.approx(1.0)
    copies = copy.deepcopy(slow), pickle.loads(pickle.dumps(slow)), slow
    first, *others = (each.inverse_kinematics(Q, target) for each in copies)
    for other in others:
        np.testing.assert_array_equal(other, first)


def test_invalid_arguments_are_named(so101):
    target = so101.forward_kinematics(Q)
    for arguments, message in (
        ((Q[:5], target), "current_joint_pos: found 5 positions; expected 6"),
        ((Q, target, -1.0), "position_weight"),
        ((Q, target, 1.0, np.inf), "orientation_weight"),
    ):
        with pytest.raises(iq.BadInput, match=message):
            so101.inverse_kinematics(*arguments)
    for options, message in (
        ({"frame_time": 0.0}, "frame_time"),
        ({"velocity_limit": [1.0, 2.0]}, "velocity_limit"),
        ({"velocity_limit": -1.0}, "velocity_limit"),
        ({"joint_names": ["shoulder_pan", "shoulder_pan"]}, "joint_names"),
    ):
        with pytest.raises(iq.BadInput, match=message):
            RobotKinematics("so101", **options)
    with pytest.raises(iq.errors.UnknownName, match="no_joint"):
        RobotKinematics("so101", joint_names=["no_joint"])
    endless = """<robot name="a"><link name="b"/><link name="tip"/><joint name="j" type="continuous"><parent link="b"/>
        <child link="tip"/><axis xyz="0 0 1"/></joint></robot>"""
    with pytest.raises(iq.BadInput, match="velocity_limit: found none for j"):
        RobotKinematics(endless, "tip")
    slide = endless.replace("continuous", "prismatic").replace(
        "<axis", '<limit lower="0" upper="1" velocity="1" effort="1"/><axis'
    )
    with pytest.raises(iq.BadInput, match="joint j slides"):
        RobotKinematics(slide, "tip")


def test_a_rotation_with_rounding_errors_is_made_orthogonal(so101):
    target = so101.forward_kinematics(Q + 3.0)
    wanted = so101.inverse_kinematics(Q, target)
    off = target.copy()
    off[:3, :3] += 1e-4 * np.random.default_rng(0).normal(size=(3, 3))
    kept = off.copy()
    answer = RobotKinematics("so101", joint_names=JOINTS).inverse_kinematics(Q, off)
    np.testing.assert_allclose(answer, wanted, atol=0.1)
    np.testing.assert_array_equal(off, kept)
    scaled = target.copy()
    scaled[:3, :3] *= 1.02
    with pytest.raises(iq.BadInput, match="desired_ee_pose: found an upper-left block that is not a rotation"):
        so101.inverse_kinematics(Q, scaled)


def ramp(n=50):
    """Actions as `predict_action_chunk` returns them: (1, n, 6) float32."""
    share = np.sin(np.linspace(0.0, np.pi / 2.0, n))[:, None]
    return (Q + share * [20.0, 15.0, -10.0, 8.0, 30.0, 25.0])[None].astype(np.float32)


def commanded(follower, T, now=0.0):
    """Actions, period by period."""
    return np.array([follower.step(now + t) for t in np.arange(0.0, T, 0.01)])


def test_a_chunk_ends_at_its_last_stamp_inside_the_limits(so101):
    follower = ActionFollower(so101, acceleration_limit=1500.0, jerk=60000.0)
    follower.reset(Q)
    follower.follow(ramp(), 0.0)
    actions = np.vstack((Q, commanded(follower, 2.4)))
    stamps = np.arange(50) / 30
    wanted = np.array([np.interp(np.arange(1, 241) * 0.01, stamps, x) for x in ramp()[0].T]).T
    moving = slice(40, 160)  # after the splice, before the end
    assert np.abs(actions[1:] - wanted)[moving, :5].max() < 0.3
    np.testing.assert_allclose(actions[1:, 5], wanted[:, 5], atol=1e-9)  # the gripper, from one action to the next
    np.testing.assert_allclose(actions[-1], ramp()[0, -1], atol=1e-3)
    assert follower.solution.status == "done"
    speed = np.diff(actions[:, :5], axis=0) / 0.01
    acceleration = np.diff(speed, axis=0, prepend=0.0 * speed[:1]) / 0.01
    jerk = np.diff(acceleration, axis=0, prepend=0.0 * speed[:1]) / 0.01
    assert np.abs(speed).max() <= np.degrees(10.0)
    assert np.abs(acceleration).max() <= 1500.0 * 1.001
    assert np.abs(jerk).max() <= 60000.0 * 1.001


def test_a_late_chunk_that_disagrees_is_joined_before_its_end(so101):
    follower = ActionFollower(so101, acceleration_limit=1500.0, jerk=60000.0)
    follower.reset(Q)
    follower.follow(ramp(), 0.0)
    commanded(follower, 0.9)
    other = ramp() + np.array([5.0, -5.0, 5.0, 0.0, 0.0, 0.0], dtype=np.float32)
    follower.follow(other, 0.2)  # observed 0.7 s ago
    actions = commanded(follower, 0.91, now=0.9)  # it ends at 1.83 s
    due = [np.interp(1.81, 0.2 + np.arange(50) / 30, x) for x in other[0].T]
    np.testing.assert_allclose(actions[-1], due, atol=0.3)
    assert np.abs(np.diff(actions[:, :5], axis=0)).max() < 1.0  # no leap


def test_streams_of_poses_and_of_actions_are_followed(so101):
    for point in (so101.forward_kinematics(Q + 2.0), Q + 2.0):
        follower = ActionFollower(so101, acceleration_limit=1500.0, fps=30.0)
        follower.reset(Q)
        for t in np.arange(0.0, 1.0, 0.03):
            follower.add(point, t)
            actions = commanded(follower, 0.03, now=t)
        assert error(so101, actions[-1], so101.forward_kinematics(Q + 2.0))[0] < 1e-5


def test_a_chunk_into_a_desk_stops_above_it(so101):
    desk = iq.limits.HalfSpace([0, 0, 0], normal=[0, 0, 1], name="desk")
    clearance = iq.limits.Clearance(so101.robot, {"tool": [iq.limits.Sphere([0, 0, 0], 0.03)]}, [desk])
    down = np.tile(Q, (1, 50, 1))
    down[0, :, 1] += np.linspace(0.0, 60.0, 50)  # the shoulder bends down
    lowest = {}
    for limits in ([], [clearance]):
        follower = ActionFollower(so101, acceleration_limit=1500.0, limits=limits)
        follower.reset(Q)
        follower.follow(down, 0.0)
        heights = [so101.forward_kinematics(action)[2, 3] for action in commanded(follower, 2.5)]
        lowest[bool(limits)] = min(heights)
        follower.follow(np.tile(Q, (1, 50, 1)), 2.5)
        np.testing.assert_allclose(commanded(follower, 2.0, now=2.5)[-1], Q, atol=0.01)
    assert lowest[False] < 0.0 < 0.0495 < lowest[True] < 0.07  # 20 mm, half a millimetre of it at ticks of 10 ms


def test_a_chunk_may_be_a_tensor():
    class Tensor:
        """The three calls of a tensor of torch that lie between it and an array."""

        def __init__(self, array):
            self.detach = self.cpu = lambda: self
            self.numpy = lambda: array

    follower = ActionFollower(RobotKinematics("so101", joint_names=JOINTS), acceleration_limit=1500.0)
    follower.reset(Q)
    follower.follow(Tensor(ramp()), 0.0)
    assert commanded(follower, 1.0)[-1, 5] > Q[5]


def test_invalid_arguments_of_the_follower_are_named(so101):
    with pytest.raises(iq.BadInput, match="kinematics"):
        ActionFollower("so101", acceleration_limit=1500.0)
    with pytest.raises(iq.BadInput, match="acceleration_limit"):
        ActionFollower(so101, acceleration_limit=-1.0)
    follower = ActionFollower(so101, acceleration_limit=1500.0)
    with pytest.raises(iq.BadInput, match="reset"):
        follower.step(0.0)
    with pytest.raises(iq.BadInput, match="action"):
        follower.reset(np.append(Q[:5] * 100.0, 0.0))
    follower.reset(Q)
    for chunk in (ramp()[:, :, :5], np.zeros((2, 50, 6)), np.full((50, 6), np.nan), "chunk"):
        with pytest.raises(iq.BadInput, match="chunk"):
            follower.follow(chunk, 0.0)


def test_a_given_velocity_limit_replaces_the_urdfs():
    kinematics = RobotKinematics("so101", joint_names=JOINTS, velocity_limit=900.0)  # its URDF says 573 deg/s
    np.testing.assert_allclose(kinematics.robot.velocity_limit, np.radians(900.0))
    follower = ActionFollower(kinematics, acceleration_limit=9000.0)
    np.testing.assert_allclose(follower.follower.controller.box.velocity_limit, np.radians(900.0))
