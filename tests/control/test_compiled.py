"""A controller's tick in the compiled core is the tick of Python: the same answer, the same memory after it."""

from contextlib import contextmanager
from copy import copy
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fuzz_ticks import random_chain
from support.random_systems import motion
from support.two_laws import NUMBER, ROUNDING

import invariantqp as iq
from invariantqp.control.compiled import compiled_tick
from invariantqp.control.frame_cost import FrameCost
from invariantqp.engine import core
from invariantqp.velocity.objective import least_squares, spectrum_of

pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
# Rounding of a tool pose and of its logarithm, in units of rounding of the pose.
POSE = 32 * np.finfo(float).eps
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
    (None, {"form": 0.1, "damping": iq.velocity.Selective()}),
    (JOINT, ROWS),
]
ARMS = ("panda", "ur5", "xarm7", "so101", "z1")


@contextmanager
def python_alone():
    """Neither ticks nor velocities by the core."""
    with (
        mock.patch("invariantqp.control.controller.compiled_tick", return_value=None),
        mock.patch("invariantqp.velocity.solve.core", None),
    ):
        yield


def in_python(controller, *tick):
    """The same tick by Python: the solution, and the controller after it."""
    other = copy(controller)
    with python_alone():
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
    assert NUMBER.sub("#", native.reason) == NUMBER.sub("#", python.reason)
    ours, theirs = controller.memory, after.memory
    assert type(native) is type(python)
    assert not np.shares_memory(controller.kept, native.velocity)
    np.testing.assert_array_equal(ours.commands[0], native.velocity)
    np.testing.assert_array_equal(ours.positions, q)
    np.testing.assert_allclose(ours.turn, theirs.turn, rtol=1e-12, atol=1e-14)
    assert ours.convergence.ticks == theirs.convergence.ticks
    for name in ("told", "done", "speed"):
        one, other = getattr(ours.convergence, name), getattr(theirs.convergence, name)
        assert one == pytest.approx(other, rel=1e-6, abs=1e-6 * theirs.convergence.told)
    return native


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**63))
def test_loops_of_any_chain(seed):
    rng = np.random.default_rng(seed)
    robot = random_chain(rng)
    m = len(robot.names)
    acceleration = 10.0 ** rng.uniform(-1.0, 3.0, m) if rng.random() < 0.5 else None
    gain = float(rng.uniform(1.0, 100.0))
    controller = iq.Controller(robot, dt=0.01, gain=gain, acceleration_limit=acceleration)
    if controller.compiled is None:  # a prismatic joint beside a revolute one
        return
    q = np.clip(rng.normal(size=m), robot.position_lower, robot.position_upper)
    size = np.abs(robot.home[:3, 3]).max()
    target = robot.pose(q) @ motion(rng, 0.3 * size) if rng.random() < 0.5 else robot.pose(q + 0.1)
    ahead = rng.normal(size=6) * (1.0, 1.0, 1.0, size, size, size) if rng.random() < 0.5 else None
    for _ in range(5):
        q = q + 0.01 * assert_same(controller, q, target, ahead).velocity


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.integers(0, 2**63))
def test_the_cost_of_a_frame_task(seed):
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 10))
    J, s, root = rng.normal(size=(6, m)), rng.normal(size=6), np.eye(6) + 0.3 * rng.normal(size=(6, 6))
    if rng.random() < 0.5:
        J[:, -1] = (J[:, 0], 0.0 * s, J[:, 0] + 1e-6 * s)[rng.integers(3)]
    if rng.random() < 0.2:
        J *= 10.0 ** rng.uniform(-60.0, 60.0)
    task = FrameCost()
    task.form, task.guard = (None, iq.PitchForm(0.1))[rng.integers(2)], (None, iq.velocity.Guard())[rng.integers(2)]
    task.damping = (iq.velocity.Fixed(0.0), iq.velocity.Adaptive())[rng.integers(2)]
    more = (0.0, 1e-3, 1.0)[rng.integers(3)]
    native = task._moved(J, s, root, more)
    with mock.patch("invariantqp.control.frame_cost.core", None):
        python = task._moved(J, s, root, more)
    for one, other in zip(native, python, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12 * np.abs(other).max())


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
    controller = iq.Controller(robot, dt=0.01, exact=exact, **limits)
    assert controller.compiled is not None
    middle = 0.5 * (robot.position_lower + robot.position_upper)
    q = middle + np.linspace(0.07, 0.14, len(middle))  # no two joints alike: no ties for rounding to break
    goal = robot.pose(q)
    methods, answered = set(), 0
    for k in range(60):
        goal = iq.exp([0.0, 0.0, 0.003, 0.006 * np.sin(0.05 * k), 0.006, 0.0]) @ goal
        ahead = np.array([0.0, 0.0, 0.3, 0.0, 0.6, 0.0])
        answered += compiled_tick(controller.compiled, controller.kept.copy(), q, goal, ahead, None) is not None
        tick = (controller, q, goal, ahead)
        solution = assert_same(*tick) if k % 3 == 0 else controller.step(*tick[1:])  # Python takes its time
        methods.add(solution.method)
        q = q + 0.01 * solution.velocity
    assert methods & {"qp", "damped"}
    assert answered > 30 or m < 6  # too few joints are left for a tool speed, or none


