"""The distance of two shapes and where they are near: closed forms, exact to rounding, inside one another as well.

    d = min |y - x| - r_a - r_b  over x in core a, y in core b       apart
    d = -(least way out) - r_a - r_b                                 where the cores go into each other

Between parallel faces the nearest points jump at the slightest turn, and a limit at them alone trembles. So each pair
has several places: the nearest points, and the ends and corners of each core against the other one. Whatever keeps the
shapes apart keeps these apart too, so that more of them cost nothing.
"""

from __future__ import annotations

from itertools import product
from math import inf, sqrt
from operator import itemgetter
from typing import NamedTuple, Protocol

import numpy as np

from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.se3 import cross, norm
from invariantqp.geometry.shapes import Core

# Segments whose squared sine is below this are parallel: their ends are as near as what is between.
PARALLEL = 1e-14


class Place(NamedTuple):
    """Where two shapes are near."""

    distance: float  # negative inside
    normal: Array  # (3,) unit vector from the first to the second
    point: Array  # (3,) of the first core; both nearest points are on one line along the normal


class Solid(Protocol):
    """A mesh, whose distances another library finds."""

    def places(self, pose: Array, other: Placed) -> list[Place]:
        """Where another shape's core is near, from that to the mesh at a (4, 4) pose."""

    def drawn(self) -> Array:
        """(n, 3, 3) corners of triangles to draw, few enough for a page, in the mesh's own frame."""


class Placed(NamedTuple):
    """A shape in the base frame."""

    core: Core
    radius: float
    half: Array  # (3,)
    pose: Array  # (4, 4)
    solid: Solid | None = None  # the mesh, of one


def distance(a: Placed, b: Placed) -> float:
    """The signed distance of two shapes; infinite for two half-spaces, which have none."""
    near = places(a, b)
    return near[0].distance if near else inf


def places(a: Placed, b: Placed) -> list[Place]:
    """All places of two shapes, by their distance."""
    cores = a.core, b.core
    if cores == (Core.HALF_SPACE, Core.HALF_SPACE):
        return []
    if b.solid is not None:
        near = b.solid.places(b.pose, a)
    elif a.solid is not None:
        near = _other_way(a.solid.places(a.pose, b))
    elif b.core is Core.HALF_SPACE:
        near = _plane(a, b)
    elif a.core is Core.HALF_SPACE:
        near = _other_way(_plane(b, a))
    elif cores == (Core.SEGMENT, Core.SEGMENT):
        near = _segments(a, b)
    elif cores == (Core.BOX, Core.BOX):
        near = _boxes(a, b)
    else:
        near = _segment_and_box(a, b) if a.core is Core.SEGMENT else _other_way(_segment_and_box(b, a))
    thick = a.radius + b.radius
    return sorted((Place(d - thick, normal, point) for d, normal, point in near), key=itemgetter(0))


def _other_way(near: list[Place]) -> list[Place]:
    return [Place(d, -normal, point + d * normal) for d, normal, point in near]


def _between(x: Array, y: Array, meeting: Array) -> Place:
    """The place of points x and y (3,); `meeting` is its direction where they are one."""
    d = norm(y - x)
    return Place(d, (y - x) / d if d > ROUNDING else meeting, x)


def _foot(x: Array, start: Array, u: Array) -> Array:
    """The point of the segment from `start` along u that is nearest to x."""
    uu = float(u.dot(u))
    return start + min(max(float((x - start).dot(u)) / uu, 0.0), 1.0) * u if uu > 0.0 else start


def _segments(a: Placed, b: Placed) -> list[Place]:
    """Of two capsules: where both are nearest between their ends, and each end against the other."""
    u, v = 2.0 * a.half[2] * a.pose[:3, 2], 2.0 * b.half[2] * b.pose[:3, 2]
    p, s = a.pose[:3, 3] - 0.5 * u, b.pose[:3, 3] - 0.5 * v
    uu, uv, vv = float(u.dot(u)), float(u.dot(v)), float(v.dot(v))
    uw, vw = float(u.dot(p - s)), float(v.dot(p - s))
    meeting = cross(u, v)
    size = norm(meeting)
    crossing = size > PARALLEL * sqrt(uu * vv) and size > 0.0
    meeting = meeting / size if crossing else _some_across(u if uu > vv else v)
    near = []
    D = uu * vv - uv * uv
    if PARALLEL * uu * vv < D:
        t = (uv * vw - vv * uw) / D
        r = (uv * t + vw) / vv
        if 0.0 <= t <= 1.0 and 0.0 <= r <= 1.0:
            t = min(max((uv * r - uw) / uu, 0.0), 1.0)
            near.append(_between(p + t * u, s + r * v, meeting))
    near += [_between(end, _foot(end, s, v), meeting) for end in ((p, p + u) if uu > 0.0 else (p,))]
    near += [_between(_foot(end, p, u), end, meeting) for end in ((s, s + v) if vv > 0.0 else (s,))]
    return near


def _some_across(u: Array) -> Array:
    """Some unit vector across u (3,), or across nothing in particular where u is zero."""
    n = cross(u, np.eye(3)[int(np.abs(u).argmin())])
    size = norm(n)
    return n / size if size > 0.0 else np.array((0.0, 0.0, 1.0))


