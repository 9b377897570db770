import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion, sample

import invariantqp as iq
from invariantqp.systems.stationary import psi

SEEDS = st.integers(0, 2**31)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 7), h=st.floats(-2.0, 2.0))
def test_psi_maps_to_the_stationary_point_of_the_cost(seed, m, h):
    """[DS]'s Psi(x) = (s - Jx)'Q_h(s - Jx) + x'Lambda x, differentiated by differences at the x that psi belongs to."""
    rng = np.random.default_rng(seed)
    J, s, A = rng.normal(size=(6, m)), rng.normal(size=6), rng.normal(size=(m, m))
    Lambda, Q = A + A.T, iq.pitch_form(h)
    total = iq.systems.gram_matrix(J, h) + Lambda
    if np.linalg.cond(total) > 1e4:
        return
    x = np.linalg.solve(total, J.T @ Q @ s)
    np.testing.assert_allclose(psi(J, h, Lambda) @ s, J @ x, atol=1e-9 * (1.0 + np.abs(x).max()))

    def cost(y):
        left = s - J @ y
        return left @ Q @ left + y @ Lambda @ y

    slopes = [(cost(x + step) - cost(x - step)) / 2e-4 for step in 1e-4 * np.eye(m)]
    np.testing.assert_allclose(slopes, 0.0, atol=1e-6 * (1.0 + np.abs(x).max() ** 2))


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 6), h=st.floats(-2.0, 2.0))
def test_eigenvalues_of_psi_are_the_gains(seed, m, h):
    rng = np.random.default_rng(seed)
    J, A = rng.normal(size=(6, m)), rng.normal(size=(m, m))
    G = iq.systems.gram_matrix(J, h)
    inverse = [0.09 * np.linalg.inv(G)] if np.linalg.cond(G) < 1e5 else []  # gains mu^2 / (mu^2 + 0.09): damping
    for Lambda in (0.3 * np.eye(m), A @ A.T + 0.1 * np.eye(m), *inverse):
        mu = np.linalg.eigvals(np.linalg.solve(Lambda, G)).real
        if np.abs(mu + 1.0).min() < 1e-3:
            continue
        expected = np.append(mu / (mu + 1.0), np.zeros(6 - m))
        gains = np.linalg.eigvals(psi(J, h, Lambda))
        scale = 1.0 + np.abs(expected).max()
        np.testing.assert_allclose(np.sort(gains.real), np.sort(expected), atol=1e-6 * scale**2)


def test_signs_of_the_gains():
    """Lambda = lambda I: damped for mu > 0, negative for -lambda < mu < 0, above 1 below that, a pole between."""
    S = np.array([(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, -0.1, 0), (0, 0, 1, 0, 0, -0.9)]).T  # G = diag(1, -0.2, -1.8)
    np.testing.assert_allclose(np.diag(iq.systems.gram_matrix(S, 0.0)), [1.0, -0.2, -1.8])
    np.testing.assert_allclose(
        np.sort(np.linalg.eigvals(psi(S, 0.0, 0.4)).real)[[0, -2, -1]], [-1.0, 1 / 1.4, 1.8 / 1.4]
    )
    for pole in (0.2, 1.8):
        with pytest.raises(iq.BadInput, match="Lambda: found a pole"):
            psi(S, 0.0, pole)


def test_psi_is_its_own_h_adjoint_and_tends_to_the_projector():
    rng = np.random.default_rng(1)
    J, h = rng.normal(size=(6, 4)), 0.7
    Lambda = np.diag(rng.uniform(0.1, 1.0, size=4))
    P, Q = psi(J, h, Lambda), iq.pitch_form(h)
    np.testing.assert_allclose(Q @ P, (Q @ P).T, atol=1e-12)
    Ad = iq.adjoint(motion(rng))
    np.testing.assert_allclose(psi(Ad @ J, h, Lambda), Ad @ P @ np.linalg.inv(Ad), atol=1e-10)
    np.testing.assert_allclose(psi(J, h, 1e-9), J @ iq.pseudoinverse(J, h), atol=1e-7)
    np.testing.assert_allclose(psi(J, h, np.diag(Lambda)), P, atol=1e-14)


