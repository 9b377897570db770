"""[DS] in exact arithmetic: every printed value of Examples 1-4 and Tables 1-3, and each erratum as the truth.

The algebra is done by sympy in rationals, without the library; then the library is held against it.
"""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from support.random_systems import MODULUS_NAMES, distance
from sympy.polys.matrices import DomainMatrix

import invariantqp as iq
from invariantqp.systems.classification import normal_form

h, p, q, a, b, c, length = sp.symbols("h p q a b c l", real=True)
I3, Z3 = sp.eye(3), sp.zeros(3)
Q = sp.BlockMatrix([[-2 * h * I3, I3], [I3, Z3]]).as_explicit()
Q0 = Q.subs(h, 0)
HALF = sp.Rational(1, 2)
AT = (sp.Rational(-7, 3), sp.Rational(1, 5), sp.Rational(4))  # pitches to hold the library against

J1 = sp.Matrix([[1, 0, 0], [0, 0, 0], [0, 1, 1], [0, 0, -2], [-1, 0, 1], [HALF, 0, 0]])
J2 = sp.Matrix([[0, 1, 1], [0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, -length]])
S4 = sp.Matrix([0, sp.Rational(3, 5), sp.Rational(4, 5), 1, -sp.Rational(4, 5), sp.Rational(3, 5)])


def columns(*rows):
    return sp.Matrix(rows).T


def gram(J):
    return sp.simplify(J.T * Q * J)


def determinant(J):
    return sp.expand(gram(J).det())


def inverse(J):
    return sp.simplify(gram(J).inv() * J.T * Q)


def numbers(M, **values):
    return np.array(M.subs({sp.Symbol(k, real=True): v for k, v in values.items()}).tolist(), dtype=float)


# --- Sect. 2


def test_pitch_form_and_its_inverse():
    """(2.6) and Sect. 6.3, without the factor 1/2 (erratum 1)."""
    for x in AT:
        np.testing.assert_array_equal(iq.pitch_form(float(x)), numbers(Q, h=x))
        np.testing.assert_array_equal(iq.pitch_form_inverse(float(x)), numbers(Q.inv(), h=x))


# --- Examples 1 and 4


def test_example_1_the_columns_are_lines_of_an_ib0_system():
    assert [(J1.col(i).T * Q0 * J1.col(i))[0] for i in range(3)] == [0, 0, 0]
    kind = iq.gibson_hunt(numbers(J1))
    assert str(kind) == "IB0"
    assert kind.moduli[0] == pytest.approx(0.0, abs=1e-14)


def test_example_1_determinant_is_8h():
    assert determinant(J1) == 8 * h
    np.testing.assert_allclose(iq.systems.gram_polynomial(numbers(J1)), [0, 8, 0, 0], atol=1e-13)
    np.testing.assert_allclose(iq.principal_pitches(numbers(J1)), [0.0], atol=1e-14)


def test_example_1_has_no_0_pseudoinverse():
    assert gram(J1).subs(h, 0).rank() == 2
    assert not iq.has_pseudoinverse(numbers(J1), 0.0)
    found = iq.involution(numbers(J1))
    assert found.holds
    assert found.determinant == pytest.approx(0.0, abs=1e-14)


# J^{+h} as printed, but for entry (3, 2): see erratum 2.
PRINTED_J1 = sp.Matrix(
    [
        [1, -HALF, 0, 0, 0, 0],
        [3 / (16 * h), -(16 * h**2 + 16 * h + 3) / (32 * h), 1, HALF, 0, -3 / (8 * h)],
        [1 / (16 * h), (16 * h**2 + 16 * h - 1) / (32 * h), 0, -HALF, 0, -1 / (8 * h)],
    ]
)


def test_example_1_pseudoinverse():
    assert sp.simplify(inverse(J1) - PRINTED_J1) == sp.zeros(3, 6)
    for x in AT:
        np.testing.assert_allclose(iq.pseudoinverse(numbers(J1), float(x)), numbers(PRINTED_J1, h=x), atol=1e-13)


V4 = sp.Matrix([-48 * h, -48 * h**2 + 160 * h - 45, 48 * h**2 - 32 * h - 15]) / (160 * h)
PHI4 = -9 * (80 * h**2 + 64 * h - 25) / (800 * h)


