"""Contact is decided against the noise, the gain follows the stiffness, and what does not settle is reported."""

from collections import deque

import numpy as np
import pytest
from support.plane import gantry, pen, press_on_plane

import invariantqp as iq


def test_noise_three_times_the_declared_one_is_reported_and_no_fault():
    run = press_on_plane(5.0, noise=0.6, declared_noise=0.2, seconds=2.5)
    assert run.stopped is None
    assert run.statuses()[-1] == "degraded"
    reports = run.solutions[-1].reason
    assert "0.2 are declared (noise=)" in reports
    assert float(reports.split()[2]) == pytest.approx(0.6, rel=0.15)
    assert run.press[-200:].mean() == pytest.approx(5.0, rel=0.05)


@pytest.mark.parametrize(("press", "noise"), [(5.0, 1.0), (5.0, 0.2), (20.0, 1.0)])
def test_before_contact_the_status_is_lost_and_the_speed_limited(press, noise):
    run = press_on_plane(press, noise=noise, seconds=1.8)
    touch = run.touch
    assert 0 < touch < len(run.press)
    assert set(run.statuses()[:touch]) == {"lost"}
    assert -np.diff(run.height[:touch]).min() / run.dt <= 0.02 * (
        1.0 + 1e-3
    )  # held for a tick, a joint velocity moves the tip on an arc
    assert set(run.statuses()[-100:]) == {"ok"}


def test_a_removed_surface_is_reported_before_the_tool_sinks():
    run = press_on_plane(5.0, noise=1.0, drops=(0.05, 1.2, np.inf), seconds=1.7, on_loss="hold")
    gone = round(1.2 / run.dt)
    assert run.statuses()[gone - 1] == "ok"
    lost = run.statuses(gone).index("lost")
    assert lost * run.dt < 0.2
    assert set(run.statuses(gone + lost)) == {"lost"}
    assert run.height[gone] - run.height[-1] < 2.5e-3


@pytest.mark.cases(1)
@pytest.mark.parametrize("stiffness", [1e5, 500.0, 1e4])
def test_the_gain_follows_the_stiffness(stiffness):
    run = press_on_plane(5.0, stiffness=stiffness, seconds=3.0)
    assert run.rms(5.0, 2.2) < 0.025
    assert run.press.max() < 7.0
    assert set(run.statuses()[-200:]) == {"ok"}


AT_REST = {"arm": "gantry", "noise": 0.1, "gap": 1e-4, "period": np.inf}


def test_a_contact_that_stiffens_is_met_no_faster_than_the_approach():
    """Twice the desired force, and a tick at 20 mm/s: 4 N of 1e5 N/m."""
    run = press_on_plane(5.0, stiffness=lambda x: 200.0 * x + 1e5 * max(0.0, x - 0.01), seconds=6.0, **AT_REST)
    assert max(-s.velocity[2] for s in run.solutions) <= 0.02 * (1.0 + 1e-9)
    assert 5.0 < run.press.max() < 16.0


def test_a_saturated_sensor_is_not_pressed_on():
    saturated = {"stiffness": 1e3, "reads": lambda press, t: min(press, 1.5), "since": 0.0, "approach_distance": 0.01}
    run = press_on_plane(5.0, seconds=3.2, **saturated, **AT_REST)
    assert "ok" not in run.statuses(1000)  # it lets go again and again, and says so
    assert max(-s.velocity[2] for s in run.solutions) <= 0.02 * (1.0 + 1e-9)
    assert run.press.max() < 30.0  # the way that the sensor can still show, and two presses


def test_a_normal_declared_wrong_by_five_degrees_costs_little():
    """A proportional law is off by v sin(5 deg) / c, more than half of the press."""
    for seed in range(3):
        tilted = press_on_plane(5.0, tilt=np.radians(5.0), seconds=3.0, period=12.0, dt=0.004, seed=seed)
        held = tilted.press[round(1.5 / 0.004) :]
        assert np.median(np.abs(held - 5.0)) < 0.015 * 5.0
        assert held.min() > 0.5 * 5.0
    proportional = press_on_plane(5.0, tilt=np.radians(5.0), seconds=3.0, period=12.0, dt=0.004, compliance=1e-3)
    assert proportional.rms(5.0, 1.5) > 0.1


def test_a_declared_delay_is_compensated():
    run = press_on_plane(5.0, stiffness=1e5, delay=0.016, declared_delay=0.016, dt=0.004, seconds=4.0, seed=1)
    assert run.rms(5.0, 2.5) < 0.3  # ten micrometres of path are a newton
    assert run.press.max() < 10.0
    assert not any("later than declared" in s.reason for s in run.solutions)
    assert not (run.press[run.touch + 250 :] == 0.0).any()


@pytest.mark.cases(1)
@pytest.mark.parametrize(("stiffness", "most"), [(1e4, 12.0), (1e5, 40.0)])
def test_an_undeclared_delay_is_measured_in_the_air(stiffness, most):
    run = press_on_plane(10.0, stiffness=stiffness, delay=0.03, seconds=3.0, period=1e9)
    assert run.press.max() < most
    touch = run.touch
    assert "commands act 31" in run.solutions[touch].reason
    assert "ok" not in run.statuses(touch)
    if stiffness == 1e4:
        assert run.press[-200:] == pytest.approx(10.0, rel=0.05)


@pytest.mark.cases(1)
@pytest.mark.parametrize("stiffness", [1e3, 1e4])
def test_an_oscillation_from_late_readings_is_damped(stiffness):
    readings = deque(maxlen=26)

    def late(reading, normal):
        readings.append(reading)
        return readings[0]

    run = press_on_plane(10.0, stiffness=stiffness, fault=late, since=0.0, seconds=6.0, period=1e9)
    assert run.press[-400:] == pytest.approx(10.0, rel=0.2)


def test_an_oscillation_and_a_force_not_reached_are_reported():
    fast = press_on_plane(
        5.0, stiffness=1e5, delay=0.016, dt=0.004, gap=0.0, seconds=3.0, compliance=2e-3, max_force=1e3, max_moment=1e2
    )
    assert any("the press oscillates about 5 N" in s.reason for s in fast.solutions)
    assert "ok" not in fast.statuses()[-250:]
    slow = press_on_plane(
        5.0, tilt=np.radians(5.0), gap=0.0, compliance=2e-4, dt=0.004, seconds=3.0, period=6.0, max_force=50.0
    )
    assert any("the force is not reached: " in s.reason and s.status == "degraded" for s in slow.solutions)


def test_tapping_is_reported_as_a_force_not_reached():
    arm, random = gantry(), np.random.default_rng(0)
    loop = iq.HybridController(
        arm,
        pen(2.0, yields=np.inf, approach_distance=np.inf),
        dt=0.004,
        sensor=iq.WrenchSensor(np.eye(4), order="moment first", reads="action", noise=0.1),
    )
    q, reports = np.zeros(6), []
    for k in range(1000):
        felt = (1.2 if k % 20 < 10 else 0.0) + random.normal(0.0, 0.1)
        solution = loop.step(q, arm.pose(q), [0.0, 0.0, 0.0, 0.0, 0.0, -felt])
        reports.append((solution.status, solution.reason))
        q = q + 0.004 * solution.velocity
    assert {status for status, _ in reports[20:50]} == {"ok"}
    assert {status for status, _ in reports[350:]} == {"degraded"}
    assert any("the force is not reached: 0." in why for _, why in reports[350:])
