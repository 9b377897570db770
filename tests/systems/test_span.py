import numpy as np
import pytest

import invariantqp as iq
from invariantqp.systems.subspaces import span


def test_rounding_is_not_a_length():
    """Translations with 1e-17 of rotation, and axes through the origin with 1e-17 of moment, keep their rank."""
    rng = np.random.default_rng(1)
    gantry = np.vstack((1e-17 * rng.normal(size=(3, 3)), np.eye(3)))
    assert span(gantry).rank == 3
    assert not iq.has_pseudoinverse(gantry, 0.5)
    with pytest.raises(iq.BlindSystem):
        iq.principal_pitches(gantry)
    wrist = np.vstack((rng.normal(size=(3, 5)), 1e-17 * rng.normal(size=(3, 5))))
    assert span(wrist).rank == 3


def test_two_systems_can_share_a_unit():
    J = np.random.default_rng(2).normal(size=(6, 2)) * np.array([[1.0], [1.0], [1.0], [50.0], [50.0], [50.0]])
    own, shared = span(J), span(J, unit=4.0)
    assert own.unit == 2.0 ** round(np.log2(np.linalg.norm(J[3:]) / np.linalg.norm(J[:3])))
    assert shared.unit == 4.0
    np.testing.assert_allclose(shared.twists(np.diag(shared.singular) @ shared.right.T), J)