def test_example_4():
    assert sp.simplify(inverse(J1) * S4 - V4) == sp.zeros(3, 1)
    left = S4 - J1 * V4
    assert sp.simplify((left.T * Q * left)[0] - PHI4) == 0
    for x in AT:
        found = iq.systems.stationary_point(numbers(J1), numbers(S4)[:, 0], float(x))
        np.testing.assert_allclose(found.velocity, numbers(V4, h=x)[:, 0], atol=1e-13)
        assert found.value == pytest.approx(float(PHI4.subs(h, x)))
        np.testing.assert_allclose(found.gradient, 0.0, atol=1e-12)


def test_example_4_the_error_vanishes_at_two_pitches():
    roots = sorted(sp.solve(80 * h**2 + 64 * h - 25, h))
    found = iq.systems.vanishing_pitches(numbers(J1), numbers(S4)[:, 0])
    np.testing.assert_allclose(found, [float(r) for r in roots], atol=1e-13)


# --- Example 2

P2 = sp.Matrix(6, 6, lambda i, j: {(0, 0): 1, (0, 3): -1 / (2 * h), (2, 2): 1, (5, 5): 1}.get((i, j), 0))
KERNEL2 = columns((0, 1, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0), (1, 0, 0, 2 * h, 0, 0))


def test_example_2_projector_determinant_and_kernel():
    assert determinant(J2) == 2 * h * length**2
    assert sp.simplify(J2 * inverse(J2) - P2) == sp.zeros(6)
    assert sp.simplify(P2 * KERNEL2) == sp.zeros(6, 3)
    J = numbers(J2, l=sp.Rational(3, 4))
    for x in AT:
        P = J @ iq.pseudoinverse(J, float(x))
        np.testing.assert_allclose(P, numbers(P2, h=x), atol=1e-13)
        # Its defining image and kernel: it is one on S, zero on S^{perp h}.
        np.testing.assert_allclose(P @ J, J, atol=1e-13)
        np.testing.assert_allclose(P @ iq.reciprocal(J, float(x)), 0.0, atol=1e-13)
        assert distance(iq.reciprocal(J, float(x)), numbers(KERNEL2, h=x)) < 1e-12


def test_example_2_is_ib0_without_a_0_pseudoinverse():
    J = numbers(J2, l=1)
    kind = iq.gibson_hunt(J)
    assert (str(kind), kind.moduli) == ("IB0", pytest.approx((0.0, 0.0), abs=1e-14))
    assert iq.involution(J).holds
    with pytest.raises(iq.NoPseudoinverse):
        iq.pseudoinverse(J, 0.0)


# --- Tables 1 and 2: determinants and moduli

# Tables 1 and 2 as printed, the modulus of each column as a symbol, with det(J'Q_h J); nothing of it is taken from the
# library. Those without an h are the types of Table 3.
NORMAL_FORMS = {
    (1, "h"): ([(1, 0, 0, a, 0, 0)], -2 * (h - a)),
    (1, "h=inf"): ([(0, 0, 0, 1, 0, 0)], 0),
    (2, "IA"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0)], 4 * (h - a) * (h - b)),
    (2, "IB"): ([(1, 0, 0, 0, 0, 0), (0, 0, 0, 1, p, 0)], -1),
    (2, "IIA"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, a, 0)], 4 * (h - a) ** 2),
    (2, "IIB"): ([(1, 0, 0, a, 0, 0), (0, 0, 0, 0, 1, 0)], 0),
    (2, "IIC"): ([(0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0)], 0),
    (3, "IA1"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0), (0, 0, 1, 0, 0, c)], -8 * (h - a) * (h - b) * (h - c)),
    (3, "IA2"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0), (0, 0, 1, 0, 0, b)], -8 * (h - a) * (h - b) ** 2),
    (3, "IIA"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, a, 0), (0, 0, 1, 0, 0, a)], -8 * (h - a) ** 3),
    (3, "IB0"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, a, 0), (0, 0, 0, 1, 0, p)], 2 * (h - a)),
    (3, "IB3"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, b, 0), (0, 0, 0, 0, 0, 1)], 0),
    (3, "IC"): ([(1, 0, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 1, 0, p)], 0),
    (3, "IIB"): ([(1, 0, 0, a, 0, 0), (0, 1, 0, 0, a, 0), (0, 0, 0, 0, 0, 1)], 0),
    (3, "IIC"): ([(1, 0, 0, a, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)], 0),
    (3, "IID"): ([(0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)], 0),
}
TABLES = {key: columns for key, (columns, _) in NORMAL_FORMS.items()}
VALUES = {a: sp.Rational(-1, 2), b: sp.Rational(1, 4), c: sp.Rational(3, 4), p: sp.Rational(2, 5)}


