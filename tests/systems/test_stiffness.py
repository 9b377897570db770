"""Legs of parallel mechanisms, and the eigenscrews, centre and axes of stiffness and compliance."""

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion

import invariantqp as iq
from invariantqp.systems import eigenscrews

Q0 = iq.pitch_form(0.0)
SEEDS = st.integers(0, 2**31)


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
def test_the_wrench_pseudoinverse_satisfies_its_definition(n):
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
    largest = eigenvalues[np.argsort(-np.abs(eigenvalues))][: here.rank]
    np.testing.assert_allclose(np.sort(found), np.sort(largest), rtol=1e-6)
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


def test_bad_input():
    with pytest.raises(iq.BadInput, match="leg 1 of length zero"):
        iq.systems.leg_wrenches([[0, 0, 0], [1, 1, 1]], [[0, 0, 1], [1, 1, 1]])
    with pytest.raises(iq.BadInput, match="no legs"):
        iq.systems.leg_wrenches(np.empty((0, 3)), np.empty((0, 3)))
    with pytest.raises(iq.BadInput, match="above zero"):
        iq.systems.platform_stiffness(np.eye(6), [1, 1, 1, 1, 1, 0])


def test_errors_of_wrenches_have_the_pitches_and_screws_of_wrenches():
    W = np.array([[0.0, 0.0, 0.5, 0.0, 0.0, 1.0]]).T  # W'Q_h^-1 W = 2 (m.f + h f.f) = 0 at h = -0.5
    with pytest.raises(iq.NoPseudoinverse) as caught:
        iq.systems.wrench_pseudoinverse(W, -0.5)
    assert caught.value.h == -0.5
    np.testing.assert_allclose(caught.value.principal_pitches, [-0.5])
    # A force at the origin, along z: W'Q_0^-1 W = 0, and the screw of the wrench is z = Q_0 w.
    w = iq.systems.leg_wrenches([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    with pytest.raises(iq.NoPseudoinverse, match=r"Gram matrix has rank 0, the system rank 1") as caught:
        iq.systems.wrench_pseudoinverse(w, 0.0)
    np.testing.assert_allclose(caught.value.self_reciprocal, iq.pitch_form(0.0) @ w[:, 0])
    assert "twist" not in str(caught.value)
    assert "J" not in str(caught.value)


def psd(rng, rank):
    B = rng.normal(size=(6, rank))
    return B @ B.T


def rebuilt(found, *, compliance):
    """K from its six springs, or C from its six compliances."""
    couples, forces = found.rotation_axes, found.force_axes
    if compliance:
        slides = np.vstack((np.zeros((3, forces.shape[1])), forces[3:]))
        return (couples * found.rotational) @ couples.T + (slides * found.translational) @ slides.T
    moments = np.vstack((couples[:3], np.zeros((3, couples.shape[1]))))
    return (forces * found.translational) @ forces.T + (moments * found.rotational) @ moments.T


@settings(max_examples=80, deadline=None)
@given(seed=SEEDS, rank=st.integers(1, 6), compliance=st.booleans())
def test_eigenscrews_and_axes_satisfy_their_definition(seed, rank, compliance):
    rng = np.random.default_rng(seed)
    K = psd(rng, rank)
    found = eigenscrews(K, compliance=compliance)
    size = np.abs(K).max()
    t = found.screws
    assert t.shape == (6, rank)
    scale = (1.0 + np.abs(t).max()) * size
    np.testing.assert_allclose(K @ t, Q0 @ t * found.values, atol=1e-8 * scale)
    reciprocal = t.T @ Q0 @ t
    np.testing.assert_allclose(reciprocal - np.diag(np.diag(reciprocal)), 0.0, atol=1e-5 * (1.0 + np.abs(t).max()) ** 2)
    heads = t[:3] if not compliance else t[3:]
    np.testing.assert_allclose(np.linalg.norm(heads, axis=0), 1.0, atol=1e-12)
    np.testing.assert_allclose((t[:3] * t[3:]).sum(axis=0), found.pitches, atol=1e-6 * (1.0 + np.abs(t).max()))
    assert found.translational.shape[0] == found.force_axes.shape[1]
    # Nearly dependent blocks of a random K of low rank cost digits of the split, not of its sum.
    np.testing.assert_allclose(rebuilt(found, compliance=compliance), K, atol=1e-6 * size)
    if rank == 6:
        np.testing.assert_array_equal(np.sign(found.values), [1, 1, 1, -1, -1, -1])


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, unit=st.sampled_from([1e-3, 1.0, 1e3]), compliance=st.booleans())
def test_eigenscrews_do_not_depend_on_frame_and_unit(seed, unit, compliance):
    rng = np.random.default_rng(seed)
    K, T = psd(rng, 6), motion(rng)
    A = iq.adjoint(T) if compliance else iq.coadjoint(T)
    D = np.diag(np.repeat([1.0, unit] if compliance else [unit, 1.0], 3))  # twists (rad; length), wrenches
    here, there = eigenscrews(K, compliance=compliance), eigenscrews(D @ A @ K @ A.T @ D, compliance=compliance)
    close = {"rtol": 1e-5, "atol": 1e-5}
    np.testing.assert_allclose(there.values, here.values * unit, **close)
    np.testing.assert_allclose(there.pitches, here.pitches * unit, rtol=1e-4, atol=1e-4 * unit)
    np.testing.assert_allclose(there.centre, unit * (T @ np.append(here.centre, 1.0))[:3], atol=1e-5 * unit)
    np.testing.assert_allclose(there.translational, here.translational * (unit**2 if compliance else 1.0), **close)
    np.testing.assert_allclose(there.rotational, here.rotational * (1.0 if compliance else unit**2), **close)


def test_a_cantilever_beam_has_its_centre_in_the_middle():
    """Tip compliance l^3/3EI, l^2/2EI, l/EI (Timoshenko); about the middle it is diagonal with l^3/12EI.

    J. M. Selig and X. Ding, A screw theory of static beams, IROS 2001.
    """
    E, G, area, moment, polar, length = 200e9, 80e9, 1e-4, 8e-10, 1.4e-9, 0.5
    C = np.diag(
        [length / (G * polar), *[length / (E * moment)] * 2, length / (E * area), *[length**3 / (3 * E * moment)] * 2]
    )
    C[2, 4] = C[4, 2] = length**2 / (2 * E * moment)
    C[1, 5] = C[5, 1] = -C[2, 4]
    for found in (eigenscrews(C, compliance=True), eigenscrews(np.linalg.inv(C))):
        np.testing.assert_allclose(found.centre, [-length / 2, 0, 0], atol=1e-12)
    bending = length**3 / (12 * E * moment)
    found = eigenscrews(C, compliance=True)
    np.testing.assert_allclose(found.translational, [bending, bending, length / (E * area)], rtol=1e-9)
    np.testing.assert_allclose(found.rotational, [length / (G * polar), *[length / (E * moment)] * 2], rtol=1e-9)
    stiff = eigenscrews(np.linalg.inv(C))
    np.testing.assert_allclose(stiff.translational[::-1], 1.0 / found.translational, rtol=1e-9)
    # A force along the beam's axis, or across it in the middle, moves the tip without turning it.
    middle = np.array([-length / 2, 0.0, 0.0])
    for w in found.force_axes.T:
        np.testing.assert_allclose((C @ w)[:3], 0.0, atol=1e-15)
        np.testing.assert_allclose(w[:3], np.cross(middle, w[3:]), atol=1e-12)


def test_eigenscrews_in_closed_form():
    """Blocks diag(a), diag(c), diag(d) about the centre: lambda = c +- sqrt(a d), pitches +- sqrt(a / d); by sympy."""
    a, c, d, x, value = sp.symbols("a c d x value", positive=True)
    solved = sp.solve([a + c * x - value * x, c + d * x - value], [x, value], dict=True)
    assert {sp.simplify(s[x] ** 2 - a / d) for s in solved} == {0}
    assert {sp.simplify((s[value] - c) ** 2 - a * d) for s in solved} == {0}
    blocks = np.array([[4.0, 1.0, 9.0], [0.5, -0.2, 0.3], [1.0, 16.0, 4.0]])
    K = np.block([[np.diag(blocks[0]), np.diag(blocks[1])], [np.diag(blocks[1]), np.diag(blocks[2])]])
    A = iq.coadjoint(iq.exp([0.3, -0.2, 0.5, 1.0, 2.0, 3.0]))
    found = eigenscrews(A @ K @ A.T)
    root = np.sqrt(blocks[0] * blocks[2])
    np.testing.assert_allclose(found.values, np.sort(np.concatenate((blocks[1] + root, blocks[1] - root)))[::-1])
    ratio = np.sqrt(blocks[0] / blocks[2])
    np.testing.assert_allclose(np.sort(found.pitches), np.sort(np.concatenate((ratio, -ratio))), atol=1e-12)


def test_springs_along_lines_have_no_trace():
    """A stiffness is one of simple springs only if the eigenvalues sum to zero (Loncaric 1987)."""
    rng = np.random.default_rng(3)
    W, k = iq.systems.leg_wrenches(*legs(rng, 9)), rng.uniform(1.0, 5.0, 9)
    assert eigenscrews(iq.systems.platform_stiffness(W, k)).values.sum() == pytest.approx(0.0, abs=1e-10)
    assert abs(eigenscrews(psd(rng, 6)).values.sum()) > 0.1


@pytest.mark.parametrize("far", [0.1, 10.0, 1e3])
def test_springs_far_from_the_origin_keep_their_rank(far):
    """Concurrent ones too, whose moments vanish about the centre: there they are rounding."""
    rng = np.random.default_rng(8)
    for i in range(150):
        n, place = int(rng.integers(1, 7)), far * rng.normal(size=3)
        base = place + (rng.normal(size=(n, 3)) if i % 2 else 0.0) * np.ones((n, 3))
        W, k = iq.systems.leg_wrenches(base, base + rng.normal(size=(n, 3))), rng.uniform(1.0, 1e3, n)
        here = iq.coadjoint(iq.transform(translation=-place)) @ W
        sigma = np.linalg.svd(here, compute_uv=False)
        rank = int(np.count_nonzero(sigma > 1e-9 * sigma[0]))
        if sigma[rank - 1] < 1e-2 * sigma[0]:
            continue
        found = eigenscrews(iq.systems.platform_stiffness(W, k))
        assert found.screws.shape == (6, rank)
        assert len(found.translational) + len(found.rotational) == rank


def test_a_centre_that_is_not_unique_is_none():
    one = np.zeros(6)
    one[5] = 1.0
    found = eigenscrews(np.outer(one, one))  # a spring along z
    assert found.centre is None
    np.testing.assert_allclose(found.translational, [1.0])
    assert found.rotational.shape == (0,)
    free = eigenscrews(np.diag([1.0, 2.0, 3.0, 0.0, 0.0, 0.0]))  # turns alone are held
    assert free.centre is None
    np.testing.assert_allclose(free.rotational, [3.0, 2.0, 1.0])


def test_matrices_that_are_no_stiffness_are_refused():
    skew = np.eye(6)
    skew[0, 1] = 0.1
    for K, said in (
        (np.zeros((6, 6)), "zeros"),
        (np.diag([1.0, 1, 1, 1, 1, -1]), "an eigenvalue -1 times"),
        (skew, "symmetric"),
    ):
        with pytest.raises(iq.BadInput, match=said):
            eigenscrews(K)
