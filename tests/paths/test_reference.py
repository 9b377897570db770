"""What is followed: sources, stops and splices, beside polynomials and sampled differences."""

import numpy as np
import pytest

from invariantqp.paths.reference import Clock, Clocked, Reference, Window, smoothed, stopping, through
from invariantqp.paths.time_law import JointLimits

LIMITS = JointLimits(np.full(3, -3.0), np.full(3, 3.0), np.full(3, 2.0), np.full(3, 10.0), np.full(3, 400.0), 0.002)


def differences_agree(source, a, b, tolerance):
    t = np.linspace(a, b, 2001)[1:-1]
    h = 1e-5
    before, now, after = (source.at(t + k) for k in (-h, 0.0, h))
    smooth = np.abs(after[:, 3] - before[:, 3]).max(axis=1) < 1.0  # not beside a knot, where jerk steps
    assert smooth.mean() > 0.9
    for k in range(3):
        slope = (after[:, k] - before[:, k]) / (2.0 * h)
        assert np.abs(slope - now[:, k + 1])[smooth].max() < tolerance * max(1.0, np.abs(now[:, k + 1]).max())


@pytest.mark.parametrize("seed", range(5))
def test_derivatives_are_derivatives(seed):
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.uniform(0.05, 0.15, 12))
    points = through(stamps, 0.1 * rng.normal(size=(12, 3)), LIMITS, 0.3)
    differences_agree(points, points.start + 0.01, points.end - 0.01, 1e-4)
    differences_agree(Clocked(points, Clock(0.3, 0.2, 0.4, 0.1, 0.9, 0.5)), 0.31, 1.0, 1e-4)
    state = np.array([0.1 * rng.normal(size=3), rng.normal(size=3), rng.normal(size=3)])
    differences_agree(stopping(state, 0.0, LIMITS), 0.001, 0.02, 1e-4)


@pytest.mark.parametrize("seed", range(10))
def test_a_stop_keeps_the_limits_and_ends_at_rest(seed):
    rng = np.random.default_rng(seed)
    state = np.array([0.3 * rng.normal(size=3), rng.uniform(-1.9, 1.9, 3), rng.uniform(-5.0, 5.0, 3)])
    stop = stopping(state, 1.0, LIMITS)
    t = np.linspace(1.0, stop.end, 4001)
    at = stop.at(t)
    assert np.abs(at[0, :3] - state).max() < 1e-9
    assert stop.end - 1.0 < 0.7
    assert (np.abs(at[:, 2]) <= 1.001 * LIMITS.acceleration).all()
    assert (np.abs(at[:, 3]) <= 1.001 * LIMITS.jerk).all()
    assert np.abs(stop.at(np.array((stop.end + 1e-9, stop.end + 5.0)))[:, 1:]).max() == 0.0


def test_a_stop_after_the_last_point_takes_its_time():
    stamps = np.arange(10) * 0.05
    moving = through(stamps, np.outer(stamps, [0.2, 0.1, 0.0]), LIMITS, 0.3)
    assert abs(moving.end - stamps[-1] - 0.3) < 1e-9
    assert stopping(np.array([np.zeros(3), [0.2, 0.1, 0.0], np.zeros(3)]), 0.0, LIMITS).end < 0.1
    at_rest = through(stamps, np.zeros((10, 3)), LIMITS, 0.3)
    assert at_rest.end == stamps[-1]


@pytest.mark.parametrize("seed", range(10))
def test_a_splice_is_continuous_to_the_second_derivative(seed):
    rng = np.random.default_rng(seed)
    stamps = np.arange(10) * 0.1
    old = through(stamps, 0.05 * rng.normal(size=(10, 3)).cumsum(axis=0), LIMITS, 0.3)
    new = through(stamps + 0.35, old.at(stamps + 0.35)[:, 0] + 0.03 * rng.normal(size=3), LIMITS, 0.3)
    reference = Reference(LIMITS, old.at(np.array((0.0,)))[0, 0], 0.0)
    reference.splice(old, 0.0, old.at(np.array((0.0,)))[0, :3], 0.25)
    now = np.array((0.5,))
    before = reference.at(now)[0, :3]
    if reference.splice(new, 0.5, before, 0.25):
        assert np.abs(reference.at(now)[0, :3] - before).max() < 1e-9
        after = np.linspace(reference.joined, reference.joined + 1.0, 50)
        assert (reference.at(after) == new.at(after)).all()


def test_smoothing_takes_no_line_off_its_way_and_delays_nothing():
    rng = np.random.default_rng(1)
    stamps = np.cumsum(rng.uniform(0.02, 0.06, 60))
    line = 0.3 * stamps[:, None] + np.arange(3)
    assert np.abs(smoothed(stamps, line, 4.0) - line).max() < 1e-9
    slow = np.sin(2.0 * np.pi * 0.5 * stamps)[:, None] * np.ones(3)
    assert np.abs(smoothed(stamps, slow, 4.0) - slow)[10:-10].max() < 0.01
    noise = rng.normal(size=(60, 3))
    assert smoothed(stamps, noise, 4.0).std() < 0.75 * noise.std()


@pytest.mark.parametrize("rate", [30.0, 60.0, 90.0])
def test_a_sample_comes_in_with_weight_zero(rate):
    rng = np.random.default_rng(int(rate))
    window, late, off = None, 0.02, []
    for i in range(200):
        stamp = i / rate
        sample = np.sin(stamp) + 0.001 * rng.normal(size=3)
        if window is None:
            window = Window(4.0, 0.002, stamp, sample, late)
            continue
        now = np.array((stamp + late,))
        before = window.at(now)[0, :3]
        window.add(stamp, sample, late)
        after = window.at(now)[0, :3]
        if i > 20:
            assert np.abs(after[0] - before[0]).max() < 1e-9
            assert np.abs(after[2] - before[2]).max() < 0.05  # of about 1: differences reach two ticks ahead
            truth = np.sin(stamp + late - window.late)
            off.append(after[0] - truth)
    assert np.sqrt(np.mean(np.square(off))) < 1e-3  # the noise that came in


def test_a_stop_of_nothing_stands():
    stop = stopping(np.zeros((3, 3)), 2.0, LIMITS)
    assert stop.end == 2.0
    assert not stop.at(np.array((2.0, 3.0))).any()
