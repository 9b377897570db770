import runpy
from pathlib import Path

import numpy as np
import pytest
from support.random_systems import motion

import invariantqp as iq

EXAMPLE = Path(__file__).parents[2] / "examples" / "20_stewart_platform.py"


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
    with pytest.raises(iq.BadInput, match="platform"):
        iq.systems.leg_wrenches(np.zeros((3, 3)), np.ones((2, 3)))
    with pytest.raises(iq.BadInput, match="above zero"):
        iq.systems.platform_stiffness(np.eye(6), [1, 1, 1, 1, 1, 0])


def test_the_example_runs(capsys):
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    printed = capsys.readouterr().out
    assert "hyperbolic" in printed
    assert "2-system of type IA" in printed


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
