"""Damped contacts are held; unresponsive readings stop the tool and are never "ok" at the end."""

import numpy as np
import pytest
from support.plane import press_on_damper

PRESS = 10.0


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("arm", "stiffness", "damping", "delay"),
    [
        ("ur5", 5e4, 2000.0, 0.0),
        ("panda", 2e4, 800.0, 0.01),
        ("gantry", 2e4, 200.0, 0.01),
        ("panda", 5e4, 2000.0, 0.01),
        ("ur5", 1e3, 60.0, 0.0),
    ],
)
def test_a_contact_with_a_damper_is_held(arm, stiffness, damping, delay):
    run = press_on_damper(arm, stiffness=stiffness, damping=damping, lag=0.01, declared_delay=delay, seconds=6.0)
    assert run.stopped is None
    assert run.reports[-1][0] == "ok"
    assert np.sqrt(np.mean((run.press[-200:] - PRESS) ** 2)) < 0.03 * PRESS
    assert run.press.max() < 1.5 * PRESS


@pytest.mark.cases(1)
@pytest.mark.parametrize(("press", "stiffness", "seed"), [(2.0, 1e3, 0), (5.0, 356.0, 0), (10.0, 356.0, 2)])
def test_a_press_nearly_hidden_by_noise_is_unloaded_gently(press, stiffness, seed):
    run = press_on_damper("ur5", press=press, stiffness=stiffness, noise=0.5, dt=0.01, seconds=16.0, seed=seed)
    assert run.stopped is None
    assert run.reports[-1][0] in ("ok", "limited", "degraded")
    assert run.height.max() < 8e-3
    assert run.press.max() < 1.6 * press


class Held:
    """A reading that stays as it was when it was read first, or at a share of the press."""

    def __init__(self, share=None):
        self.value = None if share is None else share * PRESS

    def __call__(self, press, t):
        if self.value is None:
            self.value = press
        return self.value


class InTheTouch:
    """A reading that sticks once it is above a share of the press."""

    def __init__(self, share):
        self.share, self.value = share, None

    def __call__(self, press, t):
        if self.value is None and press > self.share * PRESS:
            self.value = press
        return press if self.value is None else self.value


# Readings, from when on, and how many presses the tool may press with meanwhile.
FAULTS = {
    "stuck above": (lambda: Held(1.4), 2.5, 1.1),
    "stuck far above": (lambda: Held(1.9), 2.5, 1.1),
    "stuck below": (lambda: Held(0.3), 2.5, 2.6),
    "stuck just below": (lambda: Held(0.9), 2.5, 3.0),
    "stuck in the touch": (lambda: InTheTouch(0.3), 0.0, 4.0),
    "wrong sign": (lambda: lambda press, t: -press, 0.0, 2.6),
    "wrong sign, half a press of weight": (lambda: lambda press, t: 0.5 * PRESS - press, 0.0, 2.6),
    "a bias that jumps up by more than the press": (lambda: lambda press, t: press + 1.5 * PRESS, 2.5, 1.1),
}


ARMS = [("ur5", 8e4, 0.01), ("panda", 3e4, 0.004), ("gantry", 7e3, 0.002)]


@pytest.mark.parametrize("name", FAULTS)
def test_unresponsive_readings_stop_the_tool_within_millimetres(name):
    make, since, presses = FAULTS[name]
    arm, stiffness, dt = ARMS[list(FAULTS).index(name) % len(ARMS)]
    run = press_on_damper(
        arm, stiffness=stiffness, damping=0.005 * stiffness, dt=dt, reads=make(), since=since, seconds=8.0, seed=3
    )
    stop = run.stopped
    assert stop is not None
    assert run.reports[-1][0] in ("fault", "overload")
    first = int(since / dt)
    assert "overload" in run.reports[stop][0] or run.press[first : stop + 1].max(initial=0.0) < presses * PRESS
    assert run.height[first : stop + 1].max() < 8e-3


# As soft as MuJoCo's position servos are made: a press that joints hardly show, against a table.
SERVOS = {"arm": "ur5", "stiffness": 3e6, "damping": 0.0, "drives": 2.5e4, "lag": 0.005, "declared_delay": 0.0}


