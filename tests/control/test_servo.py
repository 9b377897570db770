"""A stream of commands: smooth, stopped where it ends, the controller's law underneath."""

from copy import deepcopy

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.control import Servo

DT = 0.002
TWIST = np.array([0.0, 0.1, 0.2, 0.1, 0.0, 0.05])


def begun(name="panda", **options):
    robot = iq.load_robot(name)
    servo = Servo(iq.Controller(robot, dt=DT, **options), acceleration=1.0, jerk=20.0, timeout=0.1)
    return servo, 0.5 * (robot.position_lower + robot.position_upper) + 0.2


def driven(servo, q, commands):
    """Each tick's commanded twist and solution, and the last q; the robot does what it is told."""
    twists, solutions = [servo.twist], []
    for command in commands:
        solutions.append(servo.step(q, command))
        q = q + DT * solutions[-1].velocity
        twists.append(servo.twist)
    return np.array(twists), solutions, q


@pytest.mark.parametrize("name", ["panda", "so101"])
def test_twists_are_reached_with_bounded_acceleration_and_jerk_and_stop_with_the_stream(name):
    servo, q = begun(name)
    other = -TWIST[[1, 0, 2, 4, 3, 5]]
    stream = [TWIST if k % 20 == 0 and k < 250 else other if k == 260 else None for k in range(600)]
    twists, solutions, _ = driven(servo, q, stream)
    size = np.diag([servo.controller.measure.length] * 3 + [1.0] * 3)  # the tool moves little: the measure is nearly so
    rate = np.diff(twists, axis=0) / DT
    jerk = np.diff(rate, axis=0) / DT
    assert np.linalg.norm(rate @ size, axis=1).max() < 1.0 * 1.2
    assert np.linalg.norm(jerk @ size, axis=1).max() < 20.0 * 1.2
    np.testing.assert_allclose(twists[250], TWIST, atol=1e-12)
    np.testing.assert_array_equal(twists[-1], np.zeros(6))
    late = 260 + round(0.1 / DT)
    assert all(s.status == "ok" for s in solutions[1:late])
    assert solutions[late + 2].status == "degraded"
    assert solutions[late + 2].reason.startswith("no command for 0.10")
    assert (solutions[-1].status, solutions[-1].method) == ("held", "hold")


def test_a_pose_is_reached_without_overshoot():
    servo, q = begun()
    robot = servo.controller.robot
    target = robot.pose(q) @ iq.exp([0.2, 0.0, 0.1, 0.0, 0.0, 0.0])
    target[:3, 3] += (0.05, 0.0, -0.1)
    start = robot.pose(q)[:3, 3]
    along = (target[:3, 3] - start) / np.linalg.norm(target[:3, 3] - start)
    beyond = -np.inf
    for k in range(2500):
        q = q + DT * servo.step(q, target if k % 30 == 0 else None).velocity
        beyond = max(beyond, (robot.pose(q)[:3, 3] - target[:3, 3]) @ along)
    assert np.linalg.norm(iq.log(target @ iq.inverse(robot.pose(q)))) < 1e-6
    assert beyond < 1e-4


def test_a_pose_that_turns_past_half_a_turn_is_followed_the_same_way():
    servo, _ = begun()
    q = start = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, -2.0])
    here = servo.controller.robot.pose(q)
    for k in range(1000):  # far faster than the tool turns
        turned = here @ iq.exp([0.0, 0.0, min(0.02 * k, np.radians(210.0)), 0.0, 0.0, 0.0])
        command = None if 300 < k < 400 else turned  # the stream is away for a while
        q = q + DT * servo.step(q, command).velocity
    assert q[6] - start[6] > 1.0


def test_pause_and_resume():
    servo, q = begun()
    _, solutions, q = driven(servo, q, [None, *[TWIST] * 200])
    assert solutions[0].reason == "no command yet"
    servo.pause()
    twists, solutions, q = driven(servo, q, [TWIST] * 300)
    assert (solutions[0].status, solutions[0].reason) == ("degraded", "paused")
    assert not twists[-1].any()
    servo.resume()
    _, solutions, q = driven(servo, q, [None])
    assert solutions[0].reason == "no command yet"  # not the one from before
    twists, _, _ = driven(servo, q, [TWIST] * 300)
    np.testing.assert_allclose(twists[-1], TWIST, atol=1e-12)


