"""Readings that do not answer the way in stop the push, whatever they say; those that do are believed."""

from functools import cache

import numpy as np
import pytest
from support.noisy_plane import press_on_plane
from support.spring_plane import gantry, pen

import invariantqp as iq
from invariantqp.force.agreement import Agreement, answer_of
from invariantqp.force.touch import Touch

PRESS, NOISE, REST = 10.0, 0.2, 1e9  # [N], [N], a turn so long that the tool stands still [s]
PHASES = {"in the air": 0.05, "just after touch": 0.136, "settled": 0.4}


class Stuck:
    """A sensor that reads a share of the wanted press and its noise, or, where it saturates, no more than that."""

    def __init__(self, share, *, saturates=False):
        self.random, self.most, self.saturates = np.random.default_rng(5), share * PRESS, saturates

    def __call__(self, reading, normal):
        press = reading[3:] @ normal
        if self.saturates and press < self.most:
            return reading
        return np.concatenate((self.random.normal(0, 0.006, 3), self.most * normal + self.random.normal(0, NOISE, 3)))


@cache
def undisturbed(stiffness, gap):
    """A run without a fault, until after the touch."""
    return press_on_plane(PRESS, stiffness=stiffness, seconds=0.1 + 50.0 * gap, gap=gap)


def stuck(share, *, saturates=False, period=REST, **run):
    """A run with such a sensor, until the tool can be seen to retreat."""
    return press_on_plane(PRESS, fault=Stuck(share, saturates=saturates), period=period, after_stop=0.1, **run)


@pytest.mark.parametrize("stiffness", [1e3, 2e4, 1e5])
@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_reading_stuck_in_its_noise_presses_once_more_at_most(share, phase, stiffness):
    since = PHASES[phase]
    run = stuck(share, stiffness=stiffness, since=since, seconds=since + 0.7)
    stop = run.stopped()
    assert run.solutions[stop].status == "fault"
    reason = run.solutions[stop].reason
    assert "a sensor at fault, a step or a slope" in reason or "a sensor that is stuck" in reason
    assert run.press.max() <= 2.0 * PRESS + 0.02 * 0.012 * max(stiffness, 1e4)
    assert run.height[-1] > run.height[stop] + 1e-3  # and left


@pytest.mark.parametrize("gap", [0.004, 0.00401, 0.00403])
@pytest.mark.parametrize(("stiffness", "share"), [(2e4, 0.12), (2e4, 0.2), (1e5, 0.1), (1e5, 0.3)])
def test_a_reading_stuck_in_the_very_tick_of_the_touch_or_soon_after(stiffness, share, gap):
    """The jump alone shows how stiff the contact is; another 12 ms of the approach beside twice the press."""
    touch = undisturbed(stiffness, gap).touch()
    for tick in (touch, touch + 1, touch + 3):
        run = stuck(share, stiffness=stiffness, since=0.002 * tick, seconds=1.3, gap=gap)
        assert run.solutions[run.stopped()].status == "fault"
        assert run.press.max() <= 2.0 * PRESS + 0.02 * 0.012 * stiffness


@pytest.mark.parametrize("stiffness", [2e4, 1e5])
@pytest.mark.parametrize("share", [0.0, 0.12, 0.2])
def test_a_reading_stuck_once_a_touch_is_decided_or_in_the_air(share, stiffness):
    """At 0 from 2 N on, above that in the air, too."""
    press = undisturbed(stiffness, 0.01).press
    decided = int(np.argmax(press > 2.0)) + 1
    for tick in (50, decided) if share else (decided,):
        run = stuck(share, stiffness=stiffness, since=0.002 * tick, seconds=1.3, gap=0.01)
        assert run.solutions[run.stopped()].status == "fault"
        assert run.press.max() <= 2.0 * PRESS + 0.02 * 0.002 * stiffness


@pytest.mark.parametrize(("stiffness", "most"), [(1e3, 22.0), (2e4, 32.0), (1e5, 60.0)])
def test_a_sensor_that_saturates_shows_before_that_how_stiff_the_contact_is(stiffness, most):
    run = stuck(0.5, saturates=True, stiffness=stiffness, since=0.0, seconds=2.0)
    assert run.solutions[run.stopped()].status == "fault"
    assert 5.0 < run.press.max() < most


def test_while_the_tool_slides_a_slope_is_allowed_for_and_no_more():
    """At 63 mm/s six degrees lead in by 6.3 mm/s."""
    for share, most in ((0.3, 30.0), (0.9, 40.0)):
        run = stuck(share, since=1.5, seconds=2.2, period=3.0, gap=0.004)
        assert run.solutions[run.stopped()].status == "fault"
        assert 2.0 * PRESS * 0.9 < run.press.max() < most
    slope = press_on_plane(PRESS, tilt=np.radians(5.0), seconds=2.0)
    assert set(slope.statuses()[400:]) == {"ok"}


def test_a_surface_that_gives_way_is_followed_as_far_as_was_told():
    followed = press_on_plane(PRESS, removed=0.4, seconds=3.6, yields=0.06, dt=0.004)
    assert followed.statuses()[-1] == "ok"
    assert followed.press[-1] == pytest.approx(PRESS, rel=0.1)
    left = press_on_plane(PRESS, removed=0.4, seconds=0.9)
    stop = left.stopped()
    assert left.solutions[stop].status == "fault"
    assert left.height[200] - left.height[stop] < 3e-3


