import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from support.random_systems import PLANAR, distance, motion

import invariantqp as iq
from invariantqp.geometry.screws import least_moving_point
from invariantqp.geometry.se3 import velocity_at
from invariantqp.systems.points import reach


def moved(J, p):
    return np.linalg.norm(J[3:] + np.cross(J[:3], p, axis=0))


@pytest.mark.parametrize("m", [2, 3, 6, 8])
def test_the_own_point_is_the_point_that_moves_least(m):
    rng = np.random.default_rng(m)
    J = rng.normal(size=(6, m))
    point, length = iq.systems.centre(J)
    found = minimize(lambda p: moved(J, p) ** 2, np.zeros(3), tol=1e-14)
    assert moved(J, point) <= np.sqrt(found.fun) * (1.0 + 1e-12)
    np.testing.assert_allclose(point, found.x, atol=1e-6)
    assert length == pytest.approx(moved(J, point) / np.linalg.norm(J[:3]))


def test_own_point_and_length_move_with_the_frame_and_scale_with_the_unit():
    rng = np.random.default_rng(5)
    for _ in range(50):
        J, T = rng.normal(size=(6, 4)), motion(rng)
        point, length = iq.systems.centre(J)
        there = iq.systems.centre(iq.adjoint(T) @ J)
        np.testing.assert_allclose(there.point, (T @ np.append(point, 1.0))[:3], atol=1e-11)
        assert there.length == pytest.approx(length, rel=1e-11)
        D = np.array([1.0] * 3 + [1e3] * 3)[:, None]
        in_mm = iq.systems.centre(D * J)
        np.testing.assert_allclose(in_mm.point, 1e3 * point, atol=1e-9)
        assert in_mm.length == pytest.approx(1e3 * length)


def test_the_twist_chooses_the_own_point_along_parallel_axes():
    """Anywhere along their common direction; the twist settles where, and a motion carries that too."""
    rng = np.random.default_rng(6)
    s = rng.normal(size=6)
    point, length = iq.systems.centre(PLANAR, s)
    np.testing.assert_allclose(point[:2], [1.1 / 3, 0.1], atol=1e-12)
    heights = [np.linalg.norm(s[3:] + np.cross(s[:3], point + np.array([0, 0, z]))) for z in (-1e-3, 0.0, 1e-3)]
    assert heights[1] < min(heights[0], heights[2])
    T = motion(rng)
    there = iq.systems.centre(iq.adjoint(T) @ PLANAR, iq.adjoint(T) @ s)
    np.testing.assert_allclose(there.point, (T @ np.append(point, 1.0))[:3], atol=1e-9)
    assert there.length == pytest.approx(length)


@pytest.mark.parametrize("rounding", [0.0, 1e-17])
def test_prismatic_joints_have_no_own_length(rounding):
    slides = np.vstack((np.full((3, 3), rounding), np.eye(3)))
    for twist in (None, [0, 0, 0, 1, 2, 3]):
        assert iq.systems.centre(slides, twist).length == np.inf
        np.testing.assert_array_equal(iq.systems.centre(slides, twist).point, 0.0)
    with pytest.raises(iq.BadInput, match="J: found"):
        iq.systems.centre(np.full((6, 2), np.nan))


@pytest.mark.parametrize("noise", [0.0, 1e-17, 1e-12, 1e-8])
def test_rounding_of_a_rotation_does_not_shift_the_own_point(noise):
    """A planar arm or a gantry with a commanded translation and the rounding of a rotation across its axes."""
    gantry = np.column_stack([iq.se3.prismatic(u) for u in np.eye(3)])
    s = np.array([noise, 0.0, 0.5, 0.3, 1.0, 0.0])
    assert np.linalg.norm(iq.systems.centre(PLANAR, s).point) < 1.0
    solution = iq.solve_velocity(PLANAR, s, form=iq.CarriedMetric(np.eye(6), np.eye(4)))
    np.testing.assert_allclose(PLANAR @ solution.velocity, [0, 0, 0.5, 0.3, 1.0, 0], atol=1e-6)
    t = np.array([noise, 0.0, 0.0, 0.0, 1.0, 0.0])
    np.testing.assert_allclose(iq.solve_velocity(gantry, t).velocity, t[3:], atol=1e-6)


