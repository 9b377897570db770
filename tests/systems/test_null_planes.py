import pickle
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import CLASSES, distance, motion, sample

import invariantqp as iq
from invariantqp.systems.lines import NullPlane, alpha_plane, beta_plane, null_plane

SEEDS = st.integers(0, 2**31)
PITCHES = st.sampled_from([0.0, 0.3, -1.2])


def planes(rng, h):
    p, q, u, n = rng.normal(size=(4, 3))
    return {
        "alpha": alpha_plane(p, h),
        "alpha at infinity": alpha_plane(direction=u, h=h),
        "beta": beta_plane(q, n, h),
        "beta at infinity": null_plane(np.eye(6)[:, 3:]),
    }


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, h=PITCHES)
def test_their_screws_are_the_ones_they_are_named_for(seed, h):
    rng = np.random.default_rng(seed)
    p, q, u, n = rng.normal(size=(4, 3))
    for s in (alpha_plane(p, h).basis @ rng.normal(size=(3, 4))).T:
        direction, foot = iq.se3.axis(s)
        np.testing.assert_allclose(np.cross(direction, p - foot), 0.0, atol=1e-12)
        assert iq.se3.pitch(s) == pytest.approx(h, abs=1e-12)
    for s in (beta_plane(q, n, h).basis @ rng.normal(size=(3, 4))).T:
        direction, foot = iq.se3.axis(s)
        assert direction @ n == pytest.approx(0.0, abs=1e-12)
        assert (foot - q) @ n == pytest.approx(0.0, abs=1e-10)
        assert iq.se3.pitch(s) == pytest.approx(h, abs=1e-10)
    for s in (alpha_plane(direction=u, h=h).basis @ rng.normal(size=(3, 4))).T:
        direction, _ = iq.se3.axis(s)
        np.testing.assert_allclose(np.cross(direction, u), 0.0, atol=1e-12)
        assert iq.se3.pitch(s) == pytest.approx(h, abs=1e-10)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, h=PITCHES)
def test_each_is_its_own_h_reciprocal_and_has_no_h_pseudoinverse(seed, h):
    rng = np.random.default_rng(seed)
    for name, plane in planes(rng, h).items():
        S = plane.basis
        np.testing.assert_allclose(S.T @ iq.pitch_form(h) @ S, 0.0, atol=1e-12)
        assert distance(iq.reciprocal(S, h), S) < 1e-12
        assert not iq.has_pseudoinverse(S, h)
        assert iq.has_pseudoinverse(S, h + 0.5) is (name == "alpha")


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, h=PITCHES)
def test_two_families(seed, h):
    """Planes of one family meet in one screw, planes of different families in none or in a pencil."""
    rng = np.random.default_rng(seed)
    found = [*planes(rng, h).values(), *list(planes(rng, h).values())[:3]]
    for one, other in combinations(found, 2):
        shared = iq.systems.system_meet(one.basis, other.basis, 1e-9).shape[1]
        assert shared % 2 == (1 if one.family == other.family else 0)
    p, n = rng.normal(size=(2, 3))
    through = alpha_plane(p, h)
    pencil = iq.systems.system_meet(through.basis, beta_plane(p, n, h).basis, 1e-9)
    assert pencil.shape[1] == 2
    assert iq.systems.system_meet(through.basis, beta_plane(p + n, n, h).basis, 1e-9).shape[1] == 0


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, h=PITCHES, unit=st.sampled_from([1e-3, 1.0, 1e3]))
def test_they_are_recognised_wherever_they_are(seed, h, unit):
    rng = np.random.default_rng(seed)
    T = motion(rng, 1.0)
    for name, plane in planes(rng, h).items():
        J = np.repeat([1.0, unit], 3)[:, None] * (iq.adjoint(T) @ plane.basis) @ rng.normal(size=(3, 4))
        found = null_plane(J)
        assert found.family == plane.family
        assert found.at_infinity == plane.at_infinity
        assert distance(found.basis, J) < 1e-7
        if name == "alpha":
            np.testing.assert_allclose(found.point, unit * (T[:3, :3] @ plane.point + T[:3, 3]), atol=1e-6 * unit)
            assert found.h == pytest.approx(unit * h, abs=1e-6 * unit)
        assert found.contains(J[:, 0], 1e-6)


