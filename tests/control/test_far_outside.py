"""Joint positions that cannot be true are not moved on: held by name, at rest, in every loop."""

from functools import partial

import numpy as np
import pytest

import invariantqp as iq

PANDA = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
DEGREES = np.degrees(PANDA)
DT = 0.002
SAID = (
    "joint 3 (panda_joint4): -135 rad is 131.9 outside its position range; are these degrees? "
    'Give far_outside="return" to move back from there'
)


@pytest.fixture(scope="module")
def robot():
    return iq.load_robot("panda")


@pytest.fixture
def loop(robot):
    """Makes a controller."""
    return partial(iq.Controller, robot, dt=DT)


def is_held(solution):
    assert (solution.status, solution.reason) == (iq.Status.HELD, SAID)
    assert not solution.velocity.any()
    return True


def test_step_follow_and_rest(robot, loop):
    controller, here = loop(), robot.pose(PANDA)
    before = controller.state
    assert is_held(controller.step(DEGREES, here))
    assert is_held(controller.follow(DEGREES, np.ones(6)))
    assert is_held(controller.rest(DEGREES, "why"))
    assert controller.state == before
    assert controller.step(PANDA, here).status == "ok"


def test_a_moving_arm_brakes_as_hard_as_it_may(robot, loop):
    controller, q, v = loop(acceleration_limit=5.0), PANDA, np.zeros(7)
    goal = iq.transform(translation=[0.1, 0.1, 0.0]) @ robot.pose(PANDA)
    for _ in range(50):
        v = controller.step(q, goal).velocity
        q = q + DT * v
    assert np.abs(v).max() > 0.2
    for _ in range(100):
        solution = controller.step(np.degrees(q), goal)
        assert solution.status == "held"
        np.testing.assert_allclose(solution.velocity, np.sign(v) * np.maximum(np.abs(v) - 5.0 * DT, 0.0), atol=1e-12)
        v = solution.velocity
    assert not v.any()


def test_a_posture_and_limits_in_degrees_are_questioned_too(robot, loop):
    with pytest.raises(iq.BadInput, match=r"posture: found joint 3 \(panda_joint4\): -135 rad is 131.9 outside"):
        loop(posture=DEGREES)
    loop(posture=PANDA)
    with pytest.warns(UserWarning, match="JointLimits: joint 0 may turn to 180 rad, 28.6 turns; are these degrees"):
        loop(limits=[iq.limits.JointLimits(-180.0, 180.0)])
    loop(limits=[iq.limits.JointLimits(-12.5, 12.5)])


def test_a_position_beyond_any_scale_is_told_in_a_line(robot, loop):
    reason = loop().step(1e300 * PANDA, robot.pose(PANDA)).reason
    assert reason.startswith("joint 3 (panda_joint4): -2.356e+300 rad is 2.356e+300 outside")


def test_a_feedforward_beyond_any_scale_is_told_by_its_name(robot, loop):
    far = iq.transform(translation=[1e200, 0.0, 0.0])
    for target, ahead, named in ((robot.pose(PANDA), 1e300 * np.eye(6)[3], "feedforward"), (far, None, "target")):
        with pytest.raises(iq.BadInput, match=rf"{named}: found (a pose (inf|1e\+200)|an entry of size 1e\+300)"):
            loop().step(PANDA, target, ahead)


def test_with_far_outside_return_the_arm_moves_back(robot, loop):
    solution = loop(far_outside="return").step(DEGREES, robot.pose(PANDA))
    assert solution.status == "limited"
    assert np.abs(solution.velocity).max() == robot.velocity_limit.max()
    assert "43.2 outside its position range" in solution.reason


