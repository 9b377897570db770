"""A path in contact is paused, turned round and sped up while it is driven, and the force goes on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.half_circle import PERIOD, Drive


def test_a_pause_stands_under_the_force_and_goes_on():
    drive = Drive()
    drive.tick(250)
    drive.follower.pause()
    solution = drive.until("paused", most=50)
    assert solution.ruling == "a pause"
    at, place = drive.tip(), solution.place
    for _ in range(125):  # half a second
        solution = drive.tick()
        assert solution.status == "paused"
        assert solution.speed == 0.0
    assert np.linalg.norm((drive.tip() - at)[:2]) < 1e-5
    assert abs(solution.place - place) < 1e-5 * PERIOD
    drive.follower.resume()
    assert drive.until("done").place == pytest.approx(PERIOD / 2, rel=1e-6)
    drive.check()


def test_back_to_the_start_and_forward_to_the_end():
    drive = Drive()
    drive.tick(100)
    start = drive.bench.start[:2, 3]
    drive.tick(100)
    drive.follower.reverse()
    solution = drive.until("paused")
    assert min(s.speed for s in drive.solutions) < 0.0
    assert solution.ruling == "the start"
    assert solution.place < 1e-6 * PERIOD
    assert np.linalg.norm(drive.tip()[:2] - start) < 1e-4
    assert drive.tick(25).status == "paused"
    drive.follower.reverse()
    assert drive.until("done").place == pytest.approx(PERIOD / 2, rel=1e-6)
    drive.check()


def test_an_override_of_zero_stands_and_of_a_half_is_half_as_fast():
    drive = Drive(rate=0.02)  # slow enough for half as much again
    drive.tick(150)
    fast = {part: drive.tick(100, override=part).speed / 0.02 for part in (0.0, 0.5, 1.0, 1.5)}
    assert fast == pytest.approx({0.0: 0.0, 0.5: 0.5, 1.0: 1.0, 1.5: 1.5}, rel=1e-9, abs=1e-12)
    assert drive.solutions[-1].status == "moving"
    drive.check()


def test_without_a_rate_an_override_only_slows_down():
    places = {}
    for part in (0.8, 1.0, 1.5):
        drive = Drive()
        places[part] = drive.tick(140, override=part).place
        drive.check()
    assert places[1.5] == places[1.0] > places[0.8] > 0.1 * PERIOD


def test_contact_lost_in_a_pause_is_regained_and_the_pause_goes_on():
    drive = Drive(yields=0.02)
    drive.tick(200)
    drive.follower.pause()
    place = drive.until("paused").place
    drive.bench.height -= 5e-3
    assert drive.until("waiting").ruling in ("no contact", "a pause")
    assert drive.until("paused").ruling == "a pause"
    solution = drive.tick(100)
    assert solution.status == "paused"
    assert abs(solution.place - place) < 1e-4 * PERIOD
    assert abs(solution.hybrid.intensities[0] / 5.0 - 1.0) < 0.02
    drive.follower.resume()
    assert drive.tick(25).place > place + 1e-3 * PERIOD


@settings(max_examples=2, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(["pause", "resume", "reverse", ""]), st.floats(0.0, 1.5), st.integers(1, 30)),
        min_size=3,
        max_size=8,
    ),
    st.sampled_from([{}, {"rate": 0.2}, {"jerk": 50.0, "rate": 0.2}]),
)
def test_random_orders_keep_the_tool_on_its_path_under_its_force(orders, options):
    drive = Drive(**options)
    drive.tick(150)
    for order, part, ticks in orders:
        if order:
            getattr(drive.follower, order)()
        drive.tick(ticks, override=part)
    drive.follower.resume()
    if drive.follower._path.drive.back:
        drive.follower.reverse()
    assert drive.until("done").place == pytest.approx(PERIOD / 2, rel=1e-6)
    drive.check()
