"""The velocity law written a second time, from its formulas alone, and problems to hold both against each other."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from math import inf

import mpmath
import numpy as np
from scipy.optimize import linprog

import invariantqp as iq

# What the law says of itself, repeated here on purpose.
UNLIMITED = (1e-2, 1e-2)  # threshold and ceiling of the damping where some joint has no bound
LIMITED = (1e-2, 2e-3)
NULL_WEIGHT = 1e-8
CALM, DEVIATION, QUIET = 0.25, 0.25, 1e-9  # of the damping that grows with what is missed
DIGITS = 50
# Seven joints have 3^7 = 2187 active sets and about a dozen are visited: after this many pivoting does not terminate.
MOST_PIVOTS = 5000


def fraction(x):
    """The rational number that is exactly x."""
    if isinstance(x, mpmath.mpf):
        sign, mantissa, exponent, _ = x._mpf_
        value = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
        return -value if sign else value
    return Fraction(float(x))


def skew(p):
    return np.array(((0.0, -p[2], p[1]), (p[2], 0.0, -p[0]), (-p[1], p[0], 0.0)))


def root_of(point, length):
    """root with |root s|^2 = L^2 |omega|^2 + |v + omega x p|^2."""
    return np.block([[length * np.eye(3), np.zeros((3, 3))], [-skew(point), np.eye(3)]])


def reach_of(J, point):
    """The broken line from the point to its foot on each turning axis, the last joint first."""
    here, length = np.array(point, dtype=float), 0.0
    for column in J.T[::-1]:
        w, v = column[:3], column[3:]
        if np.linalg.norm(w) > 0.0:
            foot = skew(w) @ v / (w @ w)
            foot = foot + w * (w @ (here - foot)) / (w @ w)
            length += np.linalg.norm(foot - here)
            here = foot
    return length


def adaptive(sigma, largest, threshold, ceiling):
    """lambda^2: (ceiling largest (1 - (sigma / (threshold largest))^2))^2 below the threshold, 0 above."""
    share = min(sigma / (threshold * largest), 1)
    return (ceiling * largest * (1 - share * share)) ** 2


def damped_velocity(A, b, posture, policy, digits=40):
    """x = sum of v_i (sigma_i u_i'b + lambda_i^2 v_i'x_p) / (sigma_i^2 + lambda_i^2), every digit of it.

    `policy(sigma, largest)` is lambda^2; a direction that moves nothing goes to the posture whole.
    """
    m = A.shape[1]
    with mpmath.workdps(digits):
        M, wanted = mpmath.matrix(A.tolist()), mpmath.matrix(b.tolist())
        towards = mpmath.matrix(np.zeros(m).tolist() if posture is None else posture.tolist())
        gram, pull = M.T * M, M.T * wanted
        squares, V = mpmath.eigsy(gram)
        largest = mpmath.sqrt(max(squares))
        x = mpmath.matrix(m, 1)
        for i in range(m):
            v = V[:, i]
            sigma = mpmath.sqrt(max(squares[i], 0))
            along = (v.T * towards)[0]
            if sigma > mpmath.mpf(10) ** -12 * largest:
                lam = policy(sigma, largest)
                along = ((v.T * pull)[0] + lam * along) / (squares[i] + lam)
            x += v * along
        return np.array([float(value) for value in x])


def shipped(A, b, dt, lower, upper):
    """The whole law inside limits, from its formulas, for a tick without posture, exact rows and chase.

    minimise |A x - b|^2 + x'L^2 x + mu |x|^2,    L^2 from the damping,    mu from the residual for mu = 0
    mu = max(0, 1/2 CALM dt (|b - A x| + max(0, DEVIATION dt |A| |x_seen|^2 - |b|)) |A| - QUIET |A|^2)
    """
    with mpmath.workdps(DIGITS):
        A, b = mpmath.matrix(A.tolist()), mpmath.matrix(b.tolist())
        squares, V = mpmath.eigsy(A.T * A)
        largest = mpmath.sqrt(max(squares))
        sigma = [mpmath.sqrt(max(value, 0)) for value in squares]
        H = V * mpmath.diag([s * s + adaptive(s, largest, *LIMITED) for s in sigma]) * V.T
        pull, size, dt = A.T * b, mpmath.mnorm(A, "f"), mpmath.mpf(dt)
        x = mpmath.matrix(box_minimum(H.tolist(), pull, lower, upper).tolist())
        along = V.T * x
        speed = mpmath.norm([v for v, s in zip(along, sigma, strict=True) if s > mpmath.mpf(10) ** -12 * largest])
        excess = max(mpmath.mpf(0), DEVIATION * dt * size * speed * speed - mpmath.norm(b))
        mu = max(mpmath.mpf(0), CALM * dt * (mpmath.norm(b - A * x) + excess) * size / 2 - QUIET * size * size)
        return box_minimum((H + mu * mpmath.eye(len(x))).tolist(), pull, lower, upper)


def least_squares_form(A, b, posture=None, damping=LIMITED):
    """(H, c) of minimise 1/2 x'Hx - c'x: damped least squares, (1e-4)^2 of the largest where nothing is moved."""
    U, sigma, Vt = np.linalg.svd(A)
    m, k = A.shape[1], len(sigma)
    sizes, pull = np.zeros(m), np.zeros(m)
    sizes[:k], pull[:k] = sigma, sigma * (U.T @ b)[:k]
    squares = np.full(m, damping**2) if np.ndim(damping) == 0 else None
    if squares is None:
        squares = np.array([adaptive(value, sigma[0], *damping) for value in sizes])
    null = sizes <= 1e-12 * sigma[0]
    squares[null & (squares == 0.0)] = NULL_WEIGHT * sigma[0] ** 2  # where the policy damps nothing
    sizes[null], pull[null] = 0.0, 0.0
    wanted = np.zeros(m) if posture is None else Vt @ posture
    return Vt.T @ np.diag(sizes**2 + squares) @ Vt, Vt.T @ (pull + squares * wanted)


def box_minimum(H, c, lower, upper):
    """The minimiser over a box in rational numbers, by least-index pivoting: no solver, no tolerance.

    A free joint outside its bounds moves to the bound; a joint at a bound whose slope points inwards becomes free; the
    first in the wrong place changes, until every one is right.

    Reference: Murty 1974 (least-index pivoting), Judice & Pires 1992 (with bounds).
    """
    H, c = [[fraction(v) for v in row] for row in H], [fraction(v) for v in c]
    low, high = ([fraction(v) if np.isfinite(v) else v for v in side] for side in (lower, upper))
    side = [0] * len(low)  # 0 free, 1 at the upper bound, -1 at the lower
    for _ in range(MOST_PIVOTS):
        x = _minimum(H, c, [high[i] if s > 0 else low[i] if s < 0 else None for i, s in enumerate(side)])
        wrong = _first_wrong(H, c, x, low, high, side)
        if wrong is None:
            return np.array([float(value) for value in x])
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


def quadprog_minimum(H, c, lower, upper, C=None, low=None, high=None):
    """The same by quadprog, with rows low <= C x <= high; all limits finite."""
    import quadprog

    m = len(c)
    normals, sides = [np.eye(m), -np.eye(m)], [np.asarray(lower), -np.asarray(upper)]
    if C is not None:
        normals, sides = [*normals, np.asarray(C).T, -np.asarray(C).T], [*sides, np.asarray(low), -np.asarray(high)]
    return quadprog.solve_qp(0.5 * (H + H.T), c, np.hstack(normals), np.concatenate(sides))[0]


def eliminated(A, b, C, e, digits=40):
    """argmin |A x - b| with C x = e, from its own linear equations in 40 digits; C and [A; C] of full rank."""
    m, k = A.shape[1], len(C)
    with mpmath.workdps(digits):
        M, rows = mpmath.matrix(A.tolist()), mpmath.matrix(C.tolist())
        kkt, right = mpmath.zeros(m + k), mpmath.zeros(m + k, 1)
        kkt[:m, :m], kkt[:m, m:], kkt[m:, :m] = M.T * M, rows.T, rows
        right[:m, 0], right[m:, 0] = M.T * mpmath.matrix(b.tolist()), mpmath.matrix(list(map(float, e)))
        return np.array([float(v) for v in mpmath.lu_solve(kkt, right)[:m]])


def regular_problem(rng, m, ratio=2e-2):
    """(J, s, h) well away from singular in any sense: nothing is damped, and the pitch form is not filtered."""
    while True:
        J, s, h = rng.normal(size=(6, m)), rng.normal(size=6), float(rng.uniform(-1.5, 1.5))
        own = iq.systems.centre(J, s).point
        A = root_of(own, reach_of(J, own)) @ J
        sigma = np.linalg.svd(A, compute_uv=False)
        mu = np.sort(np.abs(np.linalg.eigvalsh(iq.systems.gram_matrix(J, h))))
        if sigma[-1] > ratio * sigma[0] and mu[-min(m, 6)] > ratio * mu[-1]:
            return J, s, h


def tight_box(rng, m, x, share=0.6):
    """Bounds with zero inside that the velocity x leaves at about `share` of its joints."""
    reach = np.where(rng.random((2, m)) < share, 0.5, 2.0) * np.abs(x) * rng.uniform(0.4, 1.0, size=(2, m)) + 1e-3
    return iq.Bounds(-reach[0], reach[1])


def largest_share(A, b, lower, upper):
    """max a in [0, 1] with A x = a b inside the box, on x itself; None where there is none."""
    k, m = A.shape
    result = linprog(
        [-1.0] + [0.0] * m,
        A_eq=np.column_stack((-b, A)),
        b_eq=np.zeros(k),
        bounds=[(0.0, 1.0), *zip(lower, upper, strict=True)],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    return result.x[0] if result.status == 0 else None
