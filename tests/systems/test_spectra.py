from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.exact_pseudoinverse import exact_form
from support.random_systems import admits, every_class, motion, sample

import invariantqp as iq
from invariantqp.errors import NoPolarDecomposition
from invariantqp.systems.spectra import hyperbolic_polar


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), m=st.integers(1, 8), h=st.floats(-3.0, 3.0))
def test_singular_values_satisfy_their_definition(seed, m, h):
    rng = np.random.default_rng(seed)
    J, A = rng.normal(size=(6, m)), rng.normal(size=(m, m))
    M = A @ A.T + np.eye(m)
    found = iq.systems.hyperbolic_singular_values(J, h, joint_metric=M)
    V, G = found.joint_directions, iq.systems.gram_matrix(J, h)
    np.testing.assert_allclose(V.T @ M @ V, np.eye(m), atol=1e-9)
    scale = np.abs(G).max()
    np.testing.assert_allclose(G @ V, M @ V * found.values, atol=1e-9 * scale)
    np.testing.assert_allclose(found.twists, J @ V)
    gram = found.twists.T @ iq.pitch_form(h) @ found.twists
    np.testing.assert_allclose(gram, np.diag(found.values), atol=1e-9 * scale)
    assert np.all(np.diff(np.abs(found.values[: found.rank])) <= 1e-12 * scale)
    np.testing.assert_allclose(found.singular_values * np.abs(found.singular_values), found.values, atol=1e-12 * scale)


def test_hyperbolic_singular_values_are_the_same_in_every_frame_and_scale_with_the_unit():
    rng = np.random.default_rng(1)
    scale = np.repeat([1.0, 1e3], 3)[:, None]
    for m in (2, 3, 5, 6, 7):
        J = rng.normal(size=(6, m))
        moved = iq.adjoint(motion(rng)) @ J
        here, there = (iq.systems.hyperbolic_singular_values(x, 0.8) for x in (J, moved))
        in_mm = iq.systems.hyperbolic_singular_values(J * scale, 800.0)
        np.testing.assert_allclose(there.values, here.values, atol=1e-9)
        np.testing.assert_allclose(in_mm.values, 1e3 * here.values, atol=1e-6)
        assert there.condition == pytest.approx(here.condition)
        assert in_mm.condition == pytest.approx(here.condition)
        sigma, sigma_moved = (np.linalg.svd(x, compute_uv=False) for x in (J, moved))
        assert np.abs(sigma_moved - sigma).max() > 0.1


@pytest.mark.parametrize("m", [6, 7, 8])
def test_the_product_at_rank_six_is_yoshikawas_manipulability(m):
    J = np.random.default_rng(m).normal(size=(6, m))
    yoshikawa = np.sqrt(np.linalg.det(J @ J.T))
    for h in (-1.0, 0.0, 0.4, 5.0):
        found = iq.systems.hyperbolic_singular_values(J, h)
        assert np.abs(found.singular_values[:6]).prod() == pytest.approx(yoshikawa)
        np.testing.assert_array_equal(np.sort(np.sign(found.values)), [-1] * 3 + [0] * (m - 6) + [1] * 3)


def test_condition_grows_as_the_distance_to_a_principal_pitch_shrinks():
    J = np.random.default_rng(3).normal(size=(6, 3))
    h = iq.principal_pitches(J)[1]
    conditions = [iq.systems.hyperbolic_singular_values(J, h + d).condition for d in (1e-1, 1e-3, 1e-5, 0.0)]
    assert conditions == sorted(conditions)
    assert conditions[2] > 30.0 * conditions[1] / 10.0
    assert conditions[3] == float("inf")


def test_degenerate_arms():
    still = iq.systems.hyperbolic_singular_values(np.zeros((6, 2)), 0.5)
    assert (still.rank, still.condition) == (0, 1.0)
    blind = iq.systems.hyperbolic_singular_values(iq.se3.prismatic((0, 0, 1)), 0.5)
    assert blind.condition == float("inf")
    assert blind.values == 0.0


