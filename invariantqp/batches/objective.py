"""The law's damped least squares inside a box, for rows of any library, with its derivative.

    minimise |A x - b|^2 + |x - x_p|^2_Lambda   over lower <= x <= upper,     Lambda = V diag(lambda_i^2) V'

V and lambda as in `legacy.objective` and `legacy.damping`. The answer is computed without derivatives. They come
from the optimum's own equation: with g the gradient of the objective and H its Hessian, on the free joints

    H_FF dx_F = -(dg + H_FB dx_B),       dx_B = that of the bound

so one solve gives them, of first order; the passes that found the optimum take no part.

The optimum itself is that of |K (x - x*)|^2, K (m, m) of full rank, by one active set a row; the work is bounded. Every
row begins at x* clipped to its box. A pass finds the optimum of its free joints. If that is inside, one joint whose
bound does not resist is freed; if not, the row goes as far as the first bound on the way, which is then held. So x
never leaves the box and the objective never rises. Rows are the last axis there: a pass is some tens of operations on
whole arrays, with no branch in them.

Reference: Daleckii & Krein 1965, for the derivative of Lambda; the implicit function theorem for the rest; Nocedal &
Wright, Numerical Optimization, 16.5; Bjorck 1967 (least squares by modified Gram-Schmidt).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from invariantqp.batches.namespace import (
    Namespace,
    Rows,
    carries_derivatives,
    constant,
    detached,
    iterated,
    length_of,
    precision,
)
from invariantqp.geometry.arrays import NEGLIGIBLE
from invariantqp.legacy.damping import CALM, DEVIATION_SHARE, UNLIMITED_CEILING, Adaptive, Fixed
from invariantqp.legacy.objective import NULL_RATIO, NULL_WEIGHT

# In single precision, directions that the law damps by less than this share of the largest singular value are damped by
# so much: the square of a smaller one would be rounding beside the others.
SINGLE_CEILING = 1e-3
# Times the rounding that a joint may be outside its bound, or its bound may pull, before that counts.
ROUNDING = 4.0


class Least(NamedTuple):
    """The optimum of each row."""

    x: Rows  # (..., m) inside the box
    side: Rows  # (..., m) -1 at the lower bound, 1 at the upper, 0 between
    converged: Rows  # (...) whether it is the optimum


class Damped(NamedTuple):
    """lambda^2 as a function of s = sigma^2."""

    values: Rows  # (..., m)
    slopes: Rows  # (..., m, m) its divided differences, for the derivative of Lambda
    by_largest: Rows  # (..., m) its derivative by the largest s


def damped_least_squares(
    xp: Namespace,
    A: Rows,
    b: Rows,
    lower: Rows,
    upper: Rows,
    posture: Rows,
    damping: Adaptive | Fixed | None,
    unit: Rows,
    dt: float = 0.0,
) -> Least:
    """The optimum and its derivative.

    Args:
        xp: namespace.
        A: (..., k, m) finite, of size one or zero.
        b: (..., k) finite.
        lower: (..., m) at most `upper`.
        upper: likewise.
        posture: (..., m) x_p.
        damping: the policy; None is the law's default for each row.
        unit: (..., 1) what A and b were divided by, for a fixed lambda.
        dt: how long the velocity is held, for `legacy.damping.calm`; the answer then has no derivative.
    """
    A0, b0, low, high, towards = (detached(v) for v in (A, b, lower, upper, posture))
    m = A0.shape[-1]
    if A0.shape[-2] < m:
        fill = xp.broadcast_to(xp.zeros_like(A0[..., :1, :]), (*A0.shape[:-2], m - A0.shape[-2], m))
        A0, b0 = xp.concat((A0, fill), axis=-2), xp.concat((b0, fill[..., 0]), axis=-1)
    U, sigma, Vt = xp.linalg.svd(A0, full_matrices=False)
    largest = sigma[..., :1]
    still = largest == 0.0
    ratio = SINGLE_CEILING**2 if precision(xp, A0) > NEGLIGIBLE else NULL_RATIO
    largest = xp.where(still, xp.ones_like(largest), largest)
    sigma = sigma * xp.clip(sigma / (ratio * largest) - 1.0, 0.0, 1.0)
    null = sigma == 0.0
    limited = xp.all(xp.isfinite(low) & xp.isfinite(high), axis=-1)[..., None]
    damped = _damped(xp, sigma, largest, null, damping, limited, unit)
    weights = sigma * sigma + damped.values
    wanted = _times(xp.matrix_transpose(U), b0)
    optimum = (sigma * wanted + damped.values * _times(Vt, towards)) / weights
    spectrum = (Vt, sigma, damped)
    x, side, converged, K, free = _boxed(xp, Vt, weights, optimum, low, high)
    if dt > 0.0:
        speed = length_of(xp, xp.where(null, xp.zeros_like(sigma), _times(Vt, x)))
        added = _calm(xp, A0, b0, x, speed, dt)[..., None]
        total = weights + added
        x, side, converged, K, free = _boxed(xp, Vt, total, optimum * (weights / total), low, high)
    if dt == 0.0 and carries_derivatives(A, b, lower, upper, posture):
        bound = xp.where(side < 0.0, lower, xp.where(side > 0.0, upper, x))
        change = _gradient(xp, A, b, posture, bound, spectrum)
        change = _rows_last(xp, change - detached(change), 1)
        newton = inverse_hessian_times(xp, K, free, change)
        x = bound - xp.reshape(xp.matrix_transpose(newton), side.shape)
    return Least(x, side, converged)


def _boxed(
    xp: Namespace, Vt: Rows, weights: Rows, optimum: Rows, low: Rows, high: Rows
) -> tuple[Rows, Rows, Rows, Rows, Rows]:
    """x, side (..., m) and converged (...) for K = diag(sqrt(weights)) V'; K (m, m, N), free joints (m, N)."""
    roots = xp.sqrt(weights)
    centre, axes = _times(xp.matrix_transpose(Vt), optimum), Vt.ndim - 2
    condition = xp.reshape(xp.max(roots, axis=-1) / xp.min(roots, axis=-1), (-1,))
    K, start, lower, upper = (_rows_last(xp, v, v.ndim - axes) for v in (roots[..., None] * Vt, centre, low, high))
    found = least_squares_in_box(xp, Problem(K, start, lower, upper, condition))
    x, side = (xp.reshape(xp.matrix_transpose(v), centre.shape) for v in (found.x, found.side))
    return x, side, xp.reshape(found.converged, centre.shape[:-1]), K, found.side == 0.0


