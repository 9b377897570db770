from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.exact_pseudoinverse import exact_form
from support.random_systems import CLASSES, admits, motion, sample

import invariantqp as iq
from invariantqp.errors import NoPolarDecomposition
from invariantqp.systems.spectra import hyperbolic_polar


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), m=st.integers(1, 8), h=st.floats(-3.0, 3.0))
def test_they_are_what_they_say(seed, m, h):
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


def test_invariant_where_singular_values_are_not():
    rng = np.random.default_rng(1)
    for m in (2, 3, 5, 6, 7):
        J = rng.normal(size=(6, m))
        moved = iq.adjoint(motion(rng)) @ J
        here, there = (iq.systems.hyperbolic_singular_values(x, 0.8) for x in (J, moved))
        np.testing.assert_allclose(there.values, here.values, atol=1e-9)
        assert there.condition == pytest.approx(here.condition)
        sigma, sigma_moved = (np.linalg.svd(x, compute_uv=False) for x in (J, moved))
        assert np.abs(sigma_moved - sigma).max() > 0.1


def test_units_of_length_scale_them_and_leave_the_condition():
    J = np.random.default_rng(2).normal(size=(6, 5))
    scale = np.array([[1.0], [1.0], [1.0], [1e3], [1e3], [1e3]])
    metres, millimetres = (
        iq.systems.hyperbolic_singular_values(J, 0.8),
        iq.systems.hyperbolic_singular_values(J * scale, 800.0),
    )
    np.testing.assert_allclose(millimetres.values, 1e3 * metres.values)
    assert millimetres.condition == pytest.approx(metres.condition)


@pytest.mark.parametrize("m", [6, 7, 8])
def test_their_product_at_rank_six_is_yoshikawas_manipulability_for_every_h(m):
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
    assert conditions[3] > 1e7


def test_degenerate_arms():
    still = iq.systems.hyperbolic_singular_values(np.zeros((6, 2)), 0.5)
    assert (still.rank, still.condition) == (0, 1.0)
    blind = iq.systems.hyperbolic_singular_values(iq.se3.prismatic((0, 0, 1)), 0.5)
    assert blind.condition == float("inf")
    assert blind.values == 0.0


SEEDS = st.integers(0, 2**31)


def spread(J, h):
    """Largest over smallest |mu| that counts: what rounding is magnified by."""
    mu = np.abs(np.linalg.eigvalsh(iq.systems.gram_matrix(J, h)))
    mu = np.sort(mu)[::-1][: np.linalg.matrix_rank(J)]
    return mu[0] / mu[-1]


@settings(max_examples=80, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 8), rank=st.integers(1, 6), h=st.floats(-2.0, 2.0))
def test_the_factors_are_what_they_say(seed, m, rank, h):
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
def test_against_fifty_digits(m):
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
                assert error <= 1e-14 * spread(J, h)
            assert found.signs.sum() == sum(mpmath.sign(x) for x in mu)


def test_frames_move_the_movement_alone():
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


def test_gains_make_the_manipulability():
    J = np.random.default_rng(4).normal(size=(6, 6))
    assert hyperbolic_polar(J, 0.7).gains.prod() == pytest.approx(abs(np.linalg.det(J)))


@pytest.mark.parametrize("key", CLASSES, ids=lambda c: f"{c[0]}-{c[1]}")
def test_it_exists_where_the_pseudoinverse_does(key):
    rng = np.random.default_rng(5)
    J, _ = sample(rng, key, extra=1)
    for h in (-2.5, 1.7):
        if admits(key[1]):
            found = hyperbolic_polar(J, h)
            np.testing.assert_allclose(found.movement @ found.stretch, J, atol=1e-8)
        else:
            with pytest.raises(NoPolarDecomposition, match=r"whose gain is zero\. No h works for this system"):
                hyperbolic_polar(J, h)


def test_where_there_is_none_the_reason_is_told():
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


def test_nothing_moves_nothing():
    found = hyperbolic_polar(np.zeros((6, 2)), 0.3)
    assert found.gains.shape == (0,)
    np.testing.assert_array_equal(found.movement, np.zeros((6, 2)))


