"""[DS]'s Examples 1-4 and Tables 1-3 recomputed, beside what the paper prints; where the two differ, the erratum.

[DS] is Donelan and Selig, Hyperbolic pseudoinverses for kinematics in the Euclidean group. Formulas in h, l and p are
evaluated at the values below; systems are first moved and mixed at random, so that nothing is read off a normal form.

Run: python examples/21_paper.py
"""

from typing import Any, NamedTuple

import numpy as np

import invariantqp as iq

H, L, P, Q = 0.5, 0.75, 0.4, -0.3  # the pitch h, the link l, moduli p and q
A, B, C = -0.5, 0.25, 0.75  # the principal pitches h_a, h_b, h_c
rng = np.random.default_rng(0)


class Row(NamedTuple):
    """One thing that the paper prints: a number, numbers or a word; `erratum` says what is wrong with it, if it is."""

    what: str
    printed: Any
    recomputed: Any
    erratum: str = ""

    @property
    def agrees(self) -> bool:
        if isinstance(self.printed, str):
            return self.printed == self.recomputed
        return np.shape(self.printed) == np.shape(self.recomputed) and np.allclose(self.printed, self.recomputed)


def columns(*rows):
    return np.array(rows, dtype=float).T


def moved(S):
    """The same system elsewhere, spanned by other twists."""
    T = iq.exp(rng.normal(size=6))
    return iq.adjoint(T) @ S @ rng.normal(size=(S.shape[1], S.shape[1]))


def exists(J, h=0.0):
    return "exists" if iq.has_pseudoinverse(J, h) else "none"


J1 = columns((1, 0, 0, 0, -1, 0.5), (0, 0, 1, 0, 0, 0), (0, 0, 1, -2, 1, 0))
J2 = columns((0, 0, 1, 0, 0, 0), (1, 0, 0, 0, 0, 0), (1, 0, 0, 0, 0, -L))


def example_1():
    h = H
    top = (16 * h**2 + 16 * h + 3) / (32 * h)
    printed = np.array([(1, -0.5, 0, 0, 0, 0), (3, 0, 16 * h, 8 * h, 0, -6), (1, 0, 0, -8 * h, 0, -2)])
    printed[1:] /= 16 * h
    printed[1:, 1] = -top, top
    found = iq.pseudoinverse(J1, h)
    yield Row("type", "IB0", str(iq.gibson_hunt(moved(J1))))
    yield Row("det(J'Q_h J): coefficients of 1, h, h^2, h^3", [0, 8, 0, 0], iq.systems.gram_polynomial(J1))
    half = np.linalg.det(J1.T @ (0.5 * iq.pitch_form(h)) @ J1)
    yield Row(
        "the same at h with the factor 1/2 of (2.6)", 8 * h, half, "1: (2.6) has a factor 1/2, the examples have not"
    )
    yield Row("principal pitch", [0], iq.principal_pitches(moved(J1)))
    yield Row("0-pseudoinverse", "none", exists(moved(J1)))
    for i in range(2):
        yield Row(f"J^+h, row {i + 1}", printed[i], found[i])
    yield Row("J^+h, row 3", printed[2], found[2], "2: entry (3, 2) is (16h^2 + 16h - 1)/(32h)")


def example_2():
    P_h = np.zeros((6, 6))
    P_h[[0, 2, 5], [0, 2, 5]], P_h[0, 3] = 1.0, -1 / (2 * H)
    kernel = columns((0, 1, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0), (1, 0, 0, 2 * H, 0, 0))
    found = J2 @ iq.pseudoinverse(J2, H)
    yield Row("type", "IB0", str(iq.gibson_hunt(moved(J2))))
    yield Row("det(J'Q_h J), not printed: 2hl^2 by hand", 2 * H * L**2, np.linalg.det(iq.systems.gram_matrix(J2, H)))
    yield Row("0-pseudoinverse", "none", exists(moved(J2)))
    for i in range(6):
        yield Row(f"P_h, row {i + 1}", P_h[i], found[i])
    yield Row("P_h on its kernel", np.zeros((6, 3)), found @ kernel)
    yield Row("dimensions of the kernel", 3, iq.reciprocal(J2, H).shape[1])


