"""Commands that act later than was told: found in the joints' answers to the first of them, in any contact."""

from collections import deque

import numpy as np
import pytest
from support.noisy_plane import press_on_plane
from support.spring_plane import PANDA, UP, exerted, gantry, pen

import invariantqp as iq
from invariantqp.force.estimate import Delay, Ways

DT = 0.002
J, PLACE, SIZE = np.diag([1.0, 1.0, 1.0, 0.05, 0.05, 0.05]), np.zeros(3), 0.05


def found(commands, delay, share=1.0, noise=0.0, told=0, unit=1.0):
    """The lateness [s] of joints that do a share of what they are told so many ticks before."""
    rng, lag, q = np.random.default_rng(0), Delay(DT, DT * told, np.inf), np.zeros(6)
    asked = deque([np.zeros(6)] * delay)
    for way in commands:
        lag.after(unit * (q + noise * rng.normal(size=6)), unit * way, J / unit, PLACE, SIZE)
        asked.append(way)
        q = q + share * asked.popleft()
    return lag


def steps(kind, n=900):
    """Commands (n, 6): a steady motion, one that comes and goes, one like noise."""
    rng, t = np.random.default_rng(1), np.arange(n)[:, None]
    to = rng.uniform(-1.0, 1.0, 6)
    return 2e-3 * {"steady": np.ones((n, 1)), "swings": np.sin(0.03 * t), "noise": rng.normal(size=(n, 1))}[kind] * to


@pytest.mark.cases(11)
@pytest.mark.parametrize("kind", ["steady", "swings", "noise"])
@pytest.mark.parametrize("share", [0.8, 1.0, 1.05])
@pytest.mark.parametrize("delay", [0, 4, 25])
def test_a_delay_is_found_whatever_the_motion_and_the_share_that_is_done(kind, share, delay):
    assert (found(steps(kind), delay, share, noise=1e-4).late or 0.0) == pytest.approx(DT * delay, abs=1.5 * DT)


@pytest.mark.parametrize("told", [5, 20, 40])
def test_only_what_was_not_told_counts(told):
    lag = found(steps("swings"), 20, told=told)
    assert (lag.late or 0.0) == pytest.approx(DT * max(0, 20 - told), abs=1e-12)
    assert bool(lag.trouble(50.0)) == (told == 5)


def test_joints_that_do_something_else_or_nothing_are_not_late():
    commands, rng, lag = steps("steady"), np.random.default_rng(2), Delay(DT, 0.0, np.inf)
    for way in commands:
        lag.after(1e-3 * rng.normal(size=6), way, J, PLACE, SIZE)
    assert lag.late == 0.0
    assert found(commands, 5, share=0.0).late == 0.0
    assert lag.gain(50.0) == 50.0
    assert lag.trouble(50.0) == ""


def test_the_unit_of_joints_changes_nothing():
    unit = np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])  # slides in millimetres
    assert found(steps("swings"), 9, noise=1e-4, unit=unit).late == found(steps("swings"), 9, noise=1e-4).late > 0.0


def test_a_joint_that_hardly_moves_the_place_of_contact_hardly_counts():
    rng, lag, commands = np.random.default_rng(0), Delay(DT, 0.0, np.inf), steps("swings")
    turns = np.diag([1e-4, 1.0, 1.0, 1.0, 1.0, 1.0])
    for k, way in enumerate(commands):
        q = commands[: max(0, k - 9)].sum(axis=0)
        q[0] = 0.1 * rng.normal()  # of a turn 0.1 mm beside it
        lag.after(q, way, turns, PLACE, 1.0)
    assert lag.late == pytest.approx(9 * DT)


def test_a_delay_that_was_found_counts_for_where_the_joints_will_be():
    ways, q = Ways(2 * DT, DT), np.zeros(6)
    for k in range(40):
        ways.add(np.full(6, 1.0 + k), np.zeros(3), 3 * DT if k > 10 else 0.0)
    assert ways.coming(q) == pytest.approx(np.full(6, 36.0 + 37.0 + 38.0 + 39.0 + 40.0))