def test_a_path_waits_and_goes_on(robot, loop):
    here = robot.pose(PANDA)
    follower = iq.PathFollower(loop(), [here, here @ iq.transform(translation=[0.0, 0.0, 0.05])])
    with pytest.raises(iq.BadInput, match=r"q: found joint 3 \(panda_joint4\): -135 rad is"):
        follower.prepare(DEGREES)
    assert is_held(follower.step(DEGREES))
    follower.prepare(PANDA)
    q = PANDA
    for _ in range(20):
        told = follower.step(q)
        q = q + DT * told.velocity
    place = told.place
    assert 0.0 < place < 1.0
    told = follower.step(np.degrees(q))
    assert told.status == "held"
    assert "are these degrees?" in told.reason
    assert not told.velocity.any()
    assert (told.place, told.speed, told.ruling, told.across) == (place, 0.0, "joint positions", np.inf)
    for _ in range(2000):
        told = follower.step(q)
        q = q + DT * told.velocity
        if told.status == "done":
            break
    assert told.status is iq.Status.DONE


def test_a_follower_forgets_its_speed(robot, loop):
    follower = iq.Follower(loop(acceleration_limit=10.0), jerk=200.0)
    twist, q = np.array([0.0, 0.0, 0.0, 0.0, 0.1, 0.0]), PANDA
    for _ in range(30):
        follower.twist(twist)
        told = follower.step(q)
        q = q + DT * told.velocity
    assert told.velocity.any()
    slower = np.maximum(np.abs(told.velocity) - 10.0 * DT, 0.0)
    told = follower.step(np.degrees(q))
    assert (told.status, told.reason) == ("held", told.reason)
    assert "are these degrees?" in told.reason
    np.testing.assert_allclose(np.abs(told.velocity), slower, atol=1e-12)
    for _ in range(50):
        assert follower.step(np.degrees(q)).status == "held"
    assert not follower.step(np.degrees(q)).velocity.any()
    assert follower.step(q).status in ("moving", "waiting")


def test_a_pressing_tool_stands_still(robot):
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], normal=[0, 0, 1]), [5.0])
    made = {"dt": DT, "order": "force first"}
    hybrid, other = iq.HybridController(robot, task, **made), iq.HybridController(robot, task, **made)
    here, reading = robot.pose(PANDA), np.zeros(6)
    answer = hybrid.step(DEGREES, here, reading)
    assert is_held(answer)
    assert np.isnan(answer.wrench).all()
    assert not answer.motion.any()
    assert not answer.force.any()
    np.testing.assert_array_equal(hybrid.step(PANDA, here, reading).velocity, other.step(PANDA, here, reading).velocity)
    follower = iq.PathFollower(hybrid, [here, here @ iq.transform(translation=[0.05, 0.0, 0.0])])
    with pytest.raises(iq.BadInput, match="are these degrees"):
        follower.prepare(DEGREES)
    assert is_held(follower.step(DEGREES, wrench=reading))


def test_slides_ranges_without_an_end_and_half_a_radian_are_believed():
    screws = [iq.se3.prismatic([1, 0, 0]), iq.revolute([0, 0, 1], [0, 0, 0]), iq.revolute([0, 1, 0], [0, 0, 1])]
    arm = iq.robots.Chain(
        np.transpose(screws), np.eye(4), position_lower=[-1, -np.inf, -1], position_upper=[1, np.inf, 1]
    )
    controller = iq.Controller(arm, dt=DT)
    assert controller.step([700.0, 0.0, 0.0], np.eye(4)).status != "held"
    assert controller.step([0.0, 700.0, 0.0], np.eye(4)).status != "held"
    assert controller.step([0.0, 0.0, 1.49], np.eye(4)).status != "held"
    told = controller.step([0.0, 0.0, 1.51], np.eye(4))
    assert (told.status, told.reason[:46]) == ("held", "joint 2 (joint3): 1.51 rad is 0.51 outside its")


def test_what_to_do_is_one_of_two_words(robot):
    with pytest.raises(iq.BadInput, match="far_outside: found 'back'; expected 'hold' or 'return'"):
        iq.Controller(robot, dt=DT, far_outside="back")


def test_a_target_in_millimetres_is_refused(robot, loop):
    """Where it is as near as a target in metres can be out of reach, it is followed."""
    controller, here = loop(), robot.pose(PANDA)
    controller.step(PANDA, here)
    before = controller.state
    millimetres, far = here.copy(), here.copy()
    millimetres[:3, 3] *= 1000.0
    far[:3, 3] *= 30.0
    with pytest.raises(iq.BadInput, match=r"target: found a pose .* times the arm's length; .* Are these millimetres"):
        controller.step(PANDA, millimetres)
    assert controller.state == before
    assert controller.step(PANDA, far).status == "limited"