@pytest.mark.parametrize(
    ("value", "said"), [(np.eye(3), "shape"), (np.ones(3), "shape"), ([[1.0, 2.0], [0.0, 1.0]], "not symmetric")]
)
def test_bad_lambda(value, said):
    with pytest.raises(iq.BadInput, match=said) as caught:
        psi(np.eye(6)[:, :2], 0.3, value)
    assert caught.value.argument == "Lambda"


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 7])
def test_the_pseudoinverse_is_a_stationary_point_of_the_right_kind(m):
    rng = np.random.default_rng(m)
    for h in (-6.0, 0.3, 6.0):
        J, s = rng.normal(size=(6, m)), rng.normal(size=6)
        found = iq.systems.stationary_point(J, s, h)
        assert found.value == iq.systems.error_form(J, s, h, found.velocity)[0]
        np.testing.assert_allclose(found.gradient, 0.0, atol=1e-8)
        directions = np.linalg.eigh(J.T @ iq.pitch_form(h) @ J)[1].T  # the narrow cones of a saddle are along these
        changes = np.array([iq.systems.error_form(J, s, h, found.velocity + dx)[0] - found.value for dx in directions])
        if m < 6:  # with rank 6 the error is zero whatever is probed around it
            kind = "minimum" if changes.min() > 0.0 else "maximum" if changes.max() < 0.0 else "saddle"
            assert found.kind == kind
        assert sum(found.signature) == m
        if m >= 4:
            assert found.kind == "saddle"


def test_outside_the_principal_pitches_it_is_a_true_optimum():
    S = np.random.default_rng(4).normal(size=(6, 3))
    pitches = iq.principal_pitches(S)
    s = np.random.default_rng(5).normal(size=6)
    assert iq.systems.stationary_point(S, s, pitches[0] - 1.0).kind == "minimum"
    assert iq.systems.stationary_point(S, s, pitches.mean()).kind == "saddle"
    assert iq.systems.stationary_point(S, s, pitches[-1] + 1.0).kind == "maximum"
    still = iq.systems.stationary_point(np.zeros((6, 2)), s, 0.5)
    assert (still.kind, still.signature) == ("flat", (0, 0, 2))


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_the_error_vanishes_at_the_vanishing_pitches_and_changes_sign(m):
    rng = np.random.default_rng(m)
    for _ in range(5):
        J, s = rng.normal(size=(6, m)), rng.normal(size=6)
        for h in iq.systems.vanishing_pitches(J, s):
            gap = np.abs(iq.principal_pitches(J) - h).min() * 1e-3
            assert abs(iq.systems.stationary_point(J, s, h).value) < 1e-6 * (1.0 + s @ s)
            below, above = (iq.systems.stationary_point(J, s, h + d).value for d in (-gap, gap))
            assert below * above < 0.0


def test_value_and_vanishing_pitches_are_frame_free():
    rng = np.random.default_rng(9)
    J, s, Ad = rng.normal(size=(6, 3)), rng.normal(size=6), iq.adjoint(motion(rng))
    assert iq.systems.stationary_point(Ad @ J, Ad @ s, 0.4).value == pytest.approx(
        iq.systems.stationary_point(J, s, 0.4).value
    )
    np.testing.assert_allclose(
        iq.systems.vanishing_pitches(Ad @ J, Ad @ s), iq.systems.vanishing_pitches(J, s), rtol=1e-9
    )


def test_vanishing_pitches_are_refused_if_none_or_all_vanish():
    rng = np.random.default_rng(10)
    J = rng.normal(size=(6, 3))
    with pytest.raises(iq.BadInput, match="span"):
        iq.systems.vanishing_pitches(J, J @ rng.normal(size=3))
    with pytest.raises(iq.NoPseudoinverse):
        iq.systems.stationary_point(sample(rng, (3, "IC"))[0], rng.normal(size=6), 0.3)
    axis = iq.revolute((0, 0, 1))
    with pytest.raises(iq.BlindSystem):  # a translation across the axis: reciprocal to it and to itself for every h
        iq.systems.vanishing_pitches(axis, iq.se3.prismatic((1, 0, 0)))
