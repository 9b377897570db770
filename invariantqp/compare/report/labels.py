"""Names beside points: each as near to its point as the others leave room for; the points stay where they are.

    minimise the distances of names to their points, in line heights,
             + COVERED for each name on a name or a point
             + CROSSED for each line to a name across another name, line or point, and for each point beside a name that
               is not its own, where the line to its own is too short to see

Names are moved one at a time to the best place beside all others, until none moves; from several beginnings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array

# What is never worth it, and what is only where nothing else is left [line heights].
COVERED, CROSSED = 1000.0, 15.0
# How far from its point a name may be, and the steps of its places [line heights].
FARTHEST, STEP = 8.0, 0.5
# Orders in which names are moved, and rounds of moving them in each.
ORDERS, ROUNDS = 10, 20
# Room between two names beside and above each other, and the length of a line that is seen [line heights].
MARGIN, VISIBLE = (0.5, 0.15), 0.8
# So many of the places nearest to a point are looked at before all.
FEW = 80


class Area(NamedTuple):
    """A rectangle that names have to be in."""

    left: float
    bottom: float
    right: float
    top: float


def placed(points: Array, sizes: Array, room: Area, radius: float) -> Array:
    """(n, 4) left, bottom, right, top of names of (n, 2) sizes beside (n, 2) points, discs of a radius, in a room."""
    choices = [_Choices(i, points, size, room, radius) for i, size in enumerate(sizes)]
    rng, n = np.random.default_rng(0), len(points)
    least, best = np.inf, np.array([choice.first for choice in choices])
    for _ in range(ORDERS):
        names = np.array([choice.first for choice in choices])
        for _ in range(ROUNDS):
            before = names.copy()
            costs = np.zeros(n)
            for i in rng.permutation(n):
                names[i], costs[i] = choices[i].best(names)
            if np.array_equal(names, before):
                break
        if costs.sum() < least:
            least, best = float(costs.sum()), names
    return best


def nearest(names: Array, point: Array) -> Array:
    """(k, 2) the places of (k, 4) names that are nearest to a point (2,)."""
    return np.asarray(np.clip(point, names[:, :2], names[:, 2:]))


class _Choices:
    """Where one name may be, and what each place costs by itself."""

    def __init__(self, i: int, points: Array, size: Array, room: Area, radius: float) -> None:
        self.i, self.points = i, points
        point, (width, height) = points[i], size
        self.margin = np.array(MARGIN) * height
        along, up = np.arange(0.0, FARTHEST, 2.0 * STEP), np.arange(-FARTHEST, FARTHEST + STEP, STEP)
        right = 1.5 * radius + along * height
        left = point[0] + np.concatenate((right, -right - width, -0.5 * width + right, -0.5 * width - right))
        x, y = (grid.ravel() for grid in np.meshgrid(left, point[1] + (up - 0.5) * height))
        names = np.column_stack((x, y, x + width, y + height))
        inside = (x >= room.left) & (names[:, 2] <= room.right) & (y >= room.bottom) & (names[:, 3] <= room.top)
        self.names = names[inside] if inside.any() else names[:1]
        self.ends = nearest(self.names, point)
        own = np.linalg.norm(self.ends - point, axis=1)
        cost = own / height
        for j, other in enumerate(points):
            disc = np.concatenate((other - radius, other + radius))
            cost += COVERED * _covered(self.names, disc, np.zeros(2))
            if j != i:
                theirs = np.linalg.norm(nearest(self.names, other) - other, axis=1)
                ambiguous = (own < radius + VISIBLE * height) & (theirs < own + VISIBLE * height)
                cost += CROSSED * (ambiguous | _through(point, self.ends, disc))
        order = np.argsort(cost, kind="stable")
        self.names, self.ends, self.cost = self.names[order], self.ends[order], cost[order]
        self.first = self.names[0]

    def best(self, others: Array) -> tuple[Array, float]:
        """The best place beside the other names, and its cost."""
        found = self._beside(others, slice(FEW))
        # A place costs no less beside others than by itself.
        more = slice(FEW, int(np.searchsorted(self.cost, found[1])))
        return min(found, self._beside(others, more), key=lambda one: one[1]) if more.stop > FEW else found

    def _beside(self, others: Array, part: slice) -> tuple[Array, float]:
        names, ends, cost, point = self.names[part], self.ends[part], self.cost[part].copy(), self.points[self.i]
        for j, other in enumerate(others):
            if j == self.i:
                continue
            end = nearest(other[None], self.points[j])[0]
            cost += COVERED * _covered(names, other, self.margin)
            across = _through(point, ends, other) | _crossed(point, ends, self.points[j], end)
            cost += CROSSED * (across | _meets(names, self.points[j], end))
        k = int(np.argmin(cost))
        return names[k], float(cost[k])


Mask = NDArray[np.bool_]


def _covered(names: Array, other: Array, margin: Array) -> Mask:
    """Whether (k, 4) names are on another rectangle, or nearer to it than a margin (2,)."""
    return np.asarray(((names[:, :2] < other[2:] + margin) & (names[:, 2:] > other[:2] - margin)).all(axis=1))


def _slab(start: Array, step: Array, low: Array, high: Array) -> Mask:
    """Whether lines from start to start + step enter rectangles: (2,) or (k, 2) each."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(((low - start) / step, (high - start) / step))
    still, between = step == 0.0, (low < start) & (start < high)
    first = np.where(still, np.where(between, 0.0, np.inf), ends.min(axis=0))
    last = np.where(still, 1.0, ends.max(axis=0))
    return np.asarray(np.maximum(first.max(axis=-1), 0.0) < np.minimum(last.min(axis=-1), 1.0))


def _through(point: Array, ends: Array, other: Array) -> Mask:
    """Whether lines from a point to (k, 2) ends go through a rectangle."""
    return _slab(point, ends - point, other[:2], other[2:])


def _meets(names: Array, point: Array, end: Array) -> Mask:
    """Whether a line from a point to its end goes through (k, 4) names."""
    return _slab(point, np.broadcast_to(end - point, (len(names), 2)), names[:, :2], names[:, 2:])


def _crossed(point: Array, ends: Array, other: Array, end: Array) -> Mask:
    """Whether lines from a point to (k, 2) ends cross the line from another point to its end."""

    def side(a: Array, b: Array, p: Array) -> Array:
        (X, Y), (x, y) = (b - a).T, (p - a).T
        return np.asarray(X * y - Y * x)

    apart = side(point, ends, other) * side(point, ends, end) < 0.0
    return np.asarray(apart & (side(other, end, point) * side(other, end, ends) < 0.0))
