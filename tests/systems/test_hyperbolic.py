import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion

import invariantqp as iq


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
        assert there.manipulability == pytest.approx(here.manipulability)
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
def test_manipulability_at_rank_six_is_yoshikawas_for_every_h(m):
    J = np.random.default_rng(m).normal(size=(6, m))
    yoshikawa = np.sqrt(np.linalg.det(J @ J.T))
    for h in (-1.0, 0.0, 0.4, 5.0):
        found = iq.systems.hyperbolic_singular_values(J, h)
        assert found.manipulability == pytest.approx(yoshikawa)
        assert found.signature == (3, 3, m - 6)


def test_condition_grows_as_the_distance_to_a_principal_pitch_shrinks():
    J = np.random.default_rng(3).normal(size=(6, 3))
    h = iq.principal_pitches(J)[1]
    conditions = [iq.systems.hyperbolic_singular_values(J, h + d).condition for d in (1e-1, 1e-3, 1e-5, 0.0)]
    assert conditions == sorted(conditions)
    assert conditions[2] > 30.0 * conditions[1] / 10.0
    assert conditions[3] > 1e7


def test_degenerate_arms():
    still = iq.systems.hyperbolic_singular_values(np.zeros((6, 2)), 0.5)
    assert (still.rank, still.condition, still.manipulability) == (0, 1.0, 1.0)
    blind = iq.systems.hyperbolic_singular_values(iq.se3.prismatic((0, 0, 1)), 0.5)
    assert blind.condition == float("inf")
    assert blind.manipulability == 0.0
    assert blind.signature == (0, 0, 1)


def test_bad_metric_is_told():
    with pytest.raises(iq.BadInput, match="joint_metric"):
        iq.systems.hyperbolic_singular_values(np.eye(6), 0.5, joint_metric=[1, 1, 1, 1, 1, -1])
