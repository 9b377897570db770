"""J^{+h}: its definition, existence and accuracy, against the exact matrix in sixty digits."""

import mpmath
import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from support.exact_pseudoinverse import exact_pseudoinverse, relative_error
from support.random_systems import CLASSES, PLANAR, admits, every_class, motion, sample
from support.repeats import repeats

import invariantqp as iq
from invariantqp.engine import law
from invariantqp.systems.pseudoinverses import (
    LARGEST_CONDITION,
    ROUNDING,
    by_engine,
    damped_pseudoinverse,
    factors,
    form_adjoint,
    h_adjoint,
    penrose_conditions,
)
from invariantqp.systems.subspaces import Subspace

EPS = np.finfo(float).eps
SEEDS = st.integers(0, 2**31)
EXAMPLES = settings(deadline=None, derandomize=True, max_examples=80)


def generic(rng, m, rank=None):
    """(6, m) twists of the given rank, dependent columns included."""
    r = min(m, 6) if rank is None else rank
    return rng.normal(size=(6, r)) if r == m else rng.normal(size=(6, r)) @ rng.normal(size=(r, m))


def pitch_away(rng, J):
    """A pitch that is not near a principal one."""
    pitches = iq.principal_pitches(J)
    while True:
        h = rng.uniform(-2.0, 2.0)
        if not len(pitches) or np.abs(pitches - h).min() > 0.05:
            return h


@EXAMPLES
@given(SEEDS, st.integers(1, 8), st.integers(1, 6))
def test_the_four_conditions(seed, m, rank):
    """(hP1)-(hP4); the last with the M-adjoint on the joint side, and the h-adjoint on the other."""
    rng = np.random.default_rng(seed)
    J = generic(rng, m, min(rank, m))
    h = pitch_away(rng, J)
    A = rng.normal(size=(m, m))
    for M in (None, np.diag(rng.uniform(0.2, 5.0, size=m)), A @ A.T + 0.3 * np.eye(m)):
        P = iq.pseudoinverse(J, h, joint_metric=M)
        assert P.shape == (m, 6)
        size = np.linalg.norm(P) * np.linalg.norm(J)
        close = {"rtol": 0.0, "atol": 1e-10 * size**2 * (1.0 + np.linalg.norm(J))}
        np.testing.assert_allclose(J @ P @ J, J, **close)
        np.testing.assert_allclose(P @ J @ P, P, **close)
        projector = iq.pitch_form(h) @ J @ P
        np.testing.assert_allclose(projector, projector.T, **close)
        if m > np.linalg.matrix_rank(J) or M is None:
            metric = np.eye(m) if M is None else M
            on_joints = metric @ P @ J
            np.testing.assert_allclose(on_joints, on_joints.T, **close)
        assert all(penrose_conditions(J, P, h, joint_metric=M).met)


@pytest.mark.parametrize("m", [6, 7, 9])
def test_at_rank_six_it_is_moore_penrose_for_every_pitch(m):
    rng = np.random.default_rng(m)
    J = rng.normal(size=(6, m))
    for h in (-1e3, -0.2, 0.0, 0.3, 1e3):
        np.testing.assert_allclose(iq.pseudoinverse(J, h), np.linalg.pinv(J), atol=1e-13 * np.linalg.cond(J))
        found = iq.systems.existence(J, h)
        assert (iq.has_pseudoinverse(J, h), found.exists, found.certificate) == (True, True, None)
    assert penrose_conditions(J[:, :5], np.linalg.pinv(J[:, :5]), 0.4).met == (True, True, False, True)


@EXAMPLES
@given(SEEDS, st.integers(1, 7))
def test_the_joint_metric_matters_only_for_dependent_joints(seed, m):
    rng = np.random.default_rng(seed)
    J, s = generic(rng, m), rng.normal(size=6)
    h, M = pitch_away(rng, J), rng.uniform(0.1, 10.0, size=m)
    x, y = iq.pseudoinverse(J, h) @ s, iq.pseudoinverse(J, h, joint_metric=M) @ s
    np.testing.assert_allclose(J @ x, J @ y, atol=1e-9 * (1.0 + np.linalg.norm(x)))
    if m <= 6:
        np.testing.assert_allclose(x, y, atol=1e-12 * (1.0 + np.linalg.norm(x)))
    else:
        assert y @ (M * y) <= x @ (M * x) * (1.0 + 1e-12)
        assert x @ x <= y @ y * (1.0 + 1e-12)


