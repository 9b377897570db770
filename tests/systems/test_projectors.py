"""Dual projectors: the properties of P and P* in [DS] Sect. 6, and the errors."""

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.random_systems import distance, every_class, motion, sample
from support.repeats import repeats

import invariantqp as iq
from invariantqp.engine import law
from invariantqp.systems import projectors
from invariantqp.systems.pseudoinverses import by_engine

FACE = np.eye(6)[:, [2, 3, 4]]  # turns about z, slides along x and y
LENGTHS = np.repeat([1.0, 1e3], 3)  # metres to millimetres


def rules(rng, k):
    R = rng.normal(size=(6, 6))
    return [{"h": 0.4}, {"metric": R @ R.T + np.eye(6)}, {"complement": rng.normal(size=(6, 6 - k))}]


def leak(split):
    """The largest |W'Ps| over |W||P||s|: constraints W do no work on projected twists."""
    scale = np.repeat([1.0, split.unit], 3)[:, None]
    W, P = split.constraints * scale, split.motion / scale * scale.T
    size = np.linalg.norm(W, axis=0)[:, None] * max(np.linalg.norm(P), 1e-300)
    return (np.abs(W.T @ P) / size).max(initial=0.0)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**31), k=st.integers(0, 6), which=st.integers(0, 2))
def test_projectors_split_twists_and_wrenches(seed, k, which):
    rng = np.random.default_rng(seed)
    S = rng.normal(size=(6, k))
    rule = rules(rng, k)[which]
    split = iq.dual_projectors(S, **rule)
    assume(split.norm < 1e3)
    P, F, size = split.motion, split.force, 1e-13 * max(1.0, split.norm) ** 2
    np.testing.assert_allclose(F, (np.eye(6) - P).T, atol=10 * size)
    np.testing.assert_allclose(P @ P, P, atol=10 * size)
    np.testing.assert_allclose(P @ S, S, atol=10 * size * (1 + np.abs(S).max(initial=0.0)))
    np.testing.assert_allclose(P @ split.complement, 0.0, atol=10 * size)
    np.testing.assert_allclose(F @ split.constraints, split.constraints, atol=10 * size)
    assert split.freedoms.shape == (6, k)
    assert split.complement.shape == split.constraints.shape == (6, 6 - k)
    assert leak(split) <= 1e-14


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), k=st.integers(1, 5), which=st.integers(0, 2))
def test_moved_projectors_are_those_of_the_moved_system(seed, k, which):
    rng = np.random.default_rng(seed)
    S, T = rng.normal(size=(6, k)), motion(rng)
    A, B = iq.adjoint(T), iq.coadjoint(T)
    rule = rules(rng, k)[which]
    split = iq.dual_projectors(S, **rule)
    assume(split.norm < 100)
    there = dict(rule)
    if "metric" in rule:
        there["metric"] = B @ rule["metric"] @ B.T
    if "complement" in rule:
        there["complement"] = A @ rule["complement"]
    expected, moved = iq.dual_projectors(A @ S, **there), split.moved(T)
    np.testing.assert_allclose(moved.motion, expected.motion, atol=1e-9 * split.norm)
    np.testing.assert_allclose(moved.force, expected.force, atol=1e-9 * split.norm)
    np.testing.assert_allclose(moved.motion, A @ split.motion @ np.linalg.inv(A), atol=1e-9)
    np.testing.assert_allclose(moved.force, B @ split.force @ np.linalg.inv(B), atol=1e-9)
    assert distance(moved.freedoms, expected.freedoms) < 1e-9
    assert distance(moved.complement, expected.complement) < 1e-9
    assert distance(moved.constraints, expected.constraints) < 1e-9


@pytest.mark.cases(16)
@every_class
@pytest.mark.parametrize("upper", [False, True])
def test_the_force_projector_is_the_papers_formula_if_it_exists(key, upper):
    """W (W'Q_h^-1 W)^-1 W'Q_h^-1 in fifty digits, for every Gibson-Hunt type and its reciprocals."""
    rng = np.random.default_rng(len(key[1]))
    for _ in range(4):
        S, _ = sample(rng, key, upper=upper)
        h = rng.uniform(1.5, 3.0)  # the types' pitches are in [-1, 1]
        if not iq.has_pseudoinverse(S, h):
            with pytest.raises(iq.NoProjectors) as refused:
                iq.dual_projectors(S, h=h)
            assert "No h works for this type" in str(refused.value)
            assert f"of type {key[1]}" in str(refused.value)
            continue
        split = iq.dual_projectors(S, h=h)
        with mpmath.workdps(50):
            exact = mpmath.matrix(iq.systems.screw_system(S).tolist())
            null = mpmath.qr(exact)[0][:, exact.cols :]  # W in the same digits: its rounding must not enter
            Q = mpmath.matrix(iq.pitch_form_inverse(h).tolist())
            printed = null * (null.T * Q * null) ** -1 * null.T * Q
            reference = np.array(printed.tolist(), dtype=float)
        np.testing.assert_allclose(split.force, reference, atol=1e-12 * split.norm**2)