@pytest.mark.parametrize("seed", range(3))
def test_a_contact_that_answers_is_never_doubted(seed):
    """Steps of the wanted press, a told stiffness off by up to five, noise of half the press, for 40 000 ticks."""
    random, dt = np.random.default_rng(seed), 0.002
    for told, noise in ((1.0, 0.0), (1.0, 2.5), (5.0, 0.5), (0.2, 2.5)):
        k, x, agreement, touch, wanted, highest = 1e4, 0.0, Agreement(), Touch(), 5.0, 0.0
        for tick in range(10_000):
            wanted = random.uniform(3.0, 6.0) if tick % 100 == 0 else wanted
            way = 80.0 * dt / (max(told, 1.0) * k) * (wanted - k * x - noise * random.normal())
            x += way
            felt = k * x + noise * random.normal()
            touch, highest = touch.after(felt, 0.5, noise, dt), max(highest, felt)
            agreement = agreement.after((felt, wanted), (way, 0.0), answer_of(told * k, 0.0), noise, dt, touch)
            assert not agreement.trouble((felt, wanted), noise, answer_of(told * k, 0.0), 0.0, highest)


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5])
@pytest.mark.parametrize(("scale", "doubted"), [(0.3, True), (1.0, False)])
def test_a_stiffness_told_tells_a_sensor_whose_scale_is_wrong(scale, doubted, stiffness):
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=0.1)
    robot, q, random = gantry(), np.zeros(6), np.random.default_rng(0)
    loop = iq.HybridController(robot, pen(stiffness=stiffness), dt=0.002, sensor=sensor)
    solutions = []
    for _ in range(300):
        press = stiffness * max(0.0, -1e-4 - robot.pose(q)[2, 3])
        reading = np.r_[0, 0, 0, random.normal(0.0, 0.1, 3)] + scale * press * np.eye(6)[5]
        solutions.append(loop.step(q, np.eye(4), reading))
        q = q + 0.002 * solutions[-1].velocity
    assert (
        any("are told: the stiffness, the sensor's scale or the delay is wrong" in s.reason for s in solutions)
        == doubted
    )
    assert (solutions[-1].status == "degraded") == doubted


@pytest.mark.parametrize("stiffness", [500.0, 1e4])
@pytest.mark.parametrize("unit", [1e3, 1e-3])
def test_a_stiffness_told_in_millimetres_is_answered_as_in_metres(unit, stiffness):
    def moved(u):
        """Velocities of the tip in metres, from a cell whose lengths are in units of 1/u metres."""
        ways = {"approach_speed": 0.02 * u, "approach_distance": 0.1 * u, "retreat_speed": 0.02 * u}
        task = pen(PRESS, stiffness=stiffness / u, size=0.05 * u, edge_margin=0.01 * u, **ways)
        sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=0.1)
        robot, q, random = gantry(), np.zeros(6), np.random.default_rng(0)
        loop, speeds, statuses = iq.HybridController(robot, task, dt=0.002, sensor=sensor), [], []
        for _ in range(400):
            force = random.normal(0.0, 0.1, 3)
            force[2] += stiffness * max(0.0, -1e-4 - robot.pose(q)[2, 3] / u)
            solution = loop.step(q, np.eye(4), np.r_[np.zeros(3), force])
            speeds.append(solution.velocity[:3] / u)
            statuses.append(solution.status)
            q = q + 0.002 * solution.velocity
        return np.array(speeds), statuses

    (speeds, statuses), (there, also) = moved(1.0), moved(unit)
    assert statuses[-1] == "ok"
    assert also == statuses
    assert there == pytest.approx(speeds, abs=1e-12)


@pytest.mark.parametrize("stiffness", [1e3, 2e4, 1e5])
@pytest.mark.parametrize("share", [1.1, 1.9])
def test_a_reading_that_stays_above_the_wanted_press_leads_the_tool_out_by_millimetres(share, stiffness):
    """It led the arm away without end, "ok": by 190 to 840 mm."""
    run = stuck(share, stiffness=stiffness, since=2.0, seconds=6.0, dt=0.004)
    stop = run.stopped()
    assert run.solutions[stop].status == "fault"
    assert "above where it touched: a sensor that is stuck, drifts or is not tared" in run.solutions[stop].reason
    assert 1e-3 < run.height[: stop + 1].max() - run.height[run.touch()] < 4e-3


def test_a_bias_that_drifts_upwards_leads_the_tool_out_by_millimetres():
    """2 N wanted, 1 N/s."""
    start = 2.0
    ticks = iter(range(100_000))

    def drifts(reading, normal):
        return reading + np.r_[0, 0, 0, 0.004 * next(ticks) * normal]

    run = press_on_plane(2.0, noise=0.05, fault=drifts, since=start, seconds=8.0, period=REST, dt=0.004, after_stop=0.1)
    stop = run.stopped()
    assert run.solutions[stop].status == "fault"
    assert run.height[: stop + 1].max() - run.height[run.touch()] < 25e-3
