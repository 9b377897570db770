"""Polynomials of time by the engine, beside those of NumPy; and a follower that is given no positions."""

import numpy as np
import pytest
from numpy.polynomial import polynomial
from support.streams import Arm, driven

import invariantqp as iq
from invariantqp.paths.joint_limits import JointLimits
from invariantqp.paths.reference import Motion, Reference, RetimedMotion, TimeScaling
from invariantqp.paths.smoothing import smoothed_motion

LIMITS = JointLimits(*(np.full(3, x) for x in (-3.0, 3.0, 2.0, 10.0, 400.0)), 0.002)


def by_numpy(knots, coefficients, times):
    """(k, 4, m) of polynomials piece by piece, at rest before the first and after the last."""
    found = np.zeros((len(times), 4, coefficients.shape[2]))
    for row, t in zip(found, times, strict=True):
        i = int(np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(coefficients) - 1))
        u = np.clip(t, knots[0], knots[-1]) - knots[i]
        for k in range(4 if knots[0] <= t < knots[-1] else 1):
            row[k] = polynomial.polyval(u, polynomial.polyder(coefficients[i], k) if k else coefficients[i])
    return found


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("powers", [2, 4, 6])
def test_a_motion_is_its_polynomials(seed, powers):
    rng = np.random.default_rng([seed, powers])
    knots = np.cumsum(rng.uniform(0.1, 1.0, 6))
    coefficients = rng.normal(size=(5, powers, 3))
    motion = Motion(knots, coefficients)
    times = np.concatenate((knots, rng.uniform(knots[0] - 0.5, knots[-1] + 0.5, 30)))
    np.testing.assert_allclose(motion.at(times), by_numpy(knots, coefficients, times), atol=1e-11)


@pytest.mark.parametrize("seed", range(20))
def test_a_splice_is_the_quintic_to_the_source_or_leaves_a_limit(seed):
    """From a state that is off by little or much, to a motion by its time or by a clock of its own."""
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.uniform(0.02, 0.1, 30))
    points = 0.1 * np.sin(2.0 * stamps)[:, None] + 0.02 * rng.normal(size=3)
    motion = smoothed_motion(np.zeros((3, 3)), 0.0, stamps, points, LIMITS, 0.053)
    now, D = float(stamps[12]), 0.3
    away = rng.choice([0.01, 0.3]) * rng.normal(size=(3, 3)) * np.array([1.0, 0.3, 0.1])[:, None]
    for source in (motion, RetimedMotion(motion, TimeScaling(now, now, 0.5, 0.1, 0.8, 0.3))):
        reference = Reference(LIMITS, points[0], 0.0)
        state = source.at((now,))[0, :3] + away
        fits = reference.splice(source, now, state, D)
        # x, v, a / 2, then what makes all three zero after D
        T = np.array([[D ** (n - k) * np.prod(np.arange(n - k + 1, n + 1)) for n in range(3, 6)] for k in range(3)])
        first = np.array([away[0], away[1], 0.5 * away[2]])
        left = [polynomial.polyval(D, polynomial.polyder(first, k) if k else first) for k in range(3)]
        quintic = np.vstack((first, np.linalg.solve(T, -np.array(left))))
        times = now + np.linspace(0.0, D, 21)
        residual = by_numpy(np.array((now, now + D)), quintic[None], times[:-1])
        both = source.at(times[:-1]) + residual
        shares = [np.abs(both[:, k]) / limit for k, limit in enumerate(LIMITS[2:5], start=1)]
        assert fits == bool(max(share.max() for share in shares) <= 0.97)
        expected = both if fits else source.at(times[:-1])
        found = np.array([reference.at(t) for t in times[:-1]])
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("wrong", [[np.nan] * 6, [0.0] * 5, "joints", None])
def test_invalid_positions_are_refused_between_two_ticks_and_change_nothing(wrong):
    arm = Arm("ur5")
    follower, stamps = arm.follower(), np.arange(0.0, 1.2, 0.05)
    truth = arm.motion(np.random.default_rng(2))
    follower.follow([truth(t) for t in stamps], stamps)
    Q, _ = driven(arm, follower, [], 0.4)
    with pytest.raises(iq.BadInput, match="q"):
        follower.step(wrong)
    assert follower.step(Q[-1]).status == "moving"