@EXAMPLES
@given(SEEDS, st.integers(1, 6))
def test_joint_velocities_do_not_depend_on_frame_and_unit(seed, m):
    rng = np.random.default_rng(seed)
    J = generic(rng, m)
    h = pitch_away(rng, J)
    s, A = rng.normal(size=6), iq.adjoint(motion(rng))
    x = iq.pseudoinverse(J, h) @ s
    scale = np.linalg.norm(iq.pseudoinverse(J, h)) * np.linalg.norm(s)
    np.testing.assert_allclose(iq.pseudoinverse(A @ J, h) @ (A @ s), x, atol=1e-11 * scale * np.linalg.cond(A))
    for unit in (1e-3, 1e3):
        D = np.diag([1.0] * 3 + [unit] * 3)
        np.testing.assert_allclose(iq.pseudoinverse(D @ J, unit * h) @ (D @ s), x, atol=1e-12 * scale)


def test_no_pseudoinverse_carries_its_proof():
    rng = np.random.default_rng(8)
    for m in range(1, 6):
        for rank in range(1, m + 1):
            J = generic(rng, m, rank)
            pitches = iq.principal_pitches(J)
            h = float(rng.choice(pitches))
            assert not iq.has_pseudoinverse(J, h)
            with pytest.raises(iq.NoPseudoinverse) as caught:
                iq.pseudoinverse(J, h)
            error = caught.value
            assert (error.h, error.rank, error.gram_rank) == (h, rank, rank - 1)
            z = error.self_reciprocal
            assert z.shape == (6,)
            assert np.linalg.norm(z) == pytest.approx(1.0)
            size = np.linalg.norm(J) * (1.0 + abs(h))
            np.testing.assert_allclose(J.T @ iq.pitch_form(h) @ z, 0.0, atol=1e-13 * size)
            assert np.linalg.norm(J @ np.linalg.pinv(J) @ z - z) < 1e-12  # z is in the system
            assert iq.se3.pitch(z) == pytest.approx(h, abs=1e-9)
            distance = np.abs(error.principal_pitches - h)
            assert distance[0] < 1e-12
            assert (np.diff(distance) >= 0.0).all()
            np.testing.assert_allclose(np.sort(error.principal_pitches), pitches)
            assert f"no {h:g}-pseudoinverse: the Gram matrix has rank {rank - 1}, the system rank {rank}; " in str(
                error
            )
            assert "Choose h away from the principal pitches" in str(error)


@pytest.mark.parametrize("h", [-1.0, 0.0, 0.4])
def test_the_error_says_if_no_pitch_works(h):
    with pytest.raises(iq.NoPseudoinverse, match=r"No h works for this system: use Complement\(Z\)") as caught:
        iq.pseudoinverse(PLANAR, h)
    assert (caught.value.rank, caught.value.gram_rank) == (3, int(h != 0.0))
    assert caught.value.principal_pitches.shape == (0,)
    np.testing.assert_allclose(PLANAR.T @ iq.pitch_form(h) @ caught.value.self_reciprocal, 0.0, atol=1e-15)


