"""All limits by one door: what a loop may be given, and that each kind holds, by whichever name it comes."""

import copy
import pickle
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from support.arms import ready
from support.loops import drive

import invariantqp as iq
from invariantqp.limits import AccelerationLimit, JointLimits, Limit, LimitRows, PinkLimit, ToolSpeed

PANDA = ready("panda")
DT = 0.002
ROWS = LimitRows([[1.0, 1.0, 0, 0, 0, 0, 0]], [-0.01], [0.01])
MORE = LimitRows([[0, 0, 0, 1.0, 0, 1.0, 0]], [-0.02], [0.02])


def together(q):
    return LimitRows(np.vstack((ROWS.C, MORE.C)), [-0.01, -0.02], [0.01, 0.02])


class Cable(Limit):
    """One class is a limit: the wrist does not turn a cable faster than it unrolls."""

    name = "the cable"

    def __init__(self, fastest=0.01):
        self.fastest = fastest

    def for_loop(self, loop):
        self.loop, self.asked = loop, getattr(self, "asked", 0) + 1
        return self

    def rows(self, q, velocity):
        self.seen = q, velocity
        return LimitRows(np.eye(7)[4:6] + 1.0, np.full(2, -self.fastest), np.full(2, self.fastest))


class FixedCable(Limit):
    """The same, whose rows never change."""

    name = "the cable"

    def for_loop(self, loop):
        return LimitRows(np.eye(7)[4:6] + 1.0, np.full(2, -0.01), np.full(2, 0.01), ["the cable", "its other end"])


@pytest.fixture(scope="module")
def robot():
    return iq.load_robot("panda")


@pytest.fixture(scope="module")
def goal(robot):
    return iq.transform(translation=[0.1, 0.2, -0.1]) @ robot.pose(PANDA)


def answer(robot, **options):
    target = iq.transform(translation=[0.1, 0.2, -0.1]) @ robot.pose(PANDA)
    return iq.Controller(robot, dt=DT, **options).step(PANDA, target)


def driven(robot, goal, ticks=200, **options):
    return drive(iq.Controller(robot, dt=DT, **options), PANDA, goal, ticks)


class Kind(NamedTuple):
    """A limit, its shortcut, how much of it a velocity uses, 1 if it is met, and a move [m] that meets it."""

    limit: object
    shortcut: dict
    used: object
    move: tuple = (0.6, 0.8, 0.4)


ASIDE = np.array([0.1, 0.0, 0.2])


def tool_speed(robot, q, before, x, point=(0.0, 0.0, 0.0)):
    twist = robot.jacobian(q) @ x
    return np.linalg.norm(twist[3:] + np.cross(twist[:3], (robot.pose(q) @ [*point, 1.0])[:3])) / 0.1


def margin_left(robot, q, before, x):
    ahead, room = q + DT * x, 0.5 * (robot.position_upper - robot.position_lower) - 0.7
    return (np.abs(ahead - 0.5 * (robot.position_upper + robot.position_lower)) / room).max()


KINDS = {
    "rows": Kind(ROWS, {"rows": ROWS}, lambda r, q, b, x: abs(ROWS.C @ x)[0] / 0.01),
    "function": Kind(together, {"rows": together}, lambda r, q, b, x: abs(MORE.C @ x)[0] / 0.02),
    "acceleration": Kind(
        AccelerationLimit(8.0), {"acceleration_limit": 8.0}, lambda r, q, b, x: np.abs(x - b).max() / (8.0 * DT)
    ),
    "margin": Kind(JointLimits(margin=0.7), {"position_margin": 0.7}, margin_left),
    "speed": Kind(JointLimits(velocity_limit=0.2), None, lambda r, q, b, x: np.abs(x).max() / 0.2),
    "range": Kind(JointLimits(position_upper=PANDA + 0.01), None, lambda r, q, b, x: (q + DT * x - PANDA).max() / 0.01),
    "tool": Kind(ToolSpeed(0.1), {"tool_speed": 0.1}, tool_speed),
    "point": Kind(ToolSpeed(0.1, ASIDE), None, lambda *tick: tool_speed(*tick, ASIDE)),
    "own": Kind(Cable(), None, lambda r, q, b, x: (np.abs((np.eye(7)[4:6] + 1.0) @ x)).max() / 0.01),
}