def _nearest_to_box(p: Array, u: Array, h: Array) -> float:
    """t in [0, 1] for which p + t u is nearest to the box |y| <= h: where a monotone slope is zero."""
    moving = u != 0.0
    turns = np.concatenate([(side * h[moving] - p[moving]) / u[moving] for side in (-1.0, 1.0)])
    ts = np.sort(np.concatenate(((0.0, 1.0), turns[(turns > 0.0) & (turns < 1.0)])))
    y = p + ts[:, None] * u
    slopes = (y - np.clip(y, -h, h)).dot(u)
    up = slopes >= 0.0
    if not up.any():
        return 1.0
    i = int(up.argmax())
    if i == 0 or slopes[i] == 0.0 or not slopes[i] > slopes[i - 1]:
        return float(ts[i])
    return float(ts[i - 1] - slopes[i - 1] / (slopes[i] - slopes[i - 1]) * (ts[i] - ts[i - 1]))


def _point_and_box(y: Array, b: Placed) -> Place:
    """Of a point y in the frame of box b, and the box."""
    gap = y - np.clip(y, -b.half, b.half)
    d = norm(gap)
    at = b.pose.copy()
    at[:3, 3] += at[:3, :3].dot(y)
    if d > ROUNDING:
        return Place(d, -at[:3, :3].dot(gap / d), at[:3, 3])
    return _way_apart(Placed(Core.SEGMENT, 0.0, np.zeros(3), at), b)


def _segment_against_box(p: Array, u: Array, b: Placed, *, ends: bool) -> list[Place]:
    """Of a segment p + t u in the frame of box b, and the box; none where it goes into the box.

    The nearest point, the ends, and where the segment's shadow on the nearest face begins and ends.
    """
    h = b.half
    t = _nearest_to_box(p, u, h)
    y = p + t * u
    gap = y - np.clip(y, -h, h)
    if norm(gap) <= ROUNDING:
        return []
    at = [t]
    over = (gap == 0.0) & (u != 0.0)
    if int((gap != 0.0).sum()) == 1:
        sides = np.array([(side * h[over] - p[over]) / u[over] for side in (-1.0, 1.0)])
        low, high = max(0.0, *sides.min(axis=0), 0.0), min(1.0, *sides.max(axis=0), 1.0)
        at += [x for x in (low, high) if 0.0 < x < 1.0 and low < high]
    at += [0.0, 1.0] if ends else []
    return [_point_and_box(p + x * u, b) for x in dict.fromkeys(at)]


def _segment_and_box(a: Placed, b: Placed) -> list[Place]:
    """Of a capsule and a box."""
    R = b.pose[:3, :3]
    c = (a.pose[:3, 3] - b.pose[:3, 3]).dot(R)
    if a.half[2] == 0.0:
        return [_point_and_box(c, b)]
    e = a.half[2] * a.pose[:3, 2].dot(R)
    return _segment_against_box(c - e, 2.0 * e, b, ends=True) or [_way_apart(a, b)]


def corners(half: Array) -> list[Array]:
    """Of a box or of what is left of one where half sizes are zero."""
    sides = [(-h, h) if h > 0.0 else (0.0,) for h in half.tolist()]
    return [np.array(corner) for corner in product(*sides)]


def _boxes(a: Placed, b: Placed) -> list[Place]:
    """Of two boxes: the corners and edges of each against the other; where they meet, the least way out."""
    near: list[Place] = []
    for one, other in ((a, b), (b, a)):
        R = other.pose[:3, :3].T.dot(one.pose[:3, :3])
        c = other.pose[:3, :3].T.dot(one.pose[:3, 3] - other.pose[:3, 3])
        new: list[Place] = []
        for corner in product((-1.0, 1.0), repeat=3):
            y = R.dot(corner * one.half) + c
            new.append(_point_and_box(y, other))
            for k in range(3):
                if corner[k] < 0.0:
                    edge = _segment_against_box(y, 2.0 * one.half[k] * R[:, k], other, ends=False)
                    if not edge:
                        return [_way_apart(a, b)]
                    new += edge
        near += new if one is a else _other_way(new)
    return near


def _way_apart(a: Placed, b: Placed) -> Place:
    """Of two cores that go into each other: the largest separation among faces and pairs of edges.

    It is at the deepest corner of that one of which less is level there, in the middle of what is.
    """
    A, B = a.pose[:3, :3], b.pose[:3, :3]
    w = b.pose[:3, 3] - a.pose[:3, 3]
    normals = [*A.T, *B.T]
    for f, g in product(A.T, B.T):
        n = cross(f, g)
        size = norm(n)
        if size > ROUNDING:
            normals.append(n / size)
    room = [float(np.abs(n.dot(A)).dot(a.half) + np.abs(n.dot(B)).dot(b.half)) for n in normals]
    apart = [abs(float(n.dot(w))) - r for n, r in zip(normals, room, strict=True)]
    i = int(np.argmax(apart))
    n = -normals[i] if normals[i].dot(w) < 0.0 else normals[i]
    sides = n.dot(A), -n.dot(B)
    level = [np.abs(side) <= ROUNDING for side in sides]
    x, y = (
        placed.pose[:3, :3].dot(np.where(flat, 0.0, np.sign(side) * placed.half)) + placed.pose[:3, 3]
        for placed, side, flat in zip((a, b), sides, level, strict=True)
    )
    blunt = (level[0] & (a.half > 0.0)).sum() > (level[1] & (b.half > 0.0)).sum()
    return Place(apart[i], n, y - apart[i] * n if blunt else x)


def _plane(a: Placed, b: Placed) -> list[Place]:
    """Of a core and a half-space: its ends or corners."""
    normal = b.pose[:3, 2]
    points = [a.pose[:3, :3].dot(corner) + a.pose[:3, 3] for corner in corners(a.half)]
    return [Place(float(normal.dot(x - b.pose[:3, 3])), -normal, x) for x in points]
