"""A tick along a path in the compiled core is that of Python: the same answer, the same state after it."""

import copy
import pickle
from contextlib import contextmanager

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import invariantqp as iq
from invariantqp.control.path_compiled import RULINGS, compiled_drive
from invariantqp.engine import core

pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
# Rounding of a pose, times the gain, in a velocity.
ROUNDING = 1e-13
AXIS, PLANE = iq.control.ExactAxis([0.2, 0.0, 1.0]), iq.control.ExactPlane([0.0, 0.3, 1.0], [0.0, 0.0, 0.1])
ORDER = (None, 1.0, False, False)  # neither paused nor backward
RISE = "acceleration limits"
# Arm, form, exact demands and limits, what is asked of the path, noise of the encoders [rad], seed.
DRIVES = [
    ("panda", {}, {"rate": 0.5}, 0.0, 0),
    ("panda", {RISE: 0.3}, {}, 1e-4, 1),
    ("panda", {"exact": [PLANE, AXIS], "tool_speed": 0.3}, {"acceleration": 2.0}, 0.0, 2),
    ("ur5", {"form": iq.PitchForm(0.2)}, {}, 1e-3, 3),
    ("ur5", {RISE: 0.2, "exact": "position"}, {"rate": 3.0}, 1e-5, 4),
    ("xarm7", {RISE: 0.2}, {"rate": 1.0}, 0.0, 5),
    ("so101", {"exact": "position"}, {"rate": 0.4}, 1e-5, 6),
    ("so101", {RISE: 0.2}, {"acceleration": 2.0, "jerk": 20.0}, 0.0, 7),
]


@contextmanager
def python_alone(follower):
    """The follower by Python, with the memory of its loop."""
    loop = follower.controller
    follower.controller = loop.by_engine("python")
    yield
    loop.kept[:] = follower.controller.kept
    follower.controller = loop


def started(name, options, given, seed):
    """A follower that has looked along a smooth path, and joint positions at its start."""
    robot, rng = iq.load_robot(name), np.random.default_rng(seed)
    middle, half = 0.5 * (robot.position_upper + robot.position_lower), robot.position_upper - robot.position_lower
    knots = middle + np.cumsum(rng.uniform(-0.06, 0.06, (3, len(middle))) * np.minimum(half, 6.0), axis=0)
    joints = CubicSpline([0.0, 0.5, 1.0], knots)
    options = dict(options)
    if RISE in options:
        options["acceleration_limit"] = robot.velocity_limit / options.pop(RISE)
    follower = iq.PathFollower(iq.Controller(robot, dt=0.005, **options), lambda u: robot.pose(joints(u)), **given)
    follower.prepare(joints(0.0))
    return follower, joints(0.0)


def by_core(follower, *tick):
    """The tick by the core; None where it hands it back."""
    course = follower._course or follower._made_course()
    found = compiled_drive(course, *tick, follower._paused, follower._wants_back)
    return None if found is None else follower._told(found[0], tick[0]) if found[1] else found[0]


def in_python(follower, *tick):
    """The tick by Python and the state after it; the follower is as it was."""
    state, memory = follower._kept.copy(), follower.controller.kept.copy()
    with python_alone(follower):
        answer = follower.step(*tick)
    after, follower._kept[:], follower.controller.kept[:] = follower._state, state, memory
    return answer, after


def assert_same(native, state, python, after, gain):
    near = 1e-10 * np.abs(python.velocity).max() + ROUNDING * gain
    np.testing.assert_allclose(native.velocity, python.velocity, rtol=0.0, atol=near)
    assert (native.status, native.ruling, native.reason) == (python.status, python.ruling, python.reason)
    told = [np.array([s.place, s.speed, s.across, s.lag], float) for s in (native, python)]  # None is NaN
    np.testing.assert_allclose(*told, rtol=1e-9, atol=1e-9)
    for one, other in zip(state, after, strict=True):
        np.testing.assert_allclose(np.asarray(one, float), np.asarray(other, float), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "options", "given", "noise", "seed"), DRIVES, ids=str)
def test_a_drive_with_turns_and_pauses(name, options, given, noise, seed):
    follower, q = started(name, options, given, seed)
    rng, answered, told, override = np.random.default_rng(seed), 0, set(), 1.0
    for k in range(180):
        if k in (90, 130):
            follower.reverse()
        if k in (15, 75):
            (follower.pause if k == 15 else follower.resume)()
        if k % 30 == 0:
            override = (1.0, float(rng.uniform(0.2, 1.5)))[rng.integers(2)]
        seen = q + noise * rng.normal(size=len(q))
        python = in_python(follower, seen, None, override) if k % 11 == 0 or k < 2 else None
        solution = by_core(follower, seen, None, override)
        answered += solution is not None
        if solution is None:
            solution = follower.step(seen, None, override)
        elif python is not None:
            assert_same(solution, follower._state, *python, follower.controller.gain)
        told.add(solution.status)
        q = q + follower.controller.dt * solution.velocity
        if solution.status == "done":
            break
    assert answered >= 0.9 * k
    assert "slowed" in told
    assert "paused" in told or noise  # with noise joints are never quite at rest


