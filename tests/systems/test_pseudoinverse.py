import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.exact_pseudoinverse import exact_pseudoinverse, relative_error
from support.random_systems import motion

import invariantqp as iq
from invariantqp.engine import core
from invariantqp.systems.pseudoinverses import factors

EPS = np.finfo(float).eps
SEED = st.integers(0, 10_000)
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
@given(SEED, st.integers(1, 8), st.integers(1, 6))
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


@pytest.mark.parametrize("m", [6, 7, 9])
def test_at_rank_six_it_is_moore_penrose_for_every_pitch(m):
    rng = np.random.default_rng(m)
    J = rng.normal(size=(6, m))
    for h in (-1e3, -0.2, 0.0, 0.3, 1e3):
        np.testing.assert_allclose(iq.pseudoinverse(J, h), np.linalg.pinv(J), atol=1e-13 * np.linalg.cond(J))
        assert iq.has_pseudoinverse(J, h)


def test_below_rank_six_it_is_not():
    rng = np.random.default_rng(0)
    J = rng.normal(size=(6, 5))
    change = np.linalg.norm(iq.pseudoinverse(J, 0.7) - np.linalg.pinv(J)) / np.linalg.norm(np.linalg.pinv(J))
    assert change > 0.1


@EXAMPLES
@given(SEED, st.integers(1, 7))
def test_the_metric_decides_only_where_joints_are_dependent(seed, m):
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
@given(SEED, st.integers(1, 6))
def test_frames_and_units_leave_the_answer_alone(seed, m):
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
def test_where_no_pitch_works_the_error_says_so(h):
    planar = np.column_stack([iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.7, 0.3, 0))])
    with pytest.raises(iq.NoPseudoinverse, match=r"No h works for this system: use Complement\(Z\)") as caught:
        iq.pseudoinverse(planar, h)
    assert (caught.value.rank, caught.value.gram_rank) == (3, int(h != 0.0))
    assert caught.value.principal_pitches.shape == (0,)
    np.testing.assert_allclose(planar.T @ iq.pitch_form(h) @ caught.value.self_reciprocal, 0.0, atol=1e-15)


@pytest.mark.parametrize("offset", [1e-3, 1e-5, 1e-7, 1e-9])
def test_it_exists_however_near_a_principal_pitch(offset):
    """Its norm grows as one over the distance; it does not cease before rounding says so."""
    rng = np.random.default_rng(12)
    J = rng.normal(size=(6, 3))
    p = iq.principal_pitches(J)[0]
    assert iq.has_pseudoinverse(J, p + offset)
    P = iq.pseudoinverse(J, p + offset)
    near = iq.pseudoinverse(J, p + 1e-2)
    assert np.linalg.norm(P) * offset == pytest.approx(np.linalg.norm(near) * 1e-2, rel=0.2)


def test_nothing_moves_nothing():
    np.testing.assert_array_equal(iq.pseudoinverse(np.zeros((6, 3)), 0.5), np.zeros((3, 6)))
    assert iq.has_pseudoinverse(np.zeros((6, 3)), 0.5)


def intrinsic_condition(J, h):
    """cond(R) |Q_h| |(U'Q_h U)^-1| of J = UR, lengths in the arm's own unit (a power of two, so exact)."""
    unit = 2.0 ** np.round(np.log2(np.linalg.norm(J[3:]) / np.linalg.norm(J[:3])))
    scaled = J / np.array([1.0] * 3 + [unit] * 3)[:, None]
    U, R = np.linalg.qr(scaled)
    if J.shape[1] >= 6:
        return np.linalg.cond(R)
    Q = iq.pitch_form(h / unit)
    return np.linalg.cond(R) * np.linalg.norm(Q, 2) * np.linalg.norm(np.linalg.inv(U.T @ Q @ U), 2)


def gram_route(J, h):
    Q = iq.pitch_form(h)
    return np.linalg.solve(J.T @ Q @ J, J.T @ Q)


def ill_conditioned(rng, m, condition):
    U, _ = np.linalg.qr(rng.normal(size=(6, m)))
    V, _ = np.linalg.qr(rng.normal(size=(m, m)))
    return U * np.geomspace(1.0, 1.0 / condition, m) @ V


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6, 7])
def test_accurate_to_its_intrinsic_condition(m, unit):
    """Fifty digits say: at most 100 eps times the condition of R and of U'Q_h U, whatever the unit of length."""
    rng = np.random.default_rng(100 + m)
    with mpmath.workdps(50):
        for _ in range(6):
            J = rng.normal(size=(6, m)) * np.array([1.0] * 3 + [unit] * 3)[:, None]
            h = unit * rng.uniform(-1.0, 1.0)
            error = relative_error(iq.pseudoinverse(J, h), exact_pseudoinverse(J, h), J)
            assert error <= 100 * EPS * intrinsic_condition(J, h)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("m", [2, 3, 4, 5])
