"""A controller's tick in the compiled core is the tick of Python: the same answer, the same memory after it."""

from copy import copy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fuzz_ticks import random_chain
from support.random_systems import motion
from support.repeats import repeats
from support.two_laws import Brought, same_reasons

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.legacy.compiled_loop import compiled_tick
from invariantqp.legacy.damping import Selective
from invariantqp.legacy.loop import LegacyLoop
from invariantqp.legacy.objective import least_squares, spectrum_of
from invariantqp.velocity.reasons import Code

pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
# Rounding of a tool pose and of its logarithm, in units of rounding of the pose.
POSE = 32 * np.finfo(float).eps
# Rounding of an optimum inside limits, times the condition of the Hessian, relative to its distance from the free one.
ROUNDING = 64 * np.finfo(float).eps
POINT, AXIS = iq.control.ExactPoint([0.0, 0.0, 0.1]), iq.control.ExactAxis([0.2, 0.0, 1.0])
PLANE = iq.control.ExactPlane([0.0, 0.3, 1.0], [0.0, 0.0, 0.1])
ASIDE = iq.exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
SLOW = {"tool_speed": iq.limits.ToolSpeed(0.3, [0.0, 0.0, 0.1])}
JOINT, ROWS = "a joint", "rows, metric, accelerations"  # they depend on the arm
LOOPS = [
    (None, {}),
    (None, {"acceleration_limit": np.inf}),
    (None, {"acceleration_limit": 5.0, "delay": 0.05}),
    (None, {"delay": 0.05}),
    (None, ROWS),
    ("position", SLOW),
    (POINT, {"acceleration_limit": 5.0, "form": iq.CarriedMetric([0.2, 0.1, 0.3, 1.0, 2.0, 1.0], ASIDE)}),
    ([POINT, AXIS], {"form": iq.CarriedMetric([0.2, 0.1, 0.3, 1.0, 2.0, 1.0])}),
    ([PLANE, AXIS], SLOW),
    (None, {"form": 0.1, "damping": Selective()}),
    (JOINT, ROWS),
]
ARMS = ("panda", "ur5", "so101")


def in_python(controller, *tick):
    """The same tick by Python: the solution, and the controller after it."""
    other = controller.by_engine("python")
    return other.step(*tick), other


def rounding(controller, q, target):
    """How far rounding of the pose, and of what follows, may part two velocities for this target."""
    robot, law = controller.robot, controller.law
    seen = robot.sight(q, robot.target(target))
    root = controller.measure.root_for(seen.J, seen.pose)
    s = root @ seen.error * controller.gain
    objective = least_squares(spectrum_of(root @ seen.J), s, None, law.damping)
    weakest = objective.weights[objective.weights > 0].min()
    size = np.abs(robot.pose(q)).max() + np.abs(np.asarray(target)).max()
    shift = POSE * controller.gain * size * (1.0 + controller.measure.length) * np.linalg.norm(root)
    far = np.linalg.norm(objective.centre())
    return shift / np.sqrt(weakest) + ROUNDING * objective.weights.max() / weakest * far


