import mpmath
import numpy as np
import pytest
from support.random_systems import admits, every_class, motion, sample

import invariantqp as iq


def polynomial_coefficients(J):
    """c_0..c_m of det(J'Q_h J) by exact interpolation in rationals' stead: 60 digits."""
    with mpmath.workdps(60):
        A = mpmath.matrix(J.tolist())
        m = J.shape[1]
        values = [mpmath.det(A.T * mpmath.matrix(iq.pitch_form(float(h)).tolist()) * A) for h in range(m + 1)]
        V = mpmath.matrix([[mpmath.mpf(h) ** j for j in range(m + 1)] for h in range(m + 1)])
        return np.array([float(x) for x in mpmath.lu_solve(V, mpmath.matrix(values))])


@every_class
def test_polynomial_and_failing_pitches_of_every_type(key):
    rng = np.random.default_rng(17)
    for upper in [False, True] if key[0] < 3 else [False]:
        J, _ = sample(rng, key, upper=upper)
        c = iq.systems.gram_polynomial(J)
        np.testing.assert_allclose(c, polynomial_coefficients(J), atol=1e-9 * max(1.0, np.abs(c).max()))
        assert c.any() == admits(key[1])
        assert (iq.systems.blind_directions(J).shape[1] == 0) == admits(key[1])
        if not admits(key[1]):
            with pytest.raises(iq.BlindSystem):
                iq.principal_pitches(J)
            blind = iq.systems.blind_directions(J)
            for h in (-3.0, 0.0, 0.7):
                np.testing.assert_allclose(J.T @ iq.pitch_form(h) @ blind, 0.0, atol=1e-9)
            continue
        pitches, screws = iq.systems.principal_screws(J)
        np.testing.assert_array_equal(pitches, iq.principal_pitches(J))
        np.testing.assert_allclose(screws[:3].T @ screws[:3], np.eye(len(pitches)), atol=1e-9)
        for h, z in zip(pitches, screws.T, strict=True):
            assert iq.se3.pitch(z) == pytest.approx(h, abs=1e-9)
            np.testing.assert_allclose(J.T @ iq.pitch_form(h) @ z, 0.0, atol=1e-8 * np.linalg.norm(J))
            assert np.linalg.matrix_rank(np.column_stack((J, z)), tol=1e-8) == J.shape[1]


def test_polynomial_and_pitches_in_every_frame_basis_and_unit():
    rng = np.random.default_rng(2)
    for k in range(1, 7):
        J, A = rng.normal(size=(6, k)), rng.normal(size=(k, k))
        c = iq.systems.gram_polynomial(J)
        np.testing.assert_allclose(iq.systems.gram_polynomial(iq.adjoint(motion(rng)) @ J), c, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(iq.systems.gram_polynomial(J @ A), np.linalg.det(A) ** 2 * c, rtol=1e-7, atol=1e-9)
        in_mm = J * np.repeat([1.0, 1e3], 3)[:, None]
        np.testing.assert_allclose(
            iq.systems.gram_polynomial(in_mm) / 1e3 ** np.arange(k, -1.0, -1.0), c, rtol=1e-7, atol=1e-9
        )
        np.testing.assert_allclose(iq.principal_pitches(in_mm), 1e3 * iq.principal_pitches(J))


def test_dependent_columns_keep_the_pitches_and_have_a_zero_determinant():
    rng = np.random.default_rng(6)
    J = rng.normal(size=(6, 3))
    more = J @ rng.normal(size=(3, 5))
    np.testing.assert_allclose(iq.principal_pitches(more), iq.principal_pitches(J), rtol=1e-9)
    assert not iq.systems.gram_polynomial(more).any()


def test_rank_six_and_zero_have_no_principal_pitches():
    J = np.random.default_rng(0).normal(size=(6, 8))
    assert iq.principal_pitches(J).shape == (0,)
    assert iq.systems.principal_screws(np.zeros((6, 2)))[1].shape == (6, 0)
    assert iq.systems.blind_directions(J).shape == (6, 0)
