"""Streams from 10 Hz, jittered and with samples lost: the arm goes on while they last, and rests when they end."""

from itertools import count, pairwise

import numpy as np
import pytest
from support.arms import ready
from support.repeats import repeats
from support.streams import run

import invariantqp as iq
from invariantqp.paths.stamps import Arrivals

ARMS = ("ur5", "panda", "xarm7", "so101")
END = 3.5  # of the stream [s]


def driven(name, rate, kind, *, seed=0, jitter=0.0, lost=0.0, stamped=True, dt=0.008, timeout=0.1):
    """Times, statuses and speeds; when the last sample came, and when the next one was expected."""
    random, robot, start = np.random.default_rng(seed), iq.load_robot(name), ready(name)
    loop = iq.Controller(robot, dt=dt, acceleration_limit=8.0, exact="position" if len(start) < 6 else None)
    follower = iq.Follower(loop, jerk=200.0, timeout=timeout)
    stamps = np.arange(0.1, END, 1.0 / rate)
    came = [(t + 0.02 + jitter * random.random(), t) for t in stamps if random.random() >= lost or t == stamps[0]]
    came.sort()
    last = came[-1]

    def before(k, q):
        while came and came[0][0] <= k * dt:
            t = came.pop(0)[1]
            where, stamp = start + 0.1 * t, t if stamped else None
            if kind == "twist":
                follower.twist([0.0, 0.0, 0.1, 0.0, 0.03, 0.0])
            else:
                follower.add(robot.pose(where) if kind == "poses" else where, stamp)

    made = run(follower, start, round((END + 1.5) / dt), dt=dt, before=before)
    reports = list(zip(dt * np.arange(len(made.V)), made.statuses, np.abs(made.V).max(axis=1), strict=True))
    return reports, last[0], last[1] + 1.0 / rate + 0.02 + 0.5 * jitter


@pytest.mark.parametrize("kind", ["poses", "joints", "twist"])
@pytest.mark.parametrize("rate", [10.0, 15.0, 30.0, 100.0])
@pytest.mark.parametrize(("jitter", "lost"), [(0.0, 0.0), (0.05, 0.2)])
def test_the_arm_goes_on_and_rests_at_the_end(kind, rate, jitter, lost):
    for seed in range(repeats(20, 2)):
        name = ARMS[(seed + round(rate)) % 4]
        reports, last, expected = driven(name, rate, kind, seed=seed, jitter=jitter, lost=lost, stamped=seed % 2 == 0)
        begins = 0.8 if kind == "twist" else next(now for now, status, _ in reports if status != "waiting")
        during = [status for now, status, _ in reports if begins < now < last]
        assert "waiting" not in during
        assert min(speed for now, _, speed in reports if 1.0 < now < min(last, 2.0)) > 0.01
        assert max(speed for now, _, speed in reports if now > expected + 0.7) < 1e-3
        assert reports[-1][1] == "waiting"


@pytest.mark.parametrize("name", ARMS)
def test_a_stream_of_10_hz_is_followed_as_smoothly_as_one_of_30(name):
    """It stopped and went at each sample: 45 changes of status in 6 s, jerk 250 times as high."""
    jerks = []
    for rate in (10.0, 30.0):
        reports, last, _ = driven(name, rate, "poses", dt=0.004)
        assert {status for now, status, _ in reports if 0.8 < now < last} == {"moving"}
        speeds = np.array([speed for now, _, speed in reports if 0.8 < now < last])
        jerks.append(np.abs(np.diff(speeds, 2)).max() / 0.004**2)
    assert jerks[0] < 1.5 * jerks[1] + 5.0


@pytest.mark.parametrize(
    ("rate", "dt", "begins", "scatter"),
    [(rate, dt, 0.0, 0.015) for rate in (12.0, 15.0, 30.0, 60.0, 100.0) for dt in (0.002, 0.004, 0.008)]
    + [(30.0, 0.033, 0.032, 0.06), (14.53, 0.033, 0.021, 0.04), (28.0, 0.033, 0.023, 0.06), (12.5, 0.025, 0.079, 0.02)],
)
def test_samples_without_stamps_at_a_steady_speed_are_followed_at_that_speed(rate, dt, begins, scatter):
    """Samples count from the tick they came in, which scatters in a pattern: the arm stopped, or ran at 3 rad/s."""
    start, counted = ready("ur5"), count()
    follower = iq.Follower(iq.Controller(iq.load_robot("ur5"), dt=dt, acceleration_limit=8.0))
    due = [next(counted)]

    def before(k, q):
        while k * dt >= begins + due[0] / rate:
            follower.add(start + 0.1 * due[0] / rate)
            due[0] = next(counted)

    speeds = run(follower, start, round(4.0 / dt), dt=dt, before=before, clock=None).V
    assert speeds[round(1.0 / dt) :] == pytest.approx(0.1, abs=scatter)


def test_the_timeout_of_a_stream():
    for first in (0.1, 0.4):
        arrivals = Arrivals(0.1, first)
        arrivals.add(7.0)
        assert arrivals.timeout == first
    rates = (1000.0, 0.1, 0.1), (20.0, 0.1, 0.25), (10.0, 0.1, 0.5), (10.0, 2.0, 2.0), (5.0, 0.1, 0.5)
    for rate, least, expected in rates:
        arrivals = Arrivals(least, least)
        for k in range(20):
            arrivals.add(k / rate)
            arrivals.add(k / rate)  # two in one tick are no interval
        assert arrivals.timeout == pytest.approx(expected)
    arrivals.add(100.0)  # another stream
    assert arrivals.timeout == 0.1


def test_the_timeout_adapts_to_a_stream_that_becomes_slow():
    times, late, arrivals = [*np.arange(0.0, 1.0, 0.01), *np.arange(1.05, 3.0, 0.1)], 0, Arrivals(0.1, 0.1)
    for before, now in pairwise(times):
        arrivals.add(before)
        late += now - before > arrivals.timeout
    assert late <= 2