def ill_conditioned(rng, m, condition):
    U, _ = np.linalg.qr(rng.normal(size=(6, m)))
    V, _ = np.linalg.qr(rng.normal(size=(m, m)))
    return U * np.geomspace(1.0, 1.0 / condition, m) @ V


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("m", [2, 3, 4, 5])
def test_more_accurate_than_the_normal_equations(m, unit):
    """cond(J) = 1e7: forming J'Q_h J squares it."""
    rng = np.random.default_rng(200 + m)
    ours, grams = [], []
    with mpmath.workdps(50):
        for _ in range(4):
            J = ill_conditioned(rng, m, 1e7) * np.array([1.0] * 3 + [unit] * 3)[:, None]
            h = unit * 0.6
            exact = exact_pseudoinverse(J, h)
            X, condition = iq.pseudoinverse(J, h, return_condition=True)
            ours.append(relative_error(X, exact, J))
            Q = iq.pitch_form(h)
            grams.append(relative_error(np.linalg.solve(J.T @ Q @ J, J.T @ Q), exact, J))
            assert ours[-1] <= 2 * EPS * condition
            assert relative_error(iq.pseudoinverse(J, h), exact, J) <= 2 * EPS * condition
    assert np.median(grams) > 1e-5
    assert np.median(ours) < 1e-7
    assert np.median(ours) < 1e-3 * np.median(grams)


def test_bad_input():
    for call, argument in (
        (lambda: iq.pseudoinverse(np.eye(6), np.inf), "h"),
        (lambda: iq.has_pseudoinverse(np.eye(6), np.inf), "h"),
        (lambda: penrose_conditions(np.eye(6), np.eye(6), np.inf), "h"),
        (lambda: iq.pseudoinverse(np.eye(6), 0.5, joint_metric=-np.ones(6)), "joint_metric"),
        (lambda: penrose_conditions(np.eye(6), np.eye(6), 0.3, joint_metric=-np.ones(6)), "joint_metric"),
        (lambda: h_adjoint(np.eye(6), 0.3, joint_metric=-np.eye(6)), "joint_metric"),
    ):
        with pytest.raises(iq.BadInput, match=f"{argument}: found .*; expected "):
            call()


def test_the_engine_inverts_well_conditioned_systems():
    rng, answered = np.random.default_rng(0), 0
    for k in range(600):
        m, h = int(rng.integers(1, 13)), float(rng.normal() * 10.0 ** rng.uniform(-3.0, 2.0))
        J = rng.normal(size=(6, m)) * 10.0 ** rng.uniform(-2.0, 2.0)
        J[3:] *= 10.0 ** rng.uniform(-4.0, 4.0)
        if k % 4 == 0 and m > 1:  # nearly dependent
            J[:, 0] = J[:, 1] + 10.0 ** rng.uniform(-9.0, 0.0) * J[:, 0]
        if k % 4 == 1 and 1 < m < 6:  # at a principal pitch, or near it
            h = float(iq.systems.principal_pitches(J)[0] * (1.0 + 10.0 ** rng.uniform(-12.0, 0.0)))
        found, known = law.pseudoinverse(J, h), factors(Subspace(J), h)
        assert found is None or known.exists
        if found is not None:
            answered += 1
            error = np.linalg.norm(found - known.inverse)
            assert error <= 1e-14 * known.condition * np.linalg.norm(known.inverse)
    assert 300 < answered < 560
    J = rng.normal(size=(6, 3))
    for bad in (J[:5].tolist(), J.astype(complex), J[:5], np.nan * J, rng.normal(size=(6, 65)), 0.0 * J):
        assert by_engine(law.pseudoinverse, bad, 0.1) is None
    for h in (np.nan, np.inf):
        assert by_engine(law.pseudoinverse, J, h) is None


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
    found = iq.systems.existence(J, h)
    assert not found.exists
    assert not iq.systems.ScrewSystem(J).reciprocal(h).has_pseudoinverse(h)


@pytest.mark.cases(1)
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
            found = iq.systems.existence(J, h)
            assert found.exists == (found.condition <= LARGEST_CONDITION)
            if exponent > -7.0:
                assert found.exists
            if found.exists:
                error = relative_error(iq.pseudoinverse(J, h), exact_pseudoinverse(J, h), J)
                assert error <= min(THREE_DIGITS, 2.0 * ROUNDING * found.condition)


@pytest.mark.cases(1)
@pytest.mark.parametrize("far", [0.0, 2.0, 1e3])
def test_a_scara_has_none_in_any_frame(far):
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
    unit = Subspace(J).length
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
    unit = np.repeat([1.0, Subspace(J).length], 3)[:, None]
    D = rng.normal(size=J.shape)
    return J + 10.0 * ROUNDING * unit * (D / np.linalg.norm(D, axis=0) * np.linalg.norm(J / unit, axis=0))


