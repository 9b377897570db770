"""Every exact answer of the comparison a second time, by other formulas and in rational numbers.

least squares    [[I, J], [J', 0]] or [[I, J'], [J, 0]], eliminated
damped, ridge    (J'J + lambda^2 I) x = J's; inside limits by least-index pivoting
law              L^2 = c^2 e ((X + |X|) / 2)^2,  X = 1 - S / (t^2 e),  without eigenvectors; |X| = X sign(X)

Reference: Murty 1974 (least-index pivoting), Judice & Pires 1992 (with bounds).
"""

from fractions import Fraction
from itertools import combinations
from math import inf

import mpmath as mp

from invariantqp.compare.exact.law import _calm, _measured
from invariantqp.compare.exact.references import DIGITS, TIE
from invariantqp.compare.laws.linear import DLS_DAMPING
from invariantqp.compare.laws.quadratic import FIXED_WEIGHT
from invariantqp.velocity.damping import DEFAULT_CEILING, DEFAULT_THRESHOLD

# Seven joints have 3^7 = 2187 active sets and about a dozen are visited: after this many pivoting does not terminate.
MOST_PIVOTS = 5000
# The iteration for the sign stops at this relative error of the square, and fails after this many steps.
ROOT_ACCURACY, ROOT_STEPS = 1e-40, 100
SQUARED = {"ridge": FIXED_WEIGHT, "damped": DLS_DAMPING**2, "least squares": TIE}


def second_reference(problem, question, setting, *, limited):
    """The exact answer (m,) of `invariantqp.compare.exact.references.reference`, as floats."""
    with mp.workdps(DIGITS):
        return [float(v) for v in _answer(problem, question, setting, limited)]


def _answer(problem, question, setting, limited):
    if problem == "law":
        return _law(question, setting)
    if problem == "ridge" or limited:
        return least_index(*_least_squares_qp(question, SQUARED[problem]), question.lower, question.upper)
    if problem == "damped":
        return rational_solve(*_least_squares_qp(question, SQUARED[problem]))
    s, none = [Fraction(v) for v in question.s.tolist()], [Fraction(0)] * setting.m
    if setting.m >= 6:
        return _saddle(_rational(question.J.T), none, s)[: setting.m]
    return _saddle(_rational(question.J), s, none)[6:]


def _law(question, setting):
    A, b = _measured(question, setting)
    S, c = A.T * A, A.T * b
    H = S + _left(S, max(mp.eigsy(A * A.T, eigvals_only=True)))
    found = mp.matrix([number(v) for v in _by_pivots(H, c, question)])
    moving = found if setting.m <= 6 else A.T * mp.lu_solve(A * A.T, A * found)
    H += _calm(A, b, found, mp.norm(moving), setting.dt) * mp.eye(setting.m)
    return map(number, _by_pivots(H, c, question))


def _by_pivots(H, c, question):
    rows = [[fraction(v) for v in row] for row in H.tolist()]
    return least_index(rows, [fraction(v) for v in c], question.lower, question.upper)


def _left(S, largest):
    """L^2 without eigenvectors."""
    X = mp.eye(S.rows) - S / (mp.mpf(DEFAULT_THRESHOLD) ** 2 * largest)
    positive = (X + X * _sign(X)) / 2
    return mp.mpf(DEFAULT_CEILING) ** 2 * largest * positive * positive


def _sign(X):
    """The sign of a symmetric matrix by Newton's scaled iteration."""
    for _ in range(ROOT_STEPS):
        scale = abs(mp.det(X)) ** (mp.mpf(-1) / X.rows)
        X = (scale * X + mp.inverse(scale * X)) / 2
        if mp.mnorm(X * X - mp.eye(X.rows), "f") < ROOT_ACCURACY:
            return X
    raise AssertionError("the iteration for the matrix sign did not converge")


def number(x):
    """A rational or mpmath number as a number of mpmath."""
    return mp.mpf(x.numerator) / x.denominator if isinstance(x, Fraction) else mp.mpf(x)


def fraction(x):
    """The rational number that is exactly x."""
    if isinstance(x, mp.mpf):
        sign, mantissa, exponent, _ = x._mpf_
        value = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
        return -value if sign else value
    return Fraction(float(x))


def _rational(A):
    return [[Fraction(v) for v in row] for row in A.tolist()]


