"""One robot in several threads and processes: the answers are those of one thread."""

import copy
import pickle
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from support.arms import ready
from support.workers import give

import invariantqp as iq

THREADS, TICKS = 6, 480


@pytest.fixture
def impatient():
    """Threads that take turns every few microseconds, in the middle of a tick."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.fixture(scope="module")
def arm():
    return iq.load_robot("ur5")


def kinematics_of(robot, q, target):
    state = robot.state(q, target)
    here, there = robot.points(state, target, np.array([0.0, 0.0, 0.1]))
    return state.J, state.error, robot.pose(q), robot.jacobian(q), robot.origins(q), here, there


def test_six_threads_share_a_robot(arm, impatient):
    robot, rng = arm, np.random.default_rng(0)
    states = [(q, robot.target(robot.pose(q + 0.1))) for q in rng.uniform(-2.0, 2.0, size=(TICKS // THREADS, 6))]
    alone = [kinematics_of(robot, *state) for state in states]

    def ticks(first):
        order = (np.arange(TICKS) * 7 + first) % len(states)
        return sum(not all(map(np.array_equal, kinematics_of(robot, *states[i]), alone[i])) for i in order)

    with ThreadPoolExecutor(THREADS) as pool:
        wrong = list(pool.map(ticks, range(THREADS)))
    assert wrong == [0] * THREADS


def test_six_controllers_share_a_robot(impatient):
    """Each thread runs a loop of its own, from the same start to the same target."""
    robot = iq.load_robot("panda")
    start = ready("panda")
    target = iq.exp([0.1, 0.2, 0.3, 0.02, -0.01, 0.03]) @ robot.pose(start)

    def run(_):
        loop, q, path = iq.Controller(robot, dt=0.002, form=0.3), start, []
        for _ in range(300):
            q = q + loop.dt * loop.step(q, target).velocity
            path.append(q)
        return np.array(path)

    alone = run(0)
    with ThreadPoolExecutor(THREADS) as pool:
        for path in pool.map(run, range(THREADS)):
            np.testing.assert_array_equal(path, alone)


TRAVELS = {
    "copied": copy.copy,
    "deep-copied": copy.deepcopy,
    "pickled": lambda robot: pickle.loads(pickle.dumps(robot)),
}


@pytest.mark.parametrize("way", TRAVELS)
def test_robots_are_copied_and_pickled(arm, way):
    robot, q = arm.with_tool(iq.exp([0.1, 0.2, 0.3, 0.1, 0.0, 0.2])), np.linspace(-1.0, 1.0, 6)
    again = TRAVELS[way](robot)
    assert again == robot
    assert hash(again) == hash(robot)
    assert repr(again) == repr(robot)
    assert again != arm
    assert not again.velocity_limit.flags.writeable
    for a, b in zip(kinematics_of(again, q, np.eye(4)), kinematics_of(robot, q, np.eye(4)), strict=True):
        np.testing.assert_array_equal(a, b)


def test_robots_are_sent_to_other_processes(arm):
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert pool.submit(give, arm).result(60.0) == arm


def test_a_robots_limits_cannot_be_written_to(arm):
    with pytest.raises(ValueError, match="read-only"):
        arm.velocity_limit[0] = 9.0
    with pytest.raises(AttributeError):
        arm.velocity_limit = np.ones(6)


def test_a_chain_keeps_its_own_arrays():
    screws, home, limit = np.eye(6), np.eye(4), np.ones(6)
    chain = iq.robots.Chain(screws, home, velocity_limit=limit)
    before = chain.pose(np.full(6, 0.3))
    screws[:], home[:], limit[:] = 7.0, 7.0, 7.0
    np.testing.assert_array_equal(chain.pose(np.full(6, 0.3)), before)
    np.testing.assert_array_equal(chain.velocity_limit, np.ones(6))
