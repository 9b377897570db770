import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from support.random_systems import motion

import invariantqp as iq
from invariantqp.geometry import se3

SEED = st.integers(0, 10_000)
EXAMPLES = settings(deadline=None, derandomize=True, max_examples=60)
EPS = np.finfo(float).eps
NEAR_PI = [np.pi - d for d in (1e-1, 1e-3, 1e-6, 1e-9, 1e-12)]
ANGLES = [0.0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-5, 1e-3, 9.999e-3, 1e-2, 1.0001e-2, 0.1, 1.0, 2.0, 3.0, *NEAR_PI]


def twist_with_angle(rng, angle):
    u = rng.normal(size=3)
    return np.concatenate((angle * u / np.linalg.norm(u), rng.normal(size=3)))


def algebra(s):
    X = np.zeros((4, 4))
    X[:3, :3] = se3.cross_matrix(s[:3])
    X[:3, 3] = s[3:]
    return X


def ad(s):
    W, V = se3.cross_matrix(s[:3]), se3.cross_matrix(s[3:])
    return np.block([[W, np.zeros((3, 3))], [V, W]])


@EXAMPLES
@given(SEED)
def test_adjoints_are_representations(seed):
    rng = np.random.default_rng(seed)
    A, B = motion(rng), motion(rng)
    for represent in (iq.adjoint, iq.coadjoint):
        np.testing.assert_allclose(represent(A @ B), represent(A) @ represent(B), atol=1e-13)
        np.testing.assert_allclose(represent(iq.inverse(A)) @ represent(A), np.eye(6), atol=1e-13)
    np.testing.assert_array_equal(iq.adjoint(np.eye(4)), np.eye(6))
    np.testing.assert_allclose(iq.inverse(A) @ A, np.eye(4), atol=1e-14)
    np.testing.assert_allclose(iq.inverse(A @ B), iq.inverse(B) @ iq.inverse(A), atol=1e-13)


@EXAMPLES
@given(SEED)
def test_power_is_the_same_in_every_frame(seed):
    rng = np.random.default_rng(seed)
    T, s, W = motion(rng), rng.normal(size=6), rng.normal(size=6)
    assert (iq.coadjoint(T) @ W) @ (iq.adjoint(T) @ s) == pytest.approx(W @ s, abs=1e-12)
    np.testing.assert_allclose(iq.coadjoint(T), np.linalg.inv(iq.adjoint(T)).T, atol=1e-12)


@EXAMPLES
@given(SEED)
def test_conjugation_is_the_adjoint(seed):
    rng = np.random.default_rng(seed)
    T, s = motion(rng), twist_with_angle(rng, rng.uniform(0.0, 3.0))
    np.testing.assert_allclose(T @ iq.exp(s) @ iq.inverse(T), iq.exp(iq.adjoint(T) @ s), atol=1e-12)


@pytest.mark.parametrize("angle", ANGLES)
def test_exp_is_the_matrix_exponential(angle):
    rng = np.random.default_rng(1)
    for _ in range(5):
        s = twist_with_angle(rng, angle)
        np.testing.assert_allclose(iq.exp(s), expm(algebra(s)), atol=4e-15 * (1.0 + np.abs(s).max()))


@pytest.mark.parametrize("angle", [1e-6, 9.99e-3, 1.01e-2, 0.5, np.pi - 1e-9, 40.0])
def test_exp_in_fifty_digits(angle):
    s = twist_with_angle(np.random.default_rng(2), angle)
    with mpmath.workdps(50):
        exact = mpmath.expm(mpmath.matrix(algebra(s).tolist()), method="taylor")
        error = max(abs(iq.exp(s)[i, j] - exact[i, j]) for i in range(4) for j in range(4))
    assert error <= 8 * EPS * max(1.0, angle)


@pytest.mark.parametrize("angle", [a for a in ANGLES if np.pi - a > 1e-10])
def test_log_undoes_exp(angle):
    rng = np.random.default_rng(4)
    for _ in range(20):
        s = twist_with_angle(rng, angle)
        np.testing.assert_allclose(iq.log(iq.exp(s)), s, atol=1e-14, rtol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, 3.0])
def test_a_displacement_is_the_logarithm_from_pose_to_pose(angle):
    rng = np.random.default_rng(int(10 * angle))
    start, axis = iq.exp(rng.normal(size=6)), rng.normal(size=3)
    twist = np.concatenate((angle * axis / np.linalg.norm(axis), rng.normal(size=3)))
    np.testing.assert_allclose(se3.displacement(start, iq.exp(twist) @ start), twist, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("angle", [np.pi, *NEAR_PI])
def test_near_half_a_turn_log_is_a_logarithm(angle):
    """The axis may flip there by rounding alone; the motion may not."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        T = iq.exp(twist_with_angle(rng, angle))
        w = iq.log(T)[:3]
        assert np.linalg.norm(w) <= np.pi * (1.0 + EPS)
        np.testing.assert_allclose(iq.exp(iq.log(T)), T, atol=1e-14)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_a_turn_about_a_coordinate_axis(axis):
    T = iq.transform(2.0 * np.outer(axis, axis) - np.eye(3), (0.3, -0.1, 0.7))
    s = iq.log(T)
    np.testing.assert_allclose(np.abs(s[:3]), np.pi * axis, atol=1e-15)
    np.testing.assert_allclose(iq.exp(s), T, atol=1e-15)


@EXAMPLES
@given(SEED)
def test_the_bracket_is_a_lie_bracket_and_the_derivative_of_the_adjoint(seed):
    rng = np.random.default_rng(seed)
    a, b, c = rng.normal(size=(3, 6))
    np.testing.assert_allclose(iq.se3.bracket(a, b), -iq.se3.bracket(b, a))
    jacobi = (
        iq.se3.bracket(a, iq.se3.bracket(b, c))
        + iq.se3.bracket(b, iq.se3.bracket(c, a))
        + iq.se3.bracket(c, iq.se3.bracket(a, b))
    )
    np.testing.assert_allclose(jacobi, 0.0, atol=1e-13)
    np.testing.assert_allclose(iq.se3.bracket(a, b), ad(a) @ b, atol=1e-14)
    step = 1e-5
    forward, backward = iq.adjoint(iq.exp(step * a)), iq.adjoint(iq.exp(-step * a))
    np.testing.assert_allclose((forward - backward) @ b / (2.0 * step), iq.se3.bracket(a, b), atol=1e-8)
    np.testing.assert_allclose(iq.adjoint(iq.exp(0.3 * a)), expm(0.3 * ad(a)), atol=1e-12)


@EXAMPLES
@given(SEED)
def test_a_point_moves_as_the_body_does(seed):
    """v + omega x p is the derivative of exp(t s) p, in every frame."""
    rng = np.random.default_rng(seed)
    s, p = rng.normal(size=6), rng.normal(size=3)
    step = 1e-6
    moved = [(iq.exp(t * s) @ np.append(p, 1.0))[:3] for t in (step, -step)]
    np.testing.assert_allclose(se3.velocity_at(s, p), (moved[0] - moved[1]) / (2.0 * step), atol=1e-8)
    T = motion(rng)
    there = se3.velocity_at(iq.adjoint(T) @ s, (T @ np.append(p, 1.0))[:3])
    np.testing.assert_allclose(there, T[:3, :3] @ se3.velocity_at(s, p), atol=1e-13)


def test_defaults_and_foreign_poses():
    np.testing.assert_array_equal(iq.transform(), np.eye(4))

    class Foreign:
        homogeneous = iq.exp([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])

    np.testing.assert_array_equal(iq.adjoint(Foreign()), iq.adjoint(Foreign.homogeneous))
