"""A normal declared wrong is estimated from motion, with friction, within a bound."""

import numpy as np
import pytest
from support.plane import UP, press_on_plane, tip

import invariantqp as iq

DT = 0.004


def drawn(degrees, friction, seconds=3.5, **options):
    """How far the normal of each tick is off the true one [deg], force errors [N], and the last solution."""
    tilt = np.deg2rad(degrees)
    cell = {"noise": 0.1, "dt": DT, "gap": 0.0, "radius": 0.02, "period": 2.0, "slides_from": 1.0}  # it touches first
    run = press_on_plane(5.0, tilt=tilt, friction=friction, seconds=seconds, **cell, **options)
    normals = np.array([-s.contact.pose[2, 2] for s in run.solutions])
    return np.rad2deg(np.arccos(np.minimum(1.0, normals))), run.press - 5.0, run.solutions[-1]


@pytest.mark.parametrize(("degrees", "friction"), [(10.0, 0.3)])
def test_a_normal_declared_wrong_is_estimated_with_friction(degrees, friction):
    declared, errors, _ = drawn(degrees, friction, max_force=20.0, yields=0.1)  # more than a usual slope
    angles, better, solution = drawn(degrees, friction, normal_within=0.3, max_force=20.0)
    settled = slice(round(2.0 / DT), None)
    np.testing.assert_allclose(declared, degrees, atol=1e-9)
    assert angles[settled].max() < 0.3 * degrees
    assert np.std(better[settled]) < 0.5 * np.std(errors[settled])
    assert better.max() <= errors.max()  # the touch is no harder for it
    assert solution.status == "ok"


def test_a_true_normal_stays_and_the_bound_holds_and_is_reported():
    angles, _, _ = drawn(0.0, 0.3, seconds=2.5, normal_within=0.3)
    assert 0.0 < angles[round(2.0 / DT) :].max() < 1.0  # the sensor's noise over a millimetre of way
    bound = np.deg2rad(4.0)
    angles, _, solution = drawn(10.0, 0.0, seconds=2.5, normal_within=bound, max_force=20.0)
    assert angles.min() > 6.0 - 1e-9
    assert solution.status == "degraded"
    assert "the normal is 4 deg off the declared one" in solution.reason


def test_a_bound_needs_a_contact_with_one_press():
    hinge = iq.contacts.hinge([0.0, 0.0, 0.0], UP)
    with pytest.raises(iq.BadInput, match=r"normal_within: found 0\.1, and a hinge with 0 presses"):
        iq.HybridTask(hinge, np.zeros(5), normal_within=0.1)
    with pytest.raises(iq.BadInput, match="normal_within: found 1 rad"):
        iq.HybridTask(tip, [5.0], normal_within=1.0)
