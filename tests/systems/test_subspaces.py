import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import distance, motion

import invariantqp as iq
from invariantqp.systems.subspaces import Subspace


def test_rounding_does_not_set_the_own_length():
    """Translations with 1e-17 of rotation, and axes through the origin with 1e-17 of moment, keep their rank."""
    rng = np.random.default_rng(1)
    gantry = np.vstack((1e-17 * rng.normal(size=(3, 3)), np.eye(3)))
    assert Subspace(gantry).dimension == 3
    assert not iq.has_pseudoinverse(gantry, 0.5)
    with pytest.raises(iq.BlindSystem):
        iq.principal_pitches(gantry)
    wrist = np.vstack((rng.normal(size=(3, 5)), 1e-17 * rng.normal(size=(3, 5))))
    assert Subspace(wrist).dimension == 3


def same(A, B):
    return A.shape[1] == B.shape[1] and distance(A, B) < 1e-9


SEEDS = st.integers(0, 2**31)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, k=st.integers(1, 6), h=st.floats(-5.0, 5.0))
def test_reciprocal_is_reciprocal_of_right_size_and_its_own_inverse(seed, k, h):
    rng = np.random.default_rng(seed)
    S = rng.normal(size=(6, k)) @ rng.normal(size=(k, k + 1))
    R = iq.reciprocal(S, h)
    assert R.shape == (6, 6 - k)
    np.testing.assert_allclose(S.T @ iq.pitch_form(h) @ R, 0.0, atol=1e-10 * (1 + np.abs(S).max()) * (1 + abs(h)))
    if k < 6:
        assert same(iq.reciprocal(R, h), iq.systems.screw_system(S))
        W = iq.systems.annihilator(S)
        np.testing.assert_allclose(W.T @ S, 0.0, atol=1e-10)
        assert same(W, iq.pitch_form(h) @ R)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, shared=st.integers(0, 2), a=st.integers(1, 2), b=st.integers(1, 2))
def test_sum_and_meet_are_a_lattice(seed, shared, a, b):
    rng = np.random.default_rng(seed)
    common = rng.normal(size=(6, shared))
    S1 = np.hstack((common, rng.normal(size=(6, a)))) @ rng.normal(size=(shared + a, shared + a))
    S2 = np.hstack((common, rng.normal(size=(6, b)))) @ rng.normal(size=(shared + b, shared + b))
    meet, total = iq.systems.system_meet(S1, S2, 1e-10), iq.systems.system_sum(S1, S2, 1e-10)
    assert (meet.shape[1], total.shape[1]) == (shared, shared + a + b)
    assert distance(total, np.hstack((S1, S2))) < 1e-9
    if shared:
        assert distance(meet, common) < 1e-6
    # De Morgan: the reciprocal of a sum is the meet of the reciprocals.
    assert same(iq.reciprocal(total), iq.systems.system_meet(iq.reciprocal(S1), iq.reciprocal(S2), 1e-10))


def test_reciprocals_move_with_the_system_and_scale_with_the_unit_of_length():
    rng = np.random.default_rng(1)
    S = rng.normal(size=(6, 3))
    h = iq.principal_pitches(S)[1]
    z = iq.systems.self_reciprocal(S, h, 1e-10)
    for A, unit in ((iq.adjoint(motion(rng)), 1.0), (np.diag(np.repeat([1.0, 1e3], 3)), 1e3)):
        assert same(A @ iq.reciprocal(S, 0.4), iq.reciprocal(A @ S, unit * 0.4))
        assert same(A @ z, iq.systems.self_reciprocal(A @ S, unit * h, 1e-10))


def test_self_reciprocal_at_a_principal_pitch_is_its_screw():
    S = np.random.default_rng(3).normal(size=(6, 3))
    pitches, screws = iq.systems.principal_screws(S)
    for h, z in zip(pitches, screws.T, strict=True):
        assert same(iq.systems.self_reciprocal(S, h, 1e-10), z[:, None])
        assert iq.systems.self_reciprocal(S, h + 0.1).shape == (6, 0)
    assert iq.systems.self_reciprocal(np.eye(6), 0.3).shape == (6, 0)


def test_an_infinite_pitch_has_no_reciprocal():
    with pytest.raises(iq.BadInput, match="Killing"):
        iq.reciprocal(np.eye(6)[:, :2], float("inf"))


def test_systems_with_no_common_twist_and_the_zero_system():
    """The zero system is accepted by all functions."""
    E = np.eye(6)
    assert iq.systems.system_meet(E[:, :2], E[:, 3:5]).shape == (6, 0)
    assert same(iq.systems.system_meet(E[:, :2], E[:, 1:3]), E[:, 1:2])
    zero, S = iq.systems.screw_system(np.zeros((6, 2))), np.random.default_rng(4).normal(size=(6, 2))
    assert zero.shape == (6, 0)
    for other in (iq.reciprocal(zero, 0.3), iq.systems.annihilator(zero)):
        assert np.linalg.matrix_rank(other) == 6
    assert iq.systems.system_meet(S, zero).shape == (6, 0)
    assert iq.systems.self_reciprocal(zero, 0.3).shape == (6, 0)
    assert distance(iq.systems.system_sum(zero, S), S) < 1e-12
    assert iq.principal_pitches(zero).shape == (0,)
    assert iq.systems.blind_directions(zero).shape == (6, 0)
    assert iq.systems.gram_polynomial(zero) == 1.0
    assert iq.systems.ScrewSystem(np.eye(6)).reciprocal(0.3).has_pseudoinverse(0.3)