def _calm(xp: Namespace, A: Rows, b: Rows, x: Rows, speed: Rows, dt: float) -> Rows:
    """(...) mu of `legacy.damping.calm`."""
    size, left = xp.sqrt(xp.sum(A * A, axis=(-2, -1))), length_of(xp, b - _times(A, x))
    deviation = DEVIATION_SHARE * dt * size * speed * speed - length_of(xp, b)
    error = left + xp.maximum(deviation, xp.zeros_like(deviation))
    return xp.maximum(0.5 * CALM * dt * error * size - NEGLIGIBLE * size * size, xp.zeros_like(error))


def _gradient(xp: Namespace, A: Rows, b: Rows, posture: Rows, x: Rows, spectrum: tuple[Rows, Rows, Damped]) -> Rows:
    """(..., m) A'(A x - b) + Lambda(A) (x - x_p), right to first order in everything."""
    Vt, sigma, damped = spectrum
    AV = A @ xp.matrix_transpose(Vt)
    S = xp.matrix_transpose(AV) @ AV
    S = S - detached(S)
    m = sigma.shape[-1]
    one = constant(xp, sigma, np.eye(m))
    change = damped.slopes * S + one * (damped.by_largest * S[..., 0, 0][..., None])[..., None, :]
    left = _times(Vt, x - posture)
    pulled = damped.values * left + _times(change, left)
    return _times(xp.matrix_transpose(A), _times(A, x) - b) + _times(xp.matrix_transpose(Vt), pulled)