def test_what_has_no_polar_decomposition_for_its_arguments():
    for options in ({"h": np.inf}, {"h": 0.3, "joint_metric": -np.ones(6)}):
        with pytest.raises(iq.BadInput, match=next(reversed(options))):
            hyperbolic_polar(np.eye(6), **options)


def legs(rng, n):
    return rng.normal(size=(n, 3)), rng.normal(size=(n, 3)) + np.array([0.0, 0.0, 3.0])


def test_a_leg_wrench_is_the_leg_speed_of_a_moving_platform():
    rng = np.random.default_rng(1)
    base, top = legs(rng, 6)
    W = iq.systems.leg_wrenches(base, top)
    twist, dt = rng.normal(size=6), 1e-6
    T = iq.exp(twist * dt)
    moved = top @ T[:3, :3].T + T[:3, 3]
    speeds = (np.linalg.norm(moved - base, axis=1) - np.linalg.norm(top - base, axis=1)) / dt
    np.testing.assert_allclose(W.T @ twist, speeds, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(W[3:], axis=0), 1.0)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6, 8])
def test_wrench_pseudoinverse_is_what_defines_it(n):
    rng = np.random.default_rng(n)
    W, h = iq.systems.leg_wrenches(*legs(rng, n)), 0.4
    inverse = iq.systems.wrench_pseudoinverse(W, h)
    form = iq.pitch_form_inverse(h)
    P = W @ inverse
    np.testing.assert_allclose(P @ W, W, atol=1e-10)
    np.testing.assert_allclose(inverse @ W @ inverse, inverse, atol=1e-9)
    np.testing.assert_allclose(form @ P, (form @ P).T, atol=1e-9 * np.abs(P).max())
    np.testing.assert_allclose(inverse @ W, (inverse @ W).T, atol=1e-10)
    if n < 6:
        np.testing.assert_allclose(inverse, np.linalg.solve(W.T @ form @ W, W.T @ form), rtol=1e-7, atol=1e-9)
    else:
        np.testing.assert_allclose(inverse, np.linalg.pinv(W), atol=1e-9)


def test_wrench_and_twist_projectors_are_dual():
    # [DS] Sect. 6.3: P* = W W^{+h} on the annihilator of S is (I - P_h)'.
    S = np.random.default_rng(3).normal(size=(6, 3))
    W, h = iq.systems.annihilator(S), 0.7
    P = S @ iq.pseudoinverse(S, h)
    np.testing.assert_allclose(W @ iq.systems.wrench_pseudoinverse(W, h), (np.eye(6) - P).T, atol=1e-10)


def test_accuracy_survives_nearly_dependent_legs():
    rng = np.random.default_rng(4)
    base, top = legs(rng, 3)
    base[1], top[1] = base[0] + 1e-6 * rng.normal(size=3), top[0] + 1e-6 * rng.normal(size=3)
    W = iq.systems.leg_wrenches(base, top)
    f = rng.normal(size=3)
    # cond(W) = 1e6: the factored form keeps eps * cond, the normal equations only eps * cond^2.
    assert np.abs(iq.systems.wrench_pseudoinverse(W, 0.4) @ (W @ f) - f).max() < 1e-8


def test_where_it_fails_it_says_so_in_pitches_of_wrenches():
    W = np.array([[0.0, 0.0, 0.5, 0.0, 0.0, 1.0]]).T  # W'Q_h^-1 W = 2 (m.f + h f.f) = 0 at h = -0.5
    assert W[:, 0] @ iq.pitch_form_inverse(-0.5) @ W[:, 0] == 0.0
    with pytest.raises(iq.NoPseudoinverse) as caught:
        iq.systems.wrench_pseudoinverse(W, -0.5)
    assert caught.value.h == -0.5
    np.testing.assert_allclose(caught.value.principal_pitches, [-0.5])
    assert iq.systems.wrench_pseudoinverse(W, 0.5).shape == (1, 6)