@pytest.mark.parametrize("name", KINDS)
def test_every_kind_of_limit_binds_and_holds(robot, name):
    limit, _, used, move = KINDS[name]
    run = driven(robot, iq.transform(translation=move) @ robot.pose(PANDA), 400, gain=20.0, limits=[limit])
    ticks = zip(run.q[:-1], run.x - run.changes, run.x, strict=True)
    assert 0.97 < max(used(robot, *tick) for tick in ticks) < 1.0 + 1e-9


@pytest.mark.parametrize("name", [name for name, kind in KINDS.items() if kind.shortcut is not None])
def test_a_shortcut_is_the_same_limit(robot, name):
    kind = KINDS[name]
    found, wanted = answer(robot, limits=[kind.limit]), answer(robot, **kind.shortcut)
    np.testing.assert_array_equal(found.velocity, wanted.velocity)
    assert (found.status, found.active) == (wanted.status, wanted.active)


def test_joint_limits_are_those_of_a_narrower_robot(robot, goal):
    low, high, speed = PANDA - 0.3, PANDA + np.array([0.05, 1, 1, 1, 1, 1, 1]), np.full(7, 0.3)
    narrow = robot.with_limits(np.maximum(low, robot.position_lower), np.minimum(high, robot.position_upper), speed)
    limits = [JointLimits(low, high), JointLimits(velocity_limit=0.3), AccelerationLimit(9.0), AccelerationLimit(6.0)]
    q = driven(robot, goal, posture=False, limits=limits).q[-1]
    other = driven(narrow, goal, posture=False, acceleration_limit=6.0).q[-1]
    np.testing.assert_allclose(q, other, atol=1e-12)


@pytest.mark.parametrize(
    "options",
    [
        {"limits": [ROWS, MORE]},
        {"rows": ROWS, "limits": [MORE]},
        {"limits": [together]},
        {"limits": (lambda _: ROWS, MORE)},
        {"rows": lambda _: ROWS, "limits": [lambda _: None, MORE]},
    ],
)
def test_rows_are_the_same_by_either_argument(robot, options):
    found, wanted = answer(robot, **options), answer(robot, rows=together)
    assert np.abs(ROWS.C @ wanted.velocity).max() == pytest.approx(0.01)
    np.testing.assert_allclose(found.velocity, wanted.velocity, atol=1e-9)
    np.testing.assert_allclose(found.row_multipliers, wanted.row_multipliers, rtol=1e-6, atol=1e-9)


def test_a_limit_of_the_users_gets_the_loop_and_every_tick(robot, goal):
    cable = Cable()
    limits = [cable, JointLimits(velocity_limit=1.0, margin=0.1), AccelerationLimit(7.0)]
    loop = iq.Controller(robot, dt=DT, delay=0.004, limits=limits)
    assert (cable.loop.dt, cable.loop.delay) == (DT, 0.004)
    assert cable.loop.robot is robot
    np.testing.assert_array_equal(cable.loop.acceleration, np.full(7, 7.0))
    np.testing.assert_array_equal(cable.loop.velocity_limit, np.ones(7))
    np.testing.assert_array_equal(cable.loop.position_upper, robot.position_upper)
    assert cable.loop.margin == 0.1
    before = np.full(7, 1e-3)
    loop.step(PANDA, goal, velocity=before)
    loop.step(PANDA, goal)
    assert np.abs(cable.seen[0] - PANDA).max() > 0.0  # where the commands in flight will have led
    assert np.abs(cable.seen[0] - PANDA).max() < 1e-3
    np.testing.assert_array_equal(loop.step(PANDA, goal, velocity=before).velocity.shape, cable.seen[1].shape)
    np.testing.assert_array_equal(cable.seen[1], before)