def test_accurate_where_the_gram_route_has_lost_half_its_digits(m, unit):
    """cond(J) = 1e7: forming J'Q_h J squares it."""
    rng = np.random.default_rng(200 + m)
    ours, grams = [], []
    with mpmath.workdps(50):
        for _ in range(4):
            J = ill_conditioned(rng, m, 1e7) * np.array([1.0] * 3 + [unit] * 3)[:, None]
            h = unit * 0.6
            exact = exact_pseudoinverse(J, h)
            condition = intrinsic_condition(J, h)
            ours.append(relative_error(iq.pseudoinverse(J, h), exact, J))
            grams.append(relative_error(gram_route(J, h), exact, J))
            assert ours[-1] <= 100 * EPS * condition
    assert np.median(grams) > 1e-5
    assert np.median(ours) < 1e-7
    assert np.median(ours) < 1e-3 * np.median(grams)


def test_accurate_with_a_joint_metric():
    rng = np.random.default_rng(3)
    A = rng.normal(size=(8, 8))
    M = A @ A.T + np.eye(8)
    M = 0.5 * (M + M.T)
    with mpmath.workdps(50):
        J = rng.normal(size=(6, 8))
        error = relative_error(iq.pseudoinverse(J, 0.3, joint_metric=M), exact_pseudoinverse(J, 0.3, M), J)
    assert error <= 100 * EPS * np.linalg.cond(J) * np.linalg.cond(M)


BAD = {
    "nan": (lambda: iq.pseudoinverse(np.full((6, 2), np.nan), 0.5), "J"),
    "infinite pitch": (lambda: iq.pseudoinverse(np.eye(6), np.inf), "h"),
    "nan pitch": (lambda: iq.pseudoinverse(np.eye(6), np.nan), "h"),
    "shape": (lambda: iq.pseudoinverse(np.eye(5), 0.5), "J"),
    "has: pitch": (lambda: iq.has_pseudoinverse(np.eye(6), np.inf), "h"),
    "has: shape": (lambda: iq.has_pseudoinverse([1.0, 2.0], 0.5), "J"),
    "metric": (lambda: iq.pseudoinverse(np.eye(6), 0.5, joint_metric=-np.ones(6)), "joint_metric"),
    "metric shape": (lambda: iq.pseudoinverse(np.eye(6), 0.5, joint_metric=np.eye(5)), "joint_metric"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case):
    call, argument = BAD[case]
    with pytest.raises(iq.BadInput, match=f"{argument}: found .*; expected ") as caught:
        call()
    assert caught.value.argument == argument


@pytest.mark.skipif(core is None, reason="no compiled core here")
def test_the_core_answers_what_is_well_conditioned():
    rng, answered = np.random.default_rng(0), 0
    for k in range(600):
        m, h = int(rng.integers(1, 13)), float(rng.normal() * 10.0 ** rng.uniform(-3.0, 2.0))
        J = rng.normal(size=(6, m)) * 10.0 ** rng.uniform(-2.0, 2.0)
        J[3:] *= 10.0 ** rng.uniform(-4.0, 4.0)
        if k % 4 == 0 and m > 1:  # nearly dependent
            J[:, 0] = J[:, 1] + 10.0 ** rng.uniform(-9.0, 0.0) * J[:, 0]
        if k % 4 == 1 and 1 < m < 6:  # at a principal pitch, or near it
            h = float(iq.systems.principal_pitches(J)[0] * (1.0 + 10.0 ** rng.uniform(-12.0, 0.0)))
        found, known = core.pseudoinverse(J, h), factors(J, h)
        assert found is None or known.exists
        if found is not None:
            answered += 1
            error = np.linalg.norm(found - known.inverse)
            assert error <= 1e-14 * known.condition * np.linalg.norm(known.inverse)
    assert 300 < answered < 560
    J = rng.normal(size=(6, 3))
    for bad in (J.tolist(), J.astype(np.float32), J[:5], np.nan * J, rng.normal(size=(6, 17)), 0.0 * J):
        assert core.pseudoinverse(bad, 0.1) is None
    for h in (np.nan, np.inf):
        assert core.pseudoinverse(J, h) is None
