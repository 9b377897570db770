from itertools import pairwise

import numpy as np
import pytest
from support.random_systems import CLASSES, admits, distance, every_class, moduli, motion, reciprocal_of, sample
from support.repeats import repeats

import invariantqp as iq
from invariantqp.systems.classification import NEAR_BORDER, normal_form
from invariantqp.systems.subspaces import TOLERANCE


def test_noisy_moved_mixed_systems():
    rng = np.random.default_rng(20161)
    cases = [(key, False) for key in CLASSES] + [(key, True) for key in CLASSES if key[0] < 3]
    wrong = []
    for i in range(repeats(10_000, 1000)):
        key, upper = cases[i % len(cases)]
        J, values = sample(rng, key, upper=upper, noise=1e-9, extra=(i // len(cases)) % 3)
        kind = iq.gibson_hunt(J)
        if (kind.name, kind.dimension) != (key[1], 6 - key[0] if upper else key[0]):
            wrong.append((key, upper, kind.name, kind.near_border))
        else:
            # Moduli are as good as the columns are independent: 1e-9 times their condition, squared in a pitch.
            assert kind.moduli == pytest.approx(values, abs=1e-3)
    assert len(wrong) <= i // 300, wrong  # where the pitch, and so the own length, is below a hundredth
    assert all(near for *_, near in wrong), wrong


@pytest.mark.cases(8)
@every_class
def test_the_motion_takes_the_system_to_its_normal_form(key):
    rng = np.random.default_rng(7)
    for k in range(20):
        upper = key[0] < 3 and k % 4 == 0
        J, values = sample(rng, key, upper=upper)
        kind = iq.gibson_hunt(J)
        named = reciprocal_of(kind.normal_form) if upper else kind.normal_form
        assert (kind.reciprocal, kind.admits_pseudoinverse) == (upper, admits(key[1]))
        assert distance(named, iq.adjoint(kind.motion) @ J) < 1e-9
        np.testing.assert_allclose(kind.normal_form, normal_form(*key, values), atol=1e-9)
        np.testing.assert_allclose(kind.motion[:3, :3] @ kind.motion[:3, :3].T, np.eye(3), atol=1e-14)
        assert np.linalg.det(kind.motion) == pytest.approx(1.0)


# One way out of each special class into the next more general one, (special, general, columns at a distance d).
WAYS_OUT = [
    ("IIA", "IA", lambda d: [(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, 0.5 + d, 0)]),
    ("IIB", "IB", lambda d: [(1, 0, 0, 0.5, 0, 0), (0, 0, 0, d, 1, 0)]),
    ("IIC", "IB", lambda d: [(0, 0, 0, 1, 0, 0), (d, 0, 0, 0, 1, 0)]),
    ("IIC", "IIB", lambda d: [(0, 0, 0, 1, 0, 0), (0, 0, d, 0, 1, 0)]),
    ("h=inf", "h", lambda d: [(d, 0, 0, 1, 0, 0)]),
    ("IA2", "IA1", lambda d: [(1, 0, 0, -0.5, 0, 0), (0, 1, 0, 0, 0.5, 0), (0, 0, 1, 0, 0, 0.5 + d)]),
    ("IIA", "IA2", lambda d: [(1, 0, 0, 0.5 + d, 0, 0), (0, 1, 0, 0, 0.5, 0), (0, 0, 1, 0, 0, 0.5)]),
    ("IB3", "IB0", lambda d: [(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, -0.5, 0), (0, 0, 0, d, 0, 1)]),
    ("IB3", "IA1", lambda d: [(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, -0.5, 0), (0, 0, d, 0, 0, 1)]),
    ("IIB", "IB3", lambda d: [(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, 0.5 + d, 0), (0, 0, 0, 0, 0, 1)]),
    ("IB0", "IA1", lambda d: [(1, 0, 0, 0.5, 0, 0), (0, 1, 0, 0, 0.5, 0), (0, 0, d, 1, 0, 0.5)]),
    ("IIC", "IC", lambda d: [(1, 0, 0, 0.5, 0, 0), (0, 0, 0, d, 1, 0), (0, 0, 0, 0, 0, 1)]),
    ("IC", "IB0", lambda d: [(1, 0, 0, 0, 0, 0), (0, 0, d, 0, 1, 0), (0, 0, 0, 1, 0, 0.5)]),
    ("IID", "IIC", lambda d: [(d, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)]),
]


@pytest.mark.cases(7)
@pytest.mark.parametrize(("special", "general", "columns"), WAYS_OUT, ids=[f"{a}-to-{b}" for a, b, _ in WAYS_OUT])
def test_types_change_once_across_a_border_and_are_near_it(special, general, columns):
    rng = np.random.default_rng(3)
    Ad = iq.adjoint(motion(rng))
    names, kinds = [], []
    for exponent in np.arange(-14.0, -1.0, 0.125):
        S = Ad @ np.array(columns(10.0**exponent), dtype=float).T
        kinds.append(iq.gibson_hunt(S @ rng.normal(size=(S.shape[1], S.shape[1]))))
        names.append(str(kinds[-1]))
    assert names[0] == special
    assert names[-1] == general
    for before, after in pairwise(kinds):
        if str(before) != str(after):
            assert before.near_border or after.near_border
    for kind in kinds:
        if str(kind) not in {special, general}:
            assert kind.near_border
    # Exactly on the border the answer is the special class, and beyond doubt.
    exact = iq.gibson_hunt(Ad @ np.array(columns(0.0), dtype=float).T)
    assert str(exact) == special
    assert exact.margin > 1e5
    close = iq.gibson_hunt(np.array(columns(TOLERANCE * 3.0), dtype=float).T)
    assert close.near_border


def name_at(J, kind, tolerance):
    other = iq.gibson_hunt(J, tolerance)
    return str(other) if other.dimension == kind.dimension else f"{other} ({other.dimension}-system)"


def test_the_next_name_is_found_just_past_the_border():
    """Over noisy systems of every type: with the tolerance a hundredth past the nearest border, in the whole system."""
    rng = np.random.default_rng(1381)
    near, systems = 0, repeats(3000, 500)
    for i in range(systems):
        key = CLASSES[i % len(CLASSES)]
        upper = key[0] < 3 and bool(rng.integers(2))
        J, _ = sample(rng, key, upper=upper, noise=10.0 ** rng.uniform(-9.0, -5.0), extra=int(rng.integers(3)))
        kind = iq.gibson_hunt(J)
        if kind.near_border:
            near += 1
            border = kind.borders[0]
            past = border.value * (0.99 if border.vanishes else 1.01)
            assert kind.next == name_at(J, kind, past) != str(kind)
    assert near > systems // 3


@pytest.mark.parametrize("moment", [0.0, 1e-3])
def test_the_type_past_the_border_of_a_hinge_is_a_slide(moment):
    """Its angular part is nearly all of it: an error that hides that part leaves no zero system."""
    kind = iq.gibson_hunt(np.array([0.0, 0.0, 1.0, moment, 0.0, moment]))
    assert (str(kind), kind.next) == ("h", "h=inf")


def test_two_quantities_of_one_small_number_are_one_border():
    """A small angular part is a small difference of pitches too; no system nearby is of the type between the two."""
    J = np.array([(1, 0, 0, -0.5, 0, 0), (0, 1, 0, 0, 0.25, 0), (0, 0, 3e-7, 0, 0, 1)]).T
    kind = iq.gibson_hunt(J)
    first, second = kind.borders[:2]
    assert {first.quantity, second.quantity} == {"smallest angular part", "pitch difference"}
    assert first.value != second.value
    assert (str(kind), kind.next) == ("IA1", "IB3")


def test_a_nearly_dependent_column_is_a_border_of_dimension():
    rng = np.random.default_rng(5)
    S = rng.normal(size=(6, 3))
    S[:, 2] = S[:, 0] + S[:, 1] + 1e-7 * rng.normal(size=6)
    kind = iq.gibson_hunt(S)
    assert kind.near_border
    assert any(b.quantity == "dimension" and b.margin < NEAR_BORDER for b in kind.borders)
    assert (kind.dimension, iq.gibson_hunt(S, 1e-6).dimension, iq.gibson_hunt(S, 1e-9).dimension) in {
        (2, 2, 3),
        (3, 2, 3),
    }


@pytest.mark.parametrize("reach", [0.0, 0.3, 1.0, 1000.0])
def test_nearly_concurrent_axes_need_a_reference_length(reach):
    """Three axes that miss each other by 1e-9 are a wrist beside an arm, and by themselves a very small system."""
    rng = np.random.default_rng(11)
    p = rng.normal(size=3) * reach
    J = np.array([iq.revolute(rng.normal(size=3), p) for _ in range(3)]).T
    J[:3] += 1e-9 * rng.normal(size=(3, 3))
    J[3:] += 1e-9 * max(1.0, np.abs(J[3:]).max()) * rng.normal(size=(3, 3))
    kind = iq.gibson_hunt(J, length=max(reach, 1.0))
    assert (str(kind), kind.moduli[0]) == ("IIA", pytest.approx(0.0, abs=1e-6 * max(reach, 1.0)))
    assert str(iq.gibson_hunt(J)) == "IA1"


FAR = {
    "here": (0.0, 1.0),
    "a kilometre": (1e3, 1.0),
    "1 000 km": (1e6, 1.0),
    "mm": (1.0, 1e3),
    "1 000 km in mm": (1e6, 1e3),
    "km": (1.0, 1e-3),
}


@pytest.mark.cases(6)
@pytest.mark.parametrize("where", FAR)
def test_types_are_right_in_every_frame_and_unit_or_refused(where):
    """Refused if rounding decides; moduli as accurate as the digits of the twists."""
    distance, unit = FAR[where]
    rng = np.random.default_rng(20168)
    scale, refused = np.repeat([1.0, unit], 3)[:, None], 0
    for key in CLASSES:
        for i in range(15 * (2 if key[0] < 3 else 1)):
            values = moduli(rng, key)
            S = normal_form(*key, values)
            S = reciprocal_of(S) if i >= 15 else S
            k, T = S.shape[1], motion(rng, 0.0)
            T[:3, 3] = distance * iq.exp([*rng.normal(size=3), 0, 0, 0])[:3, 0]
            J = scale * (iq.adjoint(T) @ S)
            J = J @ rng.normal(size=(k, k + i % 2)) if i % 3 else J  # as joints, or mixed
            try:
                kind = iq.gibson_hunt(J)
            except iq.BadInput:
                refused += 1
                continue
            assert (str(kind), kind.dimension) == (key[1], 6 - key[0] if i >= 15 else key[0])
            expected = [x * (1.0 if n == "p" else unit) for x, n in zip(values, kind.modulus_names, strict=True)]
            near = max(1e-6, 1e-7 * distance) * max(1.0, unit)
            assert kind.moduli == pytest.approx(expected, abs=near)
            assert len(iq.systems.ScrewSystem(J).pencil.blind) == 6
    assert refused <= (5 if distance == 1e6 else 0)


def test_twists_too_far_from_the_origin_are_refused():
    turned = iq.exp([0.3, 0.5, -0.2, 0.0, 0.0, 0.0])
    turned[:3, 3] = 1e10
    J = iq.adjoint(turned) @ np.column_stack(
        [iq.revolute((0, 0, 1), p) for p in ((0, 0, 0), (0.4, 0, 0), (0.7, 0.3, 0))]
    )
    with pytest.raises(iq.BadInput, match="Give the twists about a nearer point"):
        iq.gibson_hunt(J)
    with pytest.raises(iq.BadInput, match="Give the twists about a nearer point"):
        iq.principal_pitches(J)
    dependent = np.column_stack((J, J[:, 0] + J[:, 1]))
    for ask in (iq.systems.screw_system, iq.reciprocal, iq.systems.describe):
        with pytest.raises(iq.BadInput, match="a rank that rounding does not decide"):
            ask(dependent)
    micrometres = np.repeat([1.0, 1e6], 3)[:, None] * J  # numbers of 1e16 are no translation
    with pytest.raises(iq.BadInput, match="that rounding does not decide"):
        iq.gibson_hunt(micrometres)


def test_all_decisions_use_one_rank():
    """A column that is dependent but for 1e-9: all decisions about the system agree, and J^{+h} tells its condition."""
    rng = np.random.default_rng(8)
    U, V = (np.linalg.qr(rng.normal(size=(n, 5)))[0] for n in (6, 5))
    J = U * [1.0, 1.0, 1.0, 1.0, 1e-9] @ V
    system = iq.systems.ScrewSystem(J)
    assert system.dimension == iq.gibson_hunt(J).dimension == iq.systems.screw_system(J).shape[1] == 4
    assert (iq.reciprocal(J).shape[1], iq.systems.annihilator(J).shape[1], iq.systems.describe(J).rank) == (2, 2, 4)
    assert len(iq.principal_pitches(J)) == 2
    assert iq.pseudoinverse(J, 0.3, return_condition=True)[1] > 1e8
    assert iq.systems.ScrewSystem(J, tolerance=1e-12).dimension == 5


@pytest.mark.parametrize("p", [0.0, 1e-14, 1e-10, 1e-7, 1e-3])
def test_a_cylindric_joint_has_a_frame(p):
    """A hinge and a slide along it, or nearly: every direction across is one of its axes."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        J = iq.adjoint(motion(rng)) @ np.array([(1, 0, 0, 0, 0, 0), (0, 0, 0, 1, p, 0)]).T
        kind = iq.gibson_hunt(J)
        assert (str(kind), kind.moduli) == ("IB", (pytest.approx(p, abs=1e-9),))
        np.testing.assert_allclose(kind.motion[:3, :3] @ kind.motion[:3, :3].T, np.eye(3), atol=1e-14)
        assert distance(kind.normal_form, iq.adjoint(kind.motion) @ J) < 1e-9


@pytest.mark.parametrize("scale", [1e-8, 1e-4, 1e4, 1e8])
def test_twists_of_any_size_span_the_same(scale):
    hinges_and_slide = np.array([(0, 0, 1, 0, 0, 0), (0, 1, 0, 0, 0, 0), (0, 0, 0, 0.6, 0, 0.8)]).T
    assert str(iq.gibson_hunt(scale * hinges_and_slide)) == "IB0"
    rng = np.random.default_rng(7)
    for key in CLASSES:
        J, _ = sample(rng, key)
        assert str(iq.gibson_hunt(scale * J)) == key[1]


def test_six_system():
    rng = np.random.default_rng(1)
    kind = iq.gibson_hunt(rng.normal(size=(6, 7)))
    assert (str(kind), kind.dimension, kind.moduli, kind.admits_pseudoinverse) == ("SE3", 6, (), True)
    assert kind.normal_form.shape == (6, 0)


def test_bad_input():
    with pytest.raises(iq.BadInput, match="at least one non-zero twist"):
        iq.gibson_hunt(np.zeros((6, 2)))
    with pytest.raises(iq.BadInput, match="Transpose"):
        iq.gibson_hunt(np.ones((3, 6)))
    with pytest.raises(iq.BadInput, match="tolerance"):
        iq.gibson_hunt(np.eye(6)[:, :2], tolerance=0.0)
