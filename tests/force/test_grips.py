"""Stiff hinges, screws and corners whose stiffness nobody declared: the law finds it before it swings."""

from dataclasses import replace

import numpy as np
import pytest
from support.contact_scenes import SHARED, in_scene
from support.plane import PANDA

import invariantqp as iq


def run(robot, q, scene, seconds, delay=0.0):
    """Statuses, forces and moments of the ticks, motion after half a second."""
    ticks = in_scene(robot, q, scene, round(seconds / 0.002), starts=0.5, delay=delay, dt=0.002)
    return zip(*((tick.solution.status, tick.force, tick.moment) for tick in ticks), strict=True)


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["door", "screw"])
def test_a_stiff_hinge_without_declared_stiffness_does_not_oscillate(name):
    robot = iq.load_robot("panda")
    start = robot.pose(PANDA)
    z, post = -start[:3, 2], start[:3, 3] + 0.3 * start[:3, 1]
    pitch, axis = (0.01, start[:3, 3]) if name == "screw" else (0.0, post)
    screw, turn = iq.se3.helical(z, axis, pitch), 1.0 if name == "screw" else 0.2
    declared = iq.contacts.hinge(axis, z, pitch)
    scene = SHARED["grip"](start, screw, lambda _: declared, SHARED["along"](start, turn * screw), stiffness=1e6)
    statuses, forces, moments = run(robot, PANDA, scene, 1.4)
    assert set(statuses) <= {"ok", "scaled"}
    assert max(forces) < 4.0
    assert max(moments) < 0.3


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("stiffness", "options", "delay", "turn", "seconds", "most"),
    [
        (1e5, {}, 0.014, 0.2, 2.5, 4.0),
        (1e6, {}, 0.0, 0.2, 2.5, 2.5),
        (1e5, {"stiffness": 1e5}, 0.014, 0.3, 1.0, 2.0),
    ],
)
def test_a_stiff_hinge_declared_wrong_is_followed_without_oscillation(stiffness, options, delay, turn, seconds, most):
    robot = iq.load_robot("panda")
    start = robot.pose(PANDA)
    x, z, post = start[:3, 0], -start[:3, 2], start[:3, 3] + 0.3 * start[:3, 1]
    hinge, declared = iq.revolute(z, post), iq.contacts.hinge(post + 0.01 * x, z)
    scene = SHARED["grip"](start, hinge, lambda _: declared, SHARED["along"](start, turn * hinge), stiffness=stiffness)
    statuses, forces, _ = run(robot, PANDA, replace(scene, options=options), seconds, delay=delay)
    assert set(statuses) == {"ok"}
    assert max(forces) < 1.6 * most


def test_a_joint_that_reaches_its_limit_with_a_delay_causes_little_force():
    robot, q = iq.load_robot("panda"), np.array([*PANDA[:6], 2.0])
    start = robot.pose(q)
    bolt = iq.se3.helical(-start[:3, 2], start[:3, 3], 0.01)
    declared = iq.contacts.hinge(start[:3, 3], -start[:3, 2], 0.01)
    scene = SHARED["grip"](start, bolt, lambda _: declared, SHARED["along"](start, -1.5 * bolt))
    statuses, forces, _ = run(robot, q, scene, 2.8, delay=0.032)
    assert set(statuses) <= {"ok", "scaled"}
    assert max(forces) < 4.0
