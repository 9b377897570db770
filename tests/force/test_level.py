"""Readings that jump and stay are told from a contact, however stiff it is, and from whatever else air reads."""

import numpy as np
import pytest

from invariantqp.force.level import Level

NOISE, PRESS, DT, STEP = 0.2, 10.0, 0.002, 3.8e-5  # [N], [N], [s], way of a tick at 19 mm/s [m]


def judged(presses, ways=None):
    """The tick in which readings are said to be stuck, None for never, and what is thought then."""
    level = Level()
    for tick, press in enumerate(presses):
        level = level.after((float(press), PRESS), (STEP if ways is None else ways[tick],) * 2, NOISE)
        if level.stuck:
            return tick, level
    return None, level


def noise(ticks, seed):
    return np.random.default_rng(seed).normal(0.0, NOISE, ticks)


@pytest.mark.parametrize("seed", range(3))
def test_a_jump_that_stays_is_told_soon_and_how_large_it_is(seed):
    for size, soon in ((0.8, 40), (1.0, 20), (3.0, 8)):
        presses = noise(200, seed)
        presses[100:] += size
        tick, level = judged(presses)
        assert 100 <= tick < 100 + soon
        assert level.shifted == pytest.approx(size, abs=4.0 * NOISE / np.sqrt(tick - 99))
        assert "a sensor that is stuck, or whose bias jumped" in level.trouble()


@pytest.mark.parametrize("stiffness", [200.0, 1e3, 1e4, 1e6])
def test_a_contact_is_never_one(stiffness):
    """Felt first anywhere within a tick, and slowed down by whatever is felt."""
    for seed in range(3):
        way, presses, ways = 0.0, [], []
        for n in noise(160, seed):
            press = stiffness * max(0.0, way - (100.0 + seed / 10.0) * STEP) + n
            presses.append(press)
            ways.append(STEP * (0.15 if press > 0.6 else 1.0))
            way += ways[-1]
        assert judged(presses, [0.0, *ways])[0] is None


def test_air_is_none_either():
    """Coloured noise, a drift, a cable that swings, a small step, a fall."""
    n, t = noise(600, 1), np.arange(600) * DT
    smooth = np.convolve(n, np.ones(5) / np.sqrt(5.0), "same")
    swings = [n + size * np.sin(2.0 * np.pi * rate * t) for size in (0.3, 1.0) for rate in (3.0, 10.0)]
    for presses in (n, smooth, n + t, *swings, n + 0.3 * (t > 0.8)):
        assert judged(presses)[0] is None
    assert judged(n + 3.0 * (t > 0.8), 0.0 * t)[0] is None  # a tool that stands
    assert judged(n - 3.0 * (t > 0.8))[0] is None  # a fall
