"""A speed limit on a face of the polytope: |start + M e| <= limit with the active limits kept, by its one multiplier.

    minimise 1/2 |e|^2 + 1/2 nu |v|^2,  v = start + M e,  on the face,   nu >= 0 such that |v| = limit

F = U S V' is M without what would move an active limit, e0 the shortest e of the face and v0 the velocity there:
U'v(nu) = (I + nu S S')^-1 U'v0, so that nu is the root of one scalar equation.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.active import Face

# Newton's steps for the multiplier: |v(nu)|^-1 is nearly linear in nu, a few reach rounding.
NEWTON_STEPS = 20
EPSILON = float(np.finfo(float).eps)
# A speed above the limit by less than this, relative, is at it.
ROUNDING = 1e-9


class Slower(NamedTuple):
    """The optimum on a face."""

    e: Array  # (n,)
    pull: Array  # (n,) the gradient e + nu M'v there
    nu: float  # the multiplier; 0 where the speed limit is not met, the largest one where the whole face is too fast


class Slow(NamedTuple):
    """|start + M e| <= limit, start (3,), M (3, n); `most` is the largest multiplier tried."""

    M: Array
    start: Array
    limit: float
    most: float

    def velocity(self, e: Array) -> Array:
        """(3,) of the point."""
        v: Array = self.start + self.M.dot(e)
        return v

    def allows(self, e: Array) -> bool:
        """Whether the point is slow enough, but for rounding."""
        return _within(self.velocity(e), self.limit)

    def on(self, face: Face) -> Slower:
        """The optimum on a face.

        Where the whole face is too fast, its slowest e: the multipliers then tell which limit has to be left.
        """
        v = self.velocity(face.e)
        if _within(v, self.limit):
            return Slower(face.e, face.e, 0.0)
        axes, singular, ways, _ = lapack.dgesdd(face.along(self.M))
        sizes, along = singular.tolist(), v.dot(axes).tolist()
        gains = [*(size * size for size in sizes), 0.0, 0.0][:3]
        nu = _multiplier(gains, [part * part for part in along], self.limit, self.most)
        slower = [nu * size * part / (1.0 + nu * size * size) for size, part in zip(sizes, along, strict=False)]
        e = face.e - np.dot(slower, ways[: len(slower)])
        return Slower(e, e + nu * self.velocity(e).dot(self.M), nu)


def _within(v: Array, limit: float) -> bool:
    return sqrt(float(v.dot(v))) <= limit * (1.0 + ROUNDING)


def _multiplier(gains: list[float], squares: list[float], limit: float, most: float) -> float:
    """nu with sum of squares / (1 + nu gain)^2 = limit^2, or `most` where that is larger."""
    nu, wanted = 0.0, limit * limit
    parts = list(zip(gains, squares, strict=True))
    for _ in range(NEWTON_STEPS):
        square = slope = 0.0
        for gain, start in parts:
            shrink = 1.0 + nu * gain
            shrunk = start / (shrink * shrink)
            square += shrunk
            slope += shrunk * gain / shrink
        if square <= wanted:
            break
        if slope <= 0.0:
            return most
        # Newton on 1 / |v|: from below, it never overshoots.
        ahead = square / slope * (sqrt(square) / limit - 1.0)  # the square of a tiny limit is zero
        nu += ahead
        if nu > most:
            return most
        if ahead <= EPSILON * nu:
            break
    return nu
