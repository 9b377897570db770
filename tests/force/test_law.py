"""The force law: what it promises for the true stiffness, damping and delay, and below bounds of them."""

from collections import deque
from math import exp

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.control.tracking import DELAY_SHARE
from invariantqp.force.estimate import STIFF, UNKNOWN, Setting, Stiffness, Touch
from invariantqp.force.law import APPROACHED, TAKES_UP, Drive, pressed, sought, struck, taken_up, touch_speed


def setting_of(dt, late, slope_speed=0.0):
    return Setting(dt, 1.0, 0.0, late, 0.0, slope_speed, 0.0, 2e5, 0.0)


def held(k, b, dt, lag, known, *, wanted=10.0, moves=0.0, seconds=None):
    """Presses of a contact f = k x + b x' behind an arm that lags, from 1 N on; the surface comes with a speed."""
    late = dt + lag + UNKNOWN
    setting = setting_of(dt, late, 2.0 * abs(moves))
    drive, x, v, h = Drive(), 1.0 / k, 0.0, dt / 20
    share = 1.0 - exp(-h / lag) if lag > 0.0 else 1.0
    presses = deque()
    for _ in range(round((seconds or 40.0 * max(late, b / k)) / dt)):
        f = max(0.0, k * x + b * (v + moves))
        drive = pressed(drive, wanted - f, wanted, known, setting, (1e9, 1e9), 1.0, grows=True)
        for _ in range(20):
            v += share * (drive.rate - v)
            x += h * (v + moves)
        presses.append(max(0.0, k * x + b * (v + moves)))
    return np.array(presses)


def knows(k, b):
    """All is known: no prior."""
    return Stiffness.of(k)._replace(found=np.array((k, b, 0.0)), errors=np.zeros(3), bound=k)


@pytest.mark.cases(2)
@pytest.mark.parametrize("seed", range(4))
def test_with_the_true_stiffness_and_damping_it_is_never_under_damped(seed):
    """Its poles are G/T and k/b, whatever k, b and T are: 30 of each, without the integral."""
    random = np.random.default_rng(seed)
    for _ in range(30):
        k, dt, lag = 10 ** random.uniform(2.7, 6.0), 10 ** random.uniform(-3.0, -1.3), random.uniform(0.0, 0.03)
        b = k * random.choice([0.0, 10 ** random.uniform(-3.5, -1.0)])
        presses = held(k, b, dt, lag, knows(k, b))
        assert presses.max() < 10.0 * 1.03, (k, b / k, dt, lag)
        assert presses[-1] == pytest.approx(10.0, rel=0.02)


@pytest.mark.cases(2)
@pytest.mark.parametrize("above", [1.0, 3.0, 10.0, 100.0])
def test_bounds_that_are_too_large_make_it_slower_and_never_swing(above):
    k, b, dt, lag = 1e4, 50.0, 0.002, 0.005
    true, bound = held(k, b, dt, lag, knows(k, b)), held(k, b, dt, lag, knows(above * k, above * b), seconds=20.0)
    assert bound.max() < 10.2
    assert np.argmax(bound > 9.0) >= np.argmax(true > 9.0)


def test_a_surface_that_comes_is_followed_without_an_error_by_the_slope_alone():
    k, dt, lag = 1e4, 0.002, 0.005
    late = dt + lag + UNKNOWN
    presses = held(k, 0.0, dt, lag, knows(k, 0.0), moves=2e-3, seconds=100.0 * late)
    assert presses.max() < 10.0 + 1.6 * 2e-3 * k * late / DELAY_SHARE
    assert presses[-1] == pytest.approx(10.0, rel=1e-3)
    still = pressed(Drive(0.0, 1e-3), 0.0, 10.0, knows(k, 0.0), setting_of(dt, late, 0.0), (1.0, 1.0), 1.0, grows=True)
    assert still.slope == 0.0  # of a surface that stands still nothing is left that could lead away


def test_a_contact_lost_for_moments_is_approached_from_rest():
    """A step of speed, which compliant servos turn into a force, was the next touch, and so on."""
    task = iq.HybridTask(iq.point_contact(np.zeros(3), [0, 0, 1]), [10.0])
    setting, speeds = setting_of(0.002, 0.02), []
    for airborne in (0.002, 0.05, task.lost_after, 1.0, np.inf):
        touch = Touch(airborne=airborne)
        speeds.append(sought(Drive(), 0.01, 0.0, setting, touch, task).rate)
    assert speeds == pytest.approx([0.0002, 0.005, 0.01, 0.01, 0.01])
    again = [sought(Drive(), 0.01, 0.01, setting, Touch(airborne=t), task).rate for t in (0.002, 0.1)]
    assert again == pytest.approx([0.0004, 0.02])  # so is a surface that may have gone away while the tool slid


def test_what_a_surface_might_do_makes_no_approach_faster():
    """The way that a press was asked over counted as a surface's: it came back at 7.2 mm/s for 1.9, and struck."""
    task = iq.HybridTask(iq.point_contact(np.zeros(3), [0, 0, 1]), [5.0])
    moved = setting_of(0.01, 0.03, 0.02)
    assert sought(Drive(), 0.002, 0.0, moved, Touch(airborne=1.0), task).rate == pytest.approx(0.002)
    seen = sought(Drive(0.0, 0.004), 0.002, 0.0, moved, Touch(airborne=task.lost_after / 2.0), task)
    assert seen.rate == pytest.approx(0.003)  # it was just followed as fast