class Elbow(Limit):
    """A limit of the fourth joint, which no tick begins with."""

    name = "the elbow"

    def __init__(self):
        self.seen = []

    def rows(self, q, velocity):
        return ROWS

    def after(self, q, velocity):
        self.seen.append((q, velocity))
        return LimitRows(np.eye(7)[3:4], [-0.02], [0.02]) if abs(velocity[3]) > 0.02 + 1e-9 else None


def test_a_limit_of_the_users_checks_the_end_of_a_tick(robot, goal):
    elbow, other = Elbow(), Elbow()
    assert abs(answer(robot, limits=[ROWS]).velocity[3]) > 0.05
    solution = answer(robot, limits=[elbow])
    assert np.abs(elbow.seen[0][0] - PANDA).max() == 0.0
    assert abs(elbow.seen[0][1][3]) > 0.05
    assert len(elbow.seen) == 2  # the answer beside its rows is asked about too
    assert abs(solution.velocity[3]) == pytest.approx(0.02)
    assert np.abs(ROWS.excess(solution.velocity)).max() < 1e-9
    assert "the elbow" in solution.reason
    loop = iq.Controller(robot, dt=DT)  # for a tick alone
    assert abs(loop.step(PANDA, goal, limits=[other]).velocity[3]) == pytest.approx(0.02)
    assert abs(loop.step(PANDA, goal).velocity[3]) > 0.05
    assert np.isfinite(loop.state.command).all()


class Misspelled(Limit):
    def row(self, q, velocity):
        return ROWS


class Payload(Limit):
    """A limit that never gives way: half of the accelerations, and a slow wrist."""

    def tightened(self, loop):
        fastest = loop.velocity_limit.copy()
        fastest[6] = 0.01
        return loop._replace(acceleration=0.5 * loop.acceleration, velocity_limit=fastest)


def test_a_limit_of_the_users_tightens_joint_limits(robot, goal):
    run = driven(robot, goal, 100, limits=[AccelerationLimit(8.0), Payload()])
    assert np.abs(run.changes).max() == pytest.approx(4.0 * DT)
    assert np.abs(run.x[:, 6]).max() == pytest.approx(0.01)


def test_a_tool_speed_among_limits(robot):
    wanted = answer(robot, tool_speed=0.1)
    for limits in ([ToolSpeed(0.1)], [ToolSpeed(0.1), ToolSpeed(0.2)], [ToolSpeed(0.3), ToolSpeed(0.1, np.zeros(3))]):
        assert answer(robot, limits=limits) == wanted
        assert answer(robot, limits=limits, tool_speed=0.2) == wanted
    with pytest.raises(iq.BadInput, match="limits: found tool speeds of two points"):
        answer(robot, tool_speed=0.1, limits=[ToolSpeed(0.1, [0.0, 0.0, 0.1])])


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (ROWS, "limits: found .*; expected a list"),
        ([0.25], "limits: found 0.25; expected LimitRows, a function of q that returns them, JointLimits"),
        ([None], "limits: found None"),
        ([Misspelled()], "limits: found .*Misspelled.*; expected a Limit that has rows, tightened or for_loop"),
        ([JointLimits], "limits: found .*JointLimits"),
        ([LimitRows([[1.0, 0.0]], [0.0], [1.0])], "limits: found rows on 2 joints; expected rows on 7"),
        ([JointLimits(velocity_limit=[1.0, 2.0])], "limits: found JointLimits on 2 joints"),
        ([AccelerationLimit([1.0, 2.0])], "limits: found shape"),
        ([JointLimits(position_lower=10.0)], "limits: found JointLimits that leave joint 0 no position"),
        ([JointLimits(-0.1, 0.1, margin=0.1)], "limits: found a margin of 0.1, which leaves joint 0 nothing"),
        ([JointLimits(margin=0.1), JointLimits(PANDA - 0.1, PANDA + 0.1)], "limits: found a margin of 0.1"),
    ],
)
def test_bad_limits_are_refused(robot, limits, said):
    with pytest.raises(iq.BadInput, match=said):
        iq.Controller(robot, dt=DT, limits=limits)
    with pytest.raises(iq.BadInput, match=said):
        iq.Controller(robot, dt=DT).step(PANDA, robot.pose(PANDA), limits=limits)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: JointLimits(velocity_limit=-1.0), "velocity_limit: found -1"),
        (lambda: JointLimits(2.0, 1.0), "position_lower: found"),
        (lambda: JointLimits([0.0, 1.0], [1.0, 2.0, 3.0]), "position_upper: found 3 limits"),
        (lambda: JointLimits(margin=-0.1), "margin: found"),
        (lambda: AccelerationLimit(0.0), "limit: found 0"),
        (lambda: LimitRows([[1.0]], [0.0], [1.0], ["one", "two"]), "names: found 2 names"),
        (lambda: LimitRows([[1.0]], [0.0], [1.0], [3]), "names: found 3"),
        (lambda: PinkLimit(3.0), "limit: found 3.0"),
    ],
)
def test_bad_arguments_of_limits_are_refused(make, said):
    with pytest.raises(iq.BadInput, match=said):
        make()


