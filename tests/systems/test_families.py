"""The cylindroid of a 2-system and the pitch field of a 3-system, against Ball's formulas and plain algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import CLASSES, motion, sample

import invariantqp as iq
from invariantqp.systems import cylindroid, pitch_field

SEEDS = st.integers(0, 2**31)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, distance=st.floats(0.01, 2.0), angle=st.floats(0.1, 3.0))
def test_the_cylindroid_of_two_lines(seed, distance, angle):
    """Principal pitches -(d/2) tan(a/2) and (d/2) cot(a/2), length d / sin a; axes on the two lines' bisectors.

    By symmetry: s1 + s2 and s1 - s2 of lines at z = -d/2 and d/2 are screws along the bisectors (Ball 1900; Hunt 1978).
    """
    half = 0.5 * angle
    lines = [iq.revolute((np.cos(half), sign * np.sin(half), 0), (0, 0, sign * distance / 2)) for sign in (-1, 1)]
    T = motion(np.random.default_rng(seed))
    found = cylindroid(iq.adjoint(T) @ np.column_stack(lines))
    expected = sorted((-distance / 2 * np.tan(half), distance / 2 / np.tan(half)))
    assert str(found.type) == "IA"
    np.testing.assert_allclose(found.type.moduli, expected, atol=1e-9)
    assert found.length == pytest.approx(distance / np.sin(angle), abs=1e-9)
    np.testing.assert_allclose(found.pose[:3, 3], T[:3, 3], atol=1e-9)
    np.testing.assert_allclose(np.abs(found.pose[:3, 2] @ T[:3, 2]), 1.0)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, angles=st.lists(st.floats(-7.0, 7.0), min_size=1, max_size=5))
def test_every_screw_is_in_the_system_on_the_conoid_and_of_its_pitch(seed, angles):
    rng = np.random.default_rng(seed)
    J, (a, b) = sample(rng, (2, "IA"), extra=seed % 2)
    found = cylindroid(J)
    c = found.at(angles)
    s, (directions, points) = found.screws(c), found.axes(c)
    t = np.array(angles)
    np.testing.assert_allclose(found.pitches(c), a * np.cos(t) ** 2 + b * np.sin(t) ** 2, atol=1e-8)
    inside = np.linalg.svd(J)[0][:, :2]
    np.testing.assert_allclose(inside @ inside.T @ s, s, atol=1e-8 * np.abs(s).max())
    x, y, z = (iq.inverse(found.pose) @ np.vstack((points + 0.3 * directions, np.ones(len(angles)))))[:3]
    np.testing.assert_allclose(z * (x * x + y * y), (b - a) * x * y, atol=1e-8)  # Plucker's conoid


@pytest.mark.parametrize("key", [c for c in CLASSES if c[0] in (2, 3)], ids=lambda c: f"{c[0]}-{c[1]}")
def test_screws_of_every_type(key):
    rng = np.random.default_rng(3)
    J, _ = sample(rng, key)
    found = (cylindroid if key[0] == 2 else pitch_field)(J)
    c = rng.normal(size=(key[0], 40))
    s, h, (directions, points) = found.screws(c), found.pitches(c), found.axes(c)
    assert found.basis.shape == (6, key[0])
    for i in range(40):
        exact = iq.se3.screw_of(s[:, i])
        assert np.linalg.matrix_rank(np.column_stack((J, s[:, i])), tol=1e-7) == key[0]
        if np.isinf(h[i]):
            assert key[1] in {"IIC", "IID"}
            assert np.isnan(points[:, i]).all()
            assert np.linalg.norm(s[3:, i]) == pytest.approx(1.0)
        else:
            assert exact.pitch == pytest.approx(h[i], abs=1e-9)
            np.testing.assert_allclose(exact.direction, directions[:, i], atol=1e-12)
            np.testing.assert_allclose(np.cross(points[:, i] - exact.point, directions[:, i]), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["IA1", "IA2", "IIA"])
def test_axes_of_one_pitch_lie_on_its_quadric(name):
    rng = np.random.default_rng(5)
    J, _ = sample(rng, (3, name))
    field = pitch_field(J)
    c = rng.normal(size=(3, 30))
    directions, points = field.axes(c)
    for h, u, p in zip(field.pitches(c), directions.T, points.T, strict=True):
        r = np.append(p + rng.normal() * u, 1.0)
        assert r @ field.quadric(h) @ r == pytest.approx(0.0, abs=1e-9)
    # Independently: a point r is on an axis of pitch h iff some screw of the system has v - r x omega = h omega.
    for h in (-2.0, 0.3):
        r = rng.normal(size=3)
        basis = field.basis
        determinant = np.linalg.det(basis[3:] - np.cross(r, basis[:3], axis=0) - h * basis[:3])
        assert np.append(r, 1.0) @ field.quadric(h) @ np.append(r, 1.0) == pytest.approx(determinant, abs=1e-9)


def test_systems_without_a_family_or_quadric_are_refused():
    rng = np.random.default_rng(6)
    for make, J in ((cylindroid, rng.normal(size=(6, 3))), (pitch_field, rng.normal(size=(6, 2)))):
        with pytest.raises(iq.BadInput, match="-system"):
            make(J)
    with pytest.raises(iq.BadInput, match="type IIC"):
        pitch_field(sample(rng, (3, "IIC"))[0]).quadric(0.3)
    for wrong in (np.zeros((2, 1)), np.eye(3)):
        with pytest.raises(iq.BadInput, match="coefficients"):
            cylindroid(rng.normal(size=(6, 2))).screws(wrong)


def test_lengths_of_the_other_two_systems():
    assert cylindroid(np.array([(1, 0, 0, 0.3, 0, 0), (0, 1, 0, 0, 0.3, 0)]).T).length == 0.0
    assert cylindroid(np.array([(1, 0, 0, 0.3, 0, 0), (0, 0, 0, 0, 1, 0)]).T).length == np.inf
