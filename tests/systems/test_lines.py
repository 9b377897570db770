from itertools import combinations
from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.random_systems import distance, every_class, motion, sample

import invariantqp as iq
from invariantqp.systems.classification import normal_form
from invariantqp.systems.lines import alpha_plane, beta_plane, null_plane

Q0 = iq.pitch_form(0.0)


def line(rng):
    return iq.revolute(rng.normal(size=3), rng.normal(size=3))


def transversals_by_the_line_equations(lines):
    """Lines that meet four given ones: through x = a1 + t d1 the one that meets lines 2 and 3, made to meet line 4."""
    points, directions = zip(*((iq.se3.axis(s)[1], iq.se3.axis(s)[0]) for s in lines.T), strict=True)

    def through(t):
        x = points[0] + t * directions[0]
        n2, n3 = (np.cross(points[i] - x, directions[i]) for i in (1, 2))
        return x, np.cross(n2, n3)

    def miss(t):
        x, u = through(t)
        return np.dot(np.cross(u, directions[3]), points[3] - x)

    nodes = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    cubic = np.polyfit(nodes, [miss(t) for t in nodes], 3)
    assert abs(cubic[0]) < 1e-9 * np.abs(cubic).max()  # the cubic term cancels
    return [iq.revolute(through(t)[1], through(t)[0]) for t in np.roots(cubic[1:]) if abs(t.imag) < 1e-12]


def test_four_lines_have_the_transversals_that_the_line_equations_give():
    rng = np.random.default_rng(1861)
    counts = set()
    for _ in range(60):
        J = np.array([line(rng) for _ in range(4)]).T
        found = iq.involution(J)
        expected = [np.real(s) for s in transversals_by_the_line_equations(J)]
        assert found.transversal_count == len(expected)
        assert found.transversals.shape == (6, len(expected))
        assert not found.holds
        assert not found.double
        counts.add(len(expected))
        for s in expected:
            assert min(distance(t[:, None], s[:, None]) for t in found.transversals.T) < 1e-7
    assert counts == {0, 2}


@pytest.mark.parametrize("m", [2, 3, 4, 5, 6])
def test_generic_lines_are_not_in_involution(m):
    rng = np.random.default_rng(m)
    J = np.array([line(rng) for _ in range(m)]).T
    found = iq.involution(J)
    assert not found.holds
    assert found.joint_forces is None
    assert found.equilibrium_wrench is None
    assert found.determinant == pytest.approx(np.linalg.det(J.T @ Q0 @ J))
    assert found.transversal_count == {2: inf, 3: inf, 4: found.transversal_count, 5: 0, 6: 0}[m]


def check_transversals(J, found):
    for t in found.transversals.T:
        np.testing.assert_allclose(J.T @ Q0 @ t, 0.0, atol=1e-9)
        assert iq.se3.pitch(t) == pytest.approx(0.0, abs=1e-9)
        assert np.linalg.norm(t[:3]) == pytest.approx(1.0)
    np.testing.assert_allclose(J.T @ Q0 @ found.at_infinity, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.at_infinity[:3], 0.0)
    for columns in (found.transversals, found.at_infinity):
        assert np.linalg.matrix_rank(columns) == columns.shape[1]


def check(J, found):
    """What every involution must satisfy."""
    assert found.holds
    check_transversals(J, found)
    W, forces = found.equilibrium_wrench, found.joint_forces
    np.testing.assert_allclose(J.T @ W, 0.0, atol=1e-10)
    np.testing.assert_allclose(Q0 @ J @ forces, W, atol=1e-10)
    assert np.linalg.norm(forces) == pytest.approx(1.0)
    assert W[:3] @ W[3:] == pytest.approx(0.0, abs=1e-10)  # a force along a line, or a couple


def pencil(rng, n, *, parallel=False):
    """n lines of a plane pencil, concurrent or parallel."""
    p, a, b = rng.normal(size=(3, 3))
    if parallel:
        return [iq.revolute(a, p + t * b) for t in rng.normal(size=n)]
    return [iq.revolute(a + t * b, p) for t in rng.normal(size=n)]


@pytest.mark.parametrize("parallel", [False, True])
def test_two_lines_are_in_involution_where_they_are_coplanar(parallel):
    J = np.array(pencil(np.random.default_rng(2), 2, parallel=parallel)).T
    found = iq.involution(J)
    check(J, found)
    assert found.transversal_count == inf
    assert str(iq.gibson_hunt(J)) == ("IIB" if parallel else "IIA")


def test_three_lines_are_in_involution_where_two_are_coplanar():
    rng = np.random.default_rng(3)
    for _ in range(20):
        J = np.array([*pencil(rng, 2), line(rng)]).T
        check(J, iq.involution(J))
        K = np.array([line(rng) for _ in range(3)]).T
        found = iq.involution(K)
        product = 2.0 * (K[:, 0] @ Q0 @ K[:, 1]) * (K[:, 1] @ Q0 @ K[:, 2]) * (K[:, 2] @ Q0 @ K[:, 0])
        assert found.determinant == pytest.approx(product)
        assert not found.holds


