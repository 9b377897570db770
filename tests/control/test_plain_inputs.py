"""Lists, tuples, float32 and whole numbers: the answer of arrays, by the compiled core."""

import numpy as np
import pytest
from support.arms import READY

import invariantqp as iq

ARMS = ("panda", "ur5")


def rows_of(value, of):
    """A vector or a matrix whose rows are made by a function."""
    return of(of(row.tolist()) for row in value) if value.ndim == 2 else of(value.tolist())


PLAIN = {
    "lists": lambda a: rows_of(a, list),
    "tuples": lambda a: rows_of(a, tuple),
    "NumPy's numbers": lambda a: [list(row) for row in a] if a.ndim == 2 else list(a),
    "float32 in lists": lambda a: [list(row) for row in np.float32(a)] if a.ndim == 2 else list(np.float32(a)),
    "float32": np.float32,
    "big-endian": lambda a: a.astype(">f8"),
    "columns first": np.asfortranarray,
}


def ticks(robot, q, as_given, steps=12):
    """Every call of a loop with arguments of a kind: the velocities that they return."""
    m, x = len(q), []
    target, point = robot.pose(q + 0.02), robot.pose(q)[:3, 3]
    led, speed, posture = np.array([0.0, 0.1, 0.0, 0.05, 0.0, 0.1]), 0.1 * np.ones(m), 0.1 * np.ones(m)
    target, led, speed, posture, twist = map(as_given, (target, led, speed, posture, np.array([0, 0, 0.1, 0, 0.05, 0])))
    plain, braked = iq.Controller(robot, dt=0.002), iq.Controller(robot, dt=0.002, acceleration_limit=8.0)
    exact = iq.Controller(robot, dt=0.002, exact="position")
    follower = iq.Follower(iq.Controller(robot, dt=0.002, acceleration_limit=8.0), jerk=200.0)
    joystick = iq.Follower(iq.Controller(robot, dt=0.002, acceleration_limit=8.0), jerk=200.0)
    task = iq.HybridTask(iq.contacts.point_contact(point, normal=[0, 0, 1]), [5.0], stiffness=1e4)
    press = iq.HybridController(robot, task, dt=0.002, order="moment first")
    reading = as_given(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5]))
    for k in range(steps):
        at = as_given(q + 1e-3 * np.sin(k + np.arange(m)))
        follower.add(target, 0.02 * k)
        joystick.twist(twist)
        told = [
            plain.step(at, robot.target(target)),  # as `robot.state` takes it
            plain.step(at, target),
            plain.step(at, target, led, speed=0.5, velocity_limit=as_given(2.0 * np.ones(m))),
            braked.step(at, target, led, speed),
            exact.step(at, target, led),
            plain.follow(at, twist),
            plain.follow(at, twist, at="base", posture=posture, velocity=speed),
            follower.step(at, now=0.02 * k),
            joystick.step(at),
            press.step(at, target, reading, led, velocity=speed, posture=posture),
        ]
        x.append([one.velocity for one in told])
    return np.array(x)


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("kind", PLAIN)
def test_the_answer_is_that_of_arrays(name, kind):
    robot, q = iq.load_robot(name), np.array(READY[name])
    as_given = PLAIN[kind]
    same = np.float32 if "float32" in kind else np.asarray
    expected = ticks(robot, q, lambda a: np.asarray(same(a), np.float64))

    np.testing.assert_array_equal(ticks(robot, q, as_given), expected)


@pytest.mark.parametrize("name", ARMS)
def test_whole_numbers_are_numbers(name):
    robot, whole = iq.load_robot(name), [0, -1, 1, -2, 1, 1, 1][: len(READY[name])]
    for kind in (list, tuple, np.array, np.int8, np.int32, np.float16):
        loops = iq.Controller(robot, dt=0.01), iq.Controller(robot, dt=0.01)
        one = loops[0].follow(kind(whole), [0, 0, 0, 0, 0, 1]).velocity
        np.testing.assert_array_equal(one, loops[1].follow(np.array(whole, float), np.eye(6)[5]).velocity)


WRONG = {
    "NaN": [np.nan] + [0.0] * 5,
    "None": [None] + [0.0] * 5,
    "a text": ["0.1"] + [0.0] * 5,
    "truth values": np.ones(6, bool),
    "complex": [1j] + [0.0] * 5,
    "too short": [0.0] * 5,
    "too long": (0.0,) * 7,
    "a row": [[0.0] * 6],
    "a huge number": [10**400] + [0] * 5,
    "infinite": [float("inf")] + [0] * 5,
    "float16 NaN": np.full(6, np.nan, np.float16),
    "objects": np.array([0.0] * 5 + ["x"], object),
}


@pytest.mark.parametrize("backend", [None, "osqp"])
@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_bad_vectors_are_refused_by_name_and_leave_the_loop_as_it_was(wrong, backend):
    robot, q = iq.load_robot("ur5"), np.array(READY["ur5"])
    loop = iq.Controller(robot, dt=0.01, acceleration_limit=8.0, backend=backend)
    loop.step(q, robot.pose(q + 0.1))
    before = loop.state
    calls = {
        "q": lambda: loop.step(wrong, robot.pose(q)),
        "feedforward": lambda: loop.step(q, robot.pose(q), wrong),
        "velocity": lambda: loop.step(q, robot.pose(q), None, wrong),
        "twist": lambda: loop.follow(q, wrong),
        "posture": lambda: loop.follow(q, np.zeros(6), posture=wrong),
        "v": lambda: iq.Follower(loop).twist(wrong),
    }
    for argument, call in calls.items():
        with pytest.raises(iq.BadInput, match=rf"^{argument}: found "):
            call()
    assert loop.state == before


@pytest.mark.parametrize("name", ARMS)
def test_a_target_of_few_digits_counts_as_the_nearest_rotation(name):
    robot, q = iq.load_robot(name), np.array(READY[name])
    target = robot.pose(q + 0.3)
    for digits in (4e-6, 6e-8, 1e-10):
        rough = target.copy()
        rough[:3, :3] += digits * np.random.default_rng(3).uniform(-1.0, 1.0, (3, 3))
        U, _, Vt = np.linalg.svd(rough[:3, :3])
        exact = iq.transform(U @ Vt, target[:3, 3])
        x = [iq.Controller(robot, dt=0.01).step(q, given).velocity for given in (rough, exact)]
        np.testing.assert_allclose(x[0], x[1], rtol=0.0, atol=1e-9)