def _damped(
    xp: Namespace, sigma: Rows, largest: Rows, null: Rows, damping: Adaptive | Fixed | None, limited: Rows, unit: Rows
) -> Damped:
    """The policy's squares; directions that move nothing have a weight in any case."""
    s, top = sigma * sigma, largest * largest
    single = precision(xp, sigma) > NEGLIGIBLE
    if isinstance(damping, Fixed):
        values, inside = xp.zeros_like(s) + (damping.value / unit) ** 2, xp.zeros_like(s) > 1.0
        inner, by_largest = xp.zeros_like(s)[..., None], xp.zeros_like(s)
    else:
        policy = damping or Adaptive()
        one = xp.ones_like(top)
        threshold, ceiling = one * policy.threshold, one * policy.ceiling
        if damping is None:
            ceiling = xp.where(limited, ceiling, one * UNLIMITED_CEILING)
        ceiling = xp.maximum(ceiling, one * SINGLE_CEILING) if single else ceiling
        c, t = ceiling * ceiling, threshold * threshold
        u = xp.minimum(s / (t * top), one)
        values, by_largest, inside = c * top * (1.0 - u) ** 2, c * (1.0 - u * u), u < 1.0
        inner = -(c / t)[..., None] * (2.0 - u[..., :, None] - u[..., None, :])
    floor = (SINGLE_CEILING**2 if single else NULL_WEIGHT) * top
    bare = null & (values == 0.0)
    values, by_largest = xp.where(bare, floor, values), xp.where(bare, floor / top, by_largest)
    both = inside[..., :, None] & inside[..., None, :]
    return Damped(values, xp.where(both, inner, _quotients(xp, s, values)), by_largest)


def _quotients(xp: Namespace, s: Rows, values: Rows) -> Rows:
    """(..., m, m) divided differences of values (..., m) over s (..., m), 0 where s are equal."""
    apart = s[..., :, None] - s[..., None, :]
    steps = values[..., :, None] - values[..., None, :]
    same = apart == 0.0
    return xp.where(same, xp.zeros_like(apart), steps / xp.where(same, xp.ones_like(apart), apart))


def _rows_last(xp: Namespace, value: Rows, axes: int) -> Rows:
    """(m, ..., N) rows after the last `axes` axes, whatever axes of rows there are, contiguous."""
    rows = xp.reshape(value, (-1, *value.shape[value.ndim - axes :]))
    return xp.stack([xp.moveaxis(rows, 0, -1)], axis=0)[0]


def _times(M: Rows, v: Rows) -> Rows:
    """(..., k) the product of (..., k, m) and (..., m)."""
    return (M @ v[..., None])[..., 0]


class Problem(NamedTuple):
    """What is minimised in each row: K (m, m, N), x*, lower and upper (m, N), and K's condition number (N,)."""

    K: Rows
    centre: Rows
    lower: Rows
    upper: Rows
    condition: Rows


class Boxed(NamedTuple):
    """Where each row is."""

    x: Rows  # (m, N) inside the box
    side: Rows  # (m, N) -1 held at the lower bound, 1 at the upper, 0 free
    converged: Rows  # (N,) whether x is the optimum, to rounding


def least_squares_in_box(xp: Namespace, problem: Problem) -> Boxed:
    """The optimum of every row; where it is not converged, the best velocity found."""
    _, centre, lower, upper, _ = problem
    zero = xp.zeros_like(centre)
    side = xp.where((lower >= upper) | (centre < lower), zero - 1.0, xp.where(centre > upper, zero + 1.0, zero))
    begin = Boxed(xp.minimum(xp.maximum(centre, lower), upper), side, zero[0] > 1.0)
    # Of 4096 random rows with 8 joints none needs more than 25 passes.
    x, side, found = iterated(partial(_pass, xp), problem, begin, 4 * centre.shape[0] + 10)
    x = xp.where(side < 0.0, lower, xp.where(side > 0.0, upper, x))
    return Boxed(xp.minimum(xp.maximum(x, lower), upper), side, found)