def assert_same(controller, q, target, feedforward=None):
    python, after = in_python(controller, q, target, feedforward)
    native = controller.step(q, target, feedforward)
    near = 1e-10 * np.abs(python.velocity).max() + rounding(controller, q, target)
    np.testing.assert_allclose(native.velocity, python.velocity, rtol=0.0, atol=near)
    assert (native.status, native.method, native.active) == (python.status, python.method, python.active)
    assert tuple(native.row_names) == tuple(python.row_names)
    assert native.joint_names == python.joint_names == controller.robot.names
    assert same_reasons(native.reasons, python.reasons)
    ours, theirs = controller.memory, after.memory
    assert type(native) is type(python)
    assert not np.shares_memory(controller.kept, native.velocity)
    np.testing.assert_array_equal(ours.commands[0], native.velocity)
    np.testing.assert_array_equal(ours.positions, q)
    np.testing.assert_allclose(ours.turn, theirs.turn, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(ours.states.numbers, theirs.states.numbers, rtol=1e-6, atol=1e-12)
    return native


@settings(max_examples=repeats(100, 15), deadline=None)
@given(st.integers(0, 2**63))
def test_loops_of_any_chain(seed):
    rng = np.random.default_rng(seed)
    robot = random_chain(rng)
    m = len(robot.names)
    acceleration = 10.0 ** rng.uniform(-1.0, 3.0, m) if rng.random() < 0.5 else None
    gain = float(rng.uniform(1.0, 100.0))
    controller = LegacyLoop(robot, dt=0.01, gain=gain, acceleration_limit=acceleration)
    if controller.compiled is None:  # a prismatic joint beside a revolute one
        return
    q = np.clip(rng.normal(size=m), robot.position_lower, robot.position_upper)
    size = np.abs(robot.home[:3, 3]).max()
    target = robot.pose(q) @ motion(rng, 0.3 * size) if rng.random() < 0.5 else robot.pose(q + 0.1)
    ahead = rng.normal(size=6) * (1.0, 1.0, 1.0, size, size, size) if rng.random() < 0.5 else None
    for _ in range(5):
        q = q + 0.01 * assert_same(controller, q, target, ahead).velocity


@pytest.mark.cases(12)
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize(("exact", "limits"), LOOPS, ids=str)
def test_an_arm_that_follows_a_path_into_its_limits(name, exact, limits):
    robot = iq.load_robot(name)
    m = len(robot.names)
    if limits is ROWS:
        rows = iq.limits.LimitRows(np.eye(m)[:2] + np.eye(m)[1:3], [-np.inf, -0.5], [0.3, 0.5])
        limits = {"acceleration_limit": 5.0, "rows": rows, "joint_metric": np.arange(1.0, 1.0 + m)}
    if exact is JOINT:
        exact = [PLANE, iq.control.ExactJoints(np.eye(m)[1], 0.01)]
    controller = LegacyLoop(robot, dt=0.01, exact=exact, **limits)
    assert controller.compiled is not None
    middle = 0.5 * (robot.position_lower + robot.position_upper)
    q = middle + np.linspace(0.07, 0.14, len(middle))  # no two joints alike: no ties for rounding to break
    goal = robot.pose(q)
    methods, answered = set(), 0
    for k in range(120):
        goal = iq.exp([0.0, 0.0, 0.003, 0.006 * np.sin(0.05 * k), 0.006, 0.0]) @ goal
        ahead = np.array([0.0, 0.0, 0.3, 0.0, 0.6, 0.0])
        answered += compiled_tick(controller.compiled, controller.kept.copy(), q, goal, ahead, None) is not None
        tick = (controller, q, goal, ahead)
        solution = assert_same(*tick) if k % 4 == 0 else controller.step(*tick[1:])  # Python takes its time
        methods.add(solution.method)
        q = q + 0.01 * solution.velocity
        if k >= 47 and methods & {"qp", "damped"}:
            break
    assert methods & {"qp", "damped"}
    assert answered > 24 or m < 6  # too few joints are left for a tool speed, or none


@pytest.mark.parametrize(
    ("exact", "limits"), [(None, SLOW), ("position", {}), ([PLANE, AXIS], {"acceleration_limit": 5.0})], ids=str
)
def test_a_twist_is_followed_as_in_python(exact, limits):
    robot = iq.load_robot("panda")
    controller = LegacyLoop(robot, dt=0.01, exact=exact, **limits)
    q, met, answered = 0.5 * (robot.position_lower + robot.position_upper) + 0.1, set(), 0
    controller.step(q, robot.pose(q + 0.01))
    for k in range(36):
        twist = 0.2 * np.sin([0.1 * k, 0.3, 1.0, 2.0 + 0.05 * k, 0.5, 3.0]) * (20.0 if k > 18 else 1.0)
        other, velocity = controller.by_engine("python"), (None, np.full(7, 0.01))[k % 2]
        python = other.follow(q, twist, velocity)
        answered += compiled_tick(controller.compiled, controller.kept.copy(), q, None, twist, velocity) is not None
        native = controller.follow(q, twist, velocity)
        far = rounding(controller, q, robot.pose(q)) + 1e-10 * np.abs(python.velocity).max()
        np.testing.assert_allclose(native.velocity, python.velocity, rtol=0.0, atol=far)
        assert (native.status, native.method, native.active) == (python.status, python.method, python.active)
        np.testing.assert_array_equal(controller.memory.commands[0], native.velocity)
        np.testing.assert_array_equal(controller.memory.positions, other.memory.positions)
        np.testing.assert_array_equal(controller.kept[:7], other.kept[:7])
        met.add(native.method)
        q = q + 0.01 * native.velocity
    assert answered > 24
    assert met & {"qp", "damped"}


@pytest.mark.cases(2)
@pytest.mark.parametrize("limit", [0.5, 5.0, [np.inf, 5.0, 0.5, 50.0, 5.0, 5.0, 5.0]], ids=str)
def test_acceleration_limits_to_a_target_at_rest_and_beside_a_limit(limit):
    robot = iq.load_robot("panda")
    controller = LegacyLoop(robot, dt=0.01, acceleration_limit=limit)
    q = 0.5 * (robot.position_lower + robot.position_upper) + 0.1
    goal = robot.pose(np.minimum(q + 0.4, robot.position_upper))
    for _ in range(40):
        q = q + 0.01 * assert_same(controller, q, goal).velocity
    outside = np.where(np.arange(7) == 3, robot.position_upper + 2e-3, q)
    assert "outside its position range" in assert_same(controller, outside, goal).reason
    noisy = np.minimum(outside, robot.position_upper + 1e-4)
    assert "outside" not in assert_same(controller, noisy, goal).reason
    for speed in (2.0, 20.0):  # as measured, faster than the commanded one, then than allowed
        tick = q, goal, None, np.full(7, speed)
        assert compiled_tick(controller.compiled, controller.kept.copy(), *tick) is not None
        fast, python = copy(controller).step(*tick), controller.by_engine("python").step(*tick)
        np.testing.assert_allclose(fast.velocity, python.velocity)
        assert (fast.status, fast.reason) == (python.status, python.reason)
    assert "acceleration" in fast.reason


@pytest.fixture
def panda():
    robot = iq.load_robot("panda")
    return LegacyLoop(robot, dt=0.01), 0.5 * (robot.position_lower + robot.position_upper) + 0.1


def test_exact_demands_of_which_ends_of_ranges_allow_nothing_are_the_cores():
    robot, rng = iq.load_robot("so101"), np.random.default_rng(0)
    low, high = robot.position_lower, robot.position_upper
    for _ in range(3):
        q = np.where(rng.random(5) < 0.5, low, high)
        q[:2] = rng.uniform(low[:2], high[:2])
        controller = LegacyLoop(robot, dt=0.002, exact="position")
        target = robot.pose(rng.uniform(low, high)) @ iq.transform(translation=[0.3, 0.0, 0.3])
        for tick in range(60):
            assert compiled_tick(controller.compiled, controller.kept.copy(), q, target, None, None) is not None
            if tick % 10 == 9:
                assert_same(controller, q, target)
            q = q + 0.002 * controller.step(q, target).velocity


def test_a_turn_goes_on_beyond_half_a_turn(panda):
    controller, q = panda
    angles, turns = np.sort([*np.linspace(0.7, 1.18, 8), 0.79, 0.81, 1.0 - 1e-7]), []
    for angle in np.pi * angles:
        target = controller.robot.pose(q) @ iq.exp([0.0, 0.6 * angle, 0.8 * angle, 0.02, 0.0, 0.01])
        assert compiled_tick(controller.compiled, controller.kept.copy(), q, target, None, None) is not None
        assert_same(controller, q, target)
        turns.append(np.linalg.norm(controller.memory.turn) / np.pi)
    np.testing.assert_allclose(turns, angles)


def test_an_arm_that_does_not_move_is_told(panda):
    controller, q = panda
    target = controller.robot.pose(q + 0.3)
    for _ in range(60):
        solution = assert_same(controller, q, target)
    assert solution.status == "degraded"
    assert solution.reason.startswith("no motion measured of joints 0 (panda_joint1), 1 (panda_joint2), ")
    for _ in range(15):  # it moves again
        q = q + 0.01 * solution.velocity
        solution = assert_same(controller, q, target)
    assert "no motion measured" not in solution.reason


def test_not_converging_is_told(panda):
    controller, q = panda
    target = controller.robot.pose(q + 0.3)
    for _ in range(60):  # an arm that goes the other way
        solution = assert_same(controller, q, target)
        q = q - 0.01 * solution.velocity
    assert "not converging" in solution.reason


@pytest.mark.cases(2)
@pytest.mark.parametrize("jammed", [0, 1, 3, 4, 5])
def test_a_jammed_joint_is_named(panda, jammed):
    robot, q = panda[0].robot, panda[1]
    controller = LegacyLoop(robot, dt=0.01)
    target = robot.pose(q) @ iq.exp([0.3, 0.2, 0.3, 0.1, 0.05, 0.1])
    named = []
    for k in range(400):
        solution = assert_same(controller, q, target) if k % 50 == 49 else controller.step(q, target)
        q = q + 0.01 * np.where(np.arange(7) == jammed, 0.0, solution.velocity)
        named += [one.joints == (jammed,) for one in solution.reasons if one.code == Code.NO_MOTION]
        named += [one.joints == (jammed,) for one in solution.reasons if one.code == Code.NOT_FOLLOWING]
    assert len(named) > 100
    assert all(named)


OTHERS = {
    "exact": lambda: iq.ExactRows(np.tri(9, 7), np.zeros(9)),
    "form": lambda: iq.PitchForm(0.1, convexified=True),
    "point": lambda: "own",
    "backend": lambda: "osqp",
}


@pytest.mark.parametrize("option", OTHERS)
def test_other_loops_are_python_s(panda, option):
    assert LegacyLoop(panda[0].robot, dt=0.01, **{option: OTHERS[option]()}).compiled is None


def test_a_robot_that_may_change_is_python_s(panda):
    robot = panda[0].robot

    class Wrapped:
        def __getattr__(self, name):
            return getattr(robot, name)

    assert LegacyLoop(Wrapped(), dt=0.01).compiled is None


def test_masked_numbers_are_refused_and_other_subclasses_taken():
    robot = iq.load_robot("ur5e")
    q = np.array([0.3, -1.2, 1.5, -1.0, 1.0, 0.3])
    here, twist = robot.pose(q), np.full(6, 0.1)
    loop = LegacyLoop(robot, dt=0.002, acceleration_limit=5.0)

    def masked(a):
        return np.ma.masked_array(a, mask=np.arange(a.size).reshape(a.shape) == 0)

    calls = {
        "q": lambda: loop.step(masked(q), here),
        "target": lambda: loop.step(q, masked(here)),
        "feedforward": lambda: loop.step(q, here, masked(twist)),
        "velocity": lambda: loop.step(q, here, velocity=masked(q)),
        "twist": lambda: loop.follow(q, masked(twist)),
    }
    for name, call in calls.items():
        with pytest.raises(iq.BadInput, match=f"^{name}: found a masked array with masked entries"):
            call()
    found = loop.step(np.ma.masked_array(q), here)
    np.testing.assert_allclose(found.velocity, LegacyLoop(robot, dt=0.002).step(q, here).velocity, atol=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.03])
