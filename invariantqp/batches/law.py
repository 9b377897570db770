"""The velocity law of loops for rows of any array library, without forms, exact rows and limits but the bounds.

minimise L^2 |omega error|^2 + |v error at the point|^2 + damping   over lower <= x <= upper,      row by row

L is the arm's reach to the point, as in `velocity.measure`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.batches.namespace import (
    Namespace,
    Rows,
    as_arrays,
    cross,
    detached,
    leading_axes,
    length_of,
    over_largest,
    precision,
    shaped,
)
from invariantqp.batches.objective import Least, damped_least_squares
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import NEGLIGIBLE, ROUNDING
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.legacy.damping import PROGRESS_SHARE, Adaptive, Damping, Fixed, damping_of
from invariantqp.legacy.qp import PRODUCT_ROUNDING
from invariantqp.legacy.report import MISSED

# What the numbers in `Velocities.status` mean.
STATUSES = ("ok", "limited", "held")
# A reach below this many roundings of the coordinates that it is computed from is none.
ROUNDING_STEPS = 1e3


class Velocities(NamedTuple):
    """The answers, arrays of the library that was given; a pytree of JAX.

    Attributes:
        velocity: (..., m) inside the bounds, to the last bit.
        status: (...) 0 "ok", 1 "limited", 2 "held", as `STATUSES` lists them. "ok" misses at most 5 % of the twist, of
            fewer than six joints 5 % of what they can do of it.
        active: (..., m) -1 at the lower bound, 1 at the upper, 0 at neither.
        residual: (..., 6) s - J x in the frame of J.
    """

    velocity: Rows
    status: Rows
    active: Rows
    residual: Rows


class Inputs(NamedTuple):
    """Rows of one shape: J (..., 6, m), s (..., 6), p (..., 3), low, high, posture (..., m), L (...) or None."""

    J: Rows
    s: Rows
    p: Rows
    low: Rows
    high: Rows
    posture: Rows
    L: Rows | None


def velocities(
    J: ArrayLike,
    twist: ArrayLike,
    *,
    point: ArrayLike,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    posture: ArrayLike | None = None,
    length: ArrayLike | None = None,
    damping: Damping | float | None = None,
    dt: float = 0.0,
) -> Velocities:
    """Joint velocities for a twist in every row, where the arrays are: numpy, torch, JAX, CuPy.

    Each row is a twist by itself under the law that `Controller` has, whose damping acts near singularities. A row with
    NaN, infinity or crossed bounds is "held": velocity zero, or the nearest that its bounds allow; no other row
    notices. First derivatives by J, twist, point,
    bounds, posture and length are the solution's own, where it has them: not where a joint just meets its bound.

    Args:
        J: (..., 6, m) joint twists (omega; v) as columns, each row in any one frame.
        twist: (..., 6) wanted, in the frame of J.
        point: (..., 3) in the frame of J, the physical point at which the error is least.
        bounds: lower and upper, (..., m) each, -inf and inf where there is none; None is no bounds.
        posture: (..., m) wanted where the twist leaves joints free; None is zero.
        length: (...) L [length/rad]; None is the arm's reach to the point, 0 leaves out how the tool turns.
        damping: `Adaptive`, `Fixed` or a number lambda; None is `Adaptive()`, stronger where some joint has no bound.
        dt: how long the velocity is held [s], for the damping that brings a `Controller`'s loop to rest where its
            target is out of reach; 0 is none. With it the answer carries no derivative.

    Returns:
        Velocities; leading axes of the arguments broadcast.

    Raises:
        BadInput: shapes that do not fit, another policy, arrays of two libraries.
        MissingExtra: array-api-compat is not installed.
    """
    policy, tick = _policy(damping), arrays.not_negative(dt, "dt", "a tick")
    lower, upper = pair(bounds, "bounds")
    optional = {"bounds[0]": lower, "bounds[1]": upper, "posture": posture, "length": length}
    xp, rows = as_arrays({"J": J, "twist": twist, "point": point}, optional)
    with np.errstate(all="ignore"):  # a row that overflows is held
        inputs, good, still = _sound(xp, _broadcast(xp, rows))
        x, status, side = _answer(xp, inputs, policy, tick)
        done = good & xp.all(xp.isfinite(x), axis=-1)
        x = xp.where(done[..., None], x, still)
        residual = inputs.s - (inputs.J @ x[..., None])[..., 0]
        status = xp.where(done, status, xp.zeros_like(status) + 2)
    return Velocities(x, status, xp.where(done[..., None], side, xp.zeros_like(side)), residual)


def _answer(xp: Namespace, q: Inputs, policy: Adaptive | Fixed | None, dt: float) -> tuple[Rows, Rows, Rows]:
    """Velocity, status and active bounds of rows that can be computed with."""
    J, s = at_point(xp, q.J, q.p), at_point(xp, q.s[..., None], q.p)[..., 0]
    size = length_of(xp, q.p) + xp.max(xp.abs(q.J[..., 3:, :]), axis=(-2, -1))
    L = reaches(xp, J, s, size) if q.L is None else q.L
    per_radian = xp.stack((L, L, L, *[xp.ones_like(L)] * 3), axis=-1)
    A, b = per_radian[..., None] * J, per_radian * s
    t = _metric(xp, q.J, L)
    largest = detached(xp.max(xp.abs(A * t[..., None, :]), axis=(-2, -1)))[..., None]
    unit = xp.where(largest > 0.0, largest, xp.ones_like(largest))
    A, b = A * t[..., None, :] / unit[..., None], b / unit
    least = damped_least_squares(xp, A, b, q.low / t, q.high / t, q.posture / t, policy, unit, dt)
    at_low, at_high = least.side < 0.0, least.side > 0.0
    x = xp.minimum(xp.maximum(t * least.x, q.low), q.high)
    x = xp.where(at_low, q.low, xp.where(at_high, q.high, x))
    zero = xp.zeros_like(least.converged, dtype=xp.int8)
    limited = _is_limited(xp, detached(A), detached(b), least)
    side = xp.astype(at_high, xp.int8) - xp.astype(at_low, xp.int8)
    return x, xp.where(limited, zero + 1, zero), side


def _is_limited(xp: Namespace, A: Rows, b: Rows, least: Least) -> Rows:
    """(...) whether too much of the twist is missed, no velocity reduces the error, or no optimum was found."""
    b, size = over_largest(xp, b)
    x = detached(least.x) / size
    moved = (A @ x[..., None])[..., 0]
    rounding = PRODUCT_ROUNDING**2 * xp.sum(A * A, axis=(-2, -1)) * xp.sum(x * x, axis=-1)

    def misses(wanted: Rows, share: float) -> Rows:
        left, whole = xp.sum((wanted - moved) ** 2, axis=-1), xp.sum(wanted * wanted, axis=-1)
        return (left > share * share * whole) & (left > rounding)

    little = xp.sum(b * moved, axis=-1) < PROGRESS_SHARE * xp.sum(b * b, axis=-1)
    return ~least.converged | misses(b, MISSED) | (little & misses(b, NEGLIGIBLE))


def _metric(xp: Namespace, J: Rows, L: Rows) -> Rows:
    """(..., m) how much of a joint counts as one: L of a slide beside joints that turn."""
    turning, moving = (xp.sqrt(xp.sum(detached(v) ** 2, axis=-2)) for v in (J[..., :3, :], J[..., 3:, :]))
    slides = (turning * detached(L)[..., None] <= NEGLIGIBLE * moving) & (moving > 0.0)
    mixed = xp.any(slides, axis=-1) & ~xp.all(slides, axis=-1)
    one = xp.ones_like(turning)
    return xp.where(slides & mixed[..., None] & (L[..., None] > 0.0), L[..., None] * one, one)


def _broadcast(xp: Namespace, rows: Sequence[Rows]) -> Inputs:
    """The rows in one shape, with what stands for arguments that were left out."""
    J, s, p, low, high, posture, L = rows
    m = shaped(J, (6, None), "J", "shape (..., 6, m): joint twists as columns, angular part first").shape[-1]
    tails: dict[str, tuple[Any, tuple[int, ...]]] = {"J": (J, (6, m)), "twist": (s, (6,)), "point": (p, (3,))}
    optional = {"bounds[0]": (low, (m,)), "bounds[1]": (high, (m,)), "posture": (posture, (m,)), "length": (L, ())}
    tails |= {name: (v, tail) for name, (v, tail) in optional.items() if v is not None}
    for name, (v, tail) in tails.items():
        shaped(v, tail, name, f"shape (..., {', '.join(map(str, tail))})")
    lead = leading_axes({name: tuple(v.shape[: v.ndim - len(tail)]) for name, (v, tail) in tails.items()})
    wide = {name: xp.broadcast_to(v, lead + tail) for name, (v, tail) in tails.items()}
    zero = xp.zeros_like(wide["J"][..., 0, :])
    low, high = wide.get("bounds[0]", zero - xp.inf), wide.get("bounds[1]", zero + xp.inf)
    left = wide.get("posture", zero), wide.get("length")
    return Inputs(wide["J"], wide["twist"], wide["point"], low, high, *left)


def _sound(xp: Namespace, inputs: Inputs) -> tuple[Inputs, Rows, Rows]:
    """The rows, zeros where one cannot be computed with; which can; and the velocity that holds."""
    J, s, p, low, high, posture, L = inputs
    zero = xp.zeros_like(low)
    good = xp.all(xp.isfinite(J), axis=(-2, -1))
    for v in (s, p, posture):
        good = good & xp.all(xp.isfinite(v), axis=-1)
    boxed = (low <= high) & (low < xp.inf) & (high > -xp.inf)  # not for NaN
    good = good & xp.all(boxed, axis=-1)
    if L is not None:
        good = good & xp.isfinite(L) & (L >= 0.0)
        L = xp.where(good, L, xp.ones_like(L))
    still = detached(xp.where(boxed, xp.minimum(xp.maximum(zero, low), high), zero))
    one = good[..., None]
    s, p, posture, low, high = (xp.where(one, v, xp.zeros_like(v)) for v in (s, p, posture, low, high))
    return Inputs(xp.where(one[..., None], J, xp.zeros_like(J)), s, p, low, high, posture, L), good, still


def _policy(damping: Damping | float | None) -> Adaptive | Fixed | None:
    policy = None if damping is None else damping_of(damping, limited=True)
    if policy is not None and type(policy) not in (Adaptive, Fixed):
        raise BadInput("damping", type(policy).__name__, "Adaptive, Fixed or a number", "Use solve_velocities for it.")
    return policy  # type: ignore[return-value]


def pair(limits: Any, argument: str) -> tuple[Any, Any]:
    """Lower and upper limits; None each without any."""
    if limits is None:
        return None, None
    if not isinstance(limits, (tuple, list)) or len(limits) != 2 or limits[0] is None or limits[1] is None:
        raise BadInput(argument, excerpt(limits), "(lower, upper), arrays of shape (..., m), or None")
    return limits[0], limits[1]


def at_point(xp: Namespace, twists: Rows, point: Rows) -> Rows:
    """(..., 6, k) twists as columns, their velocities taken at the point (..., 3) instead of the origin."""
    w, v = twists[..., :3, :], twists[..., 3:, :]
    turned = xp.matrix_transpose(cross(xp, xp.matrix_transpose(w), point[..., None, :]))
    return xp.concat((w + xp.zeros_like(turned), v + turned), axis=-2)


def reaches(xp: Namespace, J: Rows, s: Rows, size: Rows) -> Rows:
    """(...) L for joint twists (..., 6, m) and a wanted twist (..., 6), both taken at the point.

    The arm's reach; where no axis is away from the point, |v| / |omega| of the turning joints, or of s, or 1. A reach
    has to exceed the rounding of the coordinates that the twists were computed from, of which `size` (...) is the size,
    and that of the twist's length.
    """
    here = xp.zeros_like(J[..., :3, 0])
    total = speeds = rates = xp.zeros_like(J[..., 0, 0])
    rounding = max(ROUNDING, ROUNDING_STEPS * precision(xp, J))
    for column in range(J.shape[-1] - 1, -1, -1):
        turn, moment = J[..., :3, column], J[..., 3:, column]
        rate, far = length_of(xp, turn), length_of(xp, moment)
        turns = rate * LENGTH_LIMIT > far
        rate = xp.where(turns, rate, xp.ones_like(rate))[..., None]
        leg = cross(xp, turn / rate, moment / rate + cross(xp, turn / rate, here))
        leg = xp.where(turns[..., None], leg, xp.zeros_like(leg))
        here = here + leg
        total = total + length_of(xp, leg)
        speeds = speeds + xp.where(turns, far * far, xp.zeros_like(far))
        rates = rates + xp.where(turns, rate[..., 0] ** 2, xp.zeros_like(far))
    w, v = length_of(xp, s[..., :3]), length_of(xp, s[..., 3:])
    one, rounded = xp.ones_like(w), rounding * size
    has = (v > rounded * w) & (w * LENGTH_LIMIT > v)
    wanted = xp.where(has, v / xp.where(has, w, one), one)
    rounded = xp.maximum(rounded, xp.where(has, rounding * wanted, xp.zeros_like(wanted)))
    moves = speeds > rounded * rounded * rates
    own = xp.sqrt(xp.where(moves, speeds, one) / xp.where(moves, rates, one))
    return xp.where(total > rounded, total, xp.where(moves, own, wanted))
