import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import invariantqp as iq
from invariantqp.engine import law
from invariantqp.velocity.limits import JointBox, braking_speed

INF = np.inf
EXAMPLES = settings(deadline=None, derandomize=True, max_examples=100)

BAD = {
    "crossed": (([0.0, 1.0], [1.0, 0.5]), "lower", "lower 1 above upper 0.5 at joint 1"),
    "empty": (([], []), "lower", "shape (0,)"),
    "lower at +inf": (([INF], [INF]), "lower", "+inf"),
    "upper at -inf": (([-INF], [-INF]), "lower", "-inf"),
}


@pytest.mark.parametrize("case", BAD)
def test_wrong_bounds_are_refused(case):
    arguments, argument, found = BAD[case]
    with pytest.raises(iq.BadInput) as caught:
        iq.Bounds(*arguments)
    assert caught.value.argument == argument
    assert found in caught.value.found
    assert caught.value.expected


def test_equal_and_infinite_bounds_are_accepted():
    assert iq.Bounds([0.0, -INF], [0.0, INF]).lower.tolist() == [0.0, -INF]


@EXAMPLES
@given(
    st.floats(-2.0, 0.0),
    st.floats(0.0, 2.0),
    st.floats(0.01, 5.0),
    st.sampled_from([10.0, 100.0, 1000.0]),
    st.floats(-4, 4),
)
def test_the_joint_box_is_its_formula_and_leads_back(low, high, speed, rate, q):
    box = JointBox(np.array([low]), np.array([high]), np.array([speed]), rate)
    (lower,), (upper,) = box.at(np.array([q]))
    assert lower == pytest.approx(np.clip(rate * (low - q), -speed, speed), rel=1e-12, abs=1e-9)
    assert upper == pytest.approx(np.clip(rate * (high - q), -speed, speed), rel=1e-12, abs=1e-9)
    assert -speed <= lower <= upper <= speed
    if low <= q <= high:
        assert lower <= 1e-12
        assert upper >= -1e-12
    else:
        back = 1.0 if q < low else -1.0
        slowest = min(back * lower, back * upper)
        outside = low - q if q < low else q - high
        assert slowest == pytest.approx(min(speed, rate * outside), rel=1e-9, abs=1e-9)


def test_without_limits_the_box_is_infinite():
    box = JointBox(np.array([-INF]), np.array([INF]), np.array([INF]), 100.0)
    assert box.at(np.array([1e6])) == (-INF, INF)


def test_a_margin_shrinks_a_range_but_not_that_of_a_locked_joint():
    box = JointBox(np.array([-1.0, 0.05, -INF]), np.array([1.0, 0.05, INF]), np.full(3, 9.0), 10.0, margin=0.2)
    lower, upper = box.at(np.array([0.0, 0.0, 0.0]))
    np.testing.assert_allclose(lower, [-8.0, 0.5, -9.0])
    np.testing.assert_allclose(upper, [8.0, 0.5, 9.0])


def distance(x, a, dt, rate):
    """What a joint travels at x for one tick and braking at a from then on, tick by tick, the rest at a rate."""
    total = 0.0
    while rate * x > a * (1.0 + 1e-12):
        total += x * dt
        x -= a * dt
    return total + x / rate


@EXAMPLES
@given(
    st.floats(0.0, 3.0), st.floats(0.05, 50.0), st.sampled_from([1e-3, 1e-2, 0.1]), st.sampled_from([None, 1.0, 0.1])
)
def test_braking_speed_is_the_largest_that_stops_in_the_distance(room, a, dt, share):
    (x,) = braking_speed(np.array([room]), np.array([a]), dt, None if share is None else share / dt)
    assert distance(x, a, dt, (share or 1.0) / dt) == pytest.approx(room, rel=1e-9, abs=1e-12)


def test_braking_speed_without_limits():
    free, late = braking_speed(np.array([INF, 0.5]), np.array([1.0, INF]), 0.01)
    assert free == INF
    assert late == pytest.approx(50.0)  # nothing to wait for: up to the limit in one tick


class Braking:
    """The engine's bounds of joints with limits of position, velocity and acceleration."""

    def __init__(self, low, high, speed, rate, acceleration, dt):
        self.box, self.acceleration = (
            JointBox(np.array(low), np.array(high), np.array(speed), rate),
            np.array(acceleration),
        )
        names = ("position_lower", "position_upper", "velocity_limit")
        self.fields = {name: getattr(self.box, name) for name in names}
        self.fields |= {"acceleration": self.acceleration, "dt": dt, "rate": rate}

    def at(self, q, before):
        """Lower and upper bounds, those of positions alone, and accelerations above a limit, 0 where there are none."""
        return law.joint_bounds(self.fields, q, before)


def braking_box(rng, m, dt, share=1.0):
    low, high = -rng.uniform(0.0, 2.0, m), rng.uniform(0.0, 2.0, m)
    speed, a = rng.uniform(0.05, 5.0, m), 10.0 ** rng.uniform(-1.0, 3.0, m)
    return Braking(low, high, speed, share / dt, a, dt)