@pytest.mark.parametrize("key", TABLES, ids=[f"{k}-{n}" for k, n in TABLES])
def test_tables_1_and_2(key):
    J, expected = columns(*TABLES[key]), NORMAL_FORMS[key][1]
    moduli = [symbol for symbol in (a, b, c, p) if J.has(symbol)]
    assert sp.expand(determinant(J) - expected) == 0
    values = tuple(float(VALUES[m]) for m in moduli)
    exact = np.array(J.subs(VALUES).tolist(), dtype=float)
    np.testing.assert_array_equal(normal_form(*key, values), exact)
    kind = iq.gibson_hunt(exact)
    assert (str(kind), kind.dimension, kind.reciprocal) == (key[1], key[0], False)
    assert kind.moduli == pytest.approx(values, abs=1e-14)
    assert kind.modulus_names == MODULUS_NAMES[key]
    assert kind.margin > 1e5
    assert kind.admits_pseudoinverse == (expected != 0)
    polynomial = sp.Poly(sp.expand(sp.sympify(expected).subs(VALUES)), h).all_coeffs()[::-1]
    coefficients = [float(x) for x in polynomial] + [0.0] * (key[0] + 1 - len(polynomial))
    np.testing.assert_allclose(iq.systems.gram_polynomial(exact), coefficients, atol=1e-13)


# --- Table 3

# Bases and reciprocal bases as printed, with errata 3 (IID added), 4 (IIB) and 5 (IC) put right.
TABLE_3 = {
    (1, "h=inf"): ([(0, 0, 0, 1, 0, 0)], [(0, 1, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0), *TABLES[3, "IID"]]),
    (2, "IIB"): (
        [(1, 0, 0, p, 0, 0), (0, 0, 0, 0, 1, 0)],
        [(1, 0, 0, -p, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 1, 0, 0, 0), (0, 0, 0, 0, 0, 1)],
    ),
    (2, "IIC"): ([(0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0)], [(0, 0, 1, 0, 0, 0), *TABLES[3, "IID"]]),
    (3, "IB3"): (
        [(1, 0, 0, p, 0, 0), (0, 1, 0, 0, q, 0), (0, 0, 0, 0, 0, 1)],
        [(1, 0, 0, -p, 0, 0), (0, 1, 0, 0, -q, 0), (0, 0, 0, 0, 0, 1)],
    ),
    (3, "IC"): (
        [(1, 0, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 1, 0, p)],
        [(-p, 0, 1, 0, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)],
    ),
    (3, "IIB"): (
        [(1, 0, 0, p, 0, 0), (0, 1, 0, 0, p, 0), (0, 0, 0, 0, 0, 1)],
        [(1, 0, 0, -p, 0, 0), (0, 1, 0, 0, -p, 0), (0, 0, 0, 0, 0, 1)],
    ),
    (3, "IIC"): (
        [(1, 0, 0, p, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)],
        [(1, 0, 0, -p, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)],
    ),
    (3, "IID"): (TABLES[3, "IID"], TABLES[3, "IID"]),
}


@pytest.mark.parametrize("key", TABLE_3, ids=[f"{k}-{n}" for k, n in TABLE_3])
def test_table_3(key):
    S, R = (columns(*basis) for basis in TABLE_3[key])
    assert sp.zeros(S.cols, R.cols) == S.T * Q0 * R
    assert (S.rank(), R.rank()) == (key[0], 6 - key[0])
    assert determinant(S) == determinant(R) == 0
    at = {p: sp.Rational(2, 5), q: sp.Rational(-3, 7)}
    twists, reciprocals = (np.array(M.subs(at).tolist(), dtype=float) for M in (S, R))
    assert distance(iq.reciprocal(twists), reciprocals) < 1e-12
    for basis in (twists, reciprocals):
        assert str(iq.gibson_hunt(basis)) == key[1]  # the reciprocals of the 3-systems have the same type
        assert not any(iq.has_pseudoinverse(basis, float(x)) for x in AT)
        with pytest.raises(iq.BlindSystem):
            iq.principal_pitches(basis)


# --- The errata, one by one


def test_erratum_1_the_half_of_2_6_is_not_in_the_examples():
    """(2.6) has a factor 1/2; det = 8h, Phi_h of Example 4 and Q_h^-1 of Sect. 6.3 are without it."""
    half = J1.T * (Q / 2) * J1
    assert sp.expand(half.det()) == h
    assert determinant(J1) == 8 * h
    left = S4 - J1 * V4
    assert sp.simplify((left.T * (Q / 2) * left)[0] - PHI4 / 2) == 0


