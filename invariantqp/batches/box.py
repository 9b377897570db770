"""Least squares inside a box for many rows at once, by one active set a row; the work is bounded.

    minimise |K (x - x*)|^2   over lower <= x <= upper,      K (m, m) of full rank, the same sizes in every row

Every row begins at x* clipped to its box. A pass finds the optimum of its free joints. If that is inside, one joint
whose bound does not resist is freed; if not, the row goes as far as the first bound on the way, which is then held. So
x never leaves the box and the objective never rises. Rows are the last axis here: a pass is some tens of operations on
whole arrays, with no branch in them.

References: Nocedal & Wright, Numerical Optimization, 16.5; Bjorck 1967 (least squares by modified Gram-Schmidt).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from invariantqp.batches.namespace import Namespace, Rows, precision, settled

# Times the rounding that a joint may be outside its bound, or its bound may pull, before that counts.
ROUNDING = 4.0


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
    settled: Rows  # (N,) whether x is the optimum, to rounding


def most_passes(m: int) -> int:
    """How many passes are made at most for m joints; of 4096 random rows with 8 joints none needs more than 25."""
    return 4 * m + 10


def least_squares_in_box(xp: Namespace, problem: Problem) -> Boxed:
    """The optimum of every row; where it is not settled, the best velocity found."""
    _, centre, lower, upper, _ = problem
    zero = xp.zeros_like(centre)
    side = xp.where((lower >= upper) | (centre < lower), zero - 1.0, xp.where(centre > upper, zero + 1.0, zero))
    begin = Boxed(xp.minimum(xp.maximum(centre, lower), upper), side, zero[0] > 1.0)
    x, side, found = settled(partial(_pass, xp), problem, begin, most_passes(centre.shape[0]))
    x = xp.where(side < 0.0, lower, xp.where(side > 0.0, upper, x))
    return Boxed(xp.minimum(xp.maximum(x, lower), upper), side, found)


def _pass(xp: Namespace, problem: Problem, here: Boxed) -> Boxed:
    """One step of every row; a settled row stays."""
    K, centre, lower, upper, condition = problem
    zero, held = xp.zeros_like(centre), here.side != 0.0
    one = zero + 1.0
    moved = xp.where(held, here.x - centre, zero)
    pull = xp.sum(K * moved[None], axis=1)
    u, left = free_least_squares(xp, K, -pull, ~held)
    x = centre + moved + u
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


def free_least_squares(xp: Namespace, K: Rows, right: Rows, free: Rows) -> tuple[Rows, Rows]:
    """argmin |K_F u_F - right| over free joints, 0 for the others; and right - K u, K (m, m, ...), others (m, ...)."""
    R, z, left = triangular(xp, xp.where(free[None], K, xp.zeros_like(K)), right)
    return _back(xp, R, z), left


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
