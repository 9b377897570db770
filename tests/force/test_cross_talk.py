"""A step in force moves nothing along S, a step in motion asks for no force: in every tick, and in closed loops."""

from copy import copy

import numpy as np
import pytest
from support.plane import DT, PANDA, SO101, Bench, carried, circle, gantry, pen

import invariantqp as iq


@pytest.mark.parametrize("rule", [{}, {"h": 0.3}, {"metric": np.arange(1.0, 7.0)}])
def test_neither_part_touches_the_other_in_any_tick(panda, rule):
    """Within the limits a step in force adds nothing along S, one in motion nothing in S*."""
    task = pen(compliance=1e-3, **rule)  # a gain that depends on nothing that was felt before
    bench = Bench(panda, PANDA, task, depth=3e-4)
    path = circle(bench.start, 0.03, 2.0)
    for k in range(60):
        q, W = bench.q.copy(), bench.wrench()
        target, ahead = path(k * DT)
        elsewhere = iq.exp([0.02, 0.01, -0.02, 0.004, -0.003, 0.002]) @ target
        pressed = copy(bench.loop).step(q, target, W, ahead, wanted=[8.0])
        steered = copy(bench.loop).step(q, elsewhere, W, ahead)
        plain = bench.tick(target, ahead)
        split = iq.dual_projectors(plain.contact.freedoms, **carried(rule, plain.contact))
        J = plain.J
        assert np.abs(split.motion @ J @ (pressed.velocity - plain.velocity)).max() < 1e-5
        assert np.linalg.norm(pressed.force - plain.force) > 1e-4
        assert np.abs(plain.contact.constraints.T @ J @ (steered.velocity - plain.velocity)).max() < 1e-5
        assert np.abs(steered.error - plain.error).max() < 1e-5
        assert np.linalg.norm(steered.motion - plain.motion) > 1e-4


def test_five_joints_keep_the_two_apart_at_the_tip(so101):
    options = {"dt": 5e-3, "exact": "position"}
    task = pen(2.0, compliance=1e-3)
    bench = Bench(so101, SO101, task, stiffness=2e3, **options)
    path = circle(bench.start, 0.02, 3.0)
    for k in range(60):
        q, W, (target, ahead) = bench.q.copy(), bench.wrench(), path(k * 5e-3)
        elsewhere = iq.exp([0.0, 0.0, 0.0, 0.001, -0.002, 0.001]) @ target
        pressed = copy(bench.loop).step(q, target, W, ahead, wanted=[3.0])
        steered = copy(bench.loop).step(q, elsewhere, W, ahead)
        plain = bench.tick(target, ahead)
        p = so101.pose(q)[:3, 3]
        J = plain.J[3:] + np.cross(plain.J[:3].T, p).T
        assert np.abs((J @ (pressed.velocity - plain.velocity))[:2]).max() < 1e-5
        assert abs((J @ (steered.velocity - plain.velocity))[2]) < 1e-5
        assert np.linalg.norm((J @ (steered.velocity - plain.velocity))[:2]) > 1e-3


def stepped(robot, q, dt, *, press=5.0, aside=0.0, **options):
    """Places and presses of a loop whose wanted press or target steps after half a second."""
    bench = Bench(robot, q, pen(stiffness=1e4), depth=5e-4, dt=dt, gain=10.0, **options)
    path, places, presses = circle(bench.start, 0.03, 2.0), [], []
    for k in range(round(2.0 / dt)):
        target, ahead = path(k * dt)
        late = k * dt > 0.5
        target[0, 3] += aside * late
        solution = bench.tick(target, ahead, wanted=[press if late else 5.0])
        places.append(bench.robot.pose(bench.q)[:3, 3])
        presses.append(solution.intensities[0])
    return np.array(places), np.array(presses)


def test_a_step_in_one_leaves_the_other_alone_in_the_whole_closed_loop():
    options = {"joint_metric": np.ones(6)}
    plain, harder, aside = (stepped(gantry(), np.zeros(6), 5e-3, **options, **s) for s in STEPS)
    assert np.abs(harder[0] - plain[0])[:, :2].max() < 1e-5
    assert harder[1][-1] == pytest.approx(8.0, rel=0.01)
    assert np.abs(aside[1] - plain[1]).max() < 1e-5
    assert np.abs(aside[0] - plain[0])[:, 0].max() > 4e-3


STEPS = ({}, {"press": 8.0}, {"aside": 0.005})


def test_what_is_left_on_an_arm_is_the_tick(panda):
    """The error is of first order in dt or less: joint velocities are constant in a tick while the Jacobian changes."""
    left = []
    for dt in (4e-3, 2e-3):
        plain, harder, aside = (stepped(panda, PANDA, dt, **s) for s in STEPS)
        left.append((np.abs(harder[0] - plain[0])[:, :2].max(), np.abs(aside[1] - plain[1]).max()))
    (place, press), (place_half, press_half) = left
    assert place_half < 1e-7
    assert press_half < 0.01
    assert place_half < 0.6 * place  # the law's own speed depends on the tick, too
    assert press_half < 0.55 * press
