"""A reading that falls in mid-press is approached no deeper than contact was felt; what is healthy goes on."""

import numpy as np
import pytest
from support.plane import press_on_damper

FAILS = 3.5  # [s]
READINGS = {
    "stuck at nothing": lambda gain, press: lambda force, t: 0.0,
    "a gain that falls": lambda gain, press: lambda force, t: gain * force,
    "an offset that cancels the press": lambda gain, press: lambda force, t: force - press,
}


@pytest.mark.cases(4)
@pytest.mark.parametrize("seed", range(24))
@pytest.mark.parametrize("name", READINGS)
def test_a_reading_that_falls_during_a_press_is_not_followed(name, seed):
    random = np.random.default_rng([seed, *name.encode()])
    press, lag = random.choice([5.0, 10.0, 20.0]), random.choice([0.0, 0.005, 0.01])
    stiffness = 10.0 ** random.uniform(np.log10(2e3), np.log10(5e4))
    run = press_on_damper(
        random.choice(["gantry", "ur5", "panda", "xarm7"]),
        stiffness=stiffness,
        damping=random.choice([0.0, 0.005, 0.02]) * stiffness,
        press=press,
        noise=random.choice([0.0, 0.1, 0.3]),
        dt=random.choice([0.002, 0.004, 0.01]),
        lag=lag,
        declared_delay=lag,
        speed=random.choice([0.0, 0.02, 0.05]),
        reads=READINGS[name](random.uniform(0.0, 0.1), press),
        since=FAILS,
        seconds=6.5,
        seed=seed,
    )
    assert run.press[round(FAILS / run.dt) :].max(initial=0.0) < 2.5 * press
    assert run.reports[-1][0] in ("fault", "lost", "overload")


@pytest.mark.parametrize("arm", ["gantry", "ur5"])
def test_compliant_drives_press_no_harder_on_a_reading_that_falls(arm):
    servos = {"stiffness": 3e6, "drives": 2.5e4, "declared_delay": 0.0}
    run = press_on_damper(arm, dt=0.01, reads=lambda force, t: 0.0, since=FAILS, seconds=8.0, **servos)
    assert run.press.max() < 2.5 * 10.0
    assert run.reports[-1][0] in ("fault", "lost", "overload")


@pytest.mark.parametrize("speed", [0.0, 0.03])
@pytest.mark.parametrize("seconds", [0.08, 0.6])
@pytest.mark.parametrize(("arm", "stiffness"), [("gantry", 2e4), ("panda", 4e3)])
def test_a_plate_that_is_taken_away_and_brought_back_is_pressed_again(arm, stiffness, seconds, speed):
    run = press_on_damper(arm, stiffness=stiffness, drops=(5e-3, 4.0, 4.0 + seconds), speed=speed, seconds=7.0)
    assert run.stopped is None
    assert run.reports[-1][0] == "ok"
    assert np.abs(run.press[-100:] - 10.0).max() < 1.0
    assert run.press.max() < 2.0 * 10.0


@pytest.mark.parametrize("slope", [-0.0875, 0.0875])
@pytest.mark.parametrize(("arm", "stiffness"), [("gantry", 2e4), ("xarm7", 5e4), ("panda", 2e3)])
def test_a_slope_of_five_degrees_is_followed(arm, stiffness, slope):
    run = press_on_damper(arm, stiffness=stiffness, slope=slope, speed=0.04, seconds=6.0)
    assert run.stopped is None
    assert {status for status, _ in run.reports[-250:]} == {"ok"}
    assert np.abs(run.press[-250:] - 10.0).max() < 2.0


@pytest.mark.parametrize(("yields", "status"), [(3e-3, "ok"), (0.0, "lost")])
def test_a_step_down_is_followed_where_it_is_declared(yields, status):
    run = press_on_damper(drops=(2e-3, 4.0, np.inf), speed=0.03, seconds=7.0, yields=yields)
    assert run.reports[-1][0] == status
    if yields:
        assert np.abs(run.press[-100:] - 10.0).max() < 1.0
    else:
        assert run.height[-1] > 1e-3  # above what has stepped down by 2 mm
        assert "standing still at the last contact" in run.reports[-1][1]