@pytest.mark.cases(3)
@pytest.mark.parametrize("share", [1.0, 0.1])
@pytest.mark.parametrize("dt", [1e-3, 1e-2, 0.1])
def test_from_rest_all_three_limits_hold(dt, share):
    """Four hundred joints pushed to the edges of their boxes, 200 ticks."""
    rng = np.random.default_rng(0)
    limits = braking_box(rng, 400, dt, share)
    box = limits.box
    q = box.position_lower + (box.position_upper - box.position_lower) * rng.random(400)
    x = np.zeros(400)
    for k in range(200):
        lower, upper, *placed, exceeded = limits.at(q, x)
        assert not exceeded.any()
        assert (lower <= upper).all()
        assert (placed[0] <= lower).all()  # what is left of the limits bounds a joint no more than all of them do
        assert (placed[1] >= upper).all()
        new = (lower, upper, np.where(rng.random(400) < 0.5, lower, upper))[(k // 40) % 3]
        assert (np.abs(new - x) <= limits.acceleration * dt * (1.0 + 1e-9) + 1e-12).all()
        assert (np.abs(new) <= box.velocity_limit).all()
        x, q = new, q + dt * new
        assert max((box.position_lower - q).max(), (q - box.position_upper).max()) < 1e-12


@pytest.mark.cases(1)
@pytest.mark.parametrize("dt", [1e-3, 1e-2, 0.1])
def test_started_too_fast_the_acceleration_limit_is_exceeded_and_reported(dt):
    rng = np.random.default_rng(1)
    limits = braking_box(rng, 400, dt)
    box = limits.box
    q = box.position_lower + (box.position_upper - box.position_lower) * rng.random(400)
    x = rng.uniform(-1.0, 1.0, 400) * box.velocity_limit
    exceeded = limits.at(q, x)[-1]
    assert (exceeded > 0.0).sum() > 20
    assert (exceeded[exceeded > 0.0] > limits.acceleration[exceeded > 0.0]).all()
    for _ in range(300):
        lower, upper, *_ = limits.at(q, x)
        x = np.where(rng.random(400) < 0.5, lower, upper)
        assert (np.abs(x) <= box.velocity_limit).all()
        q = q + dt * x
        assert max((box.position_lower - q).max(), (q - box.position_upper).max()) < 1e-12


def test_the_deceleration_of_late_braking_is_constant_and_the_least_that_stops():
    """w^2 / (2 room) in continuous time: nothing is gained by braking harder first."""
    limits = Braking([-1.0], [0.1], [5.0], 1e3, [10.0], 1e-3)
    q, x, used = np.zeros(1), np.array([4.0]), []
    while x[0] > 0.0:
        upper = limits.at(q, x)[1]
        used.append((x[0] - upper[0]) / 1e-3)
        x = upper
        q = q + 1e-3 * x
    assert q[0] == pytest.approx(0.1, abs=1e-12)
    np.testing.assert_allclose(used[:-1], used[0], rtol=1e-6)  # the last tick has less than a tick's worth left
    assert used[0] == pytest.approx(4.0**2 / 0.2, rel=0.03)


def test_outside_a_limit_the_return_stops_at_it_within_the_acceleration():
    limits = Braking([-1.0], [1.0], [2.0], 100.0, [5.0], 0.01)
    q, x, seen = np.array([2.5]), np.zeros(1), [0.0]
    for _ in range(200):
        upper = limits.at(q, x)[1]
        x = upper  # no further back than it has to
        q = q + 0.01 * x
        seen.append(x[0])
        assert q[0] >= 1.0 - 1e-12
    assert min(seen) == pytest.approx(-2.0)  # the velocity limit
    assert np.abs(np.diff(seen)).max() <= 0.05 + 1e-12
    assert q[0] <= 1.0 + 1e-12
    (out,) = limits.at(np.array([1.5]), np.array([1.0]))[1]  # moving out: stopped at once
    assert out == 0.0


def test_joints_above_the_velocity_limit_are_bounded_by_it():
    limits = Braking([-9.0, -9.0], [9.0, 9.0], [1.0, 1.0], 100.0, [1.0, 1.0], 0.01)
    lower, upper, *_, exceeded = limits.at(np.zeros(2), np.array([3.0, 0.0]))
    assert (lower[0], upper[0]) == (1.0, 1.0)
    assert (exceeded > 0.0).tolist() == [True, False]


def test_a_joint_without_acceleration_limit_has_the_joint_box():
    limits = Braking([-1.0, -INF], [1.0, INF], [3.0, INF], 10.0, [INF, INF], 0.01)
    for q in ([0.0, 0.0], [0.99, 5.0], [1.01, -1e9], [-3.0, 0.0]):
        lower, upper, *_ = limits.at(np.array(q), np.array([2.0, -1.0]))
        np.testing.assert_allclose((lower, upper), limits.box.at(np.array(q)), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("speed", [1.0, 1e-4, 1e-7])
def test_active_bounds_do_not_depend_on_the_speed(speed):
    rng = np.random.default_rng(9)
    options = {"point": np.zeros(3), "length": 1.0}
    counts = set()
    for _ in range(40):
        J, s, reach = rng.normal(size=(6, 7)), rng.normal(size=6), rng.uniform(0.2, 2.0, 7)
        reach[rng.integers(7)] = 0.0  # a joint at its position limit, say
        fast = iq.solve_velocity(J, s, bounds=iq.Bounds(-reach, reach), **options)
        slow = iq.solve_velocity(J, speed * s, bounds=iq.Bounds(-speed * reach, speed * reach), **options)
        rows = iq.solve_velocities(J[None], speed * s, bounds=iq.Bounds(-speed * reach, speed * reach), **options)
        at = np.abs(np.abs(slow.velocity) - speed * reach) <= 1e-9 * speed
        assert fast.active == slow.active == rows.active[0] == tuple(np.flatnonzero(at))
        counts.add(len(slow.active))
    assert len(counts) > 2
