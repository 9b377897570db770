"""When J^{+h} is given and when it is refused, judged by the exact answer in sixty digits."""

import mpmath
import numpy as np
import pytest
from support.exact_pseudoinverse import exact_pseudoinverse, relative_error
from support.random_systems import CLASSES, motion, sample
from support.repeats import repeats

import invariantqp as iq
from invariantqp.systems.pseudoinverses import LARGEST_CONDITION, ROUNDING, factors
from invariantqp.systems.subspaces import span

THREE_DIGITS = 1e-3
# Of the random systems here with |h| below a thousand of their lengths, none that is refused changes by less.
ILL_DETERMINED = 1e-6


def scara(rng):
    """Three parallel hinges and a slide along them, anywhere in space."""
    a, b = rng.uniform(-3.0, 3.0, size=2)
    elbow = rng.uniform(0.1, 0.6) * np.array([np.cos(a), np.sin(a), 0.0])
    wrist = elbow + rng.uniform(0.1, 0.6) * np.array([np.cos(a + b), np.sin(a + b), 0.0])
    z = (0.0, 0.0, 1.0)
    return np.column_stack((iq.revolute(z), iq.revolute(z, elbow), iq.revolute(z, wrist), iq.se3.prismatic(z)))


def assert_refused(J, h):
    assert not iq.has_pseudoinverse(J, h)
    with pytest.raises(iq.NoPseudoinverse) as caught:
        iq.pseudoinverse(J, h)
    assert caught.value.gram_rank < caught.value.rank
    with pytest.raises(iq.NoProjectors):
        iq.dual_projectors(J, h=h)
    said = iq.systems.existence(J, h)
    assert said.degenerate == (True, True, True)
    assert not said.exists
    assert not iq.systems.reciprocal_has_pseudoinverse(J, h)


@pytest.mark.parametrize("far", [0.0, 2.0, 1e3])
def test_the_so101_has_no_0_pseudoinverse_in_any_state(far):
    """Its five axes always have a common transversal; rounding used to hide that in a fifth of the states."""
    rng = np.random.default_rng(101)
    arm = iq.load_robot("so101")
    for _ in range(repeats(200, 35)):
        J = arm.jacobian(rng.uniform(arm.position_lower, arm.position_upper))
        assert_refused(iq.adjoint(motion(rng, far)) @ J, 0.0)


def test_the_so101_has_one_at_every_other_pitch():
    rng = np.random.default_rng(102)
    arm = iq.load_robot("so101")
    with mpmath.workdps(60):
        for exponent in np.linspace(-10.0, 4.0, 57):
            J = arm.jacobian(rng.uniform(arm.position_lower, arm.position_upper))
            J, h = iq.adjoint(motion(rng)) @ J, 10.0**exponent
            said = iq.systems.existence(J, h)
            assert said.exists == (said.condition <= LARGEST_CONDITION)
            if exponent > -7.0:
                assert said.exists
            if said.exists:
                error = relative_error(iq.pseudoinverse(J, h), exact_pseudoinverse(J, h), J)
                assert error <= min(THREE_DIGITS, 2.0 * ROUNDING * said.condition)


@pytest.mark.parametrize("far", [0.0, 2.0, 1e3])
def test_a_scara_has_none_wherever_it_stands(far):
    rng = np.random.default_rng(103)
    for _ in range(repeats(200, 35)):
        assert_refused(iq.adjoint(motion(rng, far)) @ scara(rng), rng.normal())


def any_system(rng, i):
    """Twists of every kind: random, ill-conditioned, of each type, hinges, screws and slides, of very unequal size."""
    m = int(rng.integers(1, 6))
    kind = i % 5
    if kind == 0:
        J = rng.normal(size=(6, m))
    elif kind == 1:
        U, V = np.linalg.qr(rng.normal(size=(6, m)))[0], np.linalg.qr(rng.normal(size=(m, m)))[0]
        J = U * np.geomspace(1.0, 10.0 ** -rng.uniform(0.0, 11.0), m) @ V
    elif kind == 2:
        J, _ = sample(rng, CLASSES[rng.integers(len(CLASSES))], upper=bool(rng.integers(2)))
    elif kind == 3:
        pitches = rng.choice([0.0, 0.3, np.inf], size=m)
        J = np.column_stack([iq.se3.helical(*rng.normal(size=(2, 3)), pitch=p) for p in pitches])
    else:
        J = rng.normal(size=(6, m)) * 10.0 ** rng.uniform(-4.0, 4.0, size=m)
    J = iq.adjoint(motion(rng, 10.0 ** rng.uniform(-1.0, 3.0))) @ J
    return J * np.repeat([1.0, 10.0 ** rng.uniform(-3.0, 3.0)], 3)[:, None]


def any_pitch(rng, J):
    """Of any size against the system's length, or at any distance from a principal pitch."""
    unit = span(J).unit
    try:
        pitches = iq.principal_pitches(J)
    except iq.BlindSystem:
        pitches = []
    if np.size(pitches) and rng.integers(3):
        p = float(rng.choice(pitches))
        return p + rng.integers(2) * rng.normal() * (abs(p) + unit) * 10.0 ** rng.uniform(-15.0, 0.0)
    return unit * rng.normal() * 10.0 ** rng.uniform(-3.0, rng.choice([3.0, 10.0]))


def disturbed(rng, J):
    """J with an error of ROUNDING in each twist, ten times as large so that it can be written in float64."""
    unit = np.repeat([1.0, span(J).unit], 3)[:, None]
    D = rng.normal(size=J.shape)
    return J + 10.0 * ROUNDING * unit * (D / np.linalg.norm(D, axis=0) * np.linalg.norm(J / unit, axis=0))