def test_a_metric_carried_far_away_is_finite():
    form = iq.CarriedMetric(np.eye(6), iq.transform(translation=(0, 0, 1e17)))
    assert np.isfinite(form.carried).all()
    assert np.isfinite(iq.solve_velocity(PLANAR, [0, 0, 0.5, 0.3, 1.0, 0], form=form).velocity).all()


@pytest.mark.parametrize("reach", [0.0, 1.0, 1e3])
def test_axes_that_meet_have_own_length_zero(reach):
    rng = np.random.default_rng(2)
    p = reach * rng.normal(size=3)
    wrist = np.array([iq.revolute(rng.normal(size=3), p) for _ in range(3)]).T
    assert iq.systems.centre(wrist).length == 0.0
    np.testing.assert_allclose(iq.systems.centre(wrist).point, p, atol=1e-12 * reach)


def test_the_tolerance_decides_which_axes_are_parallel():
    J = np.column_stack([iq.revolute((1e-5 * i, 0, 1), (0.3 * i, 0.1 * i * i, 0)) for i in range(3)])
    assert least_moving_point(J).free.shape == (3, 0)
    assert least_moving_point(J, tolerance=1e-7).free.shape == (3, 1)
    assert least_moving_point(J, longest=1e-3).free.shape == (3, 3)


def broken_line(axes, point):
    """The same line by its definition: least distances found by a solver of least squares, one axis after another."""
    total, here = 0.0, np.asarray(point, dtype=float)
    for direction, through in reversed(axes):
        t = np.linalg.lstsq(direction[:, None], here - through, rcond=None)[0]
        there = through + t * direction
        total, here = total + np.linalg.norm(there - here), there
    return total


@settings(max_examples=80, deadline=None)
@given(seed=st.integers(0, 2**31), m=st.integers(1, 9), unit=st.sampled_from([1e-3, 1.0, 1e3]))
def test_reach_is_the_polygonal_line_in_every_frame_and_unit(seed, m, unit):
    rng = np.random.default_rng(seed)
    axes = [(rng.normal(size=3), rng.normal(size=3)) for _ in range(m)]
    point, T = rng.normal(size=3), motion(rng)
    twists = np.column_stack([iq.se3.helical(u, q, rng.choice([0.0, 0.3])) * rng.uniform(0.1, 9.0) for u, q in axes])
    expected = broken_line(axes, point)
    assert reach(twists, point) == pytest.approx(expected, rel=1e-12)
    scale = np.repeat([1.0, unit], 3)[:, None]
    there = (T @ np.append(point, 1.0))[:3]
    assert reach(scale * (iq.adjoint(T) @ twists), unit * there) == pytest.approx(unit * expected, rel=1e-11)


def chain_of_hinges(rng, m):
    return iq.robots.Chain(np.column_stack([iq.revolute(*rng.normal(size=(2, 3))) for _ in range(m)]), motion(rng, 0.5))


@pytest.mark.parametrize("arm", ["panda", "ur5", "so101", 1, 3, 7])
def test_no_position_of_revolute_joints_changes_the_reach(arm):
    rng = np.random.default_rng(17)
    robot = iq.load_robot(arm) if isinstance(arm, str) else chain_of_hinges(rng, arm)
    of_tool = rng.normal(size=3) * 0.1
    lengths = []
    for _ in range(50):
        q = rng.uniform(-2.0, 2.0, size=len(robot.names))
        J, point = robot.jacobian(q), (robot.pose(q) @ np.append(of_tool, 1.0))[:3]
        lengths.append(reach(J, point))
        speeds = np.linalg.norm(J[3:] + np.cross(J[:3], point, axis=0), axis=0)
        assert (speeds <= lengths[-1] * (1.0 + 1e-12)).all()  # no joint moves the point faster
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-12)
    assert lengths[0] > 0.1


def test_reach_skips_prismatic_joints_but_depends_on_their_positions():
    hinge, slide = iq.revolute((0, 0, 1), (1, 0, 0)), iq.se3.prismatic((1, 0, 0))
    first = iq.revolute((0, 1, 0))
    point = (1.0, 2.0, 0.0)
    assert reach(np.column_stack((first, slide, hinge)), point) == reach(np.column_stack((first, hinge)), point)
    arm = iq.robots.Chain(np.column_stack((first, slide, hinge)), iq.transform(translation=point))
    lengths = [reach(arm.jacobian(q), arm.pose(q)[:3, 3]) for q in ([0.3, d, 0.7] for d in (0.0, 0.5))]
    np.testing.assert_allclose(lengths, [3.0, 3.5], rtol=1e-15)
    assert reach(np.column_stack((slide, np.zeros(6))), point) == 0.0