# The table of lines.py: reciprocal, transversals, those at infinity, whether one is double, whether in involution.
OF_FOUR_LINES = [
    ("IA", (-0.5, 0.25), 2, 0, False, False),
    ("IA", (0.25, 0.5), 0, 0, False, False),
    ("IIA", (0.5,), 0, 0, False, False),
    ("IB", (0.5,), 1, 1, False, False),
    ("IA", (0.0, 0.5), 1, 0, True, True),
    ("IIB", (0.7,), 0, 1, True, True),
    ("IIA", (0.0,), inf, 0, False, True),
    ("IIB", (0.0,), inf, 1, False, True),
]


@pytest.mark.parametrize(("name", "moduli", "count", "at_infinity", "double", "holds"), OF_FOUR_LINES)
def test_four_lines_by_the_type_of_their_reciprocal(name, moduli, count, at_infinity, double, holds):
    """Four lines of the 4-system reciprocal to a given 2-system, found by solving for pitch 0 in it."""
    rng = np.random.default_rng(11)
    S = iq.adjoint(motion(rng)) @ iq.reciprocal(normal_form(2, name, moduli))
    for _ in range(5):
        lines = []
        while len(lines) < 4:
            a, b = S @ rng.normal(size=4), S @ rng.normal(size=4)
            roots = np.roots([b @ Q0 @ b, 2.0 * (a @ Q0 @ b), a @ Q0 @ a])
            line = a + rng.choice(roots).real * b
            if np.isreal(roots).all() and np.linalg.matrix_rank([*lines, line], tol=1e-2) > len(lines):
                lines.append(line)
        J = np.array(lines).T
        found, kind = iq.involution(J), iq.gibson_hunt(J)
        assert (str(kind), kind.moduli) == (name, pytest.approx(moduli, abs=1e-6))
        assert (found.rank, found.transversal_count, found.double, found.holds) == (4, count, double, holds)
        assert (found.transversals.shape[1], found.at_infinity.shape[1]) == (min(count, 2), at_infinity)
        assert any(iq.has_pseudoinverse(J, h) for h in (-1.3, 0.0, 0.4)) is (name != "IIB")
        if holds:
            check(J, found)


# Lines as (direction, point); dimensions of the span of their transversals, and of those at infinity.
X, Y, Z, O = (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)
INFINITELY_MANY = {
    "one line, twice": ([(Z, O), (Z, O)], 5, 2),
    "parallel": ([(Z, O), (Z, X)], 4, 2),
    "meeting": ([(X, O), (Y, O)], 4, 1),
    "skew": ([(X, O), (Y, Z)], 4, 1),
    "parallel, three": ([(Z, O), (Z, X), (Z, Y)], 3, 2),
    "in one plane": ([(X, O), (Y, O), (X, Y)], 3, 1),
    "through one point": ([(X, O), (Y, O), (Z, O)], 3, 0),
    "a regulus": ([(X, O), (Y, Z), ((1, 2, 3), (1, 1, 0))], 3, 0),
}


@pytest.mark.parametrize("name", INFINITELY_MANY)
def test_infinitely_many_transversals_and_those_at_infinity(name):
    """The transversals span the whole reciprocal system; those at infinity are the translations across the lines."""
    lines, dimension, translations = INFINITELY_MANY[name]
    rng = np.random.default_rng(14)
    J = np.array([iq.revolute(direction, point) for direction, point in lines]).T
    for T in (np.eye(4), *(motion(rng) for _ in range(5))):
        moved = iq.adjoint(T) @ J
        found = iq.involution(moved)
        check_transversals(moved, found)
        shapes = found.transversals.shape[1], found.at_infinity.shape[1]
        assert (found.transversal_count, *shapes) == (inf, dimension, translations)


def test_five_lines_parallel_to_a_plane_have_their_transversal_at_infinity():
    rng = np.random.default_rng(12)
    lines = [iq.revolute((*rng.normal(size=2), 0.0), rng.normal(size=3)) for _ in range(5)]
    J = iq.adjoint(motion(rng)) @ np.array(lines).T
    found = iq.involution(J)
    check(J, found)
    assert (found.rank, found.transversal_count, found.double, found.at_infinity.shape) == (5, 0, False, (6, 1))


def test_five_lines_are_in_involution_where_they_share_a_transversal():
    rng = np.random.default_rng(7)
    for _ in range(20):
        t = line(rng)
        u, p = iq.se3.axis(t)
        J = np.array([iq.revolute(rng.normal(size=3), p + rng.normal() * u) for _ in range(5)]).T
        found = iq.involution(J)
        check(J, found)
        assert (found.rank, found.transversal_count) == (5, 1)
        assert distance(found.transversals, t[:, None]) < 1e-9
        assert distance((Q0 @ found.equilibrium_wrench)[:, None], t[:, None]) < 1e-9