@every_class
@pytest.mark.parametrize("upper", [False, True])
def test_condition_and_polar_decomposition_exist_iff_the_pseudoinverse_does(key, upper):
    """A wrist at h = 0 has values that are all rounding, and of one size: that is no good condition."""
    rng = np.random.default_rng(41)
    for _ in range(4):
        J, _ = sample(rng, key, upper=upper)
        pitches = iq.principal_pitches(J) if admits(key[1]) else [0.3, -1.2]
        for h in (*pitches, 2.5):
            found = iq.systems.hyperbolic_singular_values(J, float(h))
            assert np.isfinite(found.condition) == iq.has_pseudoinverse(J, float(h)) == (h == 2.5 and admits(key[1]))
        if admits(key[1]):
            polar = hyperbolic_polar(J, 2.5)
            np.testing.assert_allclose(polar.movement @ polar.stretch, J, atol=1e-8)
        else:
            with pytest.raises(NoPolarDecomposition, match=r"whose gain is zero\. No h works for this system"):
                hyperbolic_polar(J, 2.5)


SEEDS = st.integers(0, 2**31)


@settings(max_examples=80, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 8), rank=st.integers(1, 6), h=st.floats(-2.0, 2.0))
def test_polar_factors_satisfy_their_definition(seed, m, rank, h):
    rng = np.random.default_rng(seed)
    r = min(m, rank)
    J, A = rng.normal(size=(6, r)) @ rng.normal(size=(r, m)), rng.normal(size=(m, m))
    Q = iq.pitch_form(h)
    for M in (np.eye(m), A @ A.T + np.eye(m)):
        try:
            found = hyperbolic_polar(J, h, joint_metric=M)
        except NoPolarDecomposition:
            assume(condition=False)
        ratio = (found.gains[0] / found.gains[-1]) ** 2
        assume(ratio < 1e5)
        W, S, R = found.movement, found.stretch, found.twist_stretch
        close = {"atol": 1e-11 * ratio * np.linalg.cond(M) * (1.0 + np.abs(J).max() ** 2)}
        np.testing.assert_allclose(W @ S, J, **close)
        np.testing.assert_allclose(R @ W, J, **close)
        np.testing.assert_allclose(M @ S, (M @ S).T, **close)
        np.testing.assert_allclose(Q @ R, (Q @ R).T, **close)
        assert np.linalg.eigvalsh(M @ S)[0] > -close["atol"]
        # W carries the joint metric to Q_h up to the signs of G, which commute with S.
        signs = np.linalg.solve(M, W.T @ Q @ W)
        np.testing.assert_allclose(signs @ signs @ signs, signs, **close)
        np.testing.assert_allclose(signs @ S, S @ signs, **close)
        np.testing.assert_allclose(S @ signs @ S, np.linalg.solve(M, J.T @ Q @ J), **close)
        assert found.signs.shape == found.gains.shape == (r,)
        np.testing.assert_allclose(found.screws.T @ Q @ found.screws, np.diag(found.signs), **close)
        np.testing.assert_allclose(J @ found.joint_directions, found.screws * found.gains, **close)


@pytest.mark.cases(3)
@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6])
def test_polar_factors_against_fifty_digits(m):
    """S = |G|^(1/2) and W = J S^-1 by mpmath's eigenvectors of the exact J'Q_h J."""
    rng = np.random.default_rng(m)
    with mpmath.workdps(50):
        for _ in range(12):
            J, h = rng.normal(size=(6, m)), rng.uniform(-1.0, 1.0)
            found = hyperbolic_polar(J, h)
            A = mpmath.matrix(J.tolist())
            mu, V = mpmath.eigsy(A.T * exact_form(h) * A)
            gains = [mpmath.sqrt(abs(x)) for x in mu]
            S = V * mpmath.diag(gains) * V.T
            W = A * V * mpmath.diag([1 / g for g in gains]) * V.T
            for ours, exact in ((found.stretch, S), (found.movement, W)):
                expected = np.array(exact.tolist(), dtype=float)
                error = np.linalg.norm(ours - expected) / np.linalg.norm(expected)
                assert error <= 1e-14 * (found.gains[0] / found.gains[-1]) ** 2
            assert found.signs.sum() == sum(mpmath.sign(x) for x in mu)