@pytest.mark.parametrize("exact", [None, "position"])
def test_rows_of_a_function_a_barrier_and_a_form_are_told_in_each_tick(panda, exact, delay):
    robot, seen = panda[0].robot, []
    m = len(robot.names)

    def crossed(q):
        seen.append(q)
        return iq.limits.LimitRows(np.eye(m), np.ones(m), np.zeros(m))

    def spread(q):
        few = iq.limits.LimitRows(np.vstack((np.eye(m), np.cos(q))), np.full(m + 1, -0.3), np.full(m + 1, 0.4 + q[0]))
        return None if q[0] > 0.4 else few

    more = iq.limits.LimitRows(np.ones((1, m)), [-0.5], [0.5])
    options = {"dt": 0.01, "exact": exact, "delay": delay}
    held = LegacyLoop(robot, **options, rows=crossed).step(panda[1], robot.pose(panda[1] + 0.1))
    assert held.status == "held"
    np.testing.assert_allclose(seen[0], panda[1])
    for limits in (
        {"rows": spread},
        {"rows": spread, "limits": [more]},
        {"form": Brought(np.diag([1.0, 2, -1, 1, -0.5, 0.3]))},
    ):
        controller = LegacyLoop(robot, **options, **limits)
        q, methods = panda[1], set()
        for k in range(12):
            goal = robot.pose(np.clip(q + 0.02 * np.cos(np.arange(m) + k), robot.position_lower, robot.position_upper))
            solution = assert_same(controller, q, goal)
            methods.add(solution.backend)
            q = q + 0.01 * solution.velocity
        assert "daqp" not in methods or "form" in limits