@pytest.mark.parametrize("key", CLASSES, ids=lambda c: f"{c[0]}-{c[1]}")
def test_no_other_system_is_one(key):
    J, _ = sample(np.random.default_rng(1), key)
    assert (null_plane(J) is not None) == (key in {(3, "IIA"), (3, "IIB"), (3, "IIC"), (3, "IID")})


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, h=PITCHES, unit=st.sampled_from([1e-3, 1.0, 1e3]))
def test_membership(seed, h, unit):
    rng = np.random.default_rng(seed)
    p, n = rng.normal(size=(2, 3)) * unit
    u = rng.normal(size=3)
    plane, flat = alpha_plane(p, unit * h), beta_plane(p, n, unit * h)
    across = np.cross(n, u)
    assert plane.contains(iq.se3.helical(u, p, unit * h))
    assert not plane.contains(iq.se3.helical(u, p + 1e-3 * across, unit * h))
    assert not plane.contains(iq.se3.helical(u, p, unit * (h + 1e-3)))
    assert not plane.contains(iq.se3.prismatic(u))
    assert flat.contains(iq.se3.helical(across, p + 0.3 * np.cross(n, across), unit * h))
    assert flat.contains(iq.se3.prismatic(n))
    assert not flat.contains(iq.se3.helical(across, p + 1e-3 * n, unit * h))
    assert not flat.contains(iq.se3.prismatic(across))


def test_those_that_are_groups_of_motions_close_under_the_bracket():
    """A spherical wrist, planar motion with a pitch, and slides do; hinges in a plane and bolts at a point do not."""

    def closed(plane):
        S = plane.basis
        made = [iq.se3.bracket(a, b) for a, b in combinations(S.T, 2)]
        return np.linalg.matrix_rank(np.column_stack((S, *made)), tol=1e-9) == 3

    p = (0.3, -0.2, 0.5)
    assert closed(alpha_plane(p))
    assert closed(alpha_plane(direction=(0, 1, 2), h=0.4))
    assert closed(null_plane(np.eye(6)[:, 3:]))
    assert not closed(alpha_plane(p, 0.4))
    assert not closed(beta_plane(p, (1, 2, 3)))


def test_they_are_values():
    plane = beta_plane((1, 2, 3), (0, 0, 2), 0.5)
    assert plane == beta_plane((1, 2, 3), (0, 0, 1), 0.5) != beta_plane((1, 2, 3), (0, 0, 1), 0.4)
    assert pickle.loads(pickle.dumps(plane)) == plane
    assert repr(plane) == "NullPlane(family='beta', h=0.5, point=[1., 2., 3.], direction=[0., 0., 1.])"
    given = np.array([1.0, 2.0, 3.0])
    plane = alpha_plane(given)
    given[0] = 7.0
    assert plane.point[0] == 1.0
    assert isinstance(hash(plane), int)
    assert isinstance(plane, NullPlane)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (alpha_plane, "point"),
        (lambda: alpha_plane((0, 0, 0), direction=(0, 0, 1)), "point"),
        (lambda: alpha_plane((0, 0)), "point"),
        (lambda: alpha_plane((0, 0, 0), np.inf), "h"),
        (lambda: alpha_plane(direction=(0, 0, 0)), "direction"),
        (lambda: beta_plane((0, 0, 0), (0, 0, 0)), "normal"),
        (lambda: beta_plane((0, 0, 0), (0, 0, 1), np.nan), "h"),
        (lambda: alpha_plane((0, 0, 0)).contains(np.zeros(6)), "twist"),
        (lambda: null_plane(np.zeros((6, 3))), "J"),
    ],
)
def test_bad_input(call, argument):
    with pytest.raises(iq.BadInput) as caught:
        call()
    assert caught.value.argument == argument
