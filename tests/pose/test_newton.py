"""A try at a pose in the compiled core is the try of Python: to the same joint positions, in as many steps."""

from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fuzz_ticks import random_chain

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.pose import newton
from invariantqp.pose.error import pose_arm, pose_error

pytestmark = pytest.mark.skipif(core is None, reason="no compiled core here")
ARMS = [iq.load_robot(name) for name in ("panda", "ur5", "so101")]
# Where a minimum is, is the root of what it is; the second derivative by differences has seven digits.
SAME = 1e-4
HOW = 1e-9, True, False, None  # goal, turning, patient, what is known


def both(robot, target, start, exact=(), **how):
    """The same try by the core and by Python."""
    arm = pose_arm(robot)
    error = pose_error(arm, target, None, exact)
    assert error.compiled is not None
    start = arm.space.inside(start)
    native = newton.descend(error, arm.space, start, 1e-9, inf, **how)
    return native, newton.descend(error._replace(compiled=None), arm.space, start, 1e-9, inf, **how)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**63), rows=st.integers(0, 2), patient=st.booleans(), turning=st.booleans(), far=st.booleans()
)
def test_the_same_try(seed, rows, patient, turning, far):
    rng = np.random.default_rng(seed)
    robot = ARMS[rng.integers(len(ARMS))] if rows or rng.random() < 0.6 else random_chain(rng)
    point, axis = rng.normal(size=3), rng.normal(size=3)
    kinds = iq.control.ExactPoint(0.1 * point), iq.control.ExactAxis(axis), iq.control.ExactPlane(axis, 0.1 * point)
    exact = tuple(kinds[i] for i in rng.permutation(3)[:rows])
    low, high = np.maximum(robot.position_lower, -3.0), np.minimum(robot.position_upper, 3.0)
    q, start = rng.uniform(np.minimum(low, high), high, (2, len(low)))
    target = iq.exp(rng.normal(size=6)) @ robot.pose(q) if far else robot.pose(q)
    native, python = both(robot, target, start, exact, patient=patient, turning=turning)
    assert (native.met, native.at_rest) == (python.met, python.at_rest)
    assert patient or native.steps == python.steps  # of the last digits, rounding decides
    assert native.f == pytest.approx(python.f, rel=SAME, abs=1e-18)
    assert native.unmet == pytest.approx(python.unmet, rel=SAME, abs=1e-9)
    np.testing.assert_allclose(native.q, python.q, rtol=0.0, atol=SAME * (1.0 + np.abs(python.q).max()))
    assert (robot.position_lower <= native.q).all()
    assert (native.q <= robot.position_upper).all()


def test_the_clock_is_looked_at_within_a_try(monkeypatch):
    robot, rng = ARMS[0], np.random.default_rng(0)
    q, start = [rng.uniform(robot.position_lower, robot.position_upper, (2, 7)) for _ in range(2)][1]
    target = robot.pose(q)
    target[:3, 3] *= 1.2
    error = pose_error(pose_arm(robot), target, None, (iq.control.ExactPoint(),))
    ticks = iter(range(1000))
    monkeypatch.setattr(newton, "perf_counter", lambda: next(ticks))
    found = newton.descend(error, pose_arm(robot).space, start, 1e-9, 6, patient=True)
    assert 0 < found.steps < 200  # of a thousand
    assert not found.at_rest
    assert not found.met


def test_turns_up_to_half_a_turn_and_what_is_missed():
    robot, q = ARMS[0], np.array([0.1, -0.4, 0.2, -2.2, 0.1, 1.8, 0.8])
    arm = pose_arm(robot)
    for axis in (*np.eye(3), [0.6, 0.0, 0.8]):
        for angle in (0.0, 1e-3, 1.0, 3.0, np.pi - 1e-9):
            move = iq.exp([*(angle * np.array(axis)), 0.0, 0.0, 0.0])
            move[:3, 3] = 0.1, -0.2, 0.3
            error = pose_error(arm, move @ robot.pose(q), None, ())
            native = error.misses(q)
            np.testing.assert_allclose(native, error._replace(compiled=None).misses(q), rtol=1e-12, atol=1e-14)
            assert native[1] == pytest.approx(angle, abs=1e-8)


def test_only_what_the_core_has_goes_there():
    arm, target = pose_arm(ARMS[2]), ARMS[2].pose(np.zeros(5))
    assert pose_error(arm, target, 0.3, ()).compiled is not None
    assert pose_error(arm, target, iq.tool_metric(ARMS[2]), ()).compiled is None
    nine_rows = pose_error(arm, target, None, (iq.control.ExactPoint(),) * 3).compiled
    assert core.descend(nine_rows, target, np.zeros(5), *HOW) is None
    for length in (0.3, 3.0):  # a pitch as the length of a radian
        native = iq.solve_pose(ARMS[2], iq.transform(translation=[1.0, 0.0, 0.2]), form=length, time_limit=inf)
        alone, far = ARMS[2].by_engine("python"), iq.transform(translation=[1.0, 0.0, 0.2])
        python = iq.solve_pose(alone, far, form=length, time_limit=inf)
        assert native.error == pytest.approx(python.error, rel=1e-6)


def test_numbers_that_are_none():
    pose = ARMS[0].pose(np.zeros(7))
    compiled = pose_error(pose_arm(ARMS[0]), pose, None, ()).compiled
    with pytest.raises(TypeError, match="Arm"):
        core.Arm(point=np.zeros(2))
    with pytest.raises(TypeError, match="descend"):
        core.descend(np.zeros(3), pose, np.zeros(7), *HOW)
    with pytest.raises(TypeError, match="misses"):
        core.misses(compiled, pose)
    for steps in (-1.0, np.nan, 1e300):  # no count of steps
        with pytest.raises(TypeError, match="descend"):
            core.descend(compiled, pose, np.zeros(7), *HOW[:-1], np.full(10, steps))
    for target, start in ((np.nan * pose, np.zeros(7)), (pose, np.zeros(6)), (pose, np.full(7, np.nan))):
        assert core.descend(compiled, target, start, *HOW) is None
