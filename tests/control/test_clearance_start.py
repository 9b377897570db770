"""Bodies that are too near when a loop begins: they are reported, get no nearer, and move no arm."""

import pickle
import warnings
from copy import deepcopy

import numpy as np
import pytest
from support.arms import ready
from support.loops import drive

import invariantqp as iq
from invariantqp.limits import Clearance, Limit, OtherArm, Sphere

pytest.importorskip("coal")
SLACK = 1e-3  # of the distance that they have, for noise [m]
CASES = [
    ("panda", 0.002, None),
    ("panda", 0.033, 10.0),
    ("ur5", 0.01, 10.0),
    ("ur5", 0.033, None),
    ("xarm7", 0.01, None),
    ("so101", 0.002, 26.0),
]


def beside_the_tool(robot, q, side):
    """A ball that overlaps the tool's links, on one side of it."""
    return Sphere(robot.pose(q)[:3, 3] + side * np.array([0.06, 0.0, 0.0]), 0.05, name="ball")


def begun(limit, name, dt, acceleration, **options):
    exact = "position" if name == "so101" else None
    return iq.Controller(limit.robot, dt=dt, acceleration_limit=acceleration, exact=exact, limits=[limit], **options)


@pytest.mark.cases(8)
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("name", "dt", "acceleration"), CASES)
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_an_arm_at_its_target_does_not_move(name, dt, acceleration, side, noise):
    robot, q, rng = iq.load_robot(name), ready(name), np.random.default_rng(0)
    limit = Clearance(robot, None, [beside_the_tool(robot, q, side)])
    pose, start = robot.pose(q), q
    loop = begun(limit, name, dt, acceleration)
    with pytest.warns(UserWarning, match="nearer than 20.0 mm when the loop begins"):
        loop.step(q, pose)
    for _ in range(round(4.0 / dt)):
        answer = loop.step(q + noise * rng.normal(size=len(q)), pose)
        q = q + dt * answer.velocity
    assert answer.status != "ok"
    assert "nearer than 20.0 mm" in answer.reason
    assert np.abs(q - start).max() < 20.0 * noise + 1e-9
    assert np.abs(robot.pose(q) - pose).max() < noise + 1e-9


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("name", "dt", "acceleration"), CASES)
def test_bodies_get_no_nearer_and_keep_a_larger_distance_that_they_reach(name, dt, acceleration, side):
    """It is led into the ball, then away from it, and into it again."""
    robot, q = iq.load_robot(name), ready(name)
    limit = Clearance(robot, None, [beside_the_tool(robot, q, side)])
    apart, pose = limit.at(q).distance, robot.pose(q)
    loop, reached = begun(limit, name, dt, acceleration), [apart]
    with pytest.warns(UserWarning, match="exclude="):
        loop.step(q, pose)
    for seconds, along in ((1.0, 0.1), (1.5, -0.05), (1.0, 0.1)):
        target = pose.copy()
        target[0, 3] += side * along
        run = drive(loop, q, target, round(seconds / dt))
        q, reached = run.q[-1], reached + [limit.at(p).distance for p in run.q[1:]]
    turns = round(1.0 / dt), round(2.5 / dt)
    assert min(reached) > apart - SLACK - 1e-4
    assert reached[turns[1]] > apart + 5e-4
    assert min(reached[turns[1] :]) > min(reached[turns[1]], 0.02) - SLACK - 1e-4


def test_a_copy_keeps_the_same_distances():
    robot, q = iq.load_robot("panda"), ready("panda")
    limit = Clearance(robot, None, [beside_the_tool(robot, q, 1.0)])
    loop, pose = iq.Controller(robot, dt=0.01, limits=[limit]), robot.pose(q)
    with pytest.warns(UserWarning, match="exclude="):
        loop.step(q, pose)
    for one in (pickle.loads(pickle.dumps(loop)), deepcopy(loop)):
        now = q
        for along in (-0.05, 0.1):  # away from the ball, and to it
            target = pose.copy()
            target[0, 3] += along
            now, _ = drive(one, now, target, 150).end
        assert limit.at(now).distance > 0.0199


def test_the_warning_names_what_to_leave_out_and_then_the_arm_is_free():
    robot, q = iq.load_robot("ur5"), ready("ur5")
    limit = Clearance(robot, None, [beside_the_tool(robot, q, 1.0)])
    with pytest.warns(UserWarning, match="exclude=") as found:
        iq.Controller(robot, dt=0.01, limits=[limit]).step(q, robot.pose(q))
    pairs = eval(str(found[0].message).split("exclude=")[1])
    assert all("ball" in pair for pair in pairs)
    free = Clearance(robot, None, [beside_the_tool(robot, q, 1.0)], exclude=pairs)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert iq.Controller(robot, dt=0.01, limits=[free]).step(q, robot.pose(q)).status == "ok"


