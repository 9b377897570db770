import numpy as np
import pytest
from scipy.optimize import minimize
from support.random_systems import motion

import invariantqp as iq
from invariantqp.systems.centre import resting_point


def moved(J, p):
    return np.linalg.norm(J[3:] + np.cross(J[:3], p, axis=0))


@pytest.mark.parametrize("m", [2, 3, 6, 8])
def test_the_point_is_the_one_that_moves_least(m):
    rng = np.random.default_rng(m)
    J = rng.normal(size=(6, m))
    point, length = iq.centre(J)
    found = minimize(lambda p: moved(J, p) ** 2, np.zeros(3), tol=1e-14)
    assert moved(J, point) <= np.sqrt(found.fun) * (1.0 + 1e-12)
    np.testing.assert_allclose(point, found.x, atol=1e-6)
    assert length == pytest.approx(moved(J, point) / np.linalg.norm(J[:3]))


def test_it_is_carried_by_motions_and_scaled_by_units():
    rng = np.random.default_rng(5)
    for _ in range(50):
        J, T = rng.normal(size=(6, 4)), motion(rng)
        point, length = iq.centre(J)
        there = iq.centre(iq.adjoint(T) @ J)
        np.testing.assert_allclose(there.point, (T @ np.append(point, 1.0))[:3], atol=1e-11)
        assert there.length == pytest.approx(length, rel=1e-11)
        D = np.array([1.0] * 3 + [1e3] * 3)[:, None]
        in_mm = iq.centre(D * J)
        np.testing.assert_allclose(in_mm.point, 1e3 * point, atol=1e-9)
        assert in_mm.length == pytest.approx(1e3 * length)


def test_parallel_axes_leave_the_point_to_the_twist():
    """Anywhere along their common direction; the twist settles where, and a motion carries that too."""
    rng = np.random.default_rng(6)
    J = np.column_stack([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.5, 0.3, 0))])
    s = rng.normal(size=6)
    point, length = iq.centre(J, s)
    np.testing.assert_allclose(point[:2], [0.3, 0.1], atol=1e-12)
    heights = [np.linalg.norm(s[3:] + np.cross(s[:3], point + np.array([0, 0, z]))) for z in (-1e-3, 0.0, 1e-3)]
    assert heights[1] < min(heights[0], heights[2])
    T = motion(rng)
    there = iq.centre(iq.adjoint(T) @ J, iq.adjoint(T) @ s)
    np.testing.assert_allclose(there.point, (T @ np.append(point, 1.0))[:3], atol=1e-9)
    assert there.length == pytest.approx(length)


def test_the_ends_of_the_scale():
    gantry = np.column_stack([iq.prismatic(u) for u in np.eye(3)])
    assert iq.centre(gantry).length == np.inf
    wrist = np.column_stack([iq.revolute(u, (0.1, 0.2, 0.3)) for u in np.eye(3)])
    point, length = iq.centre(wrist)
    np.testing.assert_allclose(point, (0.1, 0.2, 0.3), atol=1e-15)
    assert length == pytest.approx(0.0, abs=1e-15)
    with pytest.raises(iq.BadInput, match="J: found"):
        iq.centre(np.full((6, 2), np.nan))


@pytest.mark.parametrize("noise", [0.0, 1e-17, 1e-12, 1e-8])
def test_rounding_of_no_rotation_moves_no_point(noise):
    """A planar arm or a gantry asked for a translation, with what rounding leaves of a rotation across its axes."""
    planar = np.column_stack([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.5, 0.3, 0))])
    gantry = np.column_stack([iq.prismatic(u) for u in np.eye(3)])
    s = np.array([noise, 0.0, 0.5, 0.3, 1.0, 0.0])
    assert np.linalg.norm(iq.centre(planar, s).point) < 1.0
    solution = iq.solve_velocity(planar, s, form=iq.CarriedMetric(np.eye(6), np.eye(4)))
    np.testing.assert_allclose(planar @ solution.velocity, [0, 0, 0.5, 0.3, 1.0, 0], atol=1e-6)
    t = np.array([noise, 0.0, 0.0, 0.0, 1.0, 0.0])
    np.testing.assert_allclose(iq.solve_velocity(gantry, t).velocity, t[3:], atol=1e-6)


def test_a_metric_carried_out_of_sight_is_still_one():
    form = iq.CarriedMetric(np.eye(6), iq.transform(translation=(0, 0, 1e17)))
    assert np.isfinite(form.norms).all()


def test_slides_that_turn_by_rounding_have_no_length():
    slides = np.vstack((np.full((3, 3), 1e-17), np.eye(3)))
    assert iq.centre(slides).length == np.inf
    np.testing.assert_array_equal(iq.centre(slides).point, 0.0)
    np.testing.assert_array_equal(iq.centre(slides, [0, 0, 0, 1, 2, 3]).point, 0.0)


@pytest.mark.parametrize("reach", [0.0, 1.0, 1e3])
def test_axes_that_meet_but_for_rounding_have_none_either(reach):
    rng = np.random.default_rng(2)
    p = reach * rng.normal(size=3)
    wrist = np.array([iq.revolute(rng.normal(size=3), p) for _ in range(3)]).T
    assert iq.centre(wrist).length == 0.0
    np.testing.assert_allclose(iq.centre(wrist).point, p, atol=1e-12 * reach)


def test_the_tolerance_decides_which_axes_are_parallel():
    J = np.column_stack([iq.revolute((1e-5 * i, 0, 1), (0.3 * i, 0.1 * i * i, 0)) for i in range(3)])
    assert resting_point(J).free.shape == (3, 0)
    assert resting_point(J, tolerance=1e-7).free.shape == (3, 1)
    assert resting_point(J, longest=1e-3).free.shape == (3, 3)
