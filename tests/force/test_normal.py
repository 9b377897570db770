"""A normal declared wrong is estimated from motion, with friction, within a bound."""

import numpy as np
import pytest
from support.spring_plane import PANDA, UP, circle, pen, tip

import invariantqp as iq

DT, STIFFNESS = 0.004, 1e4


def drawn(robot, degrees, friction, seconds=3.5, **options):
    """How far the normal of each tick is off the true one [deg], force errors [N], and the last solution."""
    random, start, q = np.random.default_rng(0), robot.pose(PANDA), PANDA
    n = iq.exp([np.deg2rad(degrees), 0.0, 0.0, 0.0, 0.0, 0.0])[:3, :3] @ UP
    sensor = iq.WrenchSensor(np.eye(4), order="moment first", reads="reaction", cutoff=50.0, noise=0.1)
    loop = iq.HybridController(robot, pen(**options), dt=DT, sensor=sensor)
    path, v, angles, errors = circle(start, 0.02, 2.0), np.zeros(3), [], []
    for k in range(round(seconds / DT)):
        tool = robot.pose(q)
        depth = max(0.0, -float(n @ (tool[:3, 3] - start[:3, 3])))
        slide = v - n * (n @ v)
        f = STIFFNESS * depth * (n - friction * slide / max(np.linalg.norm(slide), 1e-3))
        reading = np.concatenate((np.zeros(3), tool[:3, :3].T @ f + random.normal(0.0, 0.1, 3)))
        target, ahead = path(max(0.0, k * DT - 1.0))  # it touches first
        solution = loop.step(q, target, reading, ahead * (k * DT >= 1.0))
        q = q + DT * solution.velocity
        v = (robot.pose(q)[:3, 3] - tool[:3, 3]) / DT
        angles.append(np.rad2deg(np.arccos(min(1.0, float(-solution.contact.pose[:3, 2] @ n)))))
        errors.append(STIFFNESS * depth - 5.0)
    return np.array(angles), np.array(errors), solution


@pytest.mark.parametrize(("degrees", "friction"), [(10.0, 0.3)])
def test_a_normal_declared_wrong_is_estimated_with_friction(panda, degrees, friction):
    declared, errors, _ = drawn(panda, degrees, friction, max_force=20.0, yields=0.1)  # more than a usual slope
    angles, better, solution = drawn(panda, degrees, friction, normal_within=0.3, max_force=20.0)
    settled = slice(round(2.0 / DT), None)
    np.testing.assert_allclose(declared, degrees, atol=1e-9)
    assert angles[settled].max() < 0.3 * degrees
    assert np.std(better[settled]) < 0.5 * np.std(errors[settled])
    assert better.max() <= errors.max()  # the touch is no harder for it
    assert solution.status == "ok"


def test_a_true_normal_stays_and_the_bound_holds_and_is_reported(panda):
    angles, _, _ = drawn(panda, 0.0, 0.3, seconds=2.5, normal_within=0.3)
    assert 0.0 < angles[round(2.0 / DT) :].max() < 1.0  # the sensor's noise over a millimetre of way
    bound = np.deg2rad(4.0)
    angles, _, solution = drawn(panda, 10.0, 0.0, seconds=2.5, normal_within=bound, max_force=20.0)
    assert angles.min() > 6.0 - 1e-9
    assert solution.status == "degraded"
    assert "the normal is 4 deg off the declared one" in solution.reason


def test_a_bound_needs_a_contact_with_one_press():
    hinge = iq.contacts.hinge([0.0, 0.0, 0.0], UP)
    with pytest.raises(iq.BadInput, match=r"normal_within: found 0\.1, and a hinge with 0 presses"):
        iq.HybridTask(hinge, np.zeros(5), normal_within=0.1)
    with pytest.raises(iq.BadInput, match="normal_within: found 1 rad"):
        iq.HybridTask(tip, [5.0], normal_within=1.0)