@pytest.mark.parametrize("dt", [0.002, 0.01])
def test_compliant_drives_cause_no_unloading(dt):
    run = press_on_damper(dt=dt, seconds=6.0, **SERVOS)
    assert {status for status, _ in run.reports} <= {"lost", "ok", "limited"}
    assert run.reports[-1][0] == "ok"
    assert np.sqrt(np.mean((run.press[-round(2.0 / dt) :] - PRESS) ** 2)) < 0.03 * PRESS


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 1.5])
def test_compliant_drives_press_no_harder_on_a_stuck_reading(share):
    run = press_on_damper(dt=0.01, seconds=12.0, since=3.0, reads=Held(share), **SERVOS)
    assert run.reports[-1][0] == "fault"
    assert run.press.max() < 3.5 * PRESS
    assert run.height[300 : run.stopped].max() < 8e-3


def test_an_upward_drift_moves_the_tool_by_millimetres():
    drift = press_on_damper(press=2.0, reads=lambda press, t: press + 0.5 * (t - 2.0), since=2.0, seconds=20.0, dt=0.01)
    assert drift.reports[-1][0] == "fault"
    assert drift.height[: drift.stopped].max() < 25e-3


MOVED = {"dt": 0.01, "noise": 0.2, "declared_delay": 0.0}


@pytest.mark.parametrize("rate", [0.0, 0.3])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_bias_that_drifts_or_jumps_at_rest_is_a_fault(sign, rate):
    bias = sign * (0.0 if rate else 4.0)
    run = press_on_damper(
        dt=0.01, since=4.0, seconds=24.0, reads=lambda press, t: press + bias + sign * rate * (t - 4.0)
    )
    assert run.reports[-1][0] == "fault"
    assert run.press.max() < 1.6 * PRESS
    assert run.height[round(4.0 / run.dt) : run.stopped].max() < 2e-3


@pytest.mark.parametrize("rate", [-0.4, 0.4])
def test_a_drift_on_a_stiff_table_is_a_fault_before_it_reaches_the_press(rate):
    table = {"stiffness": 9e4, "damping": 1.8e3, "lag": 0.01, **MOVED}
    drifts = {"since": 4.0, "reads": lambda press, t: press + rate * (t - 4.0), "seconds": 4.0 + 5.0 / abs(rate)}
    run = press_on_damper("panda", press=5.0, **table, **drifts)
    assert run.reports[-1][0] == "fault"
    assert run.press.max() < 2.0 * 5.0
    assert run.height[round(4.0 / run.dt) : run.stopped].max() < 2e-3


def test_a_bias_that_jumps_before_the_tool_rests_is_a_fault():
    reached = []

    def reads(press, t):
        if not reached and press > 0.95 * PRESS:
            reached.append(t)
        return press + PRESS * bool(reached and t > reached[0] + 0.5)

    run = press_on_damper(stiffness=3e4, damping=600.0, dt=0.004, seconds=8.0, reads=reads, noise=0.1, since=0.0)
    assert reached
    assert run.reports[-1][0] == "fault"
    assert run.press.max() < 1.1 * PRESS


def test_a_changed_force_is_tested_once_and_then_accepted():
    """4 N more than the spring explains, and nothing in the air."""
    run = press_on_damper(dt=0.01, since=4.0, seconds=20.0, reads=lambda press, t: press + 4.0 * (press > 0.0))
    assert run.stopped is None
    asked = [k for k, (_, why) in enumerate(run.reports) if "unloading to see whether they fall" in why]
    assert asked
    assert max(asked) * run.dt < 8.0
    assert {status for status, _ in run.reports[-500:]} == {"ok"}


@pytest.mark.parametrize("damping", [0.0, 104.0])
def test_readings_that_fall_during_unloading_are_no_fault(damping):
    run = press_on_damper(stiffness=2600.0, damping=damping, moves=(1e-3, 0.6), gap=4e-3, seconds=6.0, **MOVED)
    assert any("unloading" in why for _, why in run.reports)
    assert run.stopped is None
    assert run.press.max() < 1.5 * PRESS