def test_erratum_2_example_1_entry_3_2():
    """Example 1 prints (16h^2+16h+3)/(32h) at (3, 2) of J^{+h}; its own v of Example 4 needs -1."""
    printed = PRINTED_J1.copy()
    printed[2, 1] = (16 * h**2 + 16 * h + 3) / (32 * h)
    assert inverse(J1)[2, 1].equals((16 * h**2 + 16 * h - 1) / (32 * h))
    assert not sp.simplify(printed * S4 - V4).equals(sp.zeros(3, 1))
    assert sp.simplify(PRINTED_J1 * J1) == sp.eye(3)


def test_erratum_3_table_3_omits_all_translations():
    """Table 3 has no IID, Sect. 5.3 does: the systems without any h-pseudoinverse are of eleven types, not ten."""
    assert determinant(columns(*TABLES[3, "IID"])) == 0
    types = [(key, 6 - key[0]) for key in TABLE_3 if key[0] < 3]
    assert len(TABLE_3) + len(types) == 11
    assert not iq.gibson_hunt(np.eye(6)[:, 3:]).admits_pseudoinverse


def test_erratum_4_table_3_iib_reciprocal():
    """Table 3, 2-system IIB lists (0,1,0;0,0,0), not reciprocal to (0,0,0;0,1,0); it must be (0,0,0;0,1,0) itself."""
    translation = sp.Matrix([0, 0, 0, 0, 1, 0])
    assert (sp.Matrix([0, 1, 0, 0, 0, 0]).T * Q0 * translation)[0] == 1
    assert (translation.T * Q0 * translation)[0] == 0
    R = iq.reciprocal(normal_form(2, "IIB", (0.4,)))
    assert np.linalg.matrix_rank(np.column_stack((R, np.eye(6)[4]))) == 4
    assert np.linalg.matrix_rank(np.column_stack((R, np.eye(6)[1]))) == 5


def test_erratum_5_table_3_ic():
    """Table 3, IC prints (0,0,0;0,10) in the reciprocal basis: it is (0,0,0;0,1,0)."""
    S = columns(*TABLES[3, "IC"])
    assert S.T * Q0 * sp.Matrix([0, 0, 0, 0, 1, 0]) == sp.zeros(3, 1)


def test_erratum_6_four_lines_with_one_double_transversal():
    """Sect. 4, m = 4: "precisely when there is an infinity of transversals" is too narrow."""
    J = columns((1, 0, 1, 0, 0, 0), (0, 0, 1, 0, 0, 0), (0, 1, 1, 0, -q, q), (0, -1, 1, 0, q, q))
    assert sp.expand((J.T * Q0 * J).det()) == 0
    assert [sp.expand((s.T * Q0 * s)[0]) for s in (J.col(i) for i in range(4))] == [0, 0, 0, 0]
    assert J.subs(q, 2).rank() == 4
    R = sp.Matrix.hstack(*(J.T * Q0).nullspace())
    form = sp.simplify(R.T * Q0 * R)
    assert form.det() == 0  # one null direction of the form, counted twice ...
    assert form.subs(q, 2).rank() == 1  # ... and not a plane of them
    found = iq.involution(numbers(J, q=2))
    assert (found.holds, found.transversal_count, found.double) == (True, 1, True)


def test_erratum_6_four_lines_with_a_double_transversal_at_infinity():
    """Four lines parallel to one plane: det(J'Q_h J) = 0 for every h, and no line meets them all."""
    J = columns((1, 0, 1, -1, 0, 1), (1, 0, 2, -1, 1, HALF), (2, 0, 1, -2, 3, 4), (1, 0, -1, -1, 5, -1))
    assert [(s.T * Q0 * s)[0] for s in (J.col(i) for i in range(4))] == [0, 0, 0, 0]
    assert (J.rank(), determinant(J)) == (4, 0)
    R = sp.Matrix.hstack(*(J.T * Q0).nullspace())
    form = R.T * Q0 * R
    assert (form.rank(), form.det()) == (1, 0)
    null = R * form.nullspace()[0]
    assert null[:3, 0] == sp.zeros(3, 1)  # the only null twist of the reciprocal system is a translation
    found = iq.involution(numbers(J))
    assert (found.holds, found.transversal_count, found.double, found.at_infinity.shape) == (True, 0, True, (6, 1))


