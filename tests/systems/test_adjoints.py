import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion

import invariantqp as iq
from invariantqp.systems.pseudoinverses import form_adjoint, h_adjoint

SEEDS = st.integers(0, 2**31)


def random_form(rng, n):
    A = rng.normal(size=(n, n))
    return A + A.T


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=st.integers(1, 6), m=st.integers(1, 6), k=st.integers(1, 6))
def test_what_an_adjoint_is(seed, n, m, k):
    """(2.12) on vectors; twice is nothing; of a product the product the other way round."""
    rng = np.random.default_rng(seed)
    M, N, K = (random_form(rng, size) for size in (m, n, k))
    A, B = rng.normal(size=(n, m)), rng.normal(size=(m, k))
    x, y = rng.normal(size=m), rng.normal(size=n)
    star = form_adjoint(A, M, N)
    scale = np.linalg.cond(M) * np.linalg.cond(N) * np.linalg.cond(K) * (1.0 + np.abs(star).max())
    assert x @ M @ star @ y == pytest.approx((A @ x) @ N @ y, abs=1e-12 * scale)
    np.testing.assert_allclose(form_adjoint(star, N, M), A, atol=1e-12 * scale)
    np.testing.assert_allclose(form_adjoint(A @ B, K, N), form_adjoint(B, K, M) @ star, atol=1e-11 * scale)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 8), h=st.floats(-3.0, 3.0))
def test_the_h_adjoint_of_a_jacobian(seed, m, h):
    rng = np.random.default_rng(seed)
    J, A = rng.normal(size=(6, m)), rng.normal(size=(m, m))
    M = A @ A.T + np.eye(m)
    Q = iq.pitch_form(h)
    np.testing.assert_allclose(h_adjoint(J, h), J.T @ Q, atol=1e-15)
    np.testing.assert_allclose(h_adjoint(J, h, joint_metric=M), form_adjoint(J, M, Q), atol=1e-12)
    np.testing.assert_allclose(h_adjoint(J, h) @ J, iq.systems.gram_matrix(J, h), atol=1e-12)
    Ad = iq.adjoint(motion(rng))
    np.testing.assert_allclose(h_adjoint(Ad @ J, h) @ Ad, h_adjoint(J, h), atol=1e-11)


def test_transposes_and_wrenches_are_special_cases():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(4, 3))
    np.testing.assert_array_equal(form_adjoint(A, np.eye(3), np.eye(4)), A.T)
    P = rng.normal(size=(6, 6))
    Q = iq.pitch_form(0.3)
    # Q_h carries twists to wrenches, measured by Q_h^-1, and loses nothing.
    assert form_adjoint(Q, Q, iq.pitch_form_inverse(0.3)) @ Q == pytest.approx(np.eye(6))
    np.testing.assert_allclose(form_adjoint(P, Q, Q), np.linalg.solve(Q, P.T @ Q), atol=1e-12)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: form_adjoint(np.ones(3), np.eye(3), np.eye(1)), "A"),
        (lambda: form_adjoint(np.full((2, 2), np.nan), np.eye(2), np.eye(2)), "A"),
        (lambda: form_adjoint(np.ones((2, 3)), np.eye(2), np.eye(2)), "domain"),
        (lambda: form_adjoint(np.ones((2, 3)), np.eye(3), np.eye(3)), "codomain"),
        (lambda: form_adjoint(np.eye(2), [[1, 1], [0, 1]], np.eye(2)), "domain"),
        (lambda: form_adjoint(np.eye(6), iq.pitch_form(np.inf), np.eye(6)), "domain"),
        (lambda: h_adjoint(np.eye(5), 0.3), "J"),
        (lambda: h_adjoint(np.eye(6), np.nan), "h"),
        (lambda: h_adjoint(np.eye(6), 0.3, joint_metric=-np.eye(6)), "joint_metric"),
    ],
)
def test_what_has_no_adjoint(call, argument):
    with pytest.raises(iq.BadInput) as caught:
        call()
    assert caught.value.argument == argument