def test_projectors_by_wrenches_are_those_by_their_freedoms():
    rng = np.random.default_rng(4)
    W = rng.normal(size=(6, 2)) @ rng.normal(size=(2, 3))  # dependent columns
    by_wrenches = iq.dual_projectors(wrenches=W, h=0.7)
    by_twists = iq.dual_projectors(iq.systems.annihilator(W), h=0.7)
    np.testing.assert_allclose(by_wrenches.motion, by_twists.motion, atol=1e-12)
    assert distance(by_wrenches.constraints, W) < 1e-12
    np.testing.assert_array_equal(iq.dual_projectors(wrenches=np.eye(6), h=1.0).motion, np.zeros((6, 6)))


@pytest.mark.parametrize("which", [0, 1, 2])
def test_projectors_scale_with_the_unit_of_length(which):
    rng = np.random.default_rng(8)
    S = rng.normal(size=(6, 3))
    rule = rules(rng, 3)[which]
    there = {
        "h": lambda h: 1e3 * h,
        "metric": lambda M: M / np.outer(LENGTHS, LENGTHS),
        "complement": lambda Z: Z * LENGTHS[:, None],
    }
    split = iq.dual_projectors(S, **rule)
    scaled = iq.dual_projectors(S * LENGTHS[:, None], **{k: there[k](v) for k, v in rule.items()})
    np.testing.assert_allclose(scaled.motion, split.motion * np.outer(LENGTHS, 1 / LENGTHS), rtol=1e-9, atol=1e-9)


def test_the_metric_makes_z_the_compliance_of_the_wrenches():
    """The twists by which a contact of stiffness M yields to its constraint wrenches are M^-1 W."""
    rng = np.random.default_rng(6)
    R = rng.normal(size=(6, 6))
    M = R @ R.T + np.eye(6)
    split = iq.dual_projectors(FACE, metric=M)
    assert distance(split.complement, np.linalg.solve(M, split.constraints)) < 1e-12
    carried = iq.CarriedMetric(M, iq.transform(translation=[0.1, 0.2, 0.3]))
    B = iq.coadjoint(iq.transform(translation=[0.1, 0.2, 0.3]))
    np.testing.assert_allclose(
        iq.dual_projectors(FACE, metric=carried).motion, iq.dual_projectors(FACE, metric=B @ M @ B.T).motion, atol=1e-12
    )


def test_a_face_contact_is_refused_at_every_pitch_with_alternatives():
    for h in (-2.0, 0.0, 0.3, 50.0):
        rng = np.random.default_rng(int(abs(h)))
        with pytest.raises(iq.NoPseudoinverse) as caught:  # a NoProjectors is one
            iq.dual_projectors(iq.adjoint(motion(rng)) @ FACE, h=h)
        error = caught.value
        assert isinstance(error, iq.NoProjectors)
        assert (error.h, error.rank, error.gram_rank) == (h, 3, 1 if h else 0)
        assert len(error.principal_pitches) == 0
        assert error.system == "a 3-system of type IIC"
        for said in ("type IIC", "No h works", "metric=", "complement="):
            assert said in str(error)
    for rule in ({"metric": np.ones(6)}, {"complement": np.eye(6)[:, [0, 1, 5]]}):
        assert iq.dual_projectors(FACE, **rule).norm == pytest.approx(1.0)


def test_projectors_at_a_principal_pitch_are_refused():
    S = np.random.default_rng(2).normal(size=(6, 3))
    h = iq.principal_pitches(S)[1]
    with pytest.raises(iq.NoProjectors, match="Choose h away from the principal pitches") as caught:
        iq.dual_projectors(S, h=h)
    z = caught.value.self_reciprocal
    np.testing.assert_allclose(z @ iq.pitch_form(h) @ S, 0.0, atol=1e-10)
    assert caught.value.gram_rank == 2
    assert leak(iq.dual_projectors(S, h=h + 0.5)) <= 1e-14