@pytest.mark.parametrize(
    "options", [{}, {"acceleration_limit": 5.0, "delay": 0.02}, {"exact": "position", **SLOW}], ids=str
)
def test_what_a_tick_changes_is_told_to_the_core(panda, options):
    robot, q = panda[0].robot, panda[1]
    controller = LegacyLoop(robot, dt=0.01, **options)
    rng, answered = np.random.default_rng(0), 0
    for k in range(24):
        goal = iq.exp([0.0, 0.0, 0.01, 0.02 * np.sin(0.2 * k), 0.02, 0.0]) @ robot.pose(q)
        now = [{"speed": 0.3}, {"velocity_limit": 0.4}, {"tool_speed": 0.05}, {"speed": 0.7, "tool_speed": 0.2}][k % 4]
        python = controller.by_engine("python")
        ahead = rng.normal(size=6) * 0.1 if k % 3 else None
        one, other = (loop.step(q, goal, ahead, **now) for loop in (controller, python))
        answered += one.backend != other.backend or one.backend == ""
        near = rounding(controller, q, goal) + 1e-9 * max(1e-3, np.abs(other.velocity).max())
        np.testing.assert_allclose(one.velocity, other.velocity, rtol=0.0, atol=near)
        assert (one.status, one.method, one.active) == (other.status, other.method, other.active)
        np.testing.assert_allclose(controller.kept, python.kept, rtol=1e-6, atol=1e-6)
        twist = python.by_engine("compiled").follow(q, 0.1 * np.ones(6), **now).velocity
        np.testing.assert_allclose(
            twist, python.follow(q, 0.1 * np.ones(6), **now).velocity, rtol=0.0, atol=near + 1e-9
        )
        q = q + 0.01 * one.velocity
    assert answered > 12


def test_an_arm_that_may_be_far_outside_returns_by_the_core(panda):
    robot, q = panda[0].robot, panda[1].copy()
    q[3] = robot.position_upper[3] + 0.9
    loops = [LegacyLoop(robot, dt=0.01, far_outside=far) for far in ("hold", "return")]
    assert [loop.step(q, robot.pose(panda[1])).status for loop in loops] == ["held", "limited"]
    found = compiled_tick(loops[1].compiled, loops[1].kept, q, robot.pose(panda[1]), None, None)
    assert found is not None
    assert found[0].velocity[3] < 0.0