@pytest.mark.parametrize("exact", [None, "position", [PLANE, AXIS]], ids=str)
@pytest.mark.parametrize("limits", [{}, {"acceleration_limit": 5.0}, SLOW], ids=str)
def test_a_twist_is_followed_as_in_python(exact, limits):
    robot = iq.load_robot("panda")
    controller = iq.Controller(robot, dt=0.01, exact=exact, **limits)
    q, met, answered = 0.5 * (robot.position_lower + robot.position_upper) + 0.1, set(), 0
    controller.step(q, robot.pose(q + 0.01))
    for k in range(60):
        twist = 0.2 * np.sin([0.1 * k, 0.3, 1.0, 2.0 + 0.05 * k, 0.5, 3.0]) * (20.0 if k > 30 else 1.0)
        other, velocity = copy(controller), (None, np.full(7, 0.01))[k % 2]
        with python_alone():
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
    assert answered > 40
    assert met & {"qp", "damped"}


@pytest.mark.parametrize("limit", [0.5, 5.0, [np.inf, 5.0, 0.5, 50.0, 5.0, 5.0, 5.0]], ids=str)
def test_acceleration_limits_to_a_target_at_rest_and_beside_a_limit(limit):
    robot = iq.load_robot("panda")
    controller = iq.Controller(robot, dt=0.01, acceleration_limit=limit)
    q = 0.5 * (robot.position_lower + robot.position_upper) + 0.1
    goal = robot.pose(np.minimum(q + 0.4, robot.position_upper))
    for _ in range(120):
        q = q + 0.01 * assert_same(controller, q, goal).velocity
    outside = np.where(np.arange(7) == 3, robot.position_upper + 2e-3, q)
    assert "outside its position range" in assert_same(controller, outside, goal).reason
    noisy = np.minimum(outside, robot.position_upper + 1e-4)
    assert "outside" not in assert_same(controller, noisy, goal).reason
    fast = copy(controller).step(q, goal, None, np.full(7, 2.0))  # as measured, faster than the commanded one
    with python_alone():
        np.testing.assert_allclose(fast.velocity, copy(controller).step(q, goal, None, np.full(7, 2.0)).velocity)


def test_a_target_in_any_form(panda):
    controller, q = panda
    pose = controller.robot.pose(q + 0.01)
    ways = (pose, controller.robot.target(pose), np.asfortranarray(pose), pose.tolist())
    steps = [copy(controller).step(q, way) for way in ways]
    for step in steps[1:]:
        np.testing.assert_allclose(step.velocity, steps[0].velocity, rtol=1e-12, atol=1e-14)


@pytest.fixture
def panda():
    robot = iq.load_robot("panda")
    return iq.Controller(robot, dt=0.01), 0.5 * (robot.position_lower + robot.position_upper) + 0.1


def test_python_says_what_is_wrong(panda):
    controller, q = panda
    pose = controller.robot.pose(q)
    controller.step(q, pose)
    before = controller.kept.copy()
    bad = pose.copy()
    bad[3, 0] = 1.0
    for arguments in (
        (np.full(7, np.nan), pose),
        (q[:6], pose),
        (q, bad),
        (q, np.nan * pose),
        (q, 2.0 * pose),
        (q, pose, np.full(6, np.inf)),
        (q, pose, None, q[:3]),
    ):
        with pytest.raises(iq.BadInput):
            controller.step(*arguments)
        np.testing.assert_array_equal(controller.kept, before)
    for twist in (np.full(6, np.nan), np.zeros(5), np.full(6, 2e12), None):
        with pytest.raises(iq.BadInput):
            controller.follow(q, twist)
        np.testing.assert_array_equal(controller.kept, before)
    for target in (None, "home", np.eye(3)):
        with pytest.raises(iq.BadInput):
            controller.step(q, target)


@pytest.mark.parametrize("angle", [0.79 * np.pi, 0.81 * np.pi, np.pi])
def test_turns_near_half_a_turn(panda, angle):
    controller, q = panda
    target = controller.robot.pose(q) @ iq.exp([0.0, 0.6 * angle, 0.8 * angle, 0.0, 0.0, 0.0])
    for _ in range(3):
        assert_same(controller, q, target)


def test_not_converging_is_told(panda):
    controller, q = panda
    target = controller.robot.pose(q + 0.3)
    for _ in range(60):  # an arm that does not move
        solution = assert_same(controller, q, target)
    assert "not converging" in solution.reason


OTHERS = {
    "exact": lambda: iq.ExactRows(np.tri(9, 7), np.zeros(9)),
    "rows": lambda: lambda _: iq.limits.LimitRows(np.eye(7)[:1], [-1.0], [1.0]),
    "form": lambda: iq.PitchForm(0.1, convexified=True),
    "point": lambda: "own",
    "backend": lambda: "osqp",
}


@pytest.mark.parametrize("option", OTHERS)
def test_other_loops_are_python_s(panda, option):
    assert iq.Controller(panda[0].robot, dt=0.01, **{option: OTHERS[option]()}).compiled is None


def test_a_robot_that_may_change_is_python_s(panda):
    robot = panda[0].robot

    class Wrapped:
        def __getattr__(self, name):
            return getattr(robot, name)

    assert iq.Controller(Wrapped(), dt=0.01).compiled is None


def test_masked_numbers_are_refused_and_other_subclasses_taken():
    robot = iq.load_robot("ur5e")
    q = np.array([0.3, -1.2, 1.5, -1.0, 1.0, 0.3])
    here, twist = robot.pose(q), np.full(6, 0.1)
    loop = iq.Controller(robot, dt=0.002, acceleration_limit=5.0)

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
    np.testing.assert_allclose(found.velocity, iq.Controller(robot, dt=0.002).step(q, here).velocity, atol=1e-12)
