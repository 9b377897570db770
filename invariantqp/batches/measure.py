"""The measure of every row, as in `velocity.measure`: |s|^2 = L^2 |omega|^2 + |v at the point|^2, L the arm's reach."""

from __future__ import annotations

from invariantqp.batches.namespace import Namespace, Rows, precision
from invariantqp.geometry.arrays import ROUNDING
from invariantqp.geometry.sizes import LENGTH_LIMIT

# A reach below this many roundings of the coordinates that it is computed from is none.
ROUNDING_STEPS = 1e3


def cross(xp: Namespace, a: Rows, b: Rows) -> Rows:
    """(..., 3) the vector product; rows broadcast."""
    a, b = xp.broadcast_arrays(a, b)
    x, y, z = (a[..., i] for i in range(3))
    u, v, w = (b[..., i] for i in range(3))
    return xp.stack((y * w - z * v, z * u - x * w, x * v - y * u), axis=-1)


def length_of(xp: Namespace, v: Rows) -> Rows:
    """(...) |v| of (..., n), with derivative 0 where it is zero."""
    square = xp.sum(v * v, axis=-1)
    some = square > 0.0
    return xp.where(some, xp.sqrt(xp.where(some, square, xp.ones_like(square))), xp.zeros_like(square))


def beside_largest(xp: Namespace, v: Rows) -> tuple[Rows, Rows]:
    """(..., n) divided by its largest entry (..., 1), so that no square overflows; and that entry, or 1."""
    largest = xp.max(xp.abs(v), axis=-1, keepdims=True)
    largest = xp.where(largest > 0.0, largest, xp.ones_like(largest))
    return v / largest, largest


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
    asked = xp.where(has, v / xp.where(has, w, one), one)
    beside = xp.where(has, rounding * asked, xp.zeros_like(asked))
    rounded = xp.where(rounded > beside, rounded, beside)
    moves = speeds > rounded * rounded * rates
    own = xp.sqrt(xp.where(moves, speeds, one) / xp.where(moves, rates, one))
    return xp.where(total > rounded, total, xp.where(moves, own, asked))
