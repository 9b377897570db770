"""Gains: what they are bounded by, and the one that may be meant as a share of the error in a tick."""

import warnings

import numpy as np
import pytest

import invariantqp as iq

ARM = iq.robots.Chain(iq.revolute([0, 0, 1], [0, 0, 0])[:, None], iq.transform(translation=[1.0, 0.0, 0.0]))


@pytest.mark.parametrize(("gain", "dt"), [(0.5, 0.002), (1.0, 0.02), (0.1, 0.01)])
def test_a_gain_that_may_be_a_share_of_the_error_warns_once(gain, dt):
    with pytest.warns(UserWarning, match=f"gain={gain:g} is {gain:g} 1/s here") as told:
        loop = iq.Controller(ARM, dt=dt, gain=gain)
    assert len(told) == 1
    assert told[0].filename == __file__
    said = str(told[0].message)
    assert f"closes {100 * gain * dt:.2g} % of the error" in said
    assert f"gain={gain / dt:g} here" in said
    assert loop.gain == gain
    with warnings.catch_warnings(record=True) as later:
        loop.step([0.0], iq.transform(translation=[1.0, 0.1, 0.0]))
    assert later == []


@pytest.mark.parametrize(("gain", "dt"), [(1.01, 0.002), (1.0, 0.021), (0.5, 0.1), (None, 0.002), (None, 0.2)])
def test_no_other_gain_warns(gain, dt):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        iq.Controller(ARM, dt=dt, gain=gain)


@pytest.mark.parametrize(("times", "said"), [({"dt": 2.0}, "2 ms are dt=0.002, a rate of 2 Hz is dt=0.5"),
                                              ({"dt": 0.002, "delay": 8.0}, "8 ms are delay=0.008")])  # fmt: skip
def test_milliseconds_and_rates_instead_of_seconds_warn(times, said):
    with pytest.warns(UserWarning, match=said) as told:
        iq.Controller(ARM, **times)
    assert len(told) == 1
    assert told[0].filename == __file__


@pytest.mark.parametrize("number", [np.longdouble(0.01), np.array(0.01), np.float32(0.01), np.array(0.01, np.float16)])
def test_numbers_of_every_kind_are_numbers(number):
    loop = iq.Controller(ARM, dt=0.01, gain=np.longdouble(5.0), delay=number, position_margin=number)
    assert loop.gain == 5.0
    assert np.isfinite(loop.step([0.0], iq.transform(translation=[1.0, 0.1, 0.0])).velocity).all()