def test_a_helical_joint_moves_its_foot_along_its_own_axis():
    """Its own leg stays; the leg from its axis to the axis before does not."""
    first, bolt = iq.revolute((0, 1, 0)), iq.se3.helical((1, 0, 0), (0, 0, 0), pitch=0.5)
    arm = iq.robots.Chain(np.column_stack((first, bolt)), iq.transform(translation=(0.0, 2.0, 0.0)))
    lengths = [reach(arm.jacobian(q), arm.pose(q)[:3, 3]) for q in ([0.3, t] for t in (0.0, 0.8))]
    np.testing.assert_allclose(lengths, [2.0, 2.0 + 0.4], rtol=1e-14)


@pytest.mark.parametrize("far", [0.0, 1.0, 1e4])
def test_axes_that_meet_in_the_point_have_no_reach(far):
    rng = np.random.default_rng(3)
    p = far * rng.normal(size=3)
    wrist = np.column_stack([iq.revolute(rng.normal(size=3), p) for _ in range(5)])
    assert reach(wrist, p) == 0.0
    off = p + 1e-6 * max(far, 1.0) * np.array([1.0, 0.0, 0.0])
    assert reach(wrist, off) > 0.0


def by_the_defining_equation(J, p, q):
    """{x : velocity of p is parallel to q}: the null space of the part across q, by numpy alone."""
    u = q / np.linalg.norm(q)
    V = J[3:] + np.cross(J[:3].T, p).T
    across = (np.eye(3) - np.outer(u, u)) @ V
    _, s, Vt = np.linalg.svd(across)
    rank = int(np.count_nonzero(s > 1e-10 * max(1.0, s[0])))
    return Vt[rank:].T


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("rank", [6, 3])
def test_point_motion_is_the_solution_of_the_defining_equation(m, rank):
    rng = np.random.default_rng(m)
    for _ in range(5):
        J = rng.normal(size=(6, m)) if m <= rank else rng.normal(size=(6, rank)) @ rng.normal(size=(rank, m))
        p, q = rng.normal(size=(2, 3))
        found = iq.systems.point_motion(J, p, q)
        expected = by_the_defining_equation(J, p, q)
        assert found.velocities.shape == expected.shape
        if expected.shape[1]:
            assert distance(found.velocities, expected) < 1e-8
        still = found.velocities[:, found.twists.shape[1] :]
        np.testing.assert_allclose(J @ still, 0.0, atol=1e-12)
        assert still.shape[1] == max(0, m - min(m, rank))
        assert found.moves == (min(m, rank) >= 3)


def test_the_four_system_is_reciprocal_to_a_plane_pencil():
    S = iq.systems.motions_along((0.3, -0.2, 0.5), (1.0, 2.0, -1.0))
    kind = iq.gibson_hunt(S)
    assert (str(kind), kind.dimension, kind.reciprocal) == ("IIA", 4, True)
    assert kind.moduli[0] == pytest.approx(0.0, abs=1e-12)
    speed = velocity_at(S, np.array((0.3, -0.2, 0.5)))
    np.testing.assert_allclose(np.cross(speed.T, (1.0, 2.0, -1.0)), 0.0, atol=1e-12)


def test_a_wrist_cannot_move_its_centre():
    J = np.array([iq.revolute(a) for a in np.eye(3)]).T
    found = iq.systems.point_motion(J, (0, 0, 0), (0, 0, 1))
    assert not found.moves
    assert found.velocities.shape == (3, 3)
    still = iq.systems.point_motion(np.zeros((6, 2)), (0, 0, 0), (0, 0, 1))
    assert not still.moves
    assert still.velocities.shape == (2, 2)


def test_zero_direction_is_refused():
    with pytest.raises(iq.BadInput, match="zero vector"):
        iq.systems.point_motion(np.eye(6), (0, 0, 0), (0, 0, 0))