@pytest.mark.parametrize(("delay", "off"), [(0.04, 1e-3), (0.05, 1.5e-3)])
def test_the_motion_of_an_arm_that_is_late_untold_does_not_swing(delay, off):
    """A circle of 60 mm: with the gain for no delay the tool went to and fro by 38 to 78 mm, up to an overload."""
    robot, q = iq.load_robot("panda"), PANDA.copy()
    start, errors, presses, late = robot.pose(q), [], [], deque([np.zeros(7)] * round(delay / DT))
    loop = iq.HybridController(robot, pen(10.0), dt=DT, order="moment first")  # of gain 50/s
    for k in range(800):
        tool, a = robot.pose(q), 2.0 * np.pi * k * DT / 3.0
        target, ahead = start.copy(), np.zeros(6)
        target[:3, 3] += 0.03 * np.array([np.cos(a) - 1.0, np.sin(a), 0.0])
        ahead[3:5] = 0.02 * np.pi * np.array([-np.sin(a), np.cos(a)])
        wrench = exerted([tool[:3, 3]], start[2, 3] - 0.002, 1e4)
        solution = loop.step(q, target, wrench, ahead)
        late.append(solution.velocity)
        q = q + DT * late.popleft()
        errors.append(np.linalg.norm((tool - target)[:2, 3]))
        presses.append(-wrench[5])
    assert max(errors) < 0.008
    assert max(errors[500:]) < off
    assert max(presses) < 12.0
    assert solution.status == "degraded"
    assert f"commands act {1e3 * delay:.0f} ms later than declared: give delay=" in solution.reason
    assert f"the motion's gain is {0.25 / delay:.3g} instead of 50 1/s" in solution.reason


def test_a_screw_held_by_an_arm_that_is_late_untold_is_found_without_an_approach():
    """1e4 N/m behind 50 ms: 63 N before, and an overload."""
    robot, q, late = gantry(), np.zeros(6), deque([np.zeros(6)] * 25)
    task = iq.HybridTask(iq.contacts.hinge(np.zeros(3), UP, 0.01), [0.0] * 5)
    loop, forces = iq.HybridController(robot, task, dt=DT, order="moment first"), []
    twist = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.01])
    for k in range(1000):
        turn = 0.5 * (1.0 - np.cos(2.0 * k * DT))
        tool = robot.pose(q)
        told = iq.exp(turn * twist)
        # held to its screw in all other directions
        along = float(iq.log(tool) @ twist) / float(twist @ twist)
        wrench = 1e4 * np.repeat([5e-3, 1.0], 3) * (iq.log(tool) - along * twist)
        solution = loop.step(q, told, wrench, np.sin(2.0 * k * DT) * twist)
        late.append(solution.velocity)
        q = q + DT * late.popleft()
        forces.append(np.linalg.norm(wrench[3:]))
    assert "commands act 50 ms later than declared" in solution.reason
    assert solution.status == "degraded"
    assert max(forces) < 1.0
    assert abs(along - turn) < 0.1


def test_a_delay_too_small_to_swing_changes_no_gain():
    run = press_on_plane(10.0, delay=0.01, seconds=0.6)
    assert "later than declared" not in " ".join(s.reason for s in run.solutions)


@pytest.mark.parametrize("before", [0.0, -0.03])
def test_the_lag_of_an_arm_that_moves_already_is_found(before):
    """An arm that was still going up by 30 mm/s was taken to lag by 100 ms instead of 30."""
    delay, q, v, way = Delay(DT, 0.0, np.inf), np.zeros(6), np.full(6, before), np.full(6, DT * 0.008)
    for _ in range(150):
        delay.after(q, way, J, PLACE, SIZE, v)
        v = v + (1.0 - np.exp(-DT / 0.03)) * (way / DT - v)
        q = q + DT * v
    assert delay.lag == pytest.approx(0.03, abs=0.004)
