import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion

import invariantqp as iq
from invariantqp.systems.pseudoinverses import form_adjoint, penrose_conditions

SEEDS = st.integers(0, 2**31)


def regular(rng, m, rank):
    """(6, m) twists of a rank, and a pitch that is no principal one."""
    J = rng.normal(size=(6, rank)) @ rng.normal(size=(rank, m))
    pitches = iq.principal_pitches(J)
    h = rng.uniform(-2.0, 2.0)
    while len(pitches) and np.abs(pitches - h).min() < 0.05:
        h = rng.uniform(-2.0, 2.0)
    return J, h


@settings(max_examples=80, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 8), rank=st.integers(1, 6), unit=st.sampled_from([1e-3, 1.0, 1e3]))
def test_the_pseudoinverse_meets_all_four(seed, m, rank, unit):
    rng = np.random.default_rng(seed)
    J, h = regular(rng, m, min(m, rank))
    J, h = np.repeat([1.0, unit], 3)[:, None] * (iq.adjoint(motion(rng)) @ J), unit * h
    A = rng.normal(size=(m, m))
    for M in (None, A @ A.T + np.eye(m)):
        found = penrose_conditions(J, iq.pseudoinverse(J, h, joint_metric=M), h, joint_metric=M)
        assert all(found.met)
        assert found.residuals.max() <= 1e-13 * max(1.0, found.magnification)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_each_condition_is_missed_by_itself(seed):
    """What is almost a pseudoinverse: the other inverses there are, each with what it lacks."""
    rng = np.random.default_rng(seed)
    J, h = regular(rng, 4, 3)
    X = iq.pseudoinverse(J, h)
    assert penrose_conditions(J, np.zeros((4, 6)), h).met == (False, True, True, True)
    # (I - X J) N (I - J X) changes neither J X nor X J, but J cannot undo it.
    N = rng.normal(size=(4, 6))
    assert penrose_conditions(J, X + (np.eye(4) - X @ J) @ N @ (np.eye(6) - J @ X), h).met == (True, False, True, True)
    along_metric = iq.dual_projectors(J, metric=np.diag(rng.uniform(0.5, 2.0, size=6))).motion
    assert penrose_conditions(J, X @ along_metric, h).met == (True, True, False, True)
    other = iq.pseudoinverse(J, h, joint_metric=rng.uniform(0.5, 5.0, size=4))
    assert penrose_conditions(J, other, h).met == (True, True, True, False)


def test_moore_penrose_is_one_at_rank_six_only():
    rng = np.random.default_rng(2)
    J = rng.normal(size=(6, 7))
    assert all(penrose_conditions(J, np.linalg.pinv(J), 0.4).met)
    J = rng.normal(size=(6, 5))
    assert penrose_conditions(J, np.linalg.pinv(J), 0.4).met == (True, True, False, True)


def test_condition_three_is_the_h_adjoint():
    rng = np.random.default_rng(3)
    J, h = regular(rng, 3, 3)
    P = J @ iq.pseudoinverse(J, h)
    Q = iq.pitch_form(h)
    np.testing.assert_allclose(form_adjoint(P, Q, Q), P, atol=1e-11)


def test_an_error_shows_in_the_residuals():
    rng = np.random.default_rng(4)
    J, h = regular(rng, 3, 3)
    X = iq.pseudoinverse(J, h) * (1.0 + 1e-6)
    found = penrose_conditions(J, X, h)
    assert not all(found.met)
    np.testing.assert_allclose(found.residuals[:2], 1e-6, rtol=1e-3)
    assert all(penrose_conditions(J, X, h, tolerance=1e-5).met)


def test_they_are_values():
    found = penrose_conditions(np.eye(6), np.eye(6), 0.3)
    assert found == penrose_conditions(np.eye(6), np.eye(6), 0.3)
    assert pickle.loads(pickle.dumps(found)) == found
    assert "residuals=[0., 0., 0., 0.]" in repr(found)
    with pytest.raises(ValueError, match="read-only"):
        found.residuals[0] = 1.0


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (lambda: penrose_conditions(np.eye(5), np.eye(6), 0.3), "J"),
        (lambda: penrose_conditions(np.eye(6)[:, :3], np.eye(6), 0.3), "X"),
        (lambda: penrose_conditions(np.eye(6), np.eye(6), np.inf), "h"),
        (lambda: penrose_conditions(np.eye(6), np.eye(6), 0.3, joint_metric=-np.ones(6)), "joint_metric"),
        (lambda: penrose_conditions(np.eye(6), np.eye(6), 0.3, tolerance=0.0), "tolerance"),
    ],
)
def test_bad_input(call, argument):
    with pytest.raises(iq.BadInput) as caught:
        call()
    assert caught.value.argument == argument