def test_a_drive_that_changes_hands_ends_the_same():
    ends = []
    for hands in (lambda k: True, lambda k: k % 5 == 0):
        follower, q = started("so101", {RISE: 0.2}, {"acceleration": 1.0, "jerk": 20.0}, 7)
        for k in range(400):
            if hands(k):
                with python_alone(follower):
                    solution = follower.step(q)
            else:
                solution = follower.step(q)
            q = q + follower.controller.dt * solution.velocity
            if solution.status == "done":
                break
        ends.append((k, *q))
    assert ends[0][0] < 399
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("exact", [PLANE, [PLANE, AXIS], "position", [iq.control.ExactPoint(), AXIS]])
def test_a_tool_that_is_off_its_path_and_turned(exact):
    robot, q = iq.load_robot("panda"), np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
    home, turned = robot.pose(q), iq.exp([*(1.2 * AXIS.axis), 0.0, 0.0, 0.0])[:3, :3]
    follower = iq.PathFollower(
        iq.Controller(robot, dt=0.005, exact=exact, acceleration_limit=10.0),
        lambda u: iq.transform(home[:3, :3] @ turned, home[:3, 3] + [0.0, 0.1 * u, 0.0]),
    )
    follower.prepare(q)
    answered = 0
    for k in range(60):
        q = q + (k == 20) * 3e-3 * np.cos(np.arange(7.0))
        python = in_python(follower, q)
        solution = by_core(follower, q, None, 1.0)
        answered += solution is not None
        if solution is None:
            solution = follower.step(q)
        else:
            assert_same(solution, follower._state, *python, follower.controller.gain)
        q = q + follower.controller.dt * solution.velocity
    assert answered > 40


def test_what_python_has_to_do():
    follower, q = started("panda", {}, {"rate": 0.5}, 0)
    assert by_core(follower, q, None, 1) is not None
    for tick in ((q + 0.3, None, 1.0), (q.tolist(), None, 1.0), (q, None, 1.6), (q, None, 10**400), (q, q[:3], 1.0)):
        assert by_core(follower, *tick) is None
    for bad in (q * np.nan, q[:3]):
        with pytest.raises(iq.errors.BadInput, match="q"):
            follower.step(bad)


def test_the_core_refuses_what_is_no_course():
    follower, q = started("so101", {}, {"rate": 0.5}, 6)
    follower.step(q)
    course = follower._course
    numbers, kept, state, loop = course.numbers, course.kept, course.state, course.loop
    bad = [{"numbers": n} for n in (numbers[:-1], numbers[:4], np.append(numbers, 0.0), numbers.tolist())]
    bad += [{"numbers": np.where(numbers == 5.0, 6.0, numbers)}]
    bad += [{"rulings": words} for words in (RULINGS, list(course.rulings))]
    bad += [{"kept": k} for k in (kept[:-1], kept.tolist(), kept.astype(np.float32))]
    bad += [{"state": k} for k in (state[:-1], state.tolist(), follower._state)]
    bad += [{"loop": other} for other in (None, loop.law, np.zeros(9))]
    for changed in (*(course._replace(**fields) for fields in bad), course[:-1], list(course)):
        with pytest.raises(TypeError, match="drive"):
            core.drive(changed, q, *ORDER)
    with pytest.raises(TypeError, match="named tuple"):
        core.tell_as(int, iq.Status)


def test_another_controller_drives_from_its_first_tick():
    follower, q = started("panda", {}, {}, 0)
    follower.step(q)
    follower.controller = iq.Controller(follower.controller.robot, dt=0.005, tool_speed=0.01)
    python, after = in_python(follower, q)
    native = follower.step(q)
    assert_same(native, follower._state, python, after, follower.controller.gain)
    np.testing.assert_array_equal(follower.controller.memory.commands[0], native.velocity)
    assert type(follower._state) is type(after)


def test_a_velocity_that_is_changed_afterwards_is_not_what_was_commanded():
    follower, q = started("so101", {RISE: 0.2}, {}, 6)
    with python_alone(follower):
        follower.step(q).velocity[:] = 0.0
    assert follower._state.velocity.any()


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda follower: pickle.loads(pickle.dumps(follower))])
def test_a_copy_drives_by_itself(copied):
    follower, q = started("so101", {RISE: 0.2}, {}, 6)
    follower.step(q)
    other, kept = copied(follower), follower._kept.copy()
    moved = [other.step(q) for _ in range(3)]
    np.testing.assert_array_equal(follower._kept, kept)
    assert other._state.ticks == follower._state.ticks + 3
    assert moved == [follower.step(q) for _ in range(3)]
