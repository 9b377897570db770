"""Each fault of a sensor at each phase: reported, stopped, and never pressed on."""

import numpy as np
import pytest
from support.plane import FAULTS, gantry, press_on_plane

import invariantqp as iq

PHASES = {"at the start": 0.0, "in the air": 0.05, "just after touch": 0.25, "settled": 1.0}
PRESS = 10.0


@pytest.mark.cases(12)
@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_reported_and_the_press_stops(name, phase):
    make, status, message = FAULTS[name]
    since = PHASES[phase]
    run = press_on_plane(PRESS, fault=make(), since=since, seconds=max(since, 0.3) + 0.3, after_stop=0.1)
    stop = run.stopped
    assert run.solutions[stop].status == status
    assert message in run.solutions[stop].reason
    # Twice the press, and what the approach adds while readings that do not change are waited for.
    assert run.press.max() <= 2.0 * PRESS + 0.02 * 0.012 * 1e4
    assert set(run.statuses(stop)) == {status}
    assert run.press[-1] == 0.0  # left
    assert run.height[-1] > run.height[stop] + 1e-3
    if message == "has not changed" and not since:  # dead from the first reading on: not pushed at all
        assert np.ptp(run.height[:stop]) < 1e-5  # the circle leaves less than a micrometre
    assert "retreating" in run.solutions[-1].reason


@pytest.mark.parametrize("name", ["dead", "order", "sign"])
def test_a_fault_while_a_normal_is_estimated_stops_the_press(name):
    make, status, _ = FAULTS[name]
    run = press_on_plane(PRESS, fault=make(), since=1.0, seconds=1.3, tilt=0.1, dt=0.004, normal_within=0.3)
    assert -run.solutions[249].contact.pose[1, 2] < 0.06  # part of the tilt was found
    assert run.solutions[run.stopped].status == status
    assert run.press.max() <= 2.0 * PRESS
    assert run.press[-1] == 0.0


@pytest.mark.cases(1)
@pytest.mark.parametrize("start", [294, 298, 302])
def test_repeated_readings_during_an_impact_are_no_fault(start):
    """For 50 ms the driver repeats the last one, as after a lost packet."""
    kept, tick = {}, iter(range(10_000))

    def late(reading, normal):
        k = next(tick)
        kept[k] = reading
        return kept[start] if start <= k < start + 50 else reading

    run = press_on_plane(PRESS, stiffness=2e4, noise=0.05, dt=0.001, fault=late, since=0.0, seconds=1.5, period=1e9)
    assert run.stopped is None
    assert run.press.max() < 2.0 * PRESS
    assert run.press[-1] == pytest.approx(PRESS, rel=0.05)


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["dead", "rises by 30 N"])
def test_a_retreat_leaves_a_soft_surface_too(name):
    make, status, _ = FAULTS[name]
    run = press_on_plane(PRESS, stiffness=300.0, dt=0.008, seconds=10.0, period=1e9, fault=make(), since=8.0)
    assert run.press[: run.stopped].max() == pytest.approx(PRESS, rel=0.1)
    assert run.solutions[-1].status == status
    assert run.press[-1] == 0.0


def test_a_jump_below_the_press_leaves_less_than_twice_the_press():
    run = press_on_plane(
        PRESS, fault=lambda reading, normal: reading - np.r_[0, 0, 0, 6 * normal], since=0.5, seconds=1.3
    )
    assert run.press.max() <= 2.0 * PRESS
    assert run.press[-1] == pytest.approx(16.0, rel=0.05)  # no reading tells; the true press is off by the jump


def test_an_approach_that_meets_nothing_ends():
    for limits, message in (
        ({"approach_distance": 0.005}, "no contact within 0.005 of approach: standing still until reset"),
        ({"approach_time": 0.3}, "no contact within 0.3 s of approach: standing still until reset"),
    ):
        run = press_on_plane(PRESS, gap=0.5, seconds=1.0, **limits)
        assert run.solutions[-1].status == "lost"
        assert run.solutions[-1].reason == message
        assert not run.solutions[-1].velocity.any()
        assert run.height[0] - run.height[-1] < 0.0065


@pytest.mark.parametrize("mass", [0.0, 0.7])
@pytest.mark.parametrize("wrong", [{"reads": "action"}, {"order": "moment first"}], ids=["reads", "order"])
def test_a_wrong_declaration_of_a_sensor_is_named(wrong, mass):
    cell = {"order": "force first", "reads": "reaction", "mass": mass, "noise": 0.1}
    true, declared = (iq.WrenchSensor(np.eye(4), **cell | more) for more in ({}, wrong))
    robot, q, random = gantry(), np.zeros(6), np.random.default_rng(1)
    task = iq.HybridTask(lambda tool: iq.point_contact(tool[:3, 3], [0, 0, 1]), [5.0])
    loop = iq.HybridController(robot, task, dt=0.004, sensor=declared)
    for _ in range(2000):
        tool = robot.pose(q)
        press = 1e4 * max(0.0, -0.001 - tool[2, 3])
        reading = true.tare(tool) + random.normal(0.0, 0.1, 6)
        reading[2] += press
        solution = loop.step(q, np.eye(4), reading)
        q = q + 0.004 * solution.velocity
        if "retreating" in solution.reason:
            break
    assert solution.status in ("fault", "overload")
    assert f"{next(iter(wrong))}=" in solution.reason