def test_at_a_limit_it_goes_on_from_what_the_tool_does():
    slow, q = begun()
    servo, robot = Servo(slow.controller, acceleration=50.0, jerk=5000.0), slow.controller.robot
    limited = 0
    for _ in range(200):
        solution = servo.step(q, [4.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # faster than the joints turn
        if solution.active:
            limited += 1
            np.testing.assert_allclose(servo.twist, robot.jacobian(q) @ solution.velocity, rtol=0.0, atol=1e-12)
        q = q + DT * solution.velocity
        assert (np.abs(solution.velocity) <= robot.velocity_limit).all()
    assert limited > 20
    assert ((robot.position_lower <= q) & (q <= robot.position_upper)).all()


def test_with_a_joint_at_its_limit_it_stops_as_soon_as_elsewhere():
    servo, _ = begun()
    robot = servo.controller.robot
    q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, robot.position_upper[6]])
    _, solutions, q = driven(servo, q, [[0.0, 0.0, -1.0, 0.0, 0.2, 0.0]] * 300)
    assert any(6 in s.active for s in solutions)
    _, solutions, _ = driven(servo, q, [None] * 600)
    assert solutions[-1].status == "held"


def test_a_pose_behind_a_limit_is_reached():
    servo, _ = begun()
    robot = servo.controller.robot
    q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
    target = robot.pose(q) @ iq.exp([0.0, 0.0, np.pi - 0.3, 0.0, 0.0, 0.0])  # joint 6 meets its limit on the way
    limited = 0
    for _ in range(4000):
        solution = servo.step(q, target)
        limited += bool(solution.active)
        q = q + DT * solution.velocity
    assert limited > 20
    assert np.linalg.norm(iq.log(target @ iq.inverse(robot.pose(q)))) < 1e-6


class Arrays:
    """A robot of a user's, whose targets are plain arrays."""

    def __init__(self, robot):
        self._robot = robot

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def target(self, pose):
        return np.asarray(getattr(pose, "homogeneous", pose))


def test_a_robot_of_ones_own():
    servo, q = begun()
    own = Servo(iq.Controller(Arrays(servo.controller.robot), dt=DT), acceleration=1.0, jerk=20.0)
    target = servo.controller.robot.pose(q + 0.05)
    for _ in range(3):
        np.testing.assert_allclose(own.step(q, target).velocity, servo.step(q, target).velocity, rtol=1e-9, atol=1e-12)


def test_where_the_tool_frame_is_changes_nothing():
    servo, q = begun("ur5", point=[0.0, 0.0, 0.1])
    offset = iq.transform(iq.exp([0.3, 0.7, -0.2, 0, 0, 0])[:3, :3], [0.1, -0.2, 0.3])
    robot = servo.controller.robot.with_tool(offset)
    point = (iq.inverse(offset) @ [0.0, 0.0, 0.1, 1.0])[:3]
    moved = Servo(iq.Controller(robot, dt=DT, point=point), acceleration=1.0, jerk=20.0)
    target = servo.controller.robot.pose(q + 0.1)
    for k in range(200):
        command = (TWIST, target)[k > 100]
        here = servo.step(q, command)
        there = moved.step(q, command if k <= 100 else command @ offset)
        np.testing.assert_allclose(there.velocity, here.velocity, rtol=0.0, atol=1e-10)
        q = q + DT * here.velocity


def test_bad_commands_leave_it_as_it_was():
    servo, q = begun()
    _, _, q = driven(servo, q, [TWIST] * 20)
    before = deepcopy((servo.twist, servo._rate, servo._age, servo._command[0]))
    for arguments in (
        (q, np.full(6, np.nan)),
        (q, TWIST[:5]),
        (q, 2.0 * np.eye(4)),
        (q[:6], TWIST),
        (q * np.nan, TWIST),
        (q, 1e200 * TWIST),
    ):
        with pytest.raises(iq.BadInput):
            servo.step(*arguments)
    for value, kept in zip((servo.twist, servo._rate, servo._age, servo._command[0]), before, strict=True):
        np.testing.assert_array_equal(value, kept)
    with pytest.raises(iq.BadInput, match="controller"):
        Servo(servo, acceleration=1.0, jerk=1.0)
    with pytest.raises(iq.BadInput, match="jerk"):
        Servo(servo.controller, acceleration=1.0, jerk=0.0)