def test_lengths_of_any_unit_are_believed():
    """An arm described in millimetres, a gantry, and a rail that is longer than the arm on it is."""
    slide = iq.load_robot(np.array([[0, 0, 0, 1.0, 0, 0]]).T, np.eye(4))
    assert iq.Controller(slide, dt=DT).step([0.0], iq.transform(translation=[500.0, 0, 0])).status != "held"
    hinges = np.column_stack([iq.revolute([0, 0, 1], point=[x, 0, 0]) for x in (0.0, 300.0)])
    tool, goal = (iq.transform(translation=[x, 0, 0]) for x in (500.0, 5000.0))
    assert iq.Controller(iq.load_robot(hinges, tool), dt=DT).step([0.1, 0.2], goal).status == "limited"
    rail = np.column_stack(([0, 0, 0, 1.0, 0, 0], hinges / [[1], [1], [1], [1e3], [1e3], [1e3]]))
    along = iq.load_robot(rail, iq.transform(translation=[0.5, 0, 0])).with_limits([0.0, -3.0, -3.0], [200.0, 3.0, 3.0])
    assert iq.Controller(along, dt=DT).step([0.0, 0.1, 0.2], iq.transform(translation=[150.0, 0, 0])).status != "held"


def test_poses_in_millimetres_are_refused_wherever_they_come_in(robot):
    """By the one rule that a tick has; an offset or a base, which may be so far away, is questioned."""
    here = robot.pose(PANDA)
    millimetres = iq.transform(translation=1000.0 * here[:3, 3])
    with pytest.raises(iq.BadInput, match=r"target: found a pose .* Are these millimetres"):
        iq.solve_pose(robot, millimetres)
    with pytest.raises(iq.BadInput, match=r"targets\[1\]: found a pose .* Are these millimetres"):
        iq.solve_poses(robot, [here, millimetres])
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], normal=[0, 0, 1]), [5.0])
    loop = iq.HybridController(robot, task, dt=DT, order="force first")
    loop.step(PANDA, here, np.zeros(6))
    with pytest.raises(iq.BadInput, match=r"target: found a pose .* Are these millimetres"):
        loop.step(PANDA, millimetres, np.zeros(6))
    for argument in ("offset", "base"):
        with pytest.warns(UserWarning, match=f"{argument}: a pose 100 .* Are these millimetres"):
            iq.load_robot("panda", **{argument: iq.transform(translation=[0.0, 0.0, 100.0])})


def test_a_tool_speed_in_millimetres_is_questioned_once(robot):
    said = r"tool_speed: 250 \[length/s\], .* times the arm's length in a second. Are these millimetres"
    for told in ({"tool_speed": 250.0}, {"limits": [iq.limits.ToolSpeed(250.0, [0.0, 0.0, 0.1])]}):
        with pytest.warns(UserWarning, match=said) as asked:
            loop = iq.Controller(robot, dt=DT, **told)
        assert len(asked) == 1
    loop = iq.Controller(robot, dt=DT, tool_speed=5.0)  # which no arm reaches, and nobody is asked about
    loop.step(PANDA, robot.pose(PANDA), speed=0.5)
    with pytest.warns(UserWarning, match=said):
        iq.Controller(robot, dt=DT).step(PANDA, robot.pose(PANDA), tool_speed=250.0)


def test_a_follower_refuses_millimetres(robot):
    follower = iq.Follower(iq.Controller(robot, dt=DT, acceleration_limit=8.0))
    millimetres = iq.transform(translation=[400.0, 0.0, 300.0])
    with pytest.raises(iq.BadInput, match=r"points: .* millimetres"):
        follower.follow([millimetres])
    with pytest.raises(iq.BadInput, match=r"point: .* millimetres"):
        follower.add(millimetres)
    assert follower.step(PANDA).status == "waiting"