@pytest.mark.cases(2)
@pytest.mark.parametrize("seed", range(4))
def test_results_are_accurate_and_only_ill_conditioned_systems_are_refused(seed):
    rng = np.random.default_rng(seed)
    given, refused, systems = 0, 0, repeats(300, 50)
    with mpmath.workdps(60):
        for i in range(systems):
            J = any_system(rng, i)
            if Subspace(J).dimension < J.shape[1]:
                continue
            h = any_pitch(rng, J)
            found = factors(Subspace(J), h)
            try:
                exact = exact_pseudoinverse(J, h)
            except ZeroDivisionError:
                assert not found.exists
                continue
            if found.exists:
                given += 1
                error = relative_error(found.inverse, exact, J)
                assert error <= min(THREE_DIGITS, 2.0 * ROUNDING * found.condition)
            elif abs(h) < 1e3 * Subspace(J).length:
                refused += 1
                changes = [relative_error(exact_pseudoinverse(disturbed(rng, J), h), exact, J) for _ in range(2)]
                assert max(changes) > ILL_DETERMINED
    assert given > systems // 3
    assert refused > systems // 5


@pytest.mark.cases(1)
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
            found = factors(Subspace(B @ C), h, M)
            if found.exists:
                exact = exact_pseudoinverse(B, h, M, C)
                root = np.linalg.cholesky(M).T
                difference = np.array((mpmath.matrix(found.inverse.tolist()) - exact).tolist(), dtype=float)
                error = np.linalg.norm(root @ difference) / np.linalg.norm(root @ np.array(exact.tolist(), dtype=float))
                assert error <= min(THREE_DIGITS, 2.0 * ROUNDING * found.condition)


def test_condition_of_the_form_and_of_the_joints_multiply():
    """A screw of a principal pitch beside two that are almost one: neither the form nor the joints alone say no."""
    rng = np.random.default_rng(5)
    _, z = iq.systems.principal_screws(rng.normal(size=(6, 3)))
    for nearness, offset, exists in [(1e-2, 1e-8, True), (1e-8, 1e-2, True), (1e-8, 1e-8, False)]:
        J = np.column_stack((z[:, 0], z[:, 1], z[:, 1] + nearness * z[:, 2]))
        assert iq.has_pseudoinverse(J, float(iq.se3.pitch(z[:, 0])) + offset) is exists


