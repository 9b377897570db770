import numpy as np
import pytest
from support.random_systems import CLASSES, admits, motion, sample

import invariantqp as iq

IDS = [f"{k}-{n}" for k, n in CLASSES]


@pytest.mark.parametrize("key", CLASSES, ids=IDS)
def test_the_three_conditions_agree_and_so_does_the_reciprocal(key):
    rng = np.random.default_rng(31)
    for upper in [False, True] if key[0] < 3 else [False]:
        J, _ = sample(rng, key, upper=upper, extra=1)
        for h in (-2.5, 0.0, 1.7):
            said = iq.systems.existence(J, h)
            assert len(set(said.degenerate)) == 1
            assert said.exists == admits(key[1]) == iq.has_pseudoinverse(J, h)
            assert iq.systems.reciprocal_has_pseudoinverse(J, h) == said.exists


def test_they_agree_at_principal_pitches_that_are_exact():
    # Exact numbers: h is a principal pitch to the last bit.
    S = np.array([(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, -0.25, 0), (0, 0, 1, 0, 0, 2)]).T
    for h in (0.5, -0.25, 2.0):
        said = iq.systems.existence(S, h)
        assert said.degenerate == (True, True, True)
        assert (said.rank, said.gram_rank) == (3, 2)
        z = said.certificate
        np.testing.assert_allclose(S.T @ iq.pitch_form(h) @ z, 0.0, atol=1e-14)
        assert iq.se3.pitch(z) == pytest.approx(h)
        assert not iq.systems.reciprocal_has_pseudoinverse(S, h)


def test_near_a_principal_pitch_the_numbers_are_small_together():
    rng = np.random.default_rng(5)
    J = rng.normal(size=(6, 4))
    for h in iq.principal_pitches(J):
        for off in (1e-3, 1e-6, 1e-9):
            said = iq.systems.existence(J, h + off)
            assert said.exists
            assert len(set(said.degenerate)) == 1
            assert said.certificate is None
            for number in (said.gram_eigenvalue, said.angle, said.pitch_distance):
                assert off * 1e-3 < number < off * 1e3


def test_the_answer_moves_with_the_frame_and_its_numbers_do_not_matter_there():
    rng = np.random.default_rng(6)
    J = rng.normal(size=(6, 3))
    Ad = iq.adjoint(motion(rng))
    for h in (0.3, float(iq.principal_pitches(J)[0]) + 1e-5):
        assert iq.systems.existence(J, h).exists == iq.systems.existence(Ad @ J, h).exists


def test_rank_six_and_zero_always_exist():
    for J in (np.random.default_rng(1).normal(size=(6, 7)), np.zeros((6, 2))):
        said = iq.systems.existence(J, 0.0)
        assert said.exists
        assert len(set(said.degenerate)) == 1
        assert said.certificate is None


def test_tangency_at_a_point_outside_the_system_proves_nothing():
    """[DS] Theorem 3.1 (iii) prints "at some non-zero point"; its proof, and its truth, need a point of S."""
    S = np.array([[1.0, 0, 0, 0, 0, 0]]).T  # a revolute axis, h = 1
    z = np.array([0.0, 1.0, 0.0, 0.0, 1.0, 0.0])  # pitch 1, so a point of q_1, outside S
    assert z @ iq.pitch_form(1.0) @ z == 0.0
    assert S.T @ iq.pitch_form(1.0) @ z == 0.0  # S lies in the tangent space there
    assert iq.systems.existence(S, 1.0).exists
