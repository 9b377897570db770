"""Exact answers to compare with, each made twice, by formulas and arithmetics that share nothing: 50 digits, fractions.

    least squares   J'(JJ')^-1 s or (J'J)^-1 J's            |  [[I, J'], [J, 0]] or [[I, J], [J', 0]], eliminated
    damped, ridge   J'(JJ' + lambda^2)^-1 s                 |  (J'J + lambda^2) x = J's
    pitch           (J'QJ)^-1 J'Qs                          |  [[Q^-1, J], [J', 0]]
    filter          V diag(mu / (mu^2 + lambda^2)) V'g      |  (G^2 + lambda^2) x = G g
    box             V diag(sqrt(mu^2 + lambda^2)) V'        |  the matrix square root of G^2 + lambda^2
                    active set, certified                   |  least-index pivoting

An answer whose two makings differ by more than 1e-12 is an error, and nothing is compared.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from invariantqp.compare.damped import DLS_DAMPING
from invariantqp.compare.invariant import FIXED_DAMPING
from invariantqp.compare.methods import Problem, Setting
from invariantqp.compare.moore_penrose import reach_of
from invariantqp.compare.qp_backends import QP_DAMPING
from invariantqp.errors import MissingExtra
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.forms import pitch_form
from invariantqp.velocity.convexify import NULL_WEIGHT
from invariantqp.velocity.damping import DEFAULT_CEILING, DEFAULT_THRESHOLD

try:
    import mpmath as mp

    from invariantqp.compare.exact_box import NoReference, ReferenceFailure, active_set, least_index, rational_solve
except ImportError as error:
    raise MissingExtra("mpmath", "compare") from error

DIGITS = 50
AGREEMENT = 1e-12
# A square root is done when its square is this close, and has this many steps to get there.
ROOT_ACCURACY = 1e-40
ROOT_STEPS = 60


class Question(NamedTuple):
    """What is asked: a twist of joints within bounds, in the frame that the problem is about."""

    J: Array
    s: Array
    lower: Array
    upper: Array


class Reference(NamedTuple):
    """The exact answer x (m,), and by how much, relative to its largest entry, the two ways to it differ."""

    x: Array
    agreement: float


def reference(problem: Problem, asked: Question, setting: Setting) -> Reference:
    """The exact answer to one of the problems.

    Raises:
        NoReference: it has no unique answer here.
        ReferenceFailure: the two ways to it do not agree to 1e-12.
    """
    with mp.workdps(DIGITS):
        first, second = _WAYS[problem]
        try:
            x = [mp.mpf(v) for v in first(asked, setting)]
        except ZeroDivisionError as error:  # what mpmath calls a singular matrix
            raise NoReference(f"{problem}: {error}") from error
        y = [_mpf(v) for v in second(asked, setting)]
        size = max(abs(v) for v in x) or mp.mpf(1)
        agreement = float(max(abs(a - b) for a, b in zip(x, y, strict=True)) / size)
        if not agreement <= AGREEMENT:
            raise ReferenceFailure(f"{problem}: two references differ by {agreement:.1e}, more than {AGREEMENT:g}")
        return Reference(np.array([float(v) for v in x]), agreement)


Numbers = Any
Way = Callable[[Question, Setting], Numbers]


def _mpf(x: Any) -> Any:
    return mp.mpf(x.numerator) / x.denominator if isinstance(x, Fraction) else mp.mpf(x)


def _fraction(x: Any) -> Fraction:
    """Exactly the number that x is."""
    if isinstance(x, mp.mpf):
        sign, mantissa, exponent, _ = x._mpf_
        value = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
        return -value if sign else value
    return Fraction(float(x))


def _matrix(A: Array) -> Any:
    return mp.matrix(A.tolist())


def _rational(A: Array) -> list[list[Fraction]]:
    return [[Fraction(v) for v in row] for row in A.tolist()]


def _eye(n: int, scale: Fraction = Fraction(1)) -> list[list[Fraction]]:
    return [[scale if i == j else Fraction(0) for j in range(n)] for i in range(n)]


def _augmented(metric_inverse: list[list[Fraction]], J: list[list[Fraction]], rhs: list[Fraction]) -> list[Fraction]:
    """[[M^-1, J], [J', 0]] [y; x] = [rhs; 0], for x."""
    n, m = len(J), len(J[0])
    rows = [[*metric_inverse[i], *J[i]] for i in range(n)]
    rows += [[*(J[i][j] for i in range(n)), *[Fraction(0)] * m] for j in range(m)]
    return rational_solve(rows, [*rhs, *[Fraction(0)] * m])[n:]


def _shortest(J: list[list[Fraction]], s: list[Fraction]) -> list[Fraction]:
    """The shortest x with Jx = s, from [[I, J'], [J, 0]] [x; y] = [0; s]."""
    m = len(J[0])
    rows = [[*row, *(J[k][i] for k in range(6))] for i, row in enumerate(_eye(m))]
    rows += [[*J[k], *[Fraction(0)] * 6] for k in range(6)]
    return rational_solve(rows, [*[Fraction(0)] * m, *s])[:m]


def _form(problem: str, setting: Setting) -> Array:
    """The matrix of the form that a problem measures twists by."""
    if problem.startswith("inertia"):
        return np.diag(setting.inertia)
    return pitch_form(setting.pitch)


def _stationary(problem: str) -> tuple[Way, Way]:
    """Undamped: of the form for fewer than six joints, the shortest that meets the twist otherwise."""

    def first(asked: Question, setting: Setting) -> Numbers:
        J, s = _matrix(asked.J), mp.matrix(asked.s.tolist())
        if setting.m >= 6:
            return J.T * mp.lu_solve(J * J.T, s)
        Q = mp.eye(6) if problem == "least squares" else _matrix(_form(problem, setting))
        return mp.lu_solve(J.T * Q * J, J.T * Q * s)

    def second(asked: Question, setting: Setting) -> Numbers:
        J, s = _rational(asked.J), [Fraction(v) for v in asked.s.tolist()]
        if setting.m >= 6:
            return _shortest(J, s)
        if problem == "least squares":
            return _augmented(_eye(6), J, s)
        Q = _rational(_form(problem, setting))
        columns = [rational_solve(Q, unit) for unit in _eye(6)]
        return _augmented([list(row) for row in zip(*columns, strict=True)], J, s)

    return first, second


def _weighted() -> tuple[Way, Way]:
    plain = _stationary("least squares")

    def way(k: int) -> Way:
        def answer(asked: Question, setting: Setting) -> Numbers:
            reach = reach_of(asked.lower, asked.upper)
            # The scaled Jacobian is rounded once, for both ways alike: that rounding is the method's, not the answer's.
            x = plain[k](asked._replace(J=asked.J * reach), setting)
            return [value * _of(value, r) for value, r in zip(x, reach.tolist(), strict=True)]

        return answer

    return way(0), way(1)


def _of(like: Any, x: float) -> Any:
    return Fraction(x) if isinstance(like, Fraction) else mp.mpf(x)


def _ridge(squared: float) -> tuple[Way, Way]:
    def first(asked: Question, _: Setting) -> Numbers:
        J, s = _matrix(asked.J), mp.matrix(asked.s.tolist())
        return J.T * mp.lu_solve(J * J.T + mp.mpf(squared) * mp.eye(6), s)

    def second(asked: Question, _: Setting) -> Numbers:
        H, c = _least_squares_qp(asked, squared)
        return rational_solve(H, c)

    return first, second


def _least_squares_qp(asked: Question, squared: float) -> tuple[list[list[Fraction]], list[Fraction]]:
    J, s = _rational(asked.J), [Fraction(v) for v in asked.s.tolist()]
    m = len(J[0])
    H = [
        [sum((row[i] * row[j] for row in J), Fraction(squared if i == j else 0.0)) for j in range(m)] for i in range(m)
    ]
    return H, [sum((row[i] * v for row, v in zip(J, s, strict=True)), Fraction(0)) for i in range(m)]


def _ridge_box(squared: float) -> tuple[Way, Way]:
    def first(asked: Question, setting: Setting) -> Numbers:
        J, s = _matrix(asked.J), mp.matrix(asked.s.tolist())
        H = J.T * J + mp.mpf(squared) * mp.eye(setting.m)
        return active_set(H, J.T * s, asked.lower.tolist(), asked.upper.tolist())

    def second(asked: Question, _: Setting) -> Numbers:
        return least_index(*_least_squares_qp(asked, squared), asked.lower.tolist(), asked.upper.tolist())

    return first, second


class _Gram(NamedTuple):
    """(G, g) in 50 digits, and lambda."""

    G: Any
    g: Any
    damping: Any
    largest: Any


def _adaptive(smallest: Any, largest: Any) -> Any:
    ratio = smallest / (largest * mp.mpf(DEFAULT_THRESHOLD))
    return mp.mpf(0) if ratio >= 1 else mp.mpf(DEFAULT_CEILING) * largest * (1 - ratio * ratio)


def _gram(problem: str, asked: Question, setting: Setting, mu: list[Any] | None = None) -> _Gram:
    """The Gram matrix and its damping; from the eigenvalues of QJJ' unless those of G are given."""
    J, s, Q = _matrix(asked.J), mp.matrix(asked.s.tolist()), _matrix(_form(problem, setting))
    G, g = J.T * Q * J, J.T * Q * s
    if mu is None:
        mu = [abs(v) for v in mp.eig(Q * J * J.T, left=False, right=False)]
    sizes = sorted((abs(v) for v in mu), reverse=True)[: min(setting.m, 6)]
    damping = mp.mpf(FIXED_DAMPING) if problem == "filter" else _adaptive(sizes[-1], sizes[0])
    return _Gram(G, g, damping, sizes[0])


class _Spectrum(NamedTuple):
    mu: Any
    V: Any
    optimum: list[Any]
    gram: _Gram
    null: list[int]


def _spectrum(problem: str, asked: Question, setting: Setting) -> _Spectrum:
    J, Q = _matrix(asked.J), _matrix(_form(problem, setting))
    mu, V = mp.eigsy(J.T * Q * J)
    gram = _gram(problem, asked, setting, list(mu))
    null = sorted(range(setting.m), key=lambda i: abs(mu[i]))[: max(0, setting.m - 6)]
    seen = V.T * gram.g
    squared = gram.damping**2
    optimum = [mp.mpf(0) if i in null else mu[i] / (mu[i] ** 2 + squared) * seen[i] for i in range(setting.m)]
    return _Spectrum(mu, V, optimum, gram, null)


def _filtered(problem: str) -> tuple[Way, Way]:
    undamped = _stationary("inertia" if problem == "inertia" else "pitch")

    def first(asked: Question, setting: Setting) -> Numbers:
        spectrum = _spectrum(problem, asked, setting)
        return spectrum.V * mp.matrix(spectrum.optimum)

    def second(asked: Question, setting: Setting) -> Numbers:
        G, g, damping, _ = _gram(problem, asked, setting)
        if damping == 0:
            return undamped[1](asked, setting)
        squared = _fraction(damping) ** 2
        A = [[_fraction(v) for v in row] for row in (G * G).tolist()]
        for i, row in enumerate(A):
            row[i] += squared
        return rational_solve(A, [_fraction(v) for v in G * g])

    return first, second


def _root(A: Any) -> Any:
    """The square root of a positive-definite matrix by Denman and Beavers' iteration, scaled; no eigenvalue is used."""
    n = A.rows
    X, Y = A.copy(), mp.eye(n)
    for _ in range(ROOT_STEPS):
        scale = (abs(mp.det(X)) * abs(mp.det(Y))) ** (mp.mpf(-1) / (2 * n))
        X, Y = (scale * X + mp.inverse(scale * Y)) / 2, (scale * Y + mp.inverse(scale * X)) / 2
        if mp.mnorm(X * X - A, "f") < ROOT_ACCURACY * mp.mnorm(A, "f"):
            return X
    raise ReferenceFailure("the matrix square root did not converge")


def _filtered_box(problem: str) -> tuple[Way, Way]:
    optimum = _filtered("inertia" if problem.startswith("inertia") else "adaptive")

    def first(asked: Question, setting: Setting) -> Numbers:
        mu, V, z, gram, null = _spectrum(problem, asked, setting)
        squared = gram.damping**2
        left = [mp.mpf(1) if i in null else squared / (mu[i] ** 2 + squared) for i in range(setting.m)]
        weight = [
            mp.sqrt((0 if i in null else mu[i] ** 2) + squared) + mp.mpf(NULL_WEIGHT) * gram.largest * left[i]
            for i in range(setting.m)
        ]
        H = V * mp.diag(weight) * V.T
        return active_set(H, H * (V * mp.matrix(z)), asked.lower.tolist(), asked.upper.tolist())

    def second(asked: Question, setting: Setting) -> Numbers:
        G, _, damping, largest = _gram(problem, asked, setting)
        squared, one = damping**2, mp.eye(setting.m)
        if damping > 0:
            A = G * G + squared * one
            left = squared * A**-1
            root = _root(A)
        else:
            J = _matrix(asked.J)
            left = one - J.T * mp.inverse(J * J.T) * J if setting.m > 6 else mp.zeros(setting.m)
            root = _root(G * G + largest**2 * left) - largest * left
        H = root + mp.mpf(NULL_WEIGHT) * largest * left
        z = mp.matrix([_mpf(v) for v in optimum[1](asked, setting)])
        c = [_fraction(v) for v in H * z]
        exact = [[_fraction(v) for v in row] for row in H.tolist()]
        return least_index(exact, c, asked.lower.tolist(), asked.upper.tolist())

    return first, second


_WAYS: dict[str, tuple[Way, Way]] = {
    "pitch": _stationary("pitch"),
    "least squares": _stationary("least squares"),
    "weighted": _weighted(),
    "ridge": _ridge(QP_DAMPING),
    "damped": _ridge(DLS_DAMPING**2),
    "least squares box": _ridge_box(QP_DAMPING),
    "damped box": _ridge_box(DLS_DAMPING**2),
    "filter": _filtered("filter"),
    "adaptive": _filtered("adaptive"),
    "inertia": _filtered("inertia"),
    "adaptive box": _filtered_box("adaptive"),
    "inertia box": _filtered_box("inertia"),
}