def test_unloading_is_faster_than_the_force_law():
    run = press_on_damper("ur5", press=5.0, stiffness=2207.0, moves=(3e-3, 0.2622), seconds=8.0, **MOVED)
    assert any("unloading" in why for _, why in run.reports)
    assert run.stopped is None


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("stiffness", "b", "moves", "press", "seed"),
    [
        (5420.0, 0.003, (3e-3, 0.306), 10.0, 5),
        (1030.0, 0.02, (3e-3, 0.43), 5.0, 3),
        (3000.0, 0.02, (3e-3, 0.4), 10.0, 2),
        (8000.0, 0.01, (3e-3, 0.3), 10.0, 2),
    ],
)
def test_an_undeclared_surface_motion_hidden_by_noise_is_no_fault(stiffness, b, moves, press, seed):
    """The surface follows the tool: within 1 mm the readings fall by less than six sigma."""
    surface = {"stiffness": stiffness, "damping": b * stiffness, "moves": moves, "gap": 4e-3}
    run = press_on_damper("ur5", press=press, seconds=8.0, seed=seed, **surface, **MOVED | {"noise": 0.5})
    assert run.stopped is None
    assert run.press.max() < 1.5 * press


def test_a_contact_from_the_start_is_tested_once_and_accepted():
    def reads(press, t):  # the plant itself begins with none
        return press if t > 0.0 else PRESS

    run = press_on_damper(dt=0.01, gap=-PRESS / 2e4, seconds=12.0, reads=reads, since=0.0)
    asked = [k for k, (_, why) in enumerate(run.reports) if "unloading" in why]
    assert 0 < len(asked) < 20
    assert {status for status, _ in run.reports[max(asked) + 200 :]} == {"ok"}


@pytest.mark.cases(1)
@pytest.mark.parametrize(("stiffness", "share"), [(1e3, 1.9), (1e5, 1.1)])
def test_a_constant_reading_above_the_desired_press_moves_the_tool_by_millimetres(share, stiffness):
    run = press_on_damper("panda", stiffness=stiffness, reads=Held(share), since=4.0, seconds=30.0)
    stop = run.stopped
    assert run.reports[stop][0] == "fault"
    assert (
        "are still read: the readings do not respond to the motion: a sensor that is stuck, drifts"
        in run.reports[stop][1]
    )
    assert 1e-3 < run.height[: stop + 1].max() < 4e-3


@pytest.mark.parametrize("share", [0.03, 0.09, 0.105, 0.11, 0.2])
def test_a_low_stuck_reading_with_noise_is_a_fault(share):
    random, held = np.random.default_rng(0), Held(share)
    readings = {"reads": lambda press, t: held(press, t) + random.normal(0.0, 0.2), "since": 4.0}
    run = press_on_damper(stiffness=4.5e4, noise=0.2, seconds=8.0, **readings)
    assert run.reports[-1][0] in ("fault", "lost")
    assert run.press.max() < 2.5 * PRESS


@pytest.mark.parametrize("dt", [0.002, 0.004])
@pytest.mark.parametrize("arm", ["ur5", "panda"])
def test_a_chattering_press_is_held_in_its_mean(arm, dt):
    read = []

    def chatters(press, t):
        read.append(max(0.0, press + 14.0 * np.sin(2.0 * np.pi * 57.0 * t)))
        return read[-1]

    given = {"stiffness": 5e4, "damping": 500.0, "speed": 0.02, "max_force": 60.0}
    run = press_on_damper(arm, dt=dt, reads=chatters, since=2.0, seconds=8.0, **given)
    assert run.stopped is None
    ticks = round(0.5 / dt)
    means = np.mean(np.reshape(read[: len(read) // ticks * ticks], (-1, ticks)), axis=1)
    assert means[2:] == pytest.approx(PRESS, abs=0.08 * PRESS)


@pytest.mark.parametrize("share", [0.5, 0.9, 1.1, 1.5])
@pytest.mark.parametrize(("speed", "stiffness"), [(0.02, 2e4), (0.06, 2e4), (0.04, 8e4)])
def test_a_reading_stuck_during_a_slide_is_a_fault(share, speed, stiffness):
    run = press_on_damper(stiffness=stiffness, speed=speed, reads=Held(share), since=4.0, seconds=10.0)
    assert run.reports[-1][0] == "fault"
    assert run.press.max() < 3.0 * PRESS
    reports = [status for status, _ in run.reports[round(4.6 / run.dt) :]]
    assert "ok" not in reports
