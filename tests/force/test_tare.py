"""Readings in the air before the touch are a bias, of either sign; a contact from the start is none."""

import numpy as np
import pytest
from support.plane import press_on_damper

PRESS = 10.0


@pytest.mark.parametrize("share", [-0.45, -0.2, -0.1, 0.05, 0.2, 0.45, 0.65, 1.2])
@pytest.mark.parametrize(("arm", "stiffness", "dt"), [("ur5", 8e4, 0.002), ("gantry", 3e3, 0.01)])
def test_a_bias_is_no_press(share, arm, stiffness, dt):
    biased = {"reads": lambda press, t: press + share * PRESS, "since": 0.0}
    run = press_on_damper(arm, stiffness=stiffness, dt=dt, seconds=5.0, **biased)
    assert run.stopped is None
    assert run.reports[-1][0] in ("ok", "limited")
    assert np.mean(run.press[-round(1.0 / dt) :]) == pytest.approx(PRESS, rel=0.05)
    assert run.press.max() < 1.3 * PRESS


@pytest.mark.parametrize("stiffness", [2e3, 2e4, 2e5])
@pytest.mark.parametrize("press", [0.5, 1.0])
def test_a_contact_from_the_start_is_no_bias(stiffness, press):
    run = press_on_damper("ur5", stiffness=stiffness, gap=-press * PRESS / stiffness, dt=0.004, seconds=4.0)
    assert run.stopped is None
    assert np.mean(run.press[-250:]) == pytest.approx(PRESS, rel=0.05)
    assert run.press.max() < 1.3 * PRESS


def test_an_old_tare_of_a_drifting_sensor_is_reported():
    loop = press_on_damper("gantry", dt=0.004, seconds=5.0, drift=1.0)
    late = [k * 0.004 for k, (_, why) in enumerate(loop.reports) if "not tared for" in why]
    assert 2.5 < late[0] < 4.0
    assert loop.stopped is None
    assert np.mean(loop.press[-250:]) == pytest.approx(PRESS, rel=0.05)
