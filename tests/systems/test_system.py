"""ScrewSystem: its methods agree with the functions of the package; methods without a function."""

import pickle

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import PLANAR, admits, distance, every_class, motion, sample

import invariantqp as iq
from invariantqp.systems import ScrewSystem

SEEDS = st.integers(0, 2**31)


@every_class
@pytest.mark.parametrize("upper", [False, True])
def test_methods_agree_with_the_functions(key, upper):
    rng = np.random.default_rng(1)
    J, _ = sample(rng, key, upper=upper and key[0] < 3, extra=1)
    system, h = ScrewSystem(J), 1.7
    assert system.type == iq.gibson_hunt(J)
    assert system.type is system.type  # made once
    np.testing.assert_array_equal(system.reciprocal(0.3).basis, iq.reciprocal(J, 0.3))
    np.testing.assert_array_equal(system.annihilator(), iq.systems.annihilator(J))
    np.testing.assert_array_equal(system.basis, iq.systems.screw_system(J))
    np.testing.assert_array_equal(system.blind_directions, iq.systems.blind_directions(J))
    assert system.existence(h) == iq.systems.existence(J, h) == iq.systems.existence(system, h)
    assert system.has_pseudoinverse(h) == iq.has_pseudoinverse(J, h) == admits(key[1])
    assert system.report == iq.systems.describe(J)
    assert distance(system.self_reciprocal(h).basis, iq.systems.self_reciprocal(J, h)) < 1e-9
    if not admits(key[1]):
        for ask in (lambda: system.principal_pitches, lambda: system.principal_screws):
            with pytest.raises(iq.BlindSystem):
                ask()
        return
    np.testing.assert_array_equal(system.principal_pitches, iq.principal_pitches(J))
    np.testing.assert_array_equal(system.principal_screws, iq.systems.principal_screws(J)[1])
    for X in (system.pseudoinverse(h), iq.pseudoinverse(system, h)):
        np.testing.assert_allclose(X, iq.pseudoinverse(J, h), atol=1e-9)
    np.testing.assert_allclose(system.projectors(h).motion, iq.dual_projectors(J, h=h).motion, atol=1e-9)


def test_a_screw_system_is_a_value():
    J = np.random.default_rng(0).normal(size=(6, 3))
    system, again, other = ScrewSystem(J), ScrewSystem(J.tolist()), ScrewSystem(2.0 * J)
    assert system == again != other
    assert hash(system) == hash(again)
    for made in (system, system.reciprocal(0.2), system.meet(other), system.sum(other), system.self_reciprocal()):
        assert type(made) is ScrewSystem
        back = pickle.loads(pickle.dumps(made))
        assert back == made
        assert back.dimension == made.dimension
        assert made.dimension == 0 or distance(back.basis, made.basis) < 1e-12
    J[:] = 0.0
    assert system.dimension == 3
    with pytest.raises(AttributeError):
        system.length = 1.0
    with pytest.raises(ValueError, match="read-only"):
        system.twists[0, 0] = 1.0
    assert repr(system).startswith("ScrewSystem(twists=")


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, unit=st.sampled_from([1e-3, 1.0, 1e3]))
def test_own_point_and_length_do_not_depend_on_frame_and_unit(seed, unit):
    rng = np.random.default_rng(seed)
    J, T = rng.normal(size=(6, 4)), motion(rng, 30.0)
    here = ScrewSystem(J)
    there = ScrewSystem(np.repeat([1.0, unit], 3)[:, None] * (iq.adjoint(T) @ J))
    np.testing.assert_allclose(there.point, unit * (T @ np.append(here.point, 1.0))[:3], rtol=1e-6, atol=1e-6 * unit)
    assert there.length == pytest.approx(unit * here.length)
    np.testing.assert_allclose(np.abs(there.span.singular), here.span.singular, rtol=1e-9)