def _saddle(B, top, bottom):
    """(y; x) of [[I, B], [B', 0]] (y; x) = (top; bottom)."""
    zero, one, n = Fraction(0), Fraction(1), len(B)
    rows = [[*(one if i == j else zero for j in range(n)), *row] for i, row in enumerate(B)]
    rows += [[*column, *[zero] * len(bottom)] for column in zip(*B, strict=True)]
    return rational_solve(rows, [*top, *bottom])


def _least_squares_qp(question, squared):
    J, s = _rational(question.J), [Fraction(v) for v in question.s.tolist()]
    m = len(J[0])
    H = [
        [sum((row[i] * row[j] for row in J), Fraction(squared if i == j else 0.0)) for j in range(m)] for i in range(m)
    ]
    return H, [sum((row[i] * v for row, v in zip(J, s, strict=True)), Fraction(0)) for i in range(m)]


def least_index(H, c, lower, upper):
    """The minimiser in rational numbers: the first joint in the wrong place changes it, until every joint is right.

    A free joint outside its bounds moves to the bound; a joint at a bound whose slope points inwards becomes free.
    """
    low, high = [Fraction(v) for v in lower], [Fraction(v) for v in upper]
    side = [0] * len(low)  # 0 free, 1 at the upper bound, -1 at the lower
    for _ in range(MOST_PIVOTS):
        x = _minimum(H, c, [high[i] if s > 0 else low[i] if s < 0 else None for i, s in enumerate(side)])
        wrong = _first_wrong(H, c, x, low, high, side)
        if wrong is None:
            return x
        side[wrong[0]] = wrong[1]
    raise AssertionError("least-index pivoting did not terminate")


def _minimum(H, c, held):
    """The minimum over the free joints, those whose held value is None, with the other joints at their values."""
    free = [i for i, value in enumerate(held) if value is None]
    x = [Fraction(0) if value is None else value for value in held]
    rhs = [c[i] - _product(H[i], x) for i in free]
    for i, value in zip(free, rational_solve([[H[i][j] for j in free] for i in free], rhs), strict=True):
        x[i] = value
    return x


def _product(row, x):
    return sum((a * b for a, b in zip(row, x, strict=True)), Fraction(0))


def _first_wrong(H, c, x, low, high, side):
    """The first joint that is in the wrong place, and the right one: free (0), or at a bound (1, -1)."""
    for i, here in enumerate(side):
        if here == 0:
            there = 1 if x[i] > high[i] else -1 if x[i] < low[i] else 0
        else:
            there = 0 if here * (c[i] - _product(H[i], x)) < 0 else here
        if there != here:
            return i, there
    return None


def rational_solve(A, b):
    """A^-1 b by Gaussian elimination in rational numbers."""
    n = len(b)
    rows = [[*map(Fraction, row), Fraction(v)] for row, v in zip(A, b, strict=True)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k] != 0), None)
        if pivot is None:
            raise AssertionError("a singular system has no unique exact answer")
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(k + 1, n):
            if rows[i][k] != 0:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [a - factor * p for a, p in zip(rows[i], rows[k], strict=True)]
    x = [Fraction(0)] * n
    for k in reversed(range(n)):
        x[k] = (rows[k][n] - _product(rows[k][k + 1 : n], x[k + 1 :])) / rows[k][k]
    return x


def limited_minimum(T, centre, A, lower, upper):
    """The z with the least |T^-1 (z - centre)| inside lower <= A z <= upper, in rational numbers; None where none is.

    Every set of limits is tried until the equations of an optimum hold, smaller sets first; all arguments are whole
    numbers but for infinite limits.
    """
    n, values = len(centre), [_product(row, centre) for row in A]
    N = [[_product(row, column) for column in zip(*T, strict=True)] for row in A]
    sides = [(i, side, b) for i in range(len(A)) for side, b in ((1, upper[i]), (-1, lower[i])) if abs(b) < inf]
    for k in range(n + 1):
        for at in combinations(sides, k):
            gram = [[_product(N[i], N[j]) for j, _, _ in at] for i, _, _ in at]
            try:
                y = rational_solve(gram, [values[i] - Fraction(b) for i, _, b in at])
            except AssertionError:  # these depend on each other: fewer of them do
                continue
            if any(side * v < 0 for (_, side, _), v in zip(at, y, strict=True)):
                continue
            e = [-sum((N[i][l] * v for (i, _, _), v in zip(at, y, strict=True)), Fraction(0)) for l in range(n)]
            z = [c + _product(row, e) for c, row in zip(centre, T, strict=True)]
            here = [_product(row, z) for row in A]
            if all(low <= v <= high for low, v, high in zip(lower, here, upper, strict=True)):
                return z
    return None
