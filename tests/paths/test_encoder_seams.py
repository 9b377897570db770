"""Joints without position limits are compared modulo a turn: a reading that jumps by one changes nothing."""

import numpy as np
import pytest
from support.arms import ready
from support.inputs import KINDS, Bed, cases

import invariantqp as iq
from invariantqp.robots.kinematics import continuous_turns, joint_displacement, unwrapped, whole_turns

TURN = 2.0 * np.pi
READS = {
    "-pi to pi": lambda q, k: (q + np.pi) % TURN - np.pi,
    "0 to 2 pi": lambda q, k: q % TURN,
    "any turn": lambda q, k: q + TURN * np.random.default_rng(k).integers(-2, 3, len(q)),
    "three turns on": lambda q, k: q + 3.0 * TURN,
}


def turning(name):
    """An arm whose last joint, and of most the first, has no position limits, as the GEN3's."""
    robot = iq.load_robot(name)
    lower, upper = np.array(robot.position_lower), np.array(robot.position_upper)
    joints = [-1] if name == "so101" else [0, -1]
    lower[joints], upper[joints] = -np.inf, np.inf
    return robot if name == "gen3" else robot.with_limits(position_lower=lower, position_upper=upper)


def reading(robot, how):
    mask = np.isinf(robot.position_upper)
    return lambda q, k: np.where(mask, READS[how](q, k), q)


@pytest.mark.parametrize(("kind", "name", "dt", "sign"), cases(KINDS, 2))
def test_the_encoder_s_turn_changes_no_command(kind, name, dt, sign):
    """The last joint passes pi, or -pi; also of what a follower is given as joint positions."""
    robot, start = turning(name), ready(name)
    start[-1] = sign * 2.9

    def run(reads):
        bed = Bed(kind, name, dt, sign, joint=len(start) - 1, robot=robot, start=start)
        asked = bed.joints
        bed.joints = lambda t: reads(asked(t), 7)
        return bed.run(2.0, reads=reads)

    plain = run(lambda q, k: q)
    assert abs(plain.Q[-1, -1]) > np.pi
    for how in READS:
        trace = run(reading(robot, how))
        assert np.abs(trace.V - plain.V).max() < 5e-5, how  # a path is planned from rounded positions
        assert [(a.status, a.reason) for a in trace.answers] == [(a.status, a.reason) for a in plain.answers], how


@pytest.mark.parametrize("sign", [1, -1])
def test_a_tool_that_slides_over_a_surface_goes_on_over_the_seam(sign):
    robot, start, dt = iq.load_robot("gen3"), ready("gen3"), 0.01
    start[-1] = sign * 3.1
    tool = robot.pose(start)

    def run(how):
        task = iq.HybridTask(lambda T: iq.point_contact(T[:3, 3], normal=[0.0, 0.0, 1.0]), [5.0])
        loop = iq.HybridController(robot, task, dt=dt, order="moment first", acceleration_limit=8.0)
        reads, q, V, said = reading(robot, how) if how else (lambda q, k: q), start, [], []
        for k in range(100):
            turn = iq.exp([0.0, 0.0, sign * 0.4 * k * dt, 0.0, 0.0, 0.0])[:3, :3]
            target = iq.transform(turn @ tool[:3, :3], tool[:3, 3] + [0.0, 0.03 * k * dt, -0.002])
            tip = robot.pose(q)[:3, 3]
            force = np.array([0.0, 0.0, -2e4 * max(0.0, tool[2, 3] - 0.001 - tip[2])])
            answer = loop.step(reads(q, k), target, np.append(np.cross(tip, force), force))
            q = q + dt * answer.velocity
            V.append(answer.velocity)
            said.append((answer.status, answer.reason))
        return np.array(V), said, q

    V, said, q = run(None)
    assert abs(q[-1]) > np.pi
    for how in READS:
        other, same, _ = run(how)
        assert np.abs(other - V).max() < 1e-9, how
        assert same == said, how


@pytest.mark.parametrize("name", ["gen3", "so101"])
def test_a_pose_is_found_near_where_the_search_begins(name):
    """Whatever turn the start is in: no joint goes round more than it has to."""
    robot, start = turning(name), ready(name)
    mask, exact = np.isinf(robot.position_upper), "position" if len(start) < 6 else None
    target = robot.pose(start + 0.2)
    plain = iq.solve_pose(robot, target, q0=start, exact=exact)
    for turns in (-2.0, 1.0, 5.0):
        begin = start + TURN * turns * mask
        found = iq.solve_pose(robot, target, q0=begin, exact=exact)
        np.testing.assert_allclose(found.q - begin, plain.q - start, atol=1e-6)
        assert found.success == plain.success


@pytest.mark.parametrize("turns", [0, 1, -3])
def test_the_posture_of_a_continuous_joint_is_the_nearest_of_its_turns(turns):
    robot = iq.load_robot("gen3")
    q = ready("gen3")
    away = np.where(np.isinf(robot.position_upper), TURN * turns, 0.0)
    plain, other = (
        iq.Controller(robot, dt=0.01, posture=q + 0.1 + more, posture_gain=1.0) for more in (np.zeros(7), away)
    )
    for _ in range(50):
        twist = [0.0, 0.0, 0.0, 0.05, 0.0, 0.0]
        a, b = (loop.follow(q, twist) for loop in (plain, other))
        np.testing.assert_allclose(a.velocity, b.velocity, atol=1e-9)
        q = q + 0.01 * a.velocity
    still = iq.Controller(robot, dt=0.01, posture=False).follow(q, twist).velocity
    assert np.abs(a.velocity - still).max() > 1e-3


def test_joint_displacement_is_modulo_a_turn():
    random, turns = np.random.default_rng(0), np.array([TURN, 0.0, np.pi])
    for _ in range(200):
        start, step = 10.0 * random.normal(size=3), random.uniform(-1.5, 1.5, 3)
        end = start + step + turns * random.integers(-4, 5, 3)
        np.testing.assert_allclose(joint_displacement(start, end, turns), step, atol=1e-12)
        way = np.cumsum(random.uniform(-1.5, 1.5, (9, 3)), axis=0)
        read = way + turns * random.integers(-4, 5, (9, 3))
        np.testing.assert_allclose(unwrapped(np.zeros(3), read, turns), way, atol=1e-12)
        np.testing.assert_array_equal(joint_displacement(start, end, np.zeros(3)), end - start)


def test_a_whole_turn_is_that_of_a_hinge_without_limits():
    """Not of a slide, nor of a screw, which advances; a joint in other units has another turn."""
    J = np.zeros((6, 4))
    J[2, 0] = J[2, 1] = J[5, 1] = J[3, 2] = 1.0
    J[0, 3] = 2.0
    np.testing.assert_allclose(whole_turns(J), [TURN, 0.0, 0.0, np.pi])
    lower, upper = np.array([-np.inf, -np.inf, -np.inf, -3.0]), np.full(4, np.inf)
    np.testing.assert_allclose(continuous_turns(lower, upper, J), [TURN, 0.0, 0.0, 0.0])


def test_a_joint_with_limits_is_never_compared_modulo_a_turn():
    """Beyond its range by a turn it is far outside, whatever else would be near."""
    bed = Bed("step", "ur5", 0.01, 1)
    for shift in (TURN, -TURN):
        answer = bed.loop.step(bed.start + np.eye(6)[5] * (shift + 6.0 * np.sign(shift)), bed.pose(0.0))
        assert answer.status == "held"