@pytest.mark.parametrize("seed", range(4))
def test_what_is_given_is_right_and_what_is_refused_could_not_be(seed):
    rng = np.random.default_rng(seed)
    given, refused, systems = 0, 0, repeats(300, 50)
    with mpmath.workdps(60):
        for i in range(systems):
            J = any_system(rng, i)
            if span(J).rank < J.shape[1]:
                continue
            h = any_pitch(rng, J)
            found = factors(J, h)
            try:
                exact = exact_pseudoinverse(J, h)
            except ZeroDivisionError:
                assert not found.exists
                continue
            if found.exists:
                given += 1
                error = relative_error(found.inverse, exact, J)
                assert error <= min(THREE_DIGITS, 2.0 * ROUNDING * found.condition)
            elif abs(h) < 1e3 * span(J).unit:
                refused += 1
                changes = [relative_error(exact_pseudoinverse(disturbed(rng, J), h), exact, J) for _ in range(2)]
                assert max(changes) > ILL_DETERMINED
    assert given > systems // 3
    assert refused > systems // 5


@pytest.mark.parametrize("seed", range(2))
def test_dependent_joints_with_a_metric(seed):
    """Judged in the metric's own norm, on twists whose dependence is exact in float64."""
    rng = np.random.default_rng(seed)
    with mpmath.workdps(60):
        for i in range(80):
            m = int(rng.integers(2, 9))
            r = int(rng.integers(1, min(m, 7)))
            B = np.round(rng.normal(size=(6, r)) * 2.0**18) / 2.0**18
            C = np.eye(r)[:, rng.integers(0, r, size=m)] if i % 2 else rng.integers(-3, 4, size=(r, m)).astype(float)
            C[:, :r] = np.eye(r)
            A = rng.normal(size=(m, m))
            M = [
                np.eye(m),
                np.diag(10.0 ** rng.uniform(-3.0, 3.0, size=m)),
                A @ A.T + 10.0 ** -rng.uniform(0.0, 6.0) * np.eye(m),
            ][i % 3]
            M = 0.5 * (M + M.T)
            pitches = iq.principal_pitches(B)
            h = rng.choice(pitches) + rng.normal() * 10.0 ** -rng.uniform(0.0, 9.0) if len(pitches) else 0.3
            found = factors(B @ C, h, M)
            if found.exists:
                exact = exact_pseudoinverse(B, h, M, C)
                root = np.linalg.cholesky(M).T
                difference = np.array((mpmath.matrix(found.inverse.tolist()) - exact).tolist(), dtype=float)
                error = np.linalg.norm(root @ difference) / np.linalg.norm(root @ np.array(exact.tolist(), dtype=float))
                assert error <= min(THREE_DIGITS, 2.0 * ROUNDING * found.condition)


def test_two_small_numbers_that_only_together_are_too_small():
    """A screw of a principal pitch beside two that are almost one: neither the form nor the joints alone say no."""
    rng = np.random.default_rng(5)
    _, z = iq.systems.principal_screws(rng.normal(size=(6, 3)))
    for nearness, offset, exists in [(1e-2, 1e-8, True), (1e-8, 1e-2, True), (1e-8, 1e-8, False)]:
        J = np.column_stack((z[:, 0], z[:, 1], z[:, 1] + nearness * z[:, 2]))
        assert iq.has_pseudoinverse(J, float(iq.se3.pitch(z[:, 0])) + offset) is exists


@pytest.mark.parametrize("m", [4, 6, 7])
def test_joints_that_are_dependent_but_for_rounding_are_told_so(m):
    rng = np.random.default_rng(m)
    U, V = np.linalg.qr(rng.normal(size=(6, min(m, 6))))[0], np.linalg.qr(rng.normal(size=(m, m)))[0]

    def with_last(value):
        return U * np.append(np.ones(min(m, 6) - 1), value) @ V[: min(m, 6)]

    assert iq.has_pseudoinverse(with_last(1e-10), 0.3)
    assert iq.has_pseudoinverse(with_last(1e-15), 0.3)  # dependent beyond doubt, and so of lower rank
    J = with_last(3e-13)
    assert not iq.has_pseudoinverse(J, 0.3)
    with pytest.raises(iq.NoPseudoinverse, match="so nearly dependent that rounding decides") as caught:
        iq.pseudoinverse(J, 0.3)
    assert caught.value.gram_rank == caught.value.rank == min(m, 6)
    z = caught.value.self_reciprocal
    assert np.linalg.norm(np.linalg.lstsq(J, z, rcond=1e-15)[0]) > 1e11  # what it takes to move along z
    with pytest.raises(iq.BadInput, match="S: found columns so nearly dependent"):
        iq.dual_projectors(J, h=0.3)


def test_the_condition_number_is_the_same_in_every_frame_unit_and_joint_scale():
    rng = np.random.default_rng(7)
    for _ in range(60):
        J = rng.normal(size=(6, int(rng.integers(1, 7))))
        pitches = iq.principal_pitches(J)
        h = float(pitches[0]) + 10.0 ** -rng.uniform(0.0, 9.0) if len(pitches) else 0.3
        here = factors(J, h).condition
        unit = 10.0 ** rng.uniform(-3.0, 3.0)
        moved = np.repeat([1.0, unit], 3)[:, None] * (iq.adjoint(motion(rng, 1.0)) @ J)
        there = factors(moved * 10.0 ** rng.uniform(-3.0, 3.0, size=J.shape[1]), unit * h).condition
        assert 0.02 < there / here < 50.0