@pytest.mark.parametrize("m", [4, 6, 7])
def test_joints_that_are_dependent_up_to_rounding_are_refused(m):
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
        here = factors(Subspace(J), h).condition
        unit = 10.0 ** rng.uniform(-3.0, 3.0)
        moved = np.repeat([1.0, unit], 3)[:, None] * (iq.adjoint(motion(rng, 1.0)) @ J)
        there = factors(Subspace(moved * 10.0 ** rng.uniform(-3.0, 3.0, size=J.shape[1])), unit * h).condition
        assert 0.02 < there / here < 50.0


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 8), unit=st.sampled_from([1e-3, 1.0, 1e3]))
def test_the_damped_pseudoinverse_is_its_formula_in_every_frame(seed, m, unit):
    rng = np.random.default_rng(seed)
    J, A, h, damping = rng.normal(size=(6, m)), rng.normal(size=(m, m)), rng.normal(), 0.1
    M = A @ A.T + np.eye(m)
    mu, V = scipy.linalg.eigh(iq.systems.gram_matrix(J, h), M)
    expected = V @ np.diag(mu / (mu**2 + damping**2)) @ V.T @ J.T @ iq.pitch_form(h)
    found = damped_pseudoinverse(J, h, damping, joint_metric=M)
    np.testing.assert_allclose(found, expected, atol=1e-9 * (1.0 + np.abs(expected).max()))
    # [DS] Sect. 6.2 with Lambda = damping^2 M G^-1 M, where that exists.
    if m < 6:
        G = iq.systems.gram_matrix(J, h)
        damped = iq.systems.psi(J, h, damping**2 * M @ np.linalg.inv(G) @ M)
        np.testing.assert_allclose(J @ found, damped, atol=1e-7 * np.linalg.cond(G))
    Ad, D = iq.adjoint(motion(rng)), np.diag(np.repeat([1.0, unit], 3))
    there = damped_pseudoinverse(D @ Ad @ J, unit * h, unit * damping, joint_metric=M)
    np.testing.assert_allclose(there @ D @ Ad, found, atol=1e-8 * (1.0 + np.abs(found).max()))


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5])
def test_the_damped_pseudoinverse_is_continuous_through_every_principal_pitch(m):
    """Bounded by |V'J'Q_h s| / (2 damping), continuous in h and J, and J^{+h} in the limit."""
    rng = np.random.default_rng(m)
    for _ in range(10):
        J = rng.normal(size=(6, m))
        pitches, damping = iq.principal_pitches(J), 1e-3
        for h in pitches:
            middle = damped_pseudoinverse(J, h, damping)
            bound = np.linalg.norm(J.T @ iq.pitch_form(h), 2) / (2.0 * damping)
            assert np.linalg.norm(middle, 2) <= bound * (1.0 + 1e-9)
            step = 1e-9 * bound / damping * (1.0 + np.linalg.norm(J) ** 2)
            for d in (1e-9, -1e-9):
                np.testing.assert_allclose(damped_pseudoinverse(J, h + d, damping), middle, atol=10.0 * step)
                np.testing.assert_allclose(
                    damped_pseudoinverse(J + d * rng.normal(size=J.shape), h, damping), middle, atol=100.0 * step
                )
        h = pitch_away(rng, J)
        exact = iq.pseudoinverse(J, h)
        off = [np.linalg.norm(damped_pseudoinverse(J, h, d) - exact) for d in (1e-2, 1e-3, 1e-4)]
        assert off[0] > 50.0 * off[1] > 2500.0 * off[2]
        np.testing.assert_allclose(damped_pseudoinverse(J, h, 0.0), exact, atol=1e-10 * np.abs(exact).max())


def test_the_damped_pseudoinverse_exists_if_no_pitch_works():
    for h in (-1.0, 0.0, 0.4):
        with pytest.raises(iq.NoPseudoinverse):
            damped_pseudoinverse(PLANAR, h, 0.0)
        X = damped_pseudoinverse(PLANAR, h, 0.01)
        assert np.isfinite(X).all()
        gains = np.linalg.eigvals(PLANAR @ X).real
        assert gains.min() > -1e-9
        assert gains.max() < 1.0
    with pytest.raises(iq.BadInput, match="damping"):
        damped_pseudoinverse(PLANAR, 0.4, -1.0)


def test_the_condition_number_is_returned_on_request():
    rng = np.random.default_rng(3)
    for m in (2, 4, 6, 8):
        J = rng.normal(size=(6, m))
        h = pitch_away(rng, J)
        X, condition = iq.pseudoinverse(J, h, return_condition=True)
        np.testing.assert_allclose(X, iq.pseudoinverse(J, h), atol=1e-12 * np.abs(X).max())
        assert 1.0 <= condition < 1e6
        assert condition == pytest.approx(iq.systems.existence(J, h).condition)
    J = rng.normal(size=(6, 3))
    h = iq.principal_pitches(J)[0]
    near = [iq.pseudoinverse(J, h + d, return_condition=True)[1] for d in (1e-2, 1e-4, 1e-6)]
    assert near[2] > 50.0 * near[1] > 2500.0 * near[0]


@pytest.mark.parametrize("distance", [1e3, 1e6, 1e9])
def test_accuracy_far_from_the_origin(distance):
    """Against fifty digits of the same numbers: rounding times distance over length."""
    rng = np.random.default_rng(9)
    T = motion(rng)
    T[:3, 3] = distance * np.array([0.6, -0.48, 0.64])
    with mpmath.workdps(50):
        for m in (1, 3, 5, 6):
            J = iq.adjoint(T) @ rng.normal(size=(6, m))
            X, condition = iq.pseudoinverse(J, 0.37, return_condition=True)
            assert condition > 0.1 * distance
            assert relative_error(X, exact_pseudoinverse(J, 0.37), J) <= 2.0 * EPS * condition