def _pass(xp: Namespace, problem: Problem, here: Boxed) -> Boxed:
    """One step of every row; a converged row stays."""
    K, centre, lower, upper, condition = problem
    zero, held = xp.zeros_like(centre), here.side != 0.0
    one = zero + 1.0
    moved = xp.where(held, here.x - centre, zero)
    pull = xp.sum(K * moved[None], axis=1)
    R, z, left = triangular(xp, xp.where(held[None], xp.zeros_like(K), K), -pull)
    x = centre + moved + _back(xp, R, z)
    eps = ROUNDING * precision(xp, x)
    slack = eps * condition * xp.max(xp.abs(x), axis=0)
    low, high = ~held & (x < lower - slack), ~held & (x > upper + slack)
    outside = low | high
    way = xp.where(outside, x - here.x, one)
    shares = xp.where(outside, xp.clip((xp.where(low, lower, upper) - here.x) / way, 0.0, 1.0), one)
    share = xp.min(shares, axis=0)
    blocking = outside & (shares <= share)
    # How much each bound resists: the pull on its joint along the bound's own direction, beside the joint's size.
    resists = here.side * xp.sum(K * left[:, None], axis=0) / xp.sqrt(xp.sum(K * K, axis=0))
    weak = held & (lower < upper) & (resists < -eps * xp.max(xp.abs(pull), axis=0))
    through = ~xp.any(outside, axis=0)
    freed = weak & (resists <= xp.min(xp.where(weak, resists, zero), axis=0)) & through
    side = xp.where(blocking, xp.where(low, -one, one), xp.where(freed, zero, here.side))
    bound = xp.where(low, lower, upper)
    x = xp.where(blocking, bound, here.x + share * (x - here.x))
    return Boxed(x, side, through & ~xp.any(weak, axis=0))


def triangular(xp: Namespace, K: Rows, right: Rows) -> tuple[list[Rows], list[Rows], Rows]:
    """Modified Gram-Schmidt: rows j of R (m - j, ...), Q'right entry by entry, and what is left of `right`.

    A column of zeros has R_jj = 1 and entry 0.
    """
    rest, R, z = xp.concat((K, right[:, None]), axis=1), [], []
    for _ in range(K.shape[1]):
        column = rest[:, 0]
        size = xp.sqrt(xp.sum(column * column, axis=0))
        size = xp.where(size > 0.0, size, xp.ones_like(size))
        q = column / size
        dots = xp.sum(q[:, None] * rest[:, 1:], axis=0)
        rest = rest[:, 1:] - q[:, None] * dots[None]
        R.append(xp.concat((size[None], dots[:-1]), axis=0))
        z.append(dots[-1])
    return R, z, rest[:, 0]


def _back(xp: Namespace, R: list[Rows], z: list[Rows]) -> Rows:
    """(m, ...) the solution of R u = z."""
    found: list[Rows] = []
    for row, entry in zip(reversed(R), reversed(z), strict=True):
        beyond = xp.sum(row[1:] * xp.stack(found, axis=0), axis=0) if found else 0.0
        found.insert(0, (entry - beyond) / row[0])
    return xp.stack(found, axis=0)


def inverse_hessian_times(xp: Namespace, K: Rows, free: Rows, g: Rows) -> Rows:
    """(K_F'K_F)^-1 g on the free joints, 0 for the others; g (m, ...)."""
    R, _, _ = triangular(xp, xp.where(free[None], K, xp.zeros_like(K)), xp.zeros_like(g))
    left, y = xp.where(free, g, xp.zeros_like(g)), []
    for row in R:  # R'y = g
        y.append(left[0] / row[0])
        left = left[1:] - row[1:] * y[-1]
    return _back(xp, R, y)
