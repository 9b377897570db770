import numpy as np
import pytest

import invariantqp as iq
from invariantqp.systems.centre import resting_point

PLANAR = np.array([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.5, 0.3, 0))]).T


def test_the_own_point_is_moved_least():
    rng = np.random.default_rng(1)
    J = rng.normal(size=(6, 5))
    p, length = iq.centre(J)

    def motion(point):
        return np.linalg.norm(J[3:] + np.cross(J[:3], point, axis=0))

    assert all(motion(p) < motion(p + 1e-3 * d) for d in rng.normal(size=(50, 3)))
    assert length == pytest.approx(motion(p) / np.linalg.norm(J[:3]))


def test_parallel_axes_leave_it_free_along_them_and_a_twist_settles_it():
    assert resting_point(PLANAR).free.shape == (3, 1)
    tilt = np.array(iq.revolute((1, 0, 0), (0, 0, 0.7)))
    assert iq.centre(PLANAR, tilt).point[2] == pytest.approx(0.7)
    assert iq.centre(PLANAR, tilt).length == iq.centre(PLANAR).length


@pytest.mark.parametrize("noise", [0.0, 1e-22, 1e-17])
def test_rounding_in_a_twist_of_the_plane_does_not_settle_it_anywhere(noise):
    # The point would be 1e11 away, where the rounding of the rotation cancels all of the motion.
    s = np.array([noise, -noise, 0.0, 1e-6, 2e-6, 0.0])
    np.testing.assert_allclose(iq.centre(PLANAR, s).point, iq.centre(PLANAR).point)


def test_slides_have_no_length_and_neither_have_those_that_turn_by_rounding():
    slides = np.vstack((np.zeros((3, 3)), np.eye(3)))
    assert iq.centre(slides).length == np.inf
    slides[:3] = 1e-17
    assert iq.centre(slides).length == np.inf
    np.testing.assert_array_equal(iq.centre(slides).point, 0.0)
    np.testing.assert_array_equal(iq.centre(slides, [0, 0, 0, 1, 2, 3]).point, 0.0)


@pytest.mark.parametrize("reach", [0.0, 1.0, 1e3])
def test_axes_that_meet_have_no_length_either(reach):
    rng = np.random.default_rng(2)
    p = reach * rng.normal(size=3)
    wrist = np.array([iq.revolute(rng.normal(size=3), p) for _ in range(3)]).T
    assert iq.centre(wrist).length == 0.0
    np.testing.assert_allclose(iq.centre(wrist).point, p, atol=1e-12 * reach)