@pytest.mark.parametrize("decades", [1, 3, 6, 9])
def test_accuracy_for_columns_of_very_different_size(decades):
    rng, inverted = np.random.default_rng(decades), 0
    with mpmath.workdps(50):
        for m in rng.integers(1, 6, size=10):
            J, h = rng.normal(size=(6, m)) * 10.0 ** rng.uniform(-decades, decades, size=m), float(rng.normal())
            if iq.has_pseudoinverse(J, h):
                X, condition = iq.pseudoinverse(J, h, return_condition=True)
                inverted += 1
                assert relative_error(X, exact_pseudoinverse(J, h), J) <= 10.0 * EPS * condition
    assert inverted > 8


def test_dependent_joints_within_the_rounding_of_others_are_refused():
    """Seven joints of sizes 1e-9 to 1e9: the shortest solution uses those that rounding of the largest hides."""
    rng = np.random.default_rng(4)
    J = rng.normal(size=(6, 7)) * 10.0 ** np.linspace(-9.0, 9.0, 7)
    with pytest.raises(iq.NoPseudoinverse, match="so nearly dependent"):
        iq.pseudoinverse(J, 0.3)


def random_form(rng, n):
    A = rng.normal(size=(n, n))
    return A + A.T


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=st.integers(1, 6), m=st.integers(1, 6), k=st.integers(1, 6))
def test_the_adjoint_of_a_map_between_forms(seed, n, m, k):
    """(2.12) on vectors; twice is nothing; of a product the product the other way round."""
    rng = np.random.default_rng(seed)
    M, N, K = (random_form(rng, size) for size in (m, n, k))
    A, B = rng.normal(size=(n, m)), rng.normal(size=(m, k))
    x, y = rng.normal(size=m), rng.normal(size=n)
    star = form_adjoint(A, M, N)
    scale = np.linalg.cond(M) * np.linalg.cond(N) * np.linalg.cond(K) * (1.0 + np.abs(star).max())
    assert x @ M @ star @ y == pytest.approx((A @ x) @ N @ y, abs=1e-12 * scale)
    np.testing.assert_allclose(form_adjoint(star, N, M), A, atol=1e-12 * scale)
    np.testing.assert_allclose(form_adjoint(A @ B, K, N), form_adjoint(B, K, M) @ star, atol=1e-11 * scale)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, m=st.integers(1, 8), h=st.floats(-3.0, 3.0))
def test_the_h_adjoint_of_a_jacobian(seed, m, h):
    rng = np.random.default_rng(seed)
    J, A = rng.normal(size=(6, m)), rng.normal(size=(m, m))
    M = A @ A.T + np.eye(m)
    Q = iq.pitch_form(h)
    np.testing.assert_allclose(h_adjoint(J, h), J.T @ Q, atol=1e-15)
    np.testing.assert_allclose(h_adjoint(J, h, joint_metric=M), form_adjoint(J, M, Q), atol=1e-12)
    np.testing.assert_allclose(h_adjoint(J, h) @ J, iq.systems.gram_matrix(J, h), atol=1e-12)
    Ad = iq.adjoint(motion(rng))
    np.testing.assert_allclose(h_adjoint(Ad @ J, h) @ Ad, h_adjoint(J, h), atol=1e-11)