def test_a_function_that_returns_something_else_is_named(robot):
    loop = iq.Controller(robot, dt=DT, limits=[lambda _: 3])
    with pytest.raises(iq.BadInput, match="limits: found int; expected LimitRows"):
        loop.step(PANDA, robot.pose(PANDA))


@pytest.mark.parametrize(
    ("limits", "names"),
    [
        ([FixedCable()], {"the cable", "its other end"}),
        ([Cable()], {"the cable row 0", "the cable row 1"}),
        ([LimitRows(ROWS.C, ROWS.lower, ROWS.upper, "the rail"), MORE], {"the rail", "row 1"}),
        ([together], {"together row 0", "together row 1"}),
        ([lambda _: MORE], {"row 0"}),
        ([ROWS, ToolSpeed(0.02)], {"row 0", "the tool's speed"}),
    ],
)
def test_reasons_call_rows_by_the_names_that_their_limits_give(robot, limits, names):
    solution = answer(robot, limits=limits)
    at = solution.reasons[-1]
    assert at.code is iq.velocity.Code.AT_LIMITS
    assert set(at.rows) <= names
    assert at.rows
    assert str(at).startswith("at the limits of ")
    assert all(name.removeprefix("row ") in solution.reason for name in at.rows)
    contradiction = LimitRows(np.vstack((np.eye(7)[:1],) * 2), [9.0, 99.0], [np.inf] * 2, ["a little", "a lot"])
    worst = answer(robot, limits=[*limits, contradiction]).reasons[0]
    assert worst.code is iq.velocity.Code.LIMITS_CONFLICT
    assert worst.rows[:2] == ("a lot", "a little")
    assert worst.joints == (0,)


# Limits that change while the loop runs.


@pytest.mark.parametrize("name", KINDS)
def test_a_limit_of_one_tick_is_as_that_of_a_controller(robot, goal, name):
    limit = KINDS[name].limit
    before = np.zeros(7)
    now = iq.Controller(robot, dt=DT, posture=False).step(PANDA, goal, velocity=before, limits=[limit])
    always = iq.Controller(robot, dt=DT, posture=False, limits=[limit]).step(PANDA, goal, velocity=before)
    # Room to brake before the target is that of the controller's own acceleration limits.
    tolerance = 1e-9 if name != "acceleration" else 8.0 * DT
    np.testing.assert_allclose(now.velocity, always.velocity, rtol=0.0, atol=tolerance)
    after = iq.Controller(robot, dt=DT, posture=False)
    after.step(PANDA, goal, limits=[limit])
    assert KINDS[name].used(robot, PANDA, before, now.velocity) < 1.0 + 1e-9
    after.state = iq.Controller(robot, dt=DT).state  # what it remembers of that tick
    np.testing.assert_array_equal(after.step(PANDA, goal).velocity, answer(robot, posture=False).velocity)


