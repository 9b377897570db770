"""The engine's loop: it is the definition with every option, its state is a value, and nothing but numbers gets in."""

import copy
import pickle

import numpy as np
import pytest
from support.arms import ready
from support.loops import OwnDemand, drive

import invariantqp as iq
from invariantqp import _core
from invariantqp.control import ExactAxis, ExactPlane, ExactPoint
from invariantqp.limits import AccelerationLimit, JointLimits, LimitRows, ToolSpeed

DT = 0.005
ARMS = ("panda", "ur5", "so101")
OPTIONS = {
    "plain": {},
    "braking": {"acceleration_limit": 8.0},
    "late": {"delay": 0.02, "acceleration_limit": 20.0},
    "exact": {"exact": "position"},
    "exact axis and joint": {"exact": [ExactAxis([0.0, 0.0, 1.0]), ExactPlane([0.0, 0.2, 1.0], [0.0, 0.0, 0.02])]},
    "tool speed": {"tool_speed": 0.1},
    "rows": {"limits": [lambda q: LimitRows(np.ones((1, len(q))), [-0.2], [0.1 + 0.1 * np.cos(q[0])])]},
    "pitch": {"form": 0.2, "guard": False, "damping": 0.01},
    "metric": {"form": iq.CarriedMetric(np.array([0.2, 0.2, 0.2, 1.0, 1.0, 2.0]))},
    "own point": {"point": "own"},
}


def driven(loop, q, target, ticks, **more):
    """Velocities and statuses of some ticks of an arm that does what is commanded."""
    x, said = [], []
    for k in range(ticks):
        solution = loop.step(q, target, **more) if k % 3 else loop.step(q, target, np.full(6, 0.02), **more)
        q = q + DT * solution.velocity
        x.append(solution.velocity)
        said.append((solution.status, solution.active))
    return np.array(x), said


def goal(robot, q, size=0.3):
    return robot.pose(q + size * np.sin(np.arange(len(q)) + 1.0))


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("kind", OPTIONS)
def test_it_is_the_definition_solved_by_another_library(name, kind):
    robot, q = iq.load_robot(name), ready(name)
    engine, other = (iq.Controller(robot, dt=DT, backend=backend, **OPTIONS[kind]) for backend in (None, "daqp"))
    target = goal(robot, q)
    for k in range(25):
        other.state = engine.state
        found, wanted = engine.step(q, target), other.step(q, target)
        scale = max(1.0, np.abs(wanted.velocity).max())
        np.testing.assert_allclose(found.velocity, wanted.velocity, rtol=0.0, atol=1e-6 * scale, err_msg=f"{k}")
        assert (found.status, found.active) == (wanted.status, wanted.active)
        q = q + DT * found.velocity


class Bare:
    """A robot of the user's own: names, limits, poses and Jacobians; its class is no Chain."""

    def __init__(self, chain):
        self._chain = chain

    def __getattr__(self, name):
        return getattr(self._chain, name)


@pytest.mark.parametrize("options", [{}, {"exact": "position"}, {"acceleration_limit": 8.0, "delay": 0.01}], ids=str)
def test_robots_and_demands_of_the_users_own_have_the_same_ticks(options):
    chain, q = iq.load_robot("panda"), ready("panda")
    target, wanted = goal(chain, q), iq.Controller(chain, dt=DT, **options)
    expected = driven(wanted, q, target, 40)
    made = [iq.Controller(Bare(chain), dt=DT, **options)]
    if "exact" in options:
        made.append(iq.Controller(chain, dt=DT, exact=OwnDemand(ExactPoint())))
    for loop in made:
        found = driven(loop, q, target, 40)
        np.testing.assert_allclose(found[0], expected[0], rtol=0.0, atol=1e-9)
        assert found[1] == expected[1]


def test_a_state_is_a_value():
    robot, q = iq.load_robot("panda"), ready("panda")
    loop, target = iq.Controller(robot, dt=DT, delay=0.012, acceleration_limit=10.0), goal(robot, q)
    fresh = loop.state
    driven(loop, q, target, 7)
    state = loop.state
    assert state != fresh
    assert state == copy.copy(state) == copy.deepcopy(state) == pickle.loads(pickle.dumps(state))
    assert state != "a state"
    first = loop.step(q, target).velocity
    assert loop.state != state
    loop.state = state
    np.testing.assert_array_equal(loop.step(q, target).velocity, first)
    np.testing.assert_array_equal(loop.state.command, first)
    np.testing.assert_array_equal(loop.state.positions, q)
    for other in (iq.Controller(iq.load_robot("ur5"), dt=DT).state, None, fresh.numbers):
        with pytest.raises(iq.BadInput, match="state: found"):
            loop.state = other


