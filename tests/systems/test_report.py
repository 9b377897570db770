import numpy as np
import pytest
from support.random_systems import admits, every_class, motion, sample

import invariantqp as iq


def words(J):
    return " ".join(iq.systems.describe(J).sentences())


def planar(n):
    return np.array([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.5, 0, 0), (0.8, 0.3, 0))[:n]]).T


def test_the_report_of_a_scara_names_blind_directions_and_alternatives():
    J = np.column_stack((planar(3), iq.se3.prismatic((0, 0, 1))))
    report = iq.systems.describe(J)
    assert str(report).split("\n") == list(report.sentences())
    assert (report.rank, str(report.type), report.type.reciprocal) == (4, "IIC", True)
    np.testing.assert_allclose(report.blind_directions[[0, 1, 2, 5]], 0.0, atol=1e-12)
    assert report.blind_directions.shape == (6, 2)
    plane = report.blind_directions[3:5]  # which two directions of the plane is LAPACK's choice
    np.testing.assert_allclose(plane @ plane.T, np.eye(2), atol=1e-12)
    assert "along (1, 0, 0); (0, 1, 0)" in words(J) or "along (0, 1, 0); (1, 0, 0)" in words(J)
    assert "No pitch h works" in words(J)
    assert "CarriedMetric" in words(J)
    assert "No pitch h works" in words(planar(3))


def test_the_report_of_a_regular_arm_names_its_principal_pitches():
    J = np.random.default_rng(1).normal(size=(6, 5))
    report = iq.systems.describe(J)
    np.testing.assert_allclose(report.principal_pitches, iq.principal_pitches(J))
    assert f"h = {report.principal_pitches[0]:.6g}" in words(J)
    assert "5-system, the reciprocal of a 1-system of type h" in words(J)


def test_rank_singularity_and_their_words():
    J = np.random.default_rng(2).normal(size=(6, 6))
    assert "every direction" in words(J)
    assert "Every pitch h works" in words(J)
    J[:, 5] = J[:, 4]
    report = iq.systems.describe(J)
    assert (report.singular, report.singularity_distance, report.rank) == (True, 0.0, 5)
    assert "singular, 1 direction(s)" in words(J)


def test_singularity_distance_is_the_same_in_every_frame_and_unit():
    rng = np.random.default_rng(3)
    J = rng.normal(size=(6, 4))
    moved = iq.adjoint(motion(rng, reach=30.0)) @ J
    scaled = moved * np.array([[1.0], [1.0], [1.0], [1e3], [1e3], [1e3]])
    expected = iq.systems.describe(J).singularity_distance
    assert 0.0 < expected < 1.0
    assert iq.systems.describe(moved).singularity_distance == pytest.approx(expected)
    assert iq.systems.describe(scaled).singularity_distance == pytest.approx(expected)


def test_singularity_distance_falls_to_zero_towards_a_singularity():
    rng = np.random.default_rng(4)
    J = rng.normal(size=(6, 6))
    distances = []
    for d in (1e-1, 1e-3, 1e-5):
        J[:, 5] = J[:, 4] + d * np.array([1.0, -1.0, 0.5, 0.2, -0.3, 0.7])
        distances.append(iq.systems.describe(J).singularity_distance)
    assert distances[0] > 50.0 * distances[1] > 2500.0 * distances[2] > 0.0


def test_the_report_names_a_near_type():
    S = np.array([(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, 0.5 + 4e-7, 0)]).T
    assert "Close to type IIA: the pitch difference" in words(S)
    assert "Close to" not in words(np.random.default_rng(5).normal(size=(6, 2)))


@every_class
def test_every_type_with_noise_is_described_without_contradiction(key):
    rng = np.random.default_rng(6)
    for upper in [False, True] if key[0] < 3 else [False]:
        J, _ = sample(rng, key, upper=upper, noise=1e-10, extra=1)
        report = iq.systems.describe(J)
        assert report.rank == (6 - key[0] if upper else key[0])
        assert (report.blind_directions.shape[1] == 0) == admits(key[1])
        blind = report.blind_directions
        assert np.abs(J.T @ iq.pitch_form(0.3) @ blind).max(initial=0.0) < 1e-6
        assert all(s.endswith(".") and "nan" not in s for s in report.sentences())