def test_a_change_of_frame_acts_on_the_movement_only():
    rng = np.random.default_rng(1)
    for m in (2, 3, 5, 7):
        J, Ad = rng.normal(size=(6, m)), iq.adjoint(motion(rng))
        here, there = hyperbolic_polar(J, 0.4), hyperbolic_polar(Ad @ J, 0.4)
        np.testing.assert_allclose(there.stretch, here.stretch, atol=1e-9)
        np.testing.assert_allclose(there.gains, here.gains, atol=1e-9)
        np.testing.assert_allclose(there.movement, Ad @ here.movement, atol=1e-8)
        np.testing.assert_allclose(there.twist_stretch, Ad @ here.twist_stretch @ np.linalg.inv(Ad), atol=1e-7)


def test_an_isometry_needs_three_joints_and_a_pitch_outside_the_principal_ones():
    """The canonical polar decomposition, W'Q_h W = I: iff no eigenvalue of J'Q_h J is negative."""
    rng = np.random.default_rng(2)
    for m in (1, 2, 3):
        J = rng.normal(size=(6, m))
        pitches = iq.principal_pitches(J)
        Q = iq.pitch_form(pitches[0] - 0.3)
        below, above = hyperbolic_polar(J, pitches[0] - 0.3), hyperbolic_polar(J, pitches[-1] + 0.3)
        assert (below.signs == 1.0).all()
        assert (above.signs == -1.0).all()
        np.testing.assert_allclose(below.movement.T @ Q @ below.movement, np.eye(m), atol=1e-9)
        for low, high in pairwise(pitches):
            assert set(hyperbolic_polar(J, 0.5 * (low + high)).signs) == {-1.0, 1.0}
    for m in (4, 5, 6, 7):
        J = rng.normal(size=(6, m))
        for h in (-1e3, -1.0, 0.2, 1e3):
            assert set(hyperbolic_polar(J, h).signs) == {-1.0, 1.0}


def test_signs_tell_screws_of_pitch_above_h_from_those_below():
    rng = np.random.default_rng(3)
    for m in (1, 3, 5, 6):
        J, h = rng.normal(size=(6, m)), 0.3
        found = hyperbolic_polar(J, h)
        for w, sign in zip(found.screws.T, found.signs, strict=True):
            assert np.sign(iq.se3.pitch(w) - h) == sign
            assert 2.0 * w[:3] @ w[:3] * (iq.se3.pitch(w) - h) == pytest.approx(sign)


def test_the_error_says_why_there_is_no_polar_decomposition():
    S = np.array([(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, -0.25, 0)]).T
    with pytest.raises(
        NoPolarDecomposition, match=r"screw z = \(0.8944, 0, 0, 0.4472, 0, 0\), whose gain is zero"
    ) as caught:
        hyperbolic_polar(S, 0.5)
    assert isinstance(caught.value, iq.NoPseudoinverse)
    assert (caught.value.rank, caught.value.gram_rank) == (2, 1)
    assert "Choose h away from the principal pitches (0.5, -0.25)" in str(caught.value)
    # Gains that differ by more than rounding allows.
    with pytest.raises(NoPolarDecomposition, match="so small beside the largest that it is rounding"):
        hyperbolic_polar(S * np.array([1.0, 1e-7]), 0.1)


def test_the_polar_decomposition_of_zero_twists_is_zero():
    found = hyperbolic_polar(np.zeros((6, 2)), 0.3)
    assert found.gains.shape == (0,)
    np.testing.assert_array_equal(found.movement, np.zeros((6, 2)))


def test_bad_input():
    for options in ({"h": np.inf}, {"h": 0.3, "joint_metric": -np.ones(6)}):
        with pytest.raises(iq.BadInput, match=next(reversed(options))):
            hyperbolic_polar(np.eye(6), **options)


def test_messages_do_not_print_rounding():
    planar = np.array([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.5, 0.1, 0), (0.8, 0.3, 0))]).T
    turned = iq.adjoint(iq.exp([0.0, 0.0, 0.7, 0.0, 0.0, 0.0])) @ planar
    with pytest.raises(iq.NoPseudoinverse) as caught:
        iq.pseudoinverse(turned, 1.0)
    assert "e-" not in str(caught.value)
    with pytest.raises(iq.BlindSystem) as blind:
        iq.principal_pitches(turned)
    assert "e-" not in str(blind.value)