def example_3():
    arm = columns((1, 0, 0, 0, 2, 1), (0, 1, 1, 1, 0, 3), (0, 2, 1, 0, 1, 1))  # any arm of three joints
    S = iq.systems.motions_along((0, 0, 0), (1, 0, 0))
    solution = iq.systems.point_motion(arm, (0, 0, 0), (1, 0, 0)).velocities
    printed = np.linalg.matrix_rank(iq.pseudoinverse(arm, H) @ S)
    turn, slide = np.array([0, 1, 0, 0, 0, 0]), np.array([0, 0, 0, 1, 0, 0])
    closed = np.linalg.matrix_rank(np.column_stack((S, iq.se3.bracket(turn, slide)))) == 4
    yield Row("type of the reciprocal of the 4-system S", "IIA", str(iq.gibson_hunt(moved(S))))
    yield Row("dimension of the solutions", printed, solution.shape[1], "7: J^+h(S meet im J) + ker J, not J^+h(S)")
    answer = "is one" if closed else "is none"
    yield Row("S as a Lie algebra", "is one", answer, "7: a turn and the slide have a bracket outside S")


def example_4():
    h, s = H, np.array([0, 0.6, 0.8, 1, -0.8, 0.6])
    point = iq.systems.stationary_point(J1, s, h)
    v = np.array([-48 * h, -48 * h**2 + 160 * h - 45, 48 * h**2 - 32 * h - 15]) / (160 * h)
    yield Row("v = J^+h s", v, point.velocity)
    yield Row("Phi_h(v)", -9 * (80 * h**2 + 64 * h - 25) / (800 * h), point.value)
    yield Row("Phi_h = 0 at h =", np.sort(np.roots([80, 64, -25])), iq.systems.vanishing_pitches(J1, s))


# Tables 1 and 2 as printed: the normal forms and their moduli.
NORMAL_FORMS = {
    "2-system IA": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, B, 0)), (A, B)),
    "2-system IB": (columns((1, 0, 0, 0, 0, 0), (0, 0, 0, 1, P, 0)), (P,)),
    "2-system IIA": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, A, 0)), (A,)),
    "2-system IIB": (columns((1, 0, 0, A, 0, 0), (0, 0, 0, 0, 1, 0)), (A,)),
    "2-system IIC": (columns((0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0)), ()),
    "3-system IA1": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, B, 0), (0, 0, 1, 0, 0, C)), (A, B, C)),
    "3-system IA2": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, B, 0), (0, 0, 1, 0, 0, B)), (A, B)),
    "3-system IB0": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, A, 0), (0, 0, 0, 1, 0, P)), (A, P)),
    "3-system IB3": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, B, 0), (0, 0, 0, 0, 0, 1)), (A, B)),
    "3-system IC": (columns((1, 0, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 1, 0, P)), (P,)),
    "3-system IIA": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, A, 0), (0, 0, 1, 0, 0, A)), (A,)),
    "3-system IIB": (columns((1, 0, 0, A, 0, 0), (0, 1, 0, 0, A, 0), (0, 0, 0, 0, 0, 1)), (A,)),
    "3-system IIC": (columns((1, 0, 0, A, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)), (A,)),
    "3-system IID": (columns((0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 0), (0, 0, 0, 0, 0, 1)), ()),
}


def tables_1_and_2():
    for name, (S, moduli) in NORMAL_FORMS.items():
        kind = iq.gibson_hunt(moved(S))
        yield Row("type", name, f"{kind.dimension}-system {kind}")
        yield Row(f"   moduli {', '.join(kind.modulus_names) or '-'}", moduli, kind.moduli)