def test_derived_systems_inherit_point_length_and_errors():
    """Its own point, length and errors are inherited, errors times the condition of the twists."""
    J = np.random.default_rng(3).normal(size=(6, 3))
    J[:, 2] = J[:, 1] + 1e-3 * J[:, 2]
    far = ScrewSystem(iq.adjoint(iq.transform(translation=(1e4, 0, 0))) @ J)
    for made in (far.reciprocal(0.3), far.self_reciprocal(), far.reciprocal().reciprocal()):
        np.testing.assert_array_equal(made.point, far.point)
        assert made.length == far.length
        assert made.dimension == 0 or made.error_factors.min() > 100.0 * far.error_factors.max()


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, unit=st.sampled_from([1e-3, 1.0, 1e3]))
def test_contains(seed, unit):
    rng = np.random.default_rng(seed)
    J = np.repeat([1.0, unit], 3)[:, None] * (iq.adjoint(motion(rng, 10.0)) @ rng.normal(size=(6, 3)))
    system = ScrewSystem(J)
    assert system.contains(J @ rng.normal(size=(3, 2)))
    assert system.contains(system.reciprocal().reciprocal().basis)
    assert not system.contains(np.eye(6))
    assert not system.contains(system.reciprocal(0.3 * unit).basis)
    # The other may be given as its twists.
    assert system.sum(J[:, :1]).dimension == 3
    assert system.meet(J[:, 1:]).dimension == 2


@pytest.mark.parametrize("far", [1.0, 1e2, 1e4])
def test_existence_of_a_wrist_does_not_depend_on_the_frame(far):
    """Axes that meet have no length of their own: the numbers of Theorem 3.1 are then measured in the pitch."""
    rng = np.random.default_rng(5)
    wrist = np.column_stack([iq.revolute(rng.normal(size=3)) for _ in range(3)])
    here = iq.systems.existence(wrist, 0.1)
    there = iq.systems.existence(iq.adjoint(motion(rng, far)) @ wrist, 0.1)
    for name in ("gram_eigenvalue", "angle", "pitch_distance"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), rel=1e-6)


def test_the_length_of_slides_beside_a_hinge_with_a_pitch_of_rounding():
    """In millimetres, after some algebra: 5e-11 mm is nobody's length."""
    hinge = iq.se3.helical((0, 0, 1), (300.0, 200.0, 0.0), pitch=5e-11)
    slides = 500.0 * np.column_stack([iq.se3.prismatic(u) for u in np.eye(3)])
    system = ScrewSystem(np.column_stack((hinge, slides)))
    assert system.dimension == 4
    assert system.length > 1.0


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 8), rank=st.integers(1, 6), which=st.integers(0, 2))
def test_the_pseudoinverse_along_any_complement(seed, m, rank, which):
    """J X = P, X J X = X, and X is the shortest in the joint metric; with the h-reciprocal it is J^{+h}."""
    rng = np.random.default_rng(seed)
    k = min(m, rank)
    J = rng.normal(size=(6, k)) if k == m else rng.normal(size=(6, k)) @ rng.normal(size=(k, m))
    R, M = rng.normal(size=(6, 6)), np.diag(rng.uniform(0.5, 2.0, size=m))
    system, h = ScrewSystem(J), 3.0 + rng.uniform()
    Z = (rng.normal(size=(6, 6 - k)), None, system.reciprocal(h).basis)[which]
    rule = {"metric": R @ R.T + np.eye(6)} if which == 1 else {"complement": Z}
    P = system.projectors(**rule).motion
    X, condition = system.pseudoinverse(**rule, joint_metric=M, return_condition=True)
    assert condition >= 0.999 * np.linalg.norm(P @ system.basis, 2) / np.linalg.norm(system.basis, 2)
    assert condition >= system.projectors(**rule).norm
    size = 1e-10 * condition * (1.0 + np.linalg.norm(X)) * (1.0 + np.linalg.norm(J)) ** 2
    np.testing.assert_allclose(J @ X, P, atol=size)
    np.testing.assert_allclose(X @ J @ X, X, atol=size * (1.0 + np.linalg.norm(X)))
    np.testing.assert_allclose(M @ X @ J, (M @ X @ J).T, atol=size)
    if which == 2:
        np.testing.assert_allclose(X, system.pseudoinverse(h, joint_metric=M), atol=size * (1.0 + np.linalg.norm(X)))