def test_erratum_6_four_lines_parallel_to_one_plane_need_heights_in_the_ratio_of_their_directions():
    """Directions (cos, sin) of slope t_i through points at height z_i: in involution iff both have one cross ratio."""
    t, z = sp.symbols("t:4", real=True), sp.symbols("z:4", real=True)
    J = columns(*((1, t[i], 0, -z[i] * t[i], z[i], i * t[i] - 1) for i in range(4)))  # through (1, i, z_i)

    def ratio(x):
        return (x[0] - x[2]) * (x[1] - x[3]), (x[0] - x[3]) * (x[1] - x[2])

    assert [sp.expand((s.T * Q0 * s)[0]) for s in (J.col(i) for i in range(4))] == [0, 0, 0, 0]
    (top, bottom), (over, under) = ratio(t), ratio(z)
    products = DomainMatrix.from_Matrix(J.T * Q0 * J)  # polynomials: of symbols the determinant takes seconds
    assert products.domain.from_sympy((top * under - bottom * over) ** 2) == products.charpoly()[-1]
    assert not iq.involution(numbers(J.subs(dict(zip((*t, *z), (0, 1, 2, 5, 0, 1, 3, 4), strict=True))))).holds


def test_erratum_6_two_transversals_need_pitches_of_opposite_sign():
    """The null twists x s_a + y s_b of a IA 2-system: a x^2 + b y^2 = 0."""
    x, y = sp.symbols("x y", real=True)
    S = columns(*TABLES[2, "IA"]) * sp.Matrix([x, y])
    assert sp.expand((S.T * Q0 * S)[0]) == 2 * a * x**2 + 2 * b * y**2


def test_erratum_7_example_3_the_solution_is_smaller():
    """Example 3 prints J^{+h}(S): for a 3-joint arm that is all of R^3, and not every joint velocity will do."""
    J = sp.Matrix([[1, 0, 0], [0, 1, 2], [0, 1, 1], [0, 1, 0], [2, 0, 1], [1, 3, 1]])
    S = columns((1, 0, 0, 0, 0, 0), (0, 1, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0), (0, 0, 0, 1, 0, 0))  # the origin along x
    solution = sp.Matrix.vstack(J[4, :], J[5, :]).nullspace()  # v_y = v_z = 0, by definition
    assert len(solution) == 1
    assert (inverse(J).subs(h, 1) * S).rank() == 3
    found = iq.systems.point_motion(numbers(J), (0, 0, 0), (1, 0, 0))
    assert found.velocities.shape == (3, 1)
    assert distance(found.velocities, numbers(solution[0])) < 1e-12


def test_erratum_8_hp4_is_meant_with_the_ordinary_transpose():
    """(hP4) writes the h-adjoint of J^{+h} J, an m x m matrix; with the joint inner product it is the transpose."""
    rng = np.random.default_rng(1)
    J = rng.normal(size=(6, 2)) @ rng.normal(size=(2, 4))  # dependent joints: J^{+h} J is no identity
    inverse_ = iq.pseudoinverse(J, 0.7)
    C = inverse_ @ J
    np.testing.assert_allclose(C, C.T, atol=1e-12)
    form = iq.pitch_form(0.7)
    P = J @ inverse_
    np.testing.assert_allclose(np.linalg.solve(form, P.T @ form), P, atol=1e-10)  # (hP3) is with the h-adjoint
    M = np.diag([1.0, 2.0, 3.0, 4.0])
    D = iq.pseudoinverse(J, 0.7, joint_metric=M) @ J
    np.testing.assert_allclose(np.linalg.solve(M, D.T @ M), D, atol=1e-12)


def test_erratum_10_three_lines_balance_by_a_couple():
    """Sect. 4 ends with a line to which z corresponds; for three lines of type IB3 z is a translation, W a couple."""
    J = columns((1, 2, 0, 0, 0, 0), (1, 2, 0, 0, 0, 1), (1, -2, 0, 4, 2, 0))
    z = (J.T * Q0 * J).nullspace()[0]
    assert (J.T * Q0 * J).rank() == 2
    assert (J * z)[:3, 0] == sp.zeros(3, 1)
    found = iq.involution(numbers(J))
    assert (str(iq.gibson_hunt(numbers(J))), found.holds) == ("IB3", True)
    np.testing.assert_allclose(np.abs(found.equilibrium_wrench[3:]), 0.0, atol=1e-12)
    assert np.linalg.norm(found.equilibrium_wrench[:3]) > 0.1