@pytest.mark.parametrize("kind", ["twist", "poses", "goal"])
def test_followers_keep_distances_of_their_start(kind):
    robot, q = iq.load_robot("panda"), ready("panda")
    limit = Clearance(robot, None, [beside_the_tool(robot, q, 1.0)])
    loop, pose, start = iq.Controller(robot, dt=0.01, acceleration_limit=10.0, limits=[limit]), robot.pose(q), q
    follower = iq.Follower(loop, jerk=500.0)
    if kind == "goal":
        follower.follow([pose])
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        for k in range(300):
            if kind == "twist":
                follower.twist(np.zeros(6))
            if kind == "poses":
                follower.add(pose, 0.01 * k)
            q = q + 0.01 * follower.step(q, now=0.01 * k).velocity
    assert ["exclude=" in str(one.message) for one in found] == [True]
    assert np.abs(q - start).max() < 1e-6


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_limit_of_single_ticks_begins_once(side):
    """As of what the hand holds: the ball is in each tick's own limits."""
    robot, q = iq.load_robot("panda"), ready("panda")
    limit = Clearance(robot, None, [beside_the_tool(robot, q, side)])
    apart, loop, target = limit.at(q).distance, iq.Controller(robot, dt=0.01), robot.pose(q)
    target[0, 3] += 0.1 * side
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        q, _ = drive(loop, q, target, 300, lambda _: {"limits": [limit]}).end
    assert ["exclude=" in str(one.message) for one in found] == [True]
    assert limit.at(q).distance > apart - SLACK - 1e-4


@pytest.mark.parametrize("wrong", [np.zeros(5), np.zeros((7, 1)), np.full(7, np.nan), np.array([None] * 7)])
def test_positions_of_the_wrong_kind_are_refused_before_it_begins(wrong):
    robot, q = iq.load_robot("panda"), ready("panda")
    limit = Clearance(robot, None, [Sphere([3.0, 0.0, 0.0], 0.1, name="far")])
    loop, pose = iq.Controller(robot, dt=0.01), robot.pose(q)
    for _ in range(2):
        loop.step(q, pose, limits=[limit])
        with pytest.raises(iq.errors.BadInput, match=r"^q: "):
            loop.step(wrong, pose, limits=[limit])


@pytest.mark.parametrize("turn", [1, -1])
def test_a_wrap_of_another_arms_encoder_is_no_motion(turn):
    robot, q, other = (
        iq.load_robot("ur5"),
        ready("ur5"),
        iq.load_robot("gen3", base=iq.transform(translation=[0.0, 0.9, 0.0])),
    )
    at = np.array([0.0, 0.3, 3.1 * turn, -1.6, 0.2, -1.0, 3.0])
    moved = next(name for name in other.names if "3" in name)
    arm = OtherArm(other, {moved: [Sphere(other.pose(at)[:3, 3] + [0.0, 0.1, 0.0], 0.05)]})
    arm.move(at)
    limit = Clearance(robot, {"tool": [Sphere([0, 0, 0], 0.05)]}, [arm])
    loop, start = iq.Controller(robot, dt=0.01, limits=[limit]), q
    for k in range(40):
        arm.move(at - 2.0 * np.pi * turn * (k % 8 > 3) * np.eye(7)[2])
        q = q + 0.01 * loop.step(q, robot.pose(start)).velocity
    assert np.abs(q - start).max() < 1e-6


class Own(Limit):
    """A limit of the user's that contains a clearance."""

    def __init__(self, clearance):
        self.clearance = clearance

    def for_loop(self, loop):
        self.inner = self.clearance.for_loop(loop)
        return self

    def begin(self, q):
        self.inner.begin(q)

    def rows(self, q, velocity):
        return self.inner.rows(q, velocity)

    def after(self, q, velocity):
        return self.inner.after(q, velocity)

    def violation(self):
        return self.inner.violation()


@pytest.mark.filterwarnings("ignore:clearance. nearer than")
@pytest.mark.parametrize("acceleration", [None, 10.0])
def test_a_limit_of_the_users_may_contain_a_clearance(acceleration):
    """It begins too near, and then the ball moves: how fast is estimated, in `begin`."""
    robot, q, runs = iq.load_robot("ur5"), ready("ur5"), []
    for kind in (Own, lambda clearance: clearance):
        ball = beside_the_tool(robot, q, 1.0)
        limits = [kind(Clearance(robot, None, [ball]))]
        loop, x = iq.Controller(robot, dt=0.01, acceleration_limit=acceleration, limits=limits), [np.zeros(6)]
        said = []
        for k in range(60):
            ball.move(iq.transform(translation=[-0.002 * max(0, k - 30), 0.0, 0.0]))
            answer = loop.step(q + 0.01 * np.sum(x, axis=0), robot.pose(q))
            x.append(answer.velocity)
            said.append((answer.status, "are nearer than" in answer.reason))
        runs.append((x, said))
    (own, said), (bare, expected) = runs
    assert np.abs(bare).max() > 0.05
    np.testing.assert_allclose(own, bare, atol=1e-9)
    assert said == expected
    assert said[0] == ("limited", True)
