"""The estimate of stiffness, damping and slope: what it converges to, and what it is never fooled by."""

import numpy as np
import pytest

from invariantqp.force.estimate import STIFF, Setting, Stiffness

DT = 0.002


def setting_of(noise=0.1, slope_speed=0.0, begins=STIFF):
    return Setting(DT, 1.0, 0.0, 0.015, noise, slope_speed, 0.0, begins, 2e-7)


def after(k, b, *, noise=0.1, seconds=1.0, seed=0, slope=0.0, begins=STIFF, pushes=10.0):
    """What is known after a press that rises to `pushes` [N] and is moved a little, on a surface that comes."""
    random, setting, estimate = np.random.default_rng(seed), setting_of(noise, abs(slope), begins), Stiffness.of(begins)
    last, known = 0.0, []
    for tick in range(round(seconds / DT)):
        t = tick * DT
        x = pushes / k * ((1.0 - np.exp(-t / 0.1)) + 0.05 * np.sin(40.0 * t))
        f = k * (x + slope * t) + b * (x - last) / DT + random.normal(0.0, noise)
        last = x
        estimate = estimate.after(f, x, setting)
        known.append(estimate)
    return known


@pytest.mark.cases(9)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("k", [1e3, 1e4, 1e5])
@pytest.mark.parametrize("damped", [0.0, 0.01, 0.05])
def test_stiffness_and_damping_are_found_together(k, damped, seed):
    estimate = after(k, damped * k, seed=seed)[-1]
    assert estimate.known == pytest.approx(k, rel=0.25)
    assert estimate.found[1] == pytest.approx(damped * k, abs=0.01 * k)
    assert estimate.bound > 0.75 * k


def test_the_bound_comes_down_from_above_and_never_below_what_is_there():
    bounds = [estimate.bound for estimate in after(2e4, 100.0)]
    assert bounds[0] >= 2e5
    assert min(bounds) > 0.8 * 2e4
    assert bounds[-1] < 1.3 * 2e4


def test_a_declared_stiffness_is_where_it_begins_and_is_believed_no_longer_than_readings_allow():
    for declared in (2e3, 2e4, 2e5):
        assert after(2e4, 0.0, begins=declared)[-1].known == pytest.approx(2e4, rel=0.25)
    said = after(2e4, 0.0, begins=2e5)[-1].trouble(2e5)
    assert "N/m where 2e+05 are declared" in said
    assert after(2e4, 0.0, begins=2e4)[-1].trouble(2e4) == ""


def test_a_contact_that_breaks_for_moments_stays_as_stiff_as_it_was():
    """What chatters along a surface, 13 N for 8 ms, none for 4: it was another contact each time, or a softer one."""
    estimate, setting = after(5e4, 0.0)[-1], setting_of()
    for tick in range(500):
        f = 13.0 * (tick % 6 < 4)
        estimate = estimate.after(f, (f or 10.0) / 5e4, setting, short=-1 if f else 1, felt=f > 0.0)
    assert estimate.known == pytest.approx(5e4, rel=0.05)
    assert estimate.begins == STIFF
    assert estimate.residual < 0.1


@pytest.mark.parametrize("slope", [-2e-3, 2e-3])
def test_a_surface_that_comes_or_goes_is_no_stiffness(slope):
    """Without c 2 mm/s of it pass for three times the stiffness, or for less than none."""
    for estimate in after(2e4, 0.0, slope=slope)[200:]:
        if estimate.known is not None:
            assert estimate.known == pytest.approx(2e4, rel=0.5)


def test_a_plate_behind_foam_is_a_surprise_upwards_and_nothing_is_known_then():
    setting, estimate = setting_of(), Stiffness.of(STIFF)
    for tick in range(600):
        x = 1e-5 * tick
        f = 500.0 * x + 1e5 * max(0.0, x - 5e-3)
        before, estimate = estimate, estimate.after(f, x, setting)
        if estimate.rose:
            break
    assert 500 < tick < 520
    assert before.bound < 5e3
    assert estimate.bound > 1e5


def test_a_plate_behind_foam_is_found_though_the_tool_came_through_the_foam():
    """High-passed ways still held those through the foam: a negative stiffness was found, and a bound of 3 N/m."""
    setting, estimate, random, bounds = setting_of(), Stiffness.of(STIFF), np.random.default_rng(0), []
    for tick in range(1400):
        t, since = DT * tick, max(0.0, DT * tick - 2.0)
        foam = 0.035 * (1.0 - np.exp(-min(t, 2.0) / 4.0))
        plate = 1e-4 * (1.0 - np.exp(-20.0 * since) * np.cos(30.0 * since))
        f = 500.0 * foam + 1e5 * plate + random.normal(0.0, 0.1)
        estimate = estimate.after(f, foam + plate, setting, short=since == 0.0)
        bounds.append(estimate.bound)
    assert max(bounds[800:1000]) < 1e3
    assert min(bounds[1020:]) > 1e4
