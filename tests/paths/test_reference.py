"""What is followed: sources, stops and splices, beside polynomials and sampled differences."""

import numpy as np
import pytest

from invariantqp.paths.joint_limits import JointLimits
from invariantqp.paths.reference import RetimedMotion, TimeScaling
from invariantqp.paths.smoothing import DELAY_CYCLES, SampleSmoother, smoothed_motion

REST = np.zeros((3, 3))
CALM = 0.053
LIMITS = JointLimits(np.full(3, -3.0), np.full(3, 3.0), np.full(3, 2.0), np.full(3, 10.0), np.full(3, 400.0), 0.002)


def differences_agree(source, a, b, tolerance):
    t = np.linspace(a, b, 2001)[1:-1]
    h = 1e-5
    before, now, after = (source.at(t + k) for k in (-h, 0.0, h))
    smooth = np.abs(after[:, 3] - before[:, 3]).max(axis=1) < 0.01  # not beside a knot, where jerk steps
    assert smooth.mean() > 0.9
    for k in range(3):
        slope = (after[:, k] - before[:, k]) / (2.0 * h)
        assert np.abs(slope - now[:, k + 1])[smooth].max() < tolerance * max(1.0, np.abs(now[:, k + 1]).max())


@pytest.mark.parametrize("seed", range(5))
def test_derivatives_of_a_retimed_motion_are_derivatives(seed):
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.uniform(0.05, 0.15, 12))
    points = smoothed_motion(REST, 0.0, stamps, 0.1 * rng.normal(size=(12, 3)), LIMITS, CALM)
    differences_agree(RetimedMotion(points, TimeScaling(0.3, 0.2, 0.4, 0.1, 0.9, 0.5)), 0.31, 1.0, 1e-4)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("over", [False, True])
def test_a_plan_continues_its_state_keeps_the_limits_and_ends_at_rest(seed, over):
    rng = np.random.default_rng([seed, over])
    state = np.array([0.3 * rng.normal(size=3), rng.uniform(-1.5, 1.5, 3), rng.uniform(-4.0, 4.0, 3)])
    stamps = 1.0 + np.cumsum(rng.uniform(0.03, 0.1, 12)) - (1.5 if over else 0.2)
    plan = smoothed_motion(state, 1.0, stamps, 0.3 * rng.normal(size=3) + 0.02 * rng.normal(size=(12, 3)), LIMITS, CALM)
    at = plan.at(np.linspace(1.0, plan.end, 4001))
    assert np.abs(at[0, :3] - state).max() < 1e-9
    for k, limit in enumerate((LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk), start=1):
        assert (np.abs(at[:, k]) <= limit).all()
    assert plan.end - max(stamps[-1], 1.0) < 0.7
    assert np.abs(plan.at(np.array((plan.end - 1e-9, plan.end + 5.0)))[:, 1:3]).max() < 1e-6


@pytest.mark.parametrize("seed", range(5))
def test_a_plan_minimises_error_and_jerk(seed):
    """Where nothing is eased: other motions from the same state to rest cost more."""
    rng = np.random.default_rng(seed)
    stamps = np.arange(1, 21) * 0.05
    points = (0.1 * np.sin(3.0 * stamps) + 0.002 * rng.normal(size=20))[:, None] * np.ones(3)
    plan = smoothed_motion(REST, 0.0, stamps, points, LIMITS, CALM)
    most = np.full(3, np.inf)
    wide = JointLimits(-most, most, most, most, most, 0.0)
    assert np.abs(smoothed_motion(REST, 0.0, stamps, points, wide, CALM).coefficients - plan.coefficients).max() < 1e-12
    # In the first second the points alone decide: a bump there, zero with its first two derivatives at its ends.
    t = np.linspace(0.0, 1.0, 20001)

    def cost(bump):
        u = np.clip((t - bump) / 0.3, 0.0, 1.0)
        size = 0.05 * np.polynomial.polynomial.polyval(u, [0, 0, 0, 1, -3, 3, -1])  # u^3 (1 - u)^3
        bend = np.polynomial.polynomial.polyval(u, [6, -72, 180, -120])
        third = 0.05 * np.where((u > 0.0) & (u < 1.0), bend, 0.0) / 0.3**3
        jerk, off = plan.at(t)[:, 3, 0], plan.at(stamps)[:, 0, 0] - points[:, 0]
        costs = []
        for sign in (-1.0, 0.0, 1.0):
            away = off + sign * np.interp(stamps, t, size)
            costs.append(0.05 * (away**2).sum() + CALM**6 * np.trapezoid((jerk + sign * third) ** 2, t))
        return costs

    for bump in (0.02, 0.2, 0.45, 0.65):
        less, here, more = cost(bump)
        assert min(less, more) > here