def test_a_carried_metric_gives_the_same_joint_velocities_in_every_frame():
    rng = np.random.default_rng(2)
    J, T, s = rng.normal(size=(6, 4)), motion(rng), rng.normal(size=6)
    body, Ad = motion(rng), iq.adjoint(T)
    M = np.diag([0.2, 0.3, 0.4, 1.0, 1.0, 1.0])
    here = ScrewSystem(J).pseudoinverse(metric=iq.CarriedMetric(M, body)) @ s
    there = ScrewSystem(Ad @ J).pseudoinverse(metric=iq.CarriedMetric(M, T @ body)) @ Ad @ s
    np.testing.assert_allclose(there, here, atol=1e-10)
    planar = ScrewSystem(PLANAR)
    assert planar.blind_directions.shape == (6, 2)  # no pitch works: a metric or a complement has to
    assert np.isfinite(planar.pseudoinverse(metric=np.ones(6))).all()
    with pytest.raises(iq.BadInput, match="shares the twist"):
        planar.pseudoinverse(complement=planar.basis)
    with pytest.raises(iq.BadInput, match="one of h, complement, metric"):
        planar.pseudoinverse()


def test_a_badly_scaled_metric_costs_no_digits():
    """The identity in millimetres weighs a radian as a millimetre; its least squares are solved as such."""
    rng = np.random.default_rng(0)
    with mpmath.workdps(50):
        for _ in range(10):
            J = rng.normal(size=(6, 4)) * np.repeat([1.0, 1e3], 3)[:, None]
            A = mpmath.matrix(J.tolist())
            exact = mpmath.inverse(A.T * A) * A.T
            X = mpmath.matrix(ScrewSystem(J).pseudoinverse(metric=np.eye(6)).tolist())
            assert mpmath.norm(X - exact) < 1e-11 * mpmath.norm(exact)


@pytest.mark.parametrize("speed", [1e-8, 1e-4, 1.0, 1e4, 1e8])
def test_a_slide_of_any_speed_beside_a_hinge(speed):
    """What exists, and how well it is conditioned, does not depend on the unit of a joint."""
    hinge, slide = iq.revolute((0.6, 0, 0.8), (1, 2, 0.5)), speed * iq.se3.prismatic((0.48, 0.6, 0.64))
    system = ScrewSystem(np.column_stack((hinge, slide)))
    X, condition = system.pseudoinverse(0.3, return_condition=True)
    assert condition < 20.0
    assert system.has_pseudoinverse(0.3) is system.existence(0.3).exists is True
    known = iq.pseudoinverse(np.column_stack((hinge, slide / speed)), 0.3)
    np.testing.assert_allclose(X * [[1.0], [speed]], known, atol=1e-12)


@pytest.mark.parametrize("k", [1, 2, 3, 4, 5])
def test_the_condition_of_a_principal_pitch_bounds_its_error(k):
    """The condition is a bound, to first order, and not a hundred times too large."""
    rng = np.random.default_rng(k)
    worst = 0.0
    for _ in range(40):
        J = rng.normal(size=(6, k)) + np.array([0, 0, 0, 5.0, 0, 0])[:, None]
        system = ScrewSystem(J)
        found = system.pencil
        if len(found.values) > 1 and np.diff(found.values).min() < 0.1:
            continue
        error = 1e-7
        for _ in range(10):
            D = error * J * rng.uniform(-1.0, 1.0, size=J.shape)
            moved = np.abs(iq.principal_pitches(J + D) - found.values)
            ratio = moved / (found.conditions * system.length * error)
            worst = max(worst, ratio.max())
    assert 0.3 < worst < 2.5