def test_limits_of_a_tick_add_to_those_of_the_controller(robot, goal):
    loop = iq.Controller(robot, dt=DT, limits=[ROWS, ToolSpeed(0.1), AccelerationLimit(20.0)])
    x = np.zeros(7)
    for _ in range(20):
        x = loop.step(PANDA, goal, velocity=x, limits=[MORE, AccelerationLimit(3.0), ToolSpeed(0.5)]).velocity
        assert ROWS.excess(x) == pytest.approx([0.0], abs=1e-9)
        assert MORE.excess(x) == pytest.approx([0.0], abs=1e-9)
        assert tool_speed(robot, PANDA, None, x) < 1.0 + 1e-9
    with pytest.raises(iq.BadInput, match="two points"):
        loop.step(PANDA, goal, limits=[ToolSpeed(0.1, [0.0, 0.0, 0.1])])


def test_a_refused_limit_leaves_the_loop_as_it_was(robot, goal):
    once, twice = (iq.Controller(robot, dt=DT, limits=[ROWS]) for _ in range(2))
    first = once.step(PANDA, goal)
    with pytest.raises(iq.BadInput):
        twice.step(PANDA, goal, limits=[3.0])
    np.testing.assert_array_equal(twice.step(PANDA, goal).velocity, first.velocity)
    assert twice.state == once.state


# Equal, scaled and millimetre rows.


@pytest.mark.parametrize("limits", [{}, {"acceleration_limit": 20.0}, {"tool_speed": 0.05}])
def test_rows_given_twice_or_scaled_change_nothing(robot, goal, limits):
    wanted = answer(robot, rows=together, **limits).velocity
    both = together(PANDA)
    for scale in (1e-6, 1e-3, 1e3, 1e6):
        scaled = LimitRows(scale * both.C, scale * both.lower, scale * both.upper)
        np.testing.assert_allclose(answer(robot, rows=scaled, **limits).velocity, wanted, rtol=0.0, atol=1e-9)
    for more in ([both, both], [both, ROWS, MORE, ROWS]):
        np.testing.assert_allclose(answer(robot, limits=more, **limits).velocity, wanted, rtol=0.0, atol=1e-9)


def contradicting(unit, scale=1.0):
    """An arm with a slide, in units of 1 / unit metres, and two rows that want more than its joints can."""
    screws = np.array([[0, 0, 1, 0, 0, 0], [0, 0, 0, 1.0, 0, 0], [0, 1, 0, 0, 0, 0]]).T.copy()
    screws[3:, 2] = np.cross([0.3 * unit, 0, 0], [0, 1, 0])
    home = iq.transform(translation=[0.5 * unit, 0.0, 0.1 * unit])
    arm = iq.robots.Chain(screws, home, velocity_limit=[2.0, 2.0 * unit, 2.0])
    C, least = np.array([[1.0, 1.0 / unit, 0.0], [0.5, -0.2 / unit, 1.0]]), np.array([5.0, 9.0])
    rows = LimitRows(scale * C, scale * least, [np.inf, np.inf])
    loop = iq.Controller(arm, dt=0.01, limits=[rows], posture=False)
    solution = loop.step(np.zeros(3), arm.pose(np.zeros(3)))
    # Least squares of what each row of length one lacks, a slide by the arm's length counting as a radian.
    y = np.array([1.0, loop.measure.length, 1.0])
    lengths = np.linalg.norm(C * y, axis=1)
    wanted = lsq_linear(C * y / lengths[:, None], least / lengths, (-arm.velocity_limit / y, arm.velocity_limit / y))
    return solution, solution.velocity / [1.0, unit, 1.0], C @ (solution.velocity - y * wanted.x)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_contradicting_rows_give_way_alike_in_every_unit_and_scale(unit, scale):
    wanted = contradicting(1.0)[1]
    solution, found, off = contradicting(unit, scale)
    assert solution.status == "degraded"
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(off, 0.0, atol=3e-4)  # rows are relaxed by 3e-5 more than they have to be