def test_stiffness_is_the_force_of_small_displacements_and_moves_as_a_tensor():
    rng = np.random.default_rng(5)
    W, k = iq.systems.leg_wrenches(*legs(rng, 6)), rng.uniform(1e3, 1e4, 6)
    K = iq.systems.platform_stiffness(W, k)
    s = rng.normal(size=6)
    np.testing.assert_allclose(K @ s, sum(ki * (w @ s) * w for ki, w in zip(k, W.T, strict=True)))
    assert np.linalg.eigvalsh(K)[0] > 0.0
    Ad = iq.coadjoint(motion(rng))
    np.testing.assert_allclose(iq.systems.platform_stiffness(Ad @ W, k), Ad @ K @ Ad.T, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("n", [3, 6, 8])
def test_conditioning_is_frame_free_where_singular_values_are_not(n):
    rng = np.random.default_rng(6)
    W, k, h = iq.systems.leg_wrenches(*legs(rng, n)), rng.uniform(1.0, 4.0, n), 0.9
    moved = iq.coadjoint(motion(rng)) @ W
    here, there = iq.systems.leg_spectrum(W, h, k), iq.systems.leg_spectrum(moved, h, k)
    np.testing.assert_allclose(there.values, here.values, atol=1e-9 * np.abs(here.values).max())
    assert abs(np.linalg.cond(moved) - np.linalg.cond(W)) > 0.1
    eigenvalues = np.linalg.eigvals(iq.systems.platform_stiffness(W, k) @ iq.pitch_form_inverse(h)).real
    found = here.values[: here.rank]
    kept = eigenvalues[np.argsort(-np.abs(eigenvalues))][: here.rank]
    np.testing.assert_allclose(np.sort(found), np.sort(kept), rtol=1e-6)
    assert iq.systems.leg_spectrum(W, h).condition == pytest.approx(iq.systems.leg_spectrum(W, h, np.ones(n)).condition)


def test_a_singular_platform_has_no_condition():
    # Every leg meets one line: it can be turned about freely.
    rng = np.random.default_rng(7)
    base = rng.normal(size=(6, 3))
    top = np.column_stack((np.zeros((6, 2)), rng.normal(size=6) + 5.0))
    W = iq.systems.leg_wrenches(base, top)
    spectrum = iq.systems.leg_spectrum(W, 0.5)
    assert spectrum.rank == 5
    assert iq.systems.annihilator(W).shape == (6, 1)


def test_bad_input_is_told():
    with pytest.raises(iq.BadInput, match="leg 1 of length zero"):
        iq.systems.leg_wrenches([[0, 0, 0], [1, 1, 1]], [[0, 0, 1], [1, 1, 1]])
    with pytest.raises(iq.BadInput, match="no legs"):
        iq.systems.leg_wrenches(np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(iq.BadInput, match="above zero"):
        iq.systems.platform_stiffness(np.eye(6), [1, 1, 1, 1, 1, 0])


def test_what_is_said_of_wrenches_is_true_of_wrenches():
    # A force at the origin, along z: W'Q_0^-1 W = 0, and the screw of the wrench is z = Q_0 w.
    w = iq.systems.leg_wrenches([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    with pytest.raises(iq.NoPseudoinverse, match=r"Gram matrix has rank 0, the system rank 1") as caught:
        iq.systems.wrench_pseudoinverse(w, 0.0)
    np.testing.assert_allclose(caught.value.self_reciprocal, iq.pitch_form(0.0) @ w[:, 0])
    assert "twist" not in str(caught.value)
    assert "J" not in str(caught.value)


def test_noise_is_not_written():
    planar = np.array([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.5, 0.1, 0), (0.8, 0.3, 0))]).T
    turned = iq.adjoint(iq.exp([0.0, 0.0, 0.7, 0.0, 0.0, 0.0])) @ planar
    with pytest.raises(iq.NoPseudoinverse) as caught:
        iq.pseudoinverse(turned, 1.0)
    assert "e-" not in str(caught.value)
    with pytest.raises(iq.BlindSystem) as blind:
        iq.principal_pitches(turned)
    assert "e-" not in str(blind.value)
