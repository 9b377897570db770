"""An arm that stands while its loop is stepped on: nothing accumulates, and it goes on from rest to its input."""

from copy import copy

import numpy as np
import pytest
from support.inputs import KINDS, SIZE, TIME, Bed, cases

CASES = pytest.mark.parametrize(("kind", "name", "dt", "sign"), cases(KINDS, 3))
STOP = 0.4, 1.0
RESPONSE_TIME = 0.125  # without a response [s], as in core/joints.hpp


def moved(trace, dt, stands):
    """(n, m) the velocities at which the arm moved."""
    t = dt * np.arange(len(trace.V))
    return np.where(((stands[0] <= t) & (t < stands[1]))[:, None], 0.0, trace.V)


@CASES
def test_the_arm_starts_from_rest_and_goes_to_where_its_input_is(kind, name, dt, sign):
    bed, stop = Bed(kind, name, dt, sign), (0.15, 0.75) if kind.startswith("goal") else STOP
    trace = bed.run(4.0, stands=stop)
    V, release = moved(trace, dt, stop), round(np.ceil(stop[1] / dt - 1e-9))
    assert np.abs(V[: round(stop[0] / dt)]).max() > 0.03
    assert np.abs(np.diff(V[release - 1 :], axis=0)).max() < 1.001 * bed.acceleration * dt
    assert np.abs(V[-1]).max() < 1e-3
    last = trace.answers[release - 1]
    assert (last.status, "no motion measured" in last.reason) == ("degraded", True)
    assert "no motion measured" not in trace.answers[-1].reason
    if kind != "twist":
        assert bed.off(trace.Q[-1], TIME) < 2e-3
    assert np.abs((trace.Q - bed.start) @ bed.axis).max() < 1.02 * SIZE


@pytest.mark.parametrize("kind", ["joints", "goal of a pose", "step"])
@pytest.mark.parametrize("noise", [1e-5, 3e-4])
def test_noise_is_not_taken_for_motion(kind, noise):
    bed, random = Bed(kind, "ur5", 0.002, 1), np.random.default_rng(2)
    trace = bed.run(2.5, stands=STOP, reads=lambda q, k: q + noise * random.normal(size=6))
    V = moved(trace, bed.dt, STOP)[round(STOP[1] / bed.dt) - 1 :]
    assert np.abs(np.diff(V, axis=0)).max() < 1.001 * bed.acceleration * bed.dt
    assert {"degraded"} == {str(a.status) for a in trace.answers[350:500]}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dt", [0.001, 0.002, 0.01])
def test_the_end_of_a_stop_is_detected_through_noise(kind, dt):
    """Although the first commands from rest are nearly nothing where jerk is limited."""
    bed, random, stop = Bed(kind, "panda", dt, -1), np.random.default_rng(4), (0.2, 0.8)
    trace = bed.run(1.2, stands=stop, reads=lambda q, k: q + 1e-4 * random.normal(size=7))
    stood = ["no motion measured" in a.reason for a in trace.answers]
    assert stood[round(stop[1] / dt) - 1]
    assert not any(stood[round(1.1 / dt) :])


@pytest.mark.parametrize("kind", ["chunks of joints", "poses", "path", "step"])
def test_an_arm_that_lags_is_not_taken_for_one_that_stands(kind):
    """First-order lag of 50 ms, joints of a fifth of the usual speed, and a command of nothing."""
    bed = Bed(kind, "ur5", 0.01, 1)
    answers = bed.run(2.5, lag=0.05).answers
    assert not any("no motion measured" in a.reason for a in answers)


def test_an_arm_commanded_to_rest_has_no_fault():
    bed = Bed("step", "panda", 0.01, 1)
    for _ in range(100):
        answer = bed.loop.step(bed.start, bed.pose(0.0))
    assert (answer.status, answer.reason) == ("ok", "")


def test_one_joint_that_is_blocked_is_named_and_the_others_move():
    bed = Bed("joints", "ur5", 0.002, 1, joint=1)
    answer = bed.run(1.0, moves=lambda k: np.arange(6) != 1).answers[-1]
    assert answer.status == "degraded"
    assert answer.reason.startswith("no motion measured of joint 1 (")


def test_a_stop_is_detected_within_a_fifth_of_a_second_and_its_end_at_once():
    for dt in (0.002, 0.01, 0.033):
        bed = Bed("step", "ur5", dt, 1)
        trace = bed.run(1.3, stands=(0.5, 1.0))
        stood = ["no motion measured" in a.reason for a in trace.answers]
        first, last = stood.index(True), len(stood) - 1 - stood[::-1].index(True)
        assert 0.5 + RESPONSE_TIME - dt <= first * dt <= 0.5 + RESPONSE_TIME + 0.08 + 2.0 * dt
        assert last * dt <= 1.0 + max(0.05, 4.0 * dt)


def test_a_copy_of_a_stopped_loop_continues_alike():
    bed = Bed("step", "panda", 0.01, 1)
    bed.run(0.9, stands=(0.4, 2.0))
    other = copy(bed.loop)
    for k in range(10):
        a, b = (loop.step(bed.start, bed.pose(0.9 + 0.01 * k)) for loop in (bed.loop, other))
        np.testing.assert_array_equal(a.velocity, b.velocity)
        assert a.reason == b.reason


@pytest.mark.parametrize("way", ["no velocity given", "velocity given"])
def test_a_given_velocity_is_used(way):
    """Who measures the velocity says that the arm stands; nothing is concluded from positions."""
    bed = Bed("twist", "ur5", 0.002, 1)
    given = {"velocity": np.zeros(6)} if way == "velocity given" else {}
    trace = bed.run(0.6, stands=(0.0, np.inf), **given)
    assert any("no motion measured" in answer.reason for answer in trace.answers) == (not given)
    assert not given or np.abs(trace.V).max() < 1.001 * bed.acceleration * bed.dt
