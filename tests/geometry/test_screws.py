import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import motion

import invariantqp as iq

POINT = st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3).map(np.array)
DIRECTION = POINT.filter(lambda u: np.linalg.norm(u) > 1e-3)
EXAMPLES = settings(deadline=None, derandomize=True, max_examples=60)


@EXAMPLES
@given(DIRECTION, POINT, st.floats(-5.0, 5.0))
def test_pitch_and_axis_of_a_helical_joint(u, q, h):
    s = iq.se3.helical(u, q, h)
    assert iq.se3.pitch(s) == pytest.approx(h, abs=1e-13 * (1.0 + np.abs(q).max()))
    direction, point = iq.se3.axis(s)
    np.testing.assert_allclose(direction, u / np.linalg.norm(u), atol=1e-14)
    assert direction @ point == pytest.approx(0.0, abs=1e-12)  # nearest the origin
    np.testing.assert_allclose(np.cross(q - point, direction), 0.0, atol=1e-12)


@EXAMPLES
@given(DIRECTION, POINT)
def test_revolute_and_prismatic_joints(u, q):
    hinge, slide = iq.revolute(u, q), iq.se3.prismatic(u)
    np.testing.assert_allclose(hinge[3:] + np.cross(hinge[:3], q), 0.0, atol=1e-13)
    assert iq.se3.pitch(hinge) == pytest.approx(0.0, abs=1e-13)
    assert not slide[:3].any()
    assert np.linalg.norm(slide) == pytest.approx(1.0)
    assert iq.se3.pitch(slide) == np.inf


def test_a_screw_advances_by_its_pitch():
    """A full turn of a helical joint moves by 2 pi h along its axis and turns by nothing."""
    T = iq.exp(2.0 * np.pi * iq.se3.helical((0, 0, 3), (0.4, -0.2, 0.0), 0.1))
    np.testing.assert_allclose(T, iq.transform(translation=(0, 0, 0.2 * np.pi)), atol=1e-15)


def test_pitch_is_the_same_in_every_frame_and_for_every_multiple():
    rng = np.random.default_rng(3)
    for _ in range(50):
        s = rng.normal(size=6)
        h = iq.se3.pitch(s)
        assert iq.se3.pitch(-1e-200 * s) == pytest.approx(h, rel=1e-12)
        assert iq.se3.pitch(iq.adjoint(motion(rng)) @ s) == pytest.approx(h, rel=1e-11, abs=1e-12)


@pytest.mark.parametrize("size", [1e-200, 1e-160, 1.0, 1e160, 1e200])
def test_any_length_of_an_axis_will_do(size):
    """Squares of these overflow or vanish; their direction does not."""
    np.testing.assert_allclose(iq.revolute((0, 0, size), (1, 0, 0)), [0, 0, 1, 0, -1, 0])
    np.testing.assert_allclose(iq.se3.prismatic((size, size, 0)), np.array([0, 0, 0, 1, 1, 0]) / np.sqrt(2.0))
    direction, point = iq.se3.axis(size * iq.revolute((0, 0, 1), (0.5, 0, 0)))
    np.testing.assert_allclose((*direction, *point), (0, 0, 1, 0.5, 0, 0), atol=1e-15)


def test_a_pitch_too_large_to_square_is_still_a_pitch():
    assert iq.se3.pitch([0, 0, 1e-170, 0, 0, 1.0]) == pytest.approx(1e170)
    assert iq.se3.pitch([0, 0, 1e-170, 1.0, 0, 0]) == 0.0


def test_infinite_pitch_of_either_sign_is_the_slide():
    np.testing.assert_array_equal(iq.se3.helical((0, 2, 0), (1, 1, 1), np.inf), iq.se3.prismatic((0, 1, 0)))
    np.testing.assert_array_equal(iq.se3.helical((0, 2, 0), (1, 1, 1), -np.inf), iq.se3.prismatic((0, 1, 0)))


def test_magnitude_pitch_and_axis_of_twists_and_wrenches():
    rng = np.random.default_rng(4)
    for _ in range(50):
        u, p, h, size = rng.normal(size=3), rng.normal(size=3), rng.normal(), rng.uniform(0.1, 5.0)
        s = size * iq.se3.helical(u, p, h)
        for found in (iq.se3.screw_of(s), iq.se3.screw_of_wrench(np.concatenate((s[3:], s[:3])))):
            assert (found.magnitude, found.pitch) == (pytest.approx(size), pytest.approx(h))
            np.testing.assert_allclose(found.direction, u / np.linalg.norm(u), atol=1e-12)
            np.testing.assert_allclose(np.cross(p - found.point, found.direction), 0.0, atol=1e-10)
    couple = iq.se3.screw_of_wrench([0, 0, 3, 0, 0, 0])
    assert (couple.magnitude, couple.pitch, couple.point) == (3.0, np.inf, None)
    slide = iq.se3.screw_of([0, 0, 0, 0, 2, 0])
    assert (slide.magnitude, slide.pitch, slide.direction.tolist()) == (2.0, np.inf, [0, 1, 0])
    with pytest.raises(iq.BadInput, match="wrench"):
        iq.se3.screw_of_wrench(np.zeros(5))
