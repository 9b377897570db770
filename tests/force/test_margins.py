"""The margins of the force law: beside a frequency response of NumPy's, and the worst of them."""

import numpy as np
import pytest

import invariantqp as iq
from invariantqp.force import margins


@pytest.mark.parametrize("T", [0.004, 0.02, 0.06])
@pytest.mark.parametrize("ratio", [0.0, 0.01, 0.1])  # b/k [s]
@pytest.mark.parametrize("share", [1.0, 0.25])  # of the bound
def test_margins_agree_with_a_frequency_response(T, ratio, share):
    k = 2e4 * share
    found = margins(k, ratio * k, T, k_bound=2e4, b_bound=ratio * 2e4)
    w = np.geomspace(1e-4, 1e3, 400_000) / T
    L = found.g * (1 + 1 / (found.Ti * 1j * w)) / (1 + found.tau * 1j * w) * (k + ratio * k * 1j * w) / (1j * w)
    L *= np.exp(-1j * T * w)
    assert found.sensitivity == pytest.approx((1 / np.abs(1 + L)).max(), rel=1e-4)
    # A gain larger by the margin, and a delay longer by the phase margin, pass through -1.
    assert np.abs(1 + found.gain * L).min() < 2e-3
    crossing = np.flatnonzero(np.diff(np.sign(np.abs(L) - 1)))
    least = min(abs(np.degrees(np.angle(-L[i]))) for i in crossing)
    assert found.phase == pytest.approx(least, abs=0.05)


def test_the_worst_margins_are_those_stated():
    """T 15 to 60 ms, b/k 0 to 300 ms, true k down to a quarter of the bound, true b down to zero."""
    worst = [
        margins(k, b, T, k_bound=1e5, b_bound=1e5 * ratio)
        for T in (0.015, 0.02, 0.04, 0.06)
        for ratio in (0.0, 0.001, 0.003, 0.01, 0.02, 0.03, 0.05, 0.1, 0.3)
        for k in (1e5, 2.5e4)
        for b in {1e5 * ratio, k * ratio, 0.0}
    ]
    assert min(m.gain for m in worst) == pytest.approx(2.15, abs=0.01)
    assert min(m.phase for m in worst) == pytest.approx(54.0, abs=1.0)
    assert max(m.sensitivity for m in worst) == pytest.approx(1.87, abs=0.01)


@pytest.mark.parametrize(("argument", "given"), [("k", (0.0,)), ("b", (1.0, -1.0)), ("T", (1.0, 0.0, 0.0))])
def test_numbers_that_are_no_contact(argument, given):
    with pytest.raises(iq.BadInput) as caught:
        margins(*given)
    assert caught.value.argument == argument
