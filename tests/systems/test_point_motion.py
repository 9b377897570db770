import numpy as np
import pytest
from support.random_systems import distance, motion

import invariantqp as iq
from invariantqp.geometry.se3 import velocity_at


def by_the_defining_equation(J, p, q):
    """{x : velocity of p is parallel to q}: the null space of the part across q, by numpy alone."""
    u = q / np.linalg.norm(q)
    V = J[3:] + np.cross(J[:3].T, p).T
    across = (np.eye(3) - np.outer(u, u)) @ V
    _, s, Vt = np.linalg.svd(across)
    rank = int(np.count_nonzero(s > 1e-10 * max(1.0, s[0])))
    return Vt[rank:].T


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("rank", [6, 3])
def test_all_joint_velocities_and_no_others(m, rank):
    rng = np.random.default_rng(m)
    for _ in range(5):
        J = rng.normal(size=(6, m)) if m <= rank else rng.normal(size=(6, rank)) @ rng.normal(size=(rank, m))
        p, q = rng.normal(size=(2, 3))
        found = iq.systems.point_motion(J, p, q)
        expected = by_the_defining_equation(J, p, q)
        assert found.velocities.shape == expected.shape
        if expected.shape[1]:
            assert distance(found.velocities, expected) < 1e-8
        np.testing.assert_allclose(J @ found.self_motions, 0.0, atol=1e-12)
        assert found.self_motions.shape[1] == max(0, m - min(m, rank))
        assert found.moves == (min(m, rank) >= 3)


def test_example_3_corrected_for_three_joints():
    """[DS] Example 3 prints J^{+h}(S), which is every joint velocity here; J^{+h}(S meet im J) is a line."""
    rng = np.random.default_rng(33)
    J = rng.normal(size=(6, 3))
    p, q = rng.normal(size=(2, 3))
    S = iq.systems.motions_along(p, q)
    inverse = iq.pseudoinverse(J, 0.7)
    assert np.linalg.matrix_rank(inverse @ S) == 3
    found = iq.systems.point_motion(J, p, q)
    assert found.velocities.shape == (3, 1)
    assert distance(inverse @ found.twists, found.velocities) < 1e-12
    velocity = velocity_at(J @ found.velocities, p)[:, 0]
    np.testing.assert_allclose(np.cross(velocity, q), 0.0, atol=1e-12)
    assert np.linalg.norm(velocity) > 1e-3


def test_the_four_system_is_reciprocal_to_a_plane_pencil():
    S = iq.systems.motions_along((0.3, -0.2, 0.5), (1.0, 2.0, -1.0))
    kind = iq.gibson_hunt(S)
    assert (str(kind), kind.dimension, kind.reciprocal) == ("IIA", 4, True)
    assert kind.moduli[0] == pytest.approx(0.0, abs=1e-12)
    speed = velocity_at(S, np.array((0.3, -0.2, 0.5)))
    np.testing.assert_allclose(np.cross(speed.T, (1.0, 2.0, -1.0)), 0.0, atol=1e-12)


def test_no_frame_matters():
    rng = np.random.default_rng(12)
    J = rng.normal(size=(6, 4))
    p, q = rng.normal(size=(2, 3))
    T = motion(rng)
    here = iq.systems.point_motion(J, p, q)
    there = iq.systems.point_motion(iq.adjoint(T) @ J, T[:3, :3] @ p + T[:3, 3], T[:3, :3] @ q)
    assert distance(here.velocities, there.velocities) < 1e-10


def test_a_wrist_cannot_move_its_centre():
    J = np.array([iq.revolute(a) for a in np.eye(3)]).T
    found = iq.systems.point_motion(J, (0, 0, 0), (0, 0, 1))
    assert not found.moves
    assert found.velocities.shape == (3, 3)
    still = iq.systems.point_motion(np.zeros((6, 2)), (0, 0, 0), (0, 0, 1))
    assert not still.moves
    assert still.velocities.shape == (2, 2)


def test_zero_direction_is_refused():
    with pytest.raises(iq.BadInput, match="zero vector"):
        iq.systems.point_motion(np.eye(6), (0, 0, 0), (0, 0, 0))