# Limits made for Pink.


def spheres(robot, at):
    """A collision model on the arm's joints: a ball at the tool and one in the base frame."""
    import pinocchio as pin

    coal = pytest.importorskip("coal")
    model = pin.GeometryModel()
    tool = robot.model.frames[robot.model.getFrameId(robot.tool)]
    for name, joint, place in (("tool", tool.parentJoint, tool.placement), ("world", 0, pin.SE3(np.eye(3), at))):
        model.addGeometryObject(pin.GeometryObject(name, joint, place, coal.Sphere(0.05)))
    model.addCollisionPair(pin.CollisionPair(0, 1))
    return model


def test_a_barrier_that_reads_collisions_is_given_them_or_refused_when_the_controller_is_made(robot):
    from pink.barriers import SelfCollisionBarrier

    barrier = SelfCollisionBarrier(1, gain=20.0, d_min=0.02)
    known = iq.robots.Chain(robot.screws, robot.home, places=robot.places)
    with pytest.raises(iq.BadInput, match="SelfCollisionBarrier, which fails on this arm") as caught:
        iq.Controller(known, dt=DT, limits=[barrier])
    assert "PinkLimit(limit, collision_model=...)" in str(caught.value)
    assert iq.Controller(robot, dt=DT, limits=[barrier]).step(PANDA, robot.pose(PANDA)).status != "held"
    start = robot.pose(PANDA)
    at = start[:3, 3] + [0.0, 0.0, -0.2]
    below = iq.transform(translation=[0.0, 0.0, -0.19]) @ start
    near = {}
    for label, limits in (("kept", [PinkLimit(barrier, collision_model=spheres(robot, at))]), ("without", [])):
        q = driven(robot, below, 600, gain=10.0, limits=limits).q
        near[label] = min(np.linalg.norm(robot.pose(p)[:3, 3] - at) for p in q) - 0.1
    assert near["without"] < 0.0
    assert 0.018 < near["kept"] < 0.025


def test_a_limit_that_fails_on_the_arm_is_refused_by_name(robot):
    class Broken:
        def compute_qp_inequalities(self, configuration, dt):
            raise KeyError("left_hand")

    with pytest.raises(iq.BadInput, match="limits: found Broken, which fails on this arm: KeyError: 'left_hand'"):
        iq.Controller(robot, dt=DT, limits=[Broken()])


# Copies.


@pytest.mark.parametrize("travel", [copy.deepcopy, lambda loop: pickle.loads(pickle.dumps(loop))])
def test_a_loop_with_every_kind_of_limit_travels(robot, goal, travel):
    chosen = {name: kind.limit for name, kind in KINDS.items() if name != "point"}
    limits = [JointLimits(margin=0.1) if name == "margin" else limit for name, limit in chosen.items()]
    loop = iq.Controller(robot, dt=DT, limits=limits)
    loop.step(PANDA, goal)
    again = travel(loop)
    np.testing.assert_array_equal(again.step(PANDA, goal).velocity, loop.step(PANDA, goal).velocity)


def test_copies_share_what_limits_look_at(robot, goal):
    cable = Cable()
    loop = copy.copy(iq.Controller(robot, dt=DT, limits=[cable]))
    assert cable.asked == 2  # a copy is a loop of its own
    cable.fastest = 0.005
    x = loop.step(PANDA, goal).velocity
    assert np.abs((np.eye(7)[4:6] + 1.0) @ x).max() == pytest.approx(0.005)
