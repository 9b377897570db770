import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion

import invariantqp as iq

FINITE = st.floats(-1e3, 1e3)
TWIST = st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6).map(np.array)
EXAMPLES = settings(deadline=None, derandomize=True, max_examples=60)


def test_the_matrices_of_the_forms():
    eye, zero = np.eye(3), np.zeros((3, 3))
    np.testing.assert_array_equal(iq.pitch_form(0.25), np.block([[-0.5 * eye, eye], [eye, zero]]))
    np.testing.assert_array_equal(iq.pitch_form_inverse(0.25), np.block([[zero, eye], [eye, 0.5 * eye]]))
    for infinite in (np.inf, -np.inf):
        np.testing.assert_array_equal(iq.pitch_form(infinite), np.block([[-2.0 * eye, zero], [zero, zero]]))
    np.testing.assert_array_equal(
        iq.forms.invariant_form(2.0, 3.0), np.block([[-4.0 * eye, 3.0 * eye], [3.0 * eye, zero]])
    )


@EXAMPLES
@given(FINITE)
def test_the_inverse_inverts_and_the_signature_is_balanced(h):
    Q = iq.pitch_form(h)
    np.testing.assert_allclose(Q @ iq.pitch_form_inverse(h), np.eye(6), atol=1e-15)
    mu = np.linalg.eigvalsh(Q)
    assert (mu[:3] < 0.0).all()
    assert (mu[3:] > 0.0).all()


@EXAMPLES
@given(st.integers(0, 10_000), FINITE, FINITE)
def test_the_whole_pencil_is_invariant(seed, alpha, beta):
    """Ad'Q Ad = Q, and on wrenches Ad*'Q^-1 Ad* = Q^-1."""
    T = motion(np.random.default_rng(seed))
    A, B = iq.adjoint(T), iq.coadjoint(T)
    Q, Q_inverse = iq.forms.invariant_form(alpha, beta), iq.pitch_form_inverse(alpha)
    size = np.linalg.norm(A) ** 2
    np.testing.assert_allclose(A.T @ Q @ A, Q, atol=1e-15 * size * (1.0 + np.abs(Q).max()))
    np.testing.assert_allclose(B.T @ Q_inverse @ B, Q_inverse, atol=1e-15 * size * (1.0 + np.abs(Q_inverse).max()))


def test_no_other_form_is_invariant():
    """[DS] Theorem 2.1: the quadratic forms that a rigid motion leaves alone are the pencil, a plane among 21."""
    rng = np.random.default_rng(0)
    pairs = [(i, j) for i in range(6) for j in range(i, 6)]
    rows = []
    for _ in range(4):
        A = iq.adjoint(motion(rng))
        for i, j in pairs:
            E = np.zeros((6, 6))
            E[i, j] = E[j, i] = 1.0
            rows.append((A.T @ E @ A - E).ravel())
    system = np.vstack([np.array(rows[k * 21 : (k + 1) * 21]).T for k in range(4)])
    assert 21 - np.linalg.matrix_rank(system, tol=1e-9) == 2


@EXAMPLES
@given(st.floats(-5.0, 5.0), TWIST)
def test_twists_of_pitch_h_are_the_null_twists_of_the_form(h, s):
    w = s[:3] + np.array([1.0, 0.0, 0.0]) * (np.linalg.norm(s[:3]) < 0.1)
    screw = iq.se3.helical(w, s[3:], h)
    assert screw @ iq.pitch_form(h) @ screw == pytest.approx(0.0, abs=1e-13 * (1.0 + abs(h) + np.abs(s).max()))