def test_a_singular_form_has_no_adjoint():
    for domain in ([[1, 1], [0, 1]], np.zeros((2, 2))):
        with pytest.raises(iq.BadInput, match="domain"):
            form_adjoint(np.eye(2), domain, np.eye(2))
    with pytest.raises(iq.BadInput, match="domain"):
        form_adjoint(np.eye(6), iq.pitch_form(np.inf), np.eye(6))


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_each_condition_can_fail_alone(seed):
    """The other generalised inverses, each with the condition that it does not meet."""
    rng = np.random.default_rng(seed)
    J = generic(rng, 4, 3)
    h = pitch_away(rng, J)
    X = iq.pseudoinverse(J, h)
    assert penrose_conditions(J, np.zeros((4, 6)), h).met == (False, True, True, True)
    # (I - X J) N (I - J X) changes neither J X nor X J, but J cannot undo it.
    N = rng.normal(size=(4, 6))
    assert penrose_conditions(J, X + (np.eye(4) - X @ J) @ N @ (np.eye(6) - J @ X), h).met == (True, False, True, True)
    along_metric = iq.dual_projectors(J, metric=np.diag(rng.uniform(0.5, 2.0, size=6))).motion
    assert penrose_conditions(J, X @ along_metric, h).met == (True, True, False, True)
    other = iq.pseudoinverse(J, h, joint_metric=rng.uniform(0.5, 5.0, size=4))
    assert penrose_conditions(J, other, h).met == (True, True, True, False)


def test_residuals_measure_an_error_of_the_pseudoinverse():
    rng = np.random.default_rng(4)
    J = generic(rng, 3)
    h = pitch_away(rng, J)
    X = iq.pseudoinverse(J, h) * (1.0 + 1e-6)
    found = penrose_conditions(J, X, h)
    assert not all(found.met)
    np.testing.assert_allclose(found.residuals[:2], 1e-6, rtol=1e-3)
    assert all(penrose_conditions(J, X, h, tolerance=1e-5).met)


@every_class
def test_the_three_conditions_agree_and_so_does_the_reciprocal(key):
    rng = np.random.default_rng(31)
    for upper in [False, True] if key[0] < 3 else [False]:
        J, _ = sample(rng, key, upper=upper, extra=1)
        for h in (-2.5, 0.0, 1.7):
            found = iq.systems.existence(J, h)
            assert found.exists == admits(key[1]) == iq.has_pseudoinverse(J, h)
            assert iq.systems.ScrewSystem(J).reciprocal(h).has_pseudoinverse(h) == found.exists


def test_the_conditions_agree_at_exact_principal_pitches():
    # Exact numbers: h is a principal pitch to the last bit.
    S = np.array([(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, -0.25, 0), (0, 0, 1, 0, 0, 2)]).T
    for h in (0.5, -0.25, 2.0):
        found = iq.systems.existence(S, h)
        assert (found.rank, found.gram_rank) == (3, 2)
        z = found.certificate
        np.testing.assert_allclose(S.T @ iq.pitch_form(h) @ z, 0.0, atol=1e-14)
        assert iq.se3.pitch(z) == pytest.approx(h)
        assert not iq.systems.ScrewSystem(S).reciprocal(h).has_pseudoinverse(h)


def test_all_three_numbers_are_small_near_a_principal_pitch():
    rng = np.random.default_rng(5)
    J = rng.normal(size=(6, 4))
    for h in iq.principal_pitches(J):
        for off in (1e-3, 1e-6, 1e-9):
            found = iq.systems.existence(J, h + off)
            assert found.exists
            assert found.certificate is None
            for number in (found.gram_eigenvalue, found.angle, found.pitch_distance):
                assert off * 1e-3 < number < off * 1e3


def test_of_zero_twists_it_is_zero():
    assert iq.systems.existence(np.zeros((6, 2)), 0.0).exists
    np.testing.assert_array_equal(iq.pseudoinverse(np.zeros((6, 3)), 0.5), np.zeros((3, 6)))


def test_tangency_at_a_point_outside_the_system_proves_nothing():
    """[DS] Theorem 3.1 (iii) prints "at some non-zero point"; its proof, and its truth, need a point of S."""
    S = np.array([[1.0, 0, 0, 0, 0, 0]]).T  # a revolute axis, h = 1
    z = np.array([0.0, 1.0, 0.0, 0.0, 1.0, 0.0])  # pitch 1, so a point of q_1, outside S
    assert z @ iq.pitch_form(1.0) @ z == 0.0
    assert S.T @ iq.pitch_form(1.0) @ z == 0.0  # S lies in the tangent space there
    assert iq.systems.existence(S, 1.0).exists
