"""Joint limits in time: whatever is wanted, position, velocity, acceleration and jerk limits hold, for ever."""

import numpy as np
import pytest
from support.repeats import repeats

from invariantqp.engine import law
from invariantqp.paths.joint_limits import JointLimits


def limits(rng, m=6, dt=0.002):
    lower = -rng.uniform(0.2, 2.0, m)
    V, A = rng.uniform(0.5, 4.0, m), rng.uniform(2.0, 40.0, m)
    return JointLimits(lower, -lower, V, A, A / rng.uniform(0.01, 0.2, m), dt)


@pytest.mark.cases(2)
@pytest.mark.parametrize(("kind", "dt"), [("noise", 0.002), ("steps", 0.001), ("steps", 0.008), ("away", 0.002)])
def test_no_limit_is_ever_broken(kind, dt):
    rng = np.random.default_rng(len(kind))
    bounds = limits(rng, repeats(960, 8), dt)  # each joint by itself: as many runs as joints
    m = len(bounds.lower)
    q, v, a = np.zeros(m), np.zeros(m), np.zeros(m)
    wanted = np.zeros(m)
    for i in range(250):
        if kind == "noise":
            wanted = 5.0 * bounds.acceleration * rng.normal(size=m)
        elif i % 100 == 0:
            wanted = bounds.acceleration * (rng.choice([-2.0, 2.0], m) if kind == "steps" else 2.0)
        new = law.admissible_acceleration(bounds, q, v, a, wanted)
        assert (np.abs(new) <= bounds.acceleration * (1 + 1e-9)).all()
        assert (np.abs(new - a) <= bounds.jerk * dt * (1 + 1e-9)).all()
        a, v = new, v + dt * new
        q = q + dt * v
        assert (np.abs(v) <= bounds.velocity * (1 + 1e-9)).all()
        assert (q <= bounds.upper + 1e-9).all()
        assert (q >= bounds.lower - 1e-9).all()


def test_a_motion_inside_the_limits_is_unchanged():
    bounds = limits(np.random.default_rng(0), 12)
    # A slow sine needs a hundredth of each limit.
    size = 0.01 * np.minimum(bounds.upper, bounds.acceleration)
    t = np.arange(1500) * bounds.dt
    q = size * np.sin(t)[:, None] ** 4
    v = np.diff(q, axis=0) / bounds.dt
    a = np.diff(v, axis=0, prepend=0.0) / bounds.dt
    for i in range(1, len(a)):
        assert (law.admissible_acceleration(bounds, q[i], v[i - 1], a[i - 1], a[i]) == a[i]).all()


def test_a_velocity_is_reached_without_overshoot():
    rng = np.random.default_rng(0)
    bounds = limits(rng, 48)._replace(lower=np.full(48, -np.inf), upper=np.full(48, np.inf))
    wanted = bounds.velocity * rng.uniform(-0.9, 0.9, 48)
    v, a = np.zeros(48), np.zeros(48)
    for _ in range(1500):
        a = law.admissible_acceleration(bounds, np.zeros(48), v, a, law.acceleration_towards(bounds, v, wanted))
        v = v + bounds.dt * a
        # In whole ticks: the last part of a tick's jerk adds up to an eighth of what it changes the velocity by.
        assert (np.abs(v) <= np.abs(wanted) + bounds.jerk * bounds.dt**2 / 8.0 + 1e-9).all()
    assert np.abs(v - wanted).max() < 1e-9