def test_erratum_11_the_gradient_has_an_entry_for_each_joint():
    """(6.4) ends in the derivative by x_6; the error is a function of the m joint velocities, here three."""
    x = sp.Matrix(sp.symbols("x1:4", real=True))
    left = S4 - J1 * x
    gradient = sp.Matrix([(left.T * Q * left)[0]]).jacobian(x).T
    assert sp.expand(gradient + 2 * J1.T * Q * left) == sp.zeros(3, 1)
    _, found = iq.systems.error_form(numbers(J1), numbers(S4).ravel(), 0.5, (1.0, 2.0, 3.0))
    values = dict(zip((h, *x), (HALF, 1, 2, 3), strict=True))
    np.testing.assert_allclose(found, np.array(gradient.subs(values), dtype=float).ravel())


def test_the_guide_lists_every_function():
    """On the page that has the errata."""
    page = (Path(__file__).parents[2] / "examples" / "guide" / "paper.md").read_text(encoding="utf-8")
    named = {name for name in iq.systems.__all__ if name[0].islower()}
    assert len(named) > 30
    assert sorted(name for name in named if not re.search(rf"`(iq|systems)?\.{name}`", page)) == []
    assert re.findall(r"^(\d+)\. ", page, flags=re.MULTILINE) == [str(i) for i in range(1, 12)]


def test_example_3_the_four_system_is_no_lie_algebra():
    """Beyond the eight: Example 3 calls the 4-system the Lie algebra of a subgroup; a bracket leaves it."""
    S = iq.systems.motions_along((0, 0, 0), (1, 0, 0))
    turn, slide = np.array([0, 1, 0, 0, 0, 0]), np.array([0, 0, 0, 1, 0, 0])
    assert np.linalg.matrix_rank(np.column_stack((S, turn, slide))) == 4
    assert np.linalg.matrix_rank(np.column_stack((S, iq.se3.bracket(turn, slide)))) == 5


# --- Sect. 4


def test_two_and_three_lines_in_closed_form():
    """Sect. 4: det = -(s1 Q0 s2)^2 for two lines, 2 (s1 Q0 s2)(s2 Q0 s3)(s3 Q0 s1) for three."""
    x, y, z = sp.symbols("x y z", real=True)
    G = sp.Matrix([[0, x, z], [x, 0, y], [z, y, 0]])
    assert sp.expand(G[:2, :2].det()) == -(x**2)
    assert sp.expand(G.det()) == 2 * x * y * z


def test_five_lines_are_in_involution_where_the_reciprocal_is_a_line():
    """Sect. 4, m = 5: det(J'Q_0 J) of a 5-system vanishes exactly with the pitch of its reciprocal screw."""
    R = sp.Matrix([1, 0, 0, a, 0, 0])
    J = columns((1, 0, 0, -a, 0, 0), *((0, 1, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)))
    assert sp.zeros(5, 1) == J.T * Q0 * R
    assert sp.expand((J.T * Q0 * J).det()) == -2 * a


# --- The script that prints all this

SCRIPT = Path(__file__).parents[2] / "examples" / "21_paper.py"


def test_the_script_prints_what_is_proved_here():
    """Each of its rows agrees with the paper or names an erratum, and its figures are those of the exact algebra."""
    script = runpy.run_path(str(SCRIPT))
    rows = {part.split(",")[0]: list(make()) for part, make in script["PARTS"].items()}
    everything = [row for found in rows.values() for row in found]
    assert all(row.agrees is not bool(row.erratum) for row in everything)
    assert {row.erratum[0] for row in everything if row.erratum} == set("123457")
    assert len(rows["Tables 1 and 2"]) == 2 * sum(dimension > 1 for dimension, _ in TABLES)

    at = sp.Rational(script["H"])

    def recomputed(part, what):
        (found,) = [row.recomputed for row in rows[part] if row.what.startswith(what)]
        return found

    for i in range(3):
        expected = numbers(PRINTED_J1, h=at)[i]
        np.testing.assert_allclose(recomputed("Example 1", f"J^+h, row {i + 1}"), expected, atol=1e-13)
    for i in range(6):
        np.testing.assert_allclose(recomputed("Example 2", f"P_h, row {i + 1}"), numbers(P2, h=at)[i], atol=1e-13)
    np.testing.assert_allclose(recomputed("Example 4", "v = "), numbers(V4, h=at)[:, 0], atol=1e-13)
    assert recomputed("Example 4", "Phi_h(v)") == pytest.approx(float(PHI4.subs(h, at)))
    assert recomputed("Example 3", "dimension") == 1
    assert recomputed("Table 3", "types with no") == 11
