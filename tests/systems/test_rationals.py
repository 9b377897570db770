"""Systems of small whole numbers, many of them degenerate, against exact fractions: every decision and every matrix."""

from fractions import Fraction

import numpy as np
import pytest
from support.repeats import repeats

import invariantqp as iq
from invariantqp.systems import ScrewSystem, gram_polynomial, system_meet, system_sum


def reduced(A):
    """The reduced row echelon form of a list of rows, and its pivots."""
    A, pivots = [row[:] for row in A], []
    for c in range(len(A[0])):
        r = len(pivots)
        found = next((i for i in range(r, len(A)) if A[i][c]), None)
        if found is None:
            continue
        A[r], A[found] = A[found], A[r]
        A[r] = [v / A[r][c] for v in A[r]]
        A = [row if i == r else [a - row[c] * b for a, b in zip(row, A[r], strict=True)] for i, row in enumerate(A)]
        pivots.append(c)
        if len(pivots) == len(A):
            break
    return A, pivots


def transposed(A):
    return [list(row) for row in zip(*A, strict=True)]


def product(*factors):
    A, *rest = factors
    for B in rest:
        A = [[sum(a * b for a, b in zip(row, column, strict=True)) for column in transposed(B)] for row in A]
    return A


def inverse(A):
    n = len(A)
    return [row[n:] for row in reduced([[*row, *(Fraction(i == j) for j in range(n))] for i, row in enumerate(A)])[0]]


def determinant(A):
    A, value = [row[:] for row in A], Fraction(1)
    for c in range(len(A)):
        pivot = next((i for i in range(c, len(A)) if A[i][c]), None)
        if pivot is None:
            return Fraction(0)
        if pivot != c:
            A[c], A[pivot], value = A[pivot], A[c], -value
        value *= A[c][c]
        A[c + 1 :] = [[a - row[c] / A[c][c] * b for a, b in zip(row, A[c], strict=True)] for row in A[c + 1 :]]
    return value


def form(h):
    Q = [[Fraction(0)] * 6 for _ in range(6)]
    for i in range(3):
        Q[i][i], Q[i][i + 3], Q[i + 3][i] = -2 * h, Fraction(1), Fraction(1)
    return Q


def fractions(A):
    return [[Fraction(int(v)) for v in row] for row in A]


def numbers(A):
    return np.array([[float(v) for v in row] for row in A])


def whole(rng, case):
    """Twists of entries from -2 to 2; a third with translations among them, a fifth with a dependent column."""
    m = int(rng.integers(1, 8))
    J = rng.integers(-2, 3, size=(6, m))
    if case % 3 == 0:
        J[:3, rng.random(m) < 0.5] = 0
    if case % 5 == 0 and m > 1:
        J[:, -1] = J[:, 0] - 2 * J[:, m // 2]
    return J


@pytest.mark.cases(4)
@pytest.mark.parametrize("seed", range(2))
def test_every_decision_and_every_matrix(seed):
    rng, systems = np.random.default_rng(seed), repeats(1200, 100)
    for case in range(systems):
        given = whole(rng, case)
        J, columns = fractions(given), given.astype(float)
        echelon, pivots = reduced(J)
        r, system = len(pivots), ScrewSystem(columns)
        assert system.dimension == r
        if r == 0:
            continue
        basis = [[row[c] for c in pivots] for row in J]
        pitches = [Fraction(i, 3) for i in range(-3, r - 2)]
        values = [[determinant(product(transposed(basis), form(h), basis))] for h in pitches]
        polynomial = [row[0] for row in product(inverse([[h**j for j in range(r + 1)] for h in pitches]), values)]
        size = max(1.0, *(abs(float(c)) for c in polynomial))
        np.testing.assert_allclose(gram_polynomial(numbers(basis)), [float(c) for c in polynomial], atol=1e-9 * size)
        some = any(polynomial)
        assert (system.blind_directions.shape[1] == 0) == system.type.admits_pseudoinverse == some
        if some:
            degree = max(i for i, c in enumerate(polynomial) if c)
            assert len(system.principal_pitches) == (degree if r < 6 else 0)
        for h in (Fraction(0), Fraction(1, 2), Fraction(int(rng.integers(-6, 7)), int(rng.integers(1, 5)))):
            G = product(transposed(basis), form(h), basis)
            assert iq.has_pseudoinverse(columns, float(h)) == bool(determinant(G))
            R = iq.reciprocal(columns, float(h))
            assert R.shape == (6, 6 - r)
            np.testing.assert_allclose(numbers(product(transposed(J), form(h))) @ R, 0.0, atol=1e-10)
            if determinant(G):
                C = echelon[:r]
                right = product(transposed(C), inverse(product(C, transposed(C))))
                exact = numbers(product(right, inverse(G), transposed(basis), form(h)))
                X, condition = iq.pseudoinverse(columns, float(h), return_condition=True)
                assert np.linalg.norm(X - exact) <= 4e-15 * condition * np.linalg.norm(exact)
        other = rng.integers(-2, 3, size=(6, int(rng.integers(1, 5))))
        other[:, 0] = given[:, 0] if case % 2 else other[:, 0]
        both = len(reduced([a + b for a, b in zip(J, fractions(other), strict=True)])[1])
        assert system_sum(columns, other).shape[1] == both
        assert system_meet(columns, other).shape[1] == r + len(reduced(fractions(other))[1]) - both