def test_a_plan_reproduces_a_parabola_without_delay_and_smooths_noise():
    rng = np.random.default_rng(1)
    stamps = np.cumsum(rng.uniform(0.02, 0.06, 60))
    state = np.array([np.arange(3), 0.3 * np.ones(3), -0.2 * np.ones(3)])
    curve = (0.3 * stamps - 0.1 * stamps**2)[:, None] + np.arange(3)
    assert np.abs(smoothed_motion(state, 0.0, stamps, curve, LIMITS, CALM).at(stamps)[:-5, 0] - curve[:-5]).max() < 2e-4
    slow = 0.1 * np.sin(2.0 * np.pi * 0.5 * stamps)[:, None] * np.ones(3)
    state = np.array([0.0, 0.1 * np.pi, 0.0])[:, None] * np.ones(3)
    assert np.abs(smoothed_motion(state, 0.0, stamps, slow, LIMITS, CALM).at(stamps)[:-5, 0] - slow[:-5]).max() < 2e-4
    noise = 0.01 * rng.normal(size=(60, 3))
    assert smoothed_motion(REST, 0.0, stamps, noise, LIMITS, CALM).at(stamps)[:, 0].std() < 0.75 * noise.std()


@pytest.mark.parametrize(("hertz", "noise", "off", "jerk"), [(2.5, 0.0, 0.03, 1.6), (0.5, 1e-3, 0.012, 9.0)])
def test_smoothing_adapts_to_the_noise_of_a_hand(hertz, noise, off, jerk):
    """Off and jerk (rms) as shares of the hand's; joints in radians and in thousandths."""
    rng, rate, followed = np.random.default_rng(3), 60.0, []
    w, streams, plans = (
        2.0 * np.pi * hertz,
        [SampleSmoother(3.0, 0.0, 0.0, scale * np.zeros(3), 0.0) for scale in (1.0, 1e3)],
        [None, None],
    )
    for i in range(1, 600):
        sample = 0.1 * np.sin(w * i / rate) + noise * rng.normal(size=3)
        for k, scale in enumerate((1.0, 1e3)):
            streams[k].add(i / rate, scale * sample, 0.0, restarts=False)
            plans[k] = streams[k].motion(plans[k], i / rate)
        here = [plan.at(i / rate + np.arange(8) / (8.0 * rate))[:, [0, 3]] for plan in plans]
        np.testing.assert_allclose(1e3 * here[0], here[1], rtol=1e-6, atol=1e-3)
        followed.append(here[0])
    seen = np.concatenate(followed[200:])
    at = (201 + np.arange(len(seen)) / 8.0) / rate - streams[0].late
    assert np.sqrt(np.mean((seen[:, 0] - 0.1 * np.sin(w * at)[:, None]) ** 2)) < off * 0.1 / np.sqrt(2.0)
    assert np.sqrt(np.mean(seen[:, 1] ** 2)) < jerk * 0.1 * w**3 / np.sqrt(2.0)


@pytest.mark.parametrize("rate", [30.0, 60.0, 90.0])
def test_samples_are_followed_smoothly_with_the_reported_delay(rate):
    rng = np.random.default_rng(int(rate))
    stream, plan, late, off = None, None, 0.02, []
    for i in range(200):
        stamp = i / rate
        sample = np.sin(stamp) + 0.001 * rng.normal(size=3)
        if stream is None:
            stream = SampleSmoother(3.0, 0.0, stamp, sample, late)
        else:
            stream.add(stamp, sample, late, restarts=False)
        now = np.array((stamp + late,))
        before, plan = plan, stream.motion(plan, now[0])
        if before is not None:
            assert np.abs(plan.at(now)[0, :3] - before.at(now)[0, :3]).max() < 1e-9
        if i > 40:
            off.append(plan.at(now)[0, 0] - np.sin(stamp + late - stream.late))
    assert stream.late == pytest.approx(late + max(DELAY_CYCLES / 3.0, 2.0 / rate))
    assert np.sqrt(np.mean(np.square(off))) < 1e-3  # the noise that came in