@pytest.mark.parametrize("late", [1e-3, 0.01, 0.1])
def test_what_is_declared_makes_an_approach_faster_and_never_slower(late):
    """Told 30 times too stiff nothing was touched in 6 s; told 10 times too soft a table was struck with 28 N of 10."""
    contact, table = iq.point_contact(np.zeros(3), [0, 0, 1]), APPROACHED * STIFF
    untold = touch_speed(iq.HybridTask(contact, [10.0], approach_speed=1.0), 9.0, 22.5, late)
    for declared in (1e2, 1e3, 1e4, 5e4, 1e5, 1e6, 1e8):
        speed = touch_speed(iq.HybridTask(contact, [10.0], stiffness=declared, approach_speed=1.0), 9.0, 22.5, late)
        assert untold <= speed <= 2.5 * untold * (1.0 + 1e-12), declared
        assert speed == pytest.approx(untold * min(max(table / declared, 1.0), 2.5))


def test_a_moment_is_levelled_no_faster_than_the_press_beside_it():
    """A sponge that had touched with a corner was turned so hard that it left the table, and struck it."""
    random = np.random.default_rng(9)
    for _ in range(300):
        dt, late = 10 ** random.uniform([-3.0, -2.5], [-1.3, -1.0])
        press, moment = (knows(k, b * k) for k, b in 10 ** random.uniform([2.5, -3.0], [6.0, -1.0], (2, 2)))
        setting, most = setting_of(dt, max(dt, late)), (1e9, 1e9)
        own, alone = (pressed(Drive(), 1.0, 0.0, one, setting, most, 1.0, grows=False).rate for one in (press, moment))
        beside = pressed(Drive(), 1.0, 0.0, moment, setting, most, 1.0, grows=False, beside=press).rate
        assert 0.0 < beside <= min(own, alone) * (1.0 + 1e-12)


def test_a_motion_along_a_contact_is_taken_up_and_a_smooth_one_is_as_asked():
    contact = iq.point_contact(np.array([0.4, -0.1, 0.3]), [0.0, 0.0, 1.0])
    task, dt, asked = iq.HybridTask(contact, [10.0]), 0.002, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    motion, ticks = np.zeros(6), 0
    while not np.array_equal(motion, asked):
        before, ticks = motion, ticks + 1
        motion = taken_up(task, contact, before, asked, dt)
        assert np.linalg.norm(motion - before) <= task.slide_speed * dt / TAKES_UP * (1.0 + 1e-9)
    assert ticks == pytest.approx(TAKES_UP / dt, abs=1)
    for t in np.arange(0.0, 1.0, dt):  # 50 mm, 0.25 m/s: 1.25 m/s^2
        circle = [
            np.array([0.0, 0.0, 0.0, *(0.25 * np.array([np.cos(5.0 * s), np.sin(5.0 * s), 0.0]))]) for s in (t, t + dt)
        ]
        assert np.allclose(taken_up(task, contact, *circle, dt), circle[1], rtol=0.0, atol=1e-15)


def test_until_the_press_was_reached_speed_and_slope_together_are_no_faster_than_a_touch():
    """A surface that may move lets the slope grow in foam; a plate behind it was struck with both, and overloaded."""
    random = np.random.default_rng(5)
    for _ in range(200):
        k, dt, late, most, moves = 10 ** random.uniform([2.0, -3.0, -2.0, -3.0, -3.0], [6.0, -1.5, -1.0, -1.5, -1.5])
        setting, drive, error = setting_of(dt, late, moves), Drive(), random.uniform(1.0, 10.0)
        for _ in range(100):
            drive = pressed(drive, error, 10.0, knows(k, 0.0), setting, (most, 1.0), 1.0, grows=True)
            assert drive.rate <= most * (1.0 + 1e-12)
        risen = knows(k, 0.0)._replace(rose=True)
        assert pressed(drive, -5.0, 10.0, risen, setting, (most, 1.0), 1.0, grows=True).rate <= 0.0


@pytest.mark.parametrize("declared", [20.0, 2e3, 2e5, 2e7])
def test_a_touch_shows_more_than_what_is_declared(declared):
    """Declared 10 to 100 times too soft, 2e3 N/m were pressed with swings of 5 of 10 N: the estimate began below it."""
    setting = setting_of(0.01, 0.03)._replace(begins=declared, resolved=1e-6)
    touched = Stiffness.of(declared)._replace(way=1e-4, force=0.2, quiet=0.0).landed(setting)
    assert (touched.begins, touched.stiff) == pytest.approx((2e3, 6e3))


@pytest.mark.parametrize(("missing", "taken"), [(15.0, 0.0), (0.4, 0.09e-3), (-1.0, 0.1e-3)])
def test_a_touch_takes_back_what_the_press_does_not_miss(missing, taken):
    """A lagging arm at 20 Hz was taken back from each touch with 4 of 20 N, and lost it: for 12 s it never pressed."""
    setting = Setting(0.05, 1.0, 0.0, 0.1, 0.1, 0.0, 0.0, 2e4, 2e-7)
    drive = struck(Drive(), 0.1e-3, missing, Stiffness.of(2e4), setting, 1.0, 1.0)
    assert 0.05 * drive.speed == pytest.approx(-taken, abs=1e-12)
