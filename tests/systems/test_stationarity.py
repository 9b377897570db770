import numpy as np
import pytest
from support.random_systems import motion, sample

import invariantqp as iq


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 7])
def test_the_pseudoinverse_is_stationary_and_its_kind_is_what_probing_shows(m):
    rng = np.random.default_rng(m)
    for h in (-6.0, 0.3, 6.0):
        J, s = rng.normal(size=(6, m)), rng.normal(size=6)
        found = iq.systems.stationary_point(J, s, h)
        assert found.value == iq.systems.error_form(J, s, h, found.velocity)[0]
        np.testing.assert_allclose(found.gradient, 0.0, atol=1e-8)
        directions = np.linalg.eigh(J.T @ iq.pitch_form(h) @ J)[1].T  # the narrow cones of a saddle are along these
        changes = np.array([iq.systems.error_form(J, s, h, found.velocity + dx)[0] - found.value for dx in directions])
        if m < 6:  # with rank 6 the error is zero whatever is probed around it
            kind = "minimum" if changes.min() > 0.0 else "maximum" if changes.max() < 0.0 else "saddle"
            assert found.kind == kind
        assert sum(found.signature) == m
        if m >= 4:
            assert found.kind == "saddle"


def test_gradient_against_differences():
    rng = np.random.default_rng(3)
    J, s, x, step = rng.normal(size=(6, 4)), rng.normal(size=6), rng.normal(size=4), 1e-5
    _, gradient = iq.systems.error_form(J, s, 0.4, x)
    for i, e in enumerate(np.eye(4)):
        up, down = (iq.systems.error_form(J, s, 0.4, x + sign * step * e)[0] for sign in (1, -1))
        assert gradient[i] == pytest.approx((up - down) / (2 * step), abs=1e-8)


def test_outside_the_principal_pitches_it_is_a_true_optimum():
    S = np.random.default_rng(4).normal(size=(6, 3))
    pitches = iq.principal_pitches(S)
    s = np.random.default_rng(5).normal(size=6)
    assert iq.systems.stationary_point(S, s, pitches[0] - 1.0).kind == "minimum"
    assert iq.systems.stationary_point(S, s, pitches.mean()).kind == "saddle"
    assert iq.systems.stationary_point(S, s, pitches[-1] + 1.0).kind == "maximum"
    still = iq.systems.stationary_point(np.zeros((6, 2)), s, 0.5)
    assert (still.kind, still.signature) == ("flat", (0, 0, 2))


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_the_error_vanishes_at_the_vanishing_pitches_and_changes_sign(m):
    rng = np.random.default_rng(m)
    for _ in range(5):
        J, s = rng.normal(size=(6, m)), rng.normal(size=6)
        for h in iq.systems.vanishing_pitches(J, s):
            gap = np.abs(iq.principal_pitches(J) - h).min() * 1e-3
            assert abs(iq.systems.stationary_point(J, s, h).value) < 1e-6 * (1.0 + s @ s)
            below, above = (iq.systems.stationary_point(J, s, h + d).value for d in (-gap, gap))
            assert below * above < 0.0


def test_value_and_vanishing_pitches_are_frame_free():
    rng = np.random.default_rng(9)
    J, s, Ad = rng.normal(size=(6, 3)), rng.normal(size=6), iq.adjoint(motion(rng))
    assert iq.systems.stationary_point(Ad @ J, Ad @ s, 0.4).value == pytest.approx(
        iq.systems.stationary_point(J, s, 0.4).value
    )
    np.testing.assert_allclose(
        iq.systems.vanishing_pitches(Ad @ J, Ad @ s), iq.systems.vanishing_pitches(J, s), rtol=1e-9
    )


def test_where_nothing_can_vanish_or_everything_does_it_says_so():
    rng = np.random.default_rng(10)
    J = rng.normal(size=(6, 3))
    with pytest.raises(iq.BadInput, match="span"):
        iq.systems.vanishing_pitches(J, J @ rng.normal(size=3))
    with pytest.raises(iq.NoPseudoinverse):
        iq.systems.stationary_point(sample(rng, (3, "IC"))[0], rng.normal(size=6), 0.3)
    axis = iq.revolute((0, 0, 1))
    with pytest.raises(iq.BlindSystem):  # a translation across the axis: reciprocal to it and to itself for every h
        iq.systems.vanishing_pitches(axis, iq.se3.prismatic((1, 0, 0)))