def test_six_lines_are_in_involution_where_they_are_dependent():
    rng = np.random.default_rng(8)
    u, p = np.array([0.0, 0.6, 0.8]), rng.normal(size=3)
    J = np.array([iq.revolute(rng.normal(size=3), p + rng.normal() * u) for _ in range(6)]).T
    found = iq.involution(J)
    check(J, found)
    assert found.rank == 5
    np.testing.assert_allclose(J @ found.joint_forces, 0.0, atol=1e-12)
    assert not found.equilibrium_wrench.any()


@pytest.mark.cases(1)
@pytest.mark.parametrize("far", [0.0, 2.0, 1e3])
def test_the_axes_of_an_so101_are_in_involution_in_every_state(far):
    rng = np.random.default_rng(13)
    arm = iq.load_robot("so101")
    for _ in range(100):
        J = iq.adjoint(motion(rng, far)) @ arm.jacobian(rng.uniform(arm.position_lower, arm.position_upper))
        found = iq.involution(J)
        assert found.holds is not iq.has_pseudoinverse(J, 0.0)
        assert (found.holds, found.transversal_count + found.at_infinity.shape[1]) == (True, 1)
        W = found.equilibrium_wrench
        np.testing.assert_allclose(J.T @ W, 0.0, atol=1e-11 * (1.0 + far) * np.linalg.norm(W))


def test_no_frame_matters():
    rng = np.random.default_rng(9)
    J = np.array([line(rng) for _ in range(4)]).T
    Ad = iq.adjoint(motion(rng))
    here, there = iq.involution(J), iq.involution(Ad @ J)
    assert there.determinant == pytest.approx(here.determinant)
    assert there.transversal_count == here.transversal_count


def test_twists_that_are_no_lines_are_refused():
    rng = np.random.default_rng(10)
    a = line(rng)
    for other, words in [
        (iq.se3.prismatic((0, 0, 1)), "column 1 of pitch inf"),
        (iq.se3.helical((0, 0, 1), pitch=0.1), "column 1 of pitch 0.1"),
        (np.zeros(6), "zero column 1"),
    ]:
        with pytest.raises(iq.BadInput, match=words):
            iq.involution(np.column_stack((a, other)))
    with pytest.raises(iq.BadInput, match="1 columns"):
        iq.involution(a)
    with pytest.raises(iq.BadInput, match="7 columns"):
        iq.involution(np.column_stack([line(rng) for _ in range(7)]))


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
def test_null_planes_contain_the_screws_of_their_definition(seed, h):
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
def test_null_planes_are_self_reciprocal_without_an_h_pseudoinverse(seed, h):
    rng = np.random.default_rng(seed)
    for name, plane in planes(rng, h).items():
        S = plane.basis
        np.testing.assert_allclose(S.T @ iq.pitch_form(h) @ S, 0.0, atol=1e-12)
        assert distance(iq.reciprocal(S, h), S) < 1e-12
        assert not iq.has_pseudoinverse(S, h)
        assert iq.has_pseudoinverse(S, h + 0.5) is (name == "alpha")


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, h=PITCHES)
def test_null_planes_of_the_two_families_meet_in_different_dimensions(seed, h):
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
def test_null_planes_are_recognised_in_every_frame_and_unit(seed, h, unit):
    rng = np.random.default_rng(seed)
    T = motion(rng, 1.0)
    for name, plane in planes(rng, h).items():
        J = np.repeat([1.0, unit], 3)[:, None] * (iq.adjoint(T) @ plane.basis) @ rng.normal(size=(3, 4))
        found = null_plane(J)
        assert found.family == plane.family
        assert (found.point is None) == (plane.point is None)
        assert distance(found.basis, J) < 1e-7
        if name == "alpha":
            np.testing.assert_allclose(found.point, unit * (T[:3, :3] @ plane.point + T[:3, 3]), atol=1e-6 * unit)
            assert found.h == pytest.approx(unit * h, abs=1e-6 * unit)


@every_class
def test_systems_of_other_types_are_no_null_planes(key):
    J, _ = sample(np.random.default_rng(1), key)
    assert (null_plane(J) is not None) == (key in {(3, "IIA"), (3, "IIB"), (3, "IIC"), (3, "IID")})


def test_null_planes_that_are_lie_algebras_close_under_the_bracket():
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


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (alpha_plane, "point"),
        (lambda: alpha_plane((0, 0, 0), direction=(0, 0, 1)), "point"),
        (lambda: alpha_plane((0, 0, 0), np.inf), "h"),
        (lambda: alpha_plane(direction=(0, 0, 0)), "direction"),
        (lambda: beta_plane((0, 0, 0), (0, 0, 0)), "normal"),
        (lambda: null_plane(np.zeros((6, 3))), "J"),
    ],
)
def test_bad_input(call, argument):
    with pytest.raises(iq.BadInput) as caught:
        call()
    assert caught.value.argument == argument