@pytest.mark.parametrize(
    ("arguments", "rule", "argument", "said"),
    [
        ((), {"h": 1.0}, "S", "neither S nor wrenches"),
        ((FACE,), {"h": 1.0, "wrenches": FACE}, "S", "both S and wrenches"),
        ((FACE,), {}, "h", "no rule for the complement"),
        ((FACE,), {"h": 1.0, "metric": np.ones(6)}, "h", "h and metric"),
        ((FACE,), {"h": np.inf}, "h", "Killing"),
        ((FACE,), {"complement": FACE}, "complement", "shares the twist"),
        ((FACE,), {"complement": np.eye(6)[:, :2]}, "complement", "rank 2"),
        ((FACE,), {"complement": np.eye(6)}, "complement", "rank 6"),
        ((FACE,), {"metric": -np.ones(6)}, "metric", "eigenvalue -1"),
        ((FACE,), {"metric": iq.CarriedMetric(np.ones(6))}, "form", "with a .4, 4. pose"),
    ],
)
def test_bad_input_names_the_argument(arguments, rule, argument, said):
    with pytest.raises(iq.BadInput, match=said) as caught:
        iq.dual_projectors(*arguments, **rule)
    assert caught.value.argument == argument


def hard_case(rng, case):
    """A system or wrenches, a rule, and the same with each matrix measured in a unit of length."""
    k, given = int(rng.integers(1, 7)), ("S", "wrenches")[int(rng.random() < 0.3)]
    S = rng.normal(size=(6, k)) * 10.0 ** rng.uniform(-2.0, 2.0)
    S[3:] *= 10.0 ** rng.uniform(-4.0, 4.0)
    if case % 4 == 0 and k > 1:  # nearly dependent
        S[:, 0] = S[:, 1] + 10.0 ** rng.uniform(-9.0, 0.0) * S[:, 0]
    if case % 4 == 1:  # one half is zero
        S[3 * (case % 8 > 4) :][:3] = 0.0
    rule = rules(rng, k if given == "S" else 6 - k)[case % 3]
    if "h" in rule:
        rule = {"h": float(rng.normal() * 10.0 ** rng.uniform(-3.0, 2.0))}

    def scaled(scale):
        S_in = {"S": S / scale, "wrenches": S * scale}[given]
        h = rule.get("h", 0.0) / scale[-1, 0]
        Z, M = rule.get("complement", S[:, :0]) / scale, rule.get("metric", np.eye(6)) * scale * scale.T
        return [S_in, iq.pitch_form(h), *([Z] if Z.size else []), *([M] if "metric" in rule else [])]

    return {given: S}, rule, scaled


def test_the_engine_projects_well_conditioned_systems(monkeypatch):
    rng, answered, cases = np.random.default_rng(0), {"h": 0, "metric": 0, "complement": 0}, repeats(450, 225)
    for case in range(cases):
        given, rule, scaled = hard_case(rng, case)
        arguments = given | rule
        found = law.projectors(*(arguments.get(name) for name in ("S", "wrenches", "h", "complement", "metric")))
        if found is None:
            continue
        with monkeypatch.context() as without:
            without.setattr(projectors, "by_engine", lambda *_: None)
            known = iq.dual_projectors(**given, **rule)
        answered[next(iter(rule))] += 1
        split, scale = projectors.DualProjectors(*found), np.repeat([1.0, known.unit], 3)[:, None]
        assert split.unit == known.unit or "wrenches" in given
        near = 1e-13 * np.prod([np.linalg.cond(A) for A in scaled(scale)]) * max(1.0, known.norm) ** 2
        assert abs(split.norm - known.norm) <= near or split.unit != known.unit
        np.testing.assert_allclose(split.motion / scale * scale.T, known.motion / scale * scale.T, rtol=0.0, atol=near)
        np.testing.assert_allclose(split.force * scale / scale.T, known.force * scale / scale.T, rtol=0.0, atol=near)
        for name, lengths in (("freedoms", 1 / scale), ("complement", 1 / scale), ("constraints", scale)):
            own, other = (getattr(a, name) * lengths for a in (split, known))
            assert own.shape == other.shape
            assert own.shape[1] % 6 == 0 or distance(own, other) <= near
    assert all(cases // 6 < count < 0.95 * cases // 3 for count in answered.values()), answered


def test_the_engine_returns_none_for_bad_input():
    nowhere = np.random.default_rng(0).normal(size=(6, 65))
    for bad in (FACE[:5], np.nan * FACE, nowhere, 0.0 * FACE, None):
        assert by_engine(law.projectors, bad, None, 0.1, None, None) is None
    assert law.projectors(None, FACE[:, :0], 0.1, None, None) is None
    for rule in (
        (np.nan, None, None),
        (None, FACE[:, :2], None),
        (None, None, None),
        (0.0, None, None),
    ):
        assert by_engine(law.projectors, np.eye(6)[:, :3], None, *rule) is None
    for metric in (-np.eye(6), np.ones((6, 6)), np.eye(6) + np.eye(6, k=1), np.diag([1.0, 1, 1, 1, 1, 0]), np.eye(5)):
        assert by_engine(law.projectors, FACE, None, None, None, metric) is None
    assert law.projectors(FACE, None, None, FACE, None) is None