X, Y, Z = (tuple(row) for row in np.eye(6)[3:])  # slides
# Table 3 as printed: a basis and a reciprocal basis of each type; IC's "(0,0,0;0,10)" is read as ten.
TABLE_3 = {
    "1-system h=inf": ([X], [(0, 1, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0), X, Y, Z], ""),
    "2-system IIB": (
        [(1, 0, 0, P, 0, 0), Y],
        [(1, 0, 0, -P, 0, 0), (0, 1, 0, 0, 0, 0), (0, 0, 1, 0, 0, 0), Z],
        "4: (0,1,0;0,0,0) should be (0,0,0;0,1,0)",
    ),
    "2-system IIC": ([X, Y], [(0, 0, 1, 0, 0, 0), X, Y, Z], ""),
    "3-system IB3": ([(1, 0, 0, P, 0, 0), (0, 1, 0, 0, Q, 0), Z], [(1, 0, 0, -P, 0, 0), (0, 1, 0, 0, -Q, 0), Z], ""),
    "3-system IC": ([(1, 0, 0, 0, 0, 0), Y, (0, 0, 0, 1, 0, P)], [(-P, 0, 1, 0, 0, 0), (0, 0, 0, 0, 10, 0), Z], ""),
    "3-system IIB": ([(1, 0, 0, P, 0, 0), (0, 1, 0, 0, P, 0), Z], [(1, 0, 0, -P, 0, 0), (0, 1, 0, 0, -P, 0), Z], ""),
    "3-system IIC": ([(1, 0, 0, P, 0, 0), Y, Z], [(1, 0, 0, -P, 0, 0), Y, Z], ""),
}


def table_3():
    for name, (basis, reciprocal, erratum) in TABLE_3.items():
        S, R = columns(*basis), columns(*reciprocal)
        kind = iq.gibson_hunt(moved(S))
        yield Row("type", name, f"{kind.dimension}-system {kind}")
        yield Row("   h-pseudoinverse for h = -2, 0, 0.3 or 7", "none", any_pitch(moved(S)))
        yield Row("   and of the reciprocal", "none", any_pitch(iq.reciprocal(moved(S))))
        yield Row("   rank of both reciprocal bases together", 6 - S.shape[1], rank_beside(R, S), erratum)
    yield Row("3-system IC, reciprocal basis, entry 2", (0, 0, 0, 0, 10), Y, "5: (0,0,0;0,10) is (0,0,0;0,1,0)")
    without = [name for name, (S, _) in NORMAL_FORMS.items() if any_pitch(moved(S)) == "none"]
    types = 2 + sum(2 if k.startswith("2") else 1 for k in without)  # h = inf too; 1- and 2-systems with reciprocals
    yield Row("types with no h-pseudoinverse", 10, types, "3: the 3-system IID, all slides, is missing")


def any_pitch(S):
    return "exists" if any(iq.has_pseudoinverse(S, h) for h in (-2.0, 0.0, 0.3, 7.0)) else "none"


def rank_beside(R, S):
    """Rank of R and the true reciprocal system together: as large as that of one alone if R is right."""
    return np.linalg.matrix_rank(np.column_stack((R, iq.reciprocal(S))))


PARTS = {
    f"Example 1, at h = {H}": example_1,
    f"Example 2, at h = {H}, l = {L}": example_2,
    "Example 3": example_3,
    f"Example 4, at h = {H}": example_4,
    f"Tables 1 and 2, at h_a, h_b, h_c, p = {A}, {B}, {C}, {P}": tables_1_and_2,
    f"Table 3, at p, q = {P}, {Q}": table_3,
}


def written(value):
    """Text as it is, numbers in short, matrices by their size."""
    if isinstance(value, str):
        return value
    a = np.round(np.asarray(value, dtype=float), 6) + 0.0
    if a.ndim == 2:
        return "all zero" if not a.any() else f"{a.shape} matrix"
    return " ".join(f"{x:.6g}" for x in np.atleast_1d(a)) or "-"


if __name__ == "__main__":
    rows = {part: list(make()) for part, make in PARTS.items()}
    for part, found in rows.items():
        print(f"\n{part}\n{'':47s} {'printed':42s} recomputed")
        for row in found:
            mark = f"ERRATUM {row.erratum}" if row.erratum else "" if row.agrees else "DIFFERS"
            print(f"{row.what:47s} {written(row.printed):42s} {written(row.recomputed):42s} {mark}".rstrip())
    flat = [row for found in rows.values() for row in found]
    right = sum(row.agrees for row in flat)
    print(f"\n{len(flat)} rows: {right} agree, {len(flat) - right} differ, each by an erratum")