def test_a_joint_that_is_locked_stops_no_redundant_arm():
    """What its joints move without the tool does not slow the approach down."""
    robot, q = iq.load_robot("panda"), ready("panda")
    target = iq.transform(translation=[0.1, 0.2, -0.1]) @ robot.pose(q)
    for joint in range(7):
        fastest = np.full(7, np.inf)
        fastest[joint] = 0.0
        x, _ = drive(iq.Controller(robot, dt=DT, limits=[JointLimits(velocity_limit=fastest)]), q, target, 400).end
        assert x[joint] == q[joint]
        if joint not in (3, 5):  # without which this arm's plane is a singularity that it does not leave
            assert np.linalg.norm((robot.pose(x) - target)[:3, 3]) < 1e-3


@pytest.mark.parametrize("m", [1, 2, 7, 16, 17, 33, 64])
def test_chains_of_up_to_64_joints(m):
    rng = np.random.default_rng(m)
    screws = [iq.revolute(np.eye(3)[rng.integers(3)], 0.1 * k * np.eye(3)[2]) for k in range(m)]
    chain = iq.robots.Chain(np.column_stack(screws), iq.transform(translation=[0, 0, 0.1 * m]), (), -2.0, 2.0, 1.0)
    q, rows = rng.uniform(-0.5, 0.5, m), LimitRows(rng.normal(size=(200, m)), np.full(200, -0.5), np.full(200, 0.5))
    for limits in ([], [rows], [AccelerationLimit(5.0), ToolSpeed(0.1)]):
        loop, before, x = iq.Controller(chain, dt=0.01, limits=limits), np.zeros(m), q
        for _ in range(10):
            solution = loop.step(x, chain.pose(q + 0.3))
            v = solution.velocity
            assert (np.abs(v) <= 1.0).all()
            assert not limits or limits[0] is not rows or np.abs(rows.excess(v)).max() < 1e-7
            assert not limits or limits[0] is rows or np.abs(v - before).max() <= 0.05 * (1.0 + 1e-9)
            before, x = v, x + 0.01 * v
    if m == 64:
        more = iq.robots.Chain(np.column_stack([*screws, screws[0]]), np.eye(4))
        with pytest.raises(iq.BadInput, match="robot: found 65 joints; expected at most 64"):
            iq.Controller(more, dt=0.01)


def test_errors_of_the_users_functions_come_through_and_leave_the_loop_as_it_was():
    robot, q = iq.load_robot("ur5"), ready("ur5")

    def broken(_q):
        raise ValueError("the user's own")

    loop = iq.Controller(robot, dt=DT, limits=[broken])
    before = loop.state
    with pytest.raises(ValueError, match="the user's own"):
        loop.step(q, robot.pose(q))
    assert loop.state == before


# What the engine itself is given, by hand.


def made(name="ur5", **changes):
    loop = iq.Controller(iq.load_robot(name), dt=DT)
    return loop._settings | {"chain": loop.robot.in_engine} | changes


HOSTILE = (None, "a", b"b", 1j, np.nan, [], [1.0], {})
HOSTILE += (np.zeros(7), np.zeros((6, 6)), np.full(6, np.nan), np.ones(6, bool))
MAY_BE_ABSENT = {"rows", "tool_speed", "posture", "pull", "metric", "chain"}


def test_hostile_settings_and_arguments_are_errors():
    settings = made()
    for name, value in settings.items():
        for wrong in HOSTILE:
            try:
                _core.Loop(settings | {name: wrong})
            except (ValueError, TypeError, KeyError, RuntimeError):
                continue
            may = np.shape(wrong) == np.shape(value) or name in {"exact", "measured", "form", "root"}
            assert may or (wrong is None and (value is None or name in MAY_BE_ABSENT)), (name, wrong)
    loop, state, q, T = _core.Loop(settings), _core.LoopState(6, 0.0, DT), ready("ur5"), np.eye(4)
    good = (state, q, T, np.zeros(6), np.zeros(6), False, False, None, None, np.zeros(6), None, None, np.zeros(3))
    loop.tick(*good)
    for i in range(len(good)):
        for wrong in HOSTILE:
            fits = isinstance(wrong, np.ndarray) and wrong.shape == np.shape(good[i]) and wrong.dtype == float
            if wrong is None or (fits and np.isfinite(wrong).all()):
                continue
            arguments = list(good)
            arguments[i] = wrong
            before = state.numbers
            with pytest.raises((ValueError, TypeError, RuntimeError)):
                loop.tick(*arguments)
            np.testing.assert_array_equal(state.numbers, before)
    for arguments in ((0, 0.0, DT), (65, 0.0, DT), (6, -1.0, DT), (6, 1e9, DT), (6, 0.0, 0.0), (6, np.nan, DT)):
        with pytest.raises(ValueError, match="no loop"):
            _core.LoopState(*arguments)
    with pytest.raises(ValueError, match="no state"):
        _core.LoopState.__new__(_core.LoopState).__setstate__((6, 0, 0.0, b"short"))
