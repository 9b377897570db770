"""The shapes of an arm's links, from the collision geometry of its description: what must not touch anything.

Balls and a link's only box stay as they are. A cylinder becomes a capsule, a link's meshes one or more, several boxes
too: they contain all that they stand for, so that what keeps clear of the capsules keeps clear of the link. They are
larger than the link; two capsules are taken where they are so much smaller than one together.
"""

from __future__ import annotations

from itertools import product
from math import cos, inf, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from invariantqp.errors import BadInput, RobotModelError, excerpt
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Box, Capsule, HalfSpace, Shape, Sphere
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, remembered
from invariantqp.robots.links import Geometry, Link

# Capsules of a link, at most: each is a pair more with everything around.
MOST_CAPSULES = 3
# Two capsules replace one where they have less than this share of its volume.
WORTHWHILE = 0.7
# Corners of the prism about a cylinder.
SIDES = 24
# A direction that tells points apart: no two of a mesh are equally far along it.
APART = np.array([0.5477225575051661, 0.31622776601683794, 0.7745966692414834])
# The search for a capsule's axis, in units of its size: it ends where a step saves less of its volume.
SEARCH = {"maxiter": 300, "fatol": 1e-4, "xatol": 1e-3}
Bodies = dict[str, list[Shape]]


def bodies_of(robot: Robot) -> Bodies:
    """The shapes of each link in its frame, in the order of the links; those without geometry are left out.

    They are computed once for each arm: capsules for meshes take a tenth of a second a link.

    Args:
        robot: from a URDF or MJCF, or a name that stands for one.

    Raises:
        BadInput: a robot whose description has no collision geometry.
        RobotModelError: geometry that cannot be read.
        MissingExtra: meshes, without coal (extra `pin`).
    """
    if not isinstance(robot, Chain):
        raise BadInput("robot", excerpt(robot), "a robot that load_robot returned")
    if not any(link.parts for link in robot.links):
        raise BadInput(
            "bodies",
            "none, and a robot known without collision geometry",
            "shapes of its links: bodies={link: [Capsule(a, b, radius), ...]}",
        )
    links = robot.links
    return remembered(robot, "bodies", lambda _: {link.name: made for link in links if (made := _shapes(link))})


def _shapes(link: Link) -> list[Shape]:
    made: list[Shape] = []
    corners: list[Array] = []
    faces: list[NDArray[np.intp]] = []
    count = 0
    joined = {"mesh", "cylinder"} | ({"box"} if sum(part.kind != "sphere" for part in link.parts) > 1 else set())
    for part in link.parts:
        if part.kind in joined:
            points, of = _surface(part)
            corners.append(points.dot(part.pose[:3, :3].T) + part.pose[:3, 3])
            faces.append(of + count)
            count += len(points)
        else:
            made.append(_plain(part))
    if corners:
        made += capsules(np.vstack(corners), np.vstack(faces))
    return made


def _plain(part: Geometry) -> Shape:
    T, size = part.pose, part.size
    if part.kind == "sphere":
        return Sphere(T[:3, 3], size[0])
    if part.kind == "box":
        return Box(T, size)
    if part.kind == "capsule":
        along = 0.5 * size[1] * T[:3, 2]
        return Capsule(T[:3, 3] - along, T[:3, 3] + along, size[0])
    if part.kind == "plane":
        return HalfSpace(T[:3, 3], T[:3, 2])
    raise RobotModelError(str(part.mesh))


def _surface(part: Geometry) -> tuple[Array, NDArray[np.intp]]:
    """Corners and triangles of a mesh, a box, or a prism about a cylinder."""
    if part.kind == "cylinder":
        radius, length = part.size
        around = radius / cos(pi / SIDES)  # outside the circle
        ring = [(around * cos(2.0 * pi * i / SIDES), around * sin(2.0 * pi * i / SIDES)) for i in range(SIDES)]
        return _hull(np.array([(x, y, z) for z in (-0.5 * length, 0.5 * length) for x, y in ring]))
    if part.kind == "box":
        return _hull(0.5 * np.array(part.size) * np.array(list(product((-1.0, 1.0), repeat=3))))
    if isinstance(part.mesh, np.ndarray):
        return _hull(part.mesh)
    from invariantqp.geometry.coal import triangles  # coal is loaded where there is a mesh

    try:
        corners, faces = triangles(part.mesh)
    except RobotModelError as error:
        raise RobotModelError(f"{error}; give bodies= for its link") from error
    return corners * np.array(part.size), faces


def _hull(points: Array) -> tuple[Array, NDArray[np.intp]]:
    hull: Any = ConvexHull(points)
    return points, np.asarray(hull.simplices, dtype=np.intp)


def capsules(corners: Array, faces: NDArray[np.intp], most: int = MOST_CAPSULES) -> list[Shape]:
    """Capsules that contain all triangles, few and small.

    Args:
        corners: (n, 3).
        faces: (f, 3) which corners each triangle has.
        most: how many capsules, at most.
    """
    parts, made = [corners[faces]], [capsule(corners)]
    tried: list[tuple[list[Array], list[Capsule]] | None] = []
    while len(made) < most:
        tried += [_halves(part, one) for part, one in zip(parts[len(tried) :], made[len(tried) :], strict=True)]
        gains = [
            0.0 if two is None else _volume(one) - sum(map(_volume, two[1]))
            for one, two in zip(made, tried, strict=True)
        ]
        i = int(np.argmax(gains))
        best = tried.pop(i)
        if best is None or gains[i] < (1.0 - WORTHWHILE) * _volume(made[i]):
            break
        parts, made = parts[:i] + parts[i + 1 :] + best[0], made[:i] + made[i + 1 :] + best[1]
    return list(made)


def capsule(points: Array, *, searched: bool = True) -> Capsule:
    """A small capsule that contains all points (n, 3): along a principal axis or one near it, by a local search."""
    points = points[np.unique(points.dot(APART), return_index=True)[1]]  # corners of triangles, once each
    try:
        hull: Any = ConvexHull(points)
        points = points[hull.vertices]
    except QhullError:  # all on one plane or line
        points = np.unique(points, axis=0)
    centre = points.mean(axis=0)
    size = float(np.abs(points - centre).max())
    if size == 0.0:
        return Capsule(centre, centre, 0.0)
    V = (points - centre) / size
    starts = [np.append(w, np.zeros(3)) for w in np.linalg.eigh(V.T.dot(V))[1].T]
    begun = min(starts, key=lambda x: _around(V, x)[0])
    if searched:
        begun = minimize(lambda x: _around(V, x)[0], begun, method="Nelder-Mead", options=SEARCH).x
    _, a, b = _around(V, begun)
    a, b = centre + size * a, centre + size * b
    return Capsule(a, b, float(_off(points, a, b).max()))


def _off(points: Array, a: Array, b: Array) -> Array:
    """(n,) distances from a segment."""
    u = b - a
    t = np.clip((points - a).dot(u) / (u.dot(u) or 1.0), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - t[:, None] * u, axis=1))


def _around(V: Array, x: Array) -> tuple[float, Array, Array]:
    """Volume and ends of the least capsule about points whose axis has direction x[:3] and goes through x[3:]."""
    u = x[:3] / (np.linalg.norm(x[:3]) or 1.0)
    t = (V - x[3:]).dot(u)
    across = ((V - x[3:] - t[:, None] * u) ** 2).sum(axis=1)
    r2 = float(across.max())
    cap = np.sqrt(np.maximum(r2 - across, 0.0))
    low, high = float((t + cap).min()), float((t - cap).max())
    if high < low:
        low = high = 0.5 * (low + high)
    return r2 * (high - low) + 4.0 / 3.0 * r2**1.5, x[3:] + low * u, x[3:] + high * u


def _volume(one: Capsule) -> float:
    return pi * one.radius**2 * (2.0 * float(one.half[2]) + 4.0 / 3.0 * one.radius)


def _halves(part: Array, one: Capsule) -> tuple[list[Array], list[Capsule]] | None:
    """Triangles (f, 3, 3) cut in two across their capsule's axis or the longest extent, and a capsule about each."""
    points = part.reshape(-1, 3)
    spread = np.cov(points.T)
    n = one.place[:3, 2] if one.half[2] > 0.0 else np.linalg.eigh(spread)[1][:, -1]
    best: list[Array] = []
    least = inf
    heights = points.dot(n)
    for share in (0.35, 0.5, 0.65):
        level = float(heights.min() + share * (heights.max() - heights.min()))
        sides = [_cut(part, s * n, s * level) for s in (1.0, -1.0)]
        if not all(len(side) for side in sides):
            continue
        volume = sum(_volume(capsule(side.reshape(-1, 3), searched=False)) for side in sides)
        if volume < least:
            best, least = sides, volume
    return (best, [capsule(side.reshape(-1, 3)) for side in best]) if best else None


def _cut(part: Array, n: Array, level: float) -> Array:
    """What of triangles (f, 3, 3) is at n'x <= level, as triangles."""
    heights = part.dot(n) - level
    order = np.argsort(heights, axis=1)  # the lowest corner first
    corners, heights = np.take_along_axis(part, order[:, :, None], axis=1), np.take_along_axis(heights, order, axis=1)
    below = (heights <= 0.0).sum(axis=1)

    def crossing(rows: NDArray[np.bool_], low: int, high: int) -> Array:
        """Where the edges from corner `low` to corner `high` of some triangles cross the plane."""
        h, x = heights[rows], corners[rows]
        share = h[:, low] / (h[:, low] - h[:, high])
        return np.asarray(x[:, low] + share[:, None] * (x[:, high] - x[:, low]))

    one, two = below == 1, below == 2
    tips = np.stack((corners[one, 0], crossing(one, 0, 1), crossing(one, 0, 2)), axis=1)
    first = np.stack((corners[two, 0], corners[two, 1], crossing(two, 1, 2)), axis=1)
    second = np.stack((corners[two, 0], crossing(two, 0, 2), crossing(two, 1, 2)), axis=1)
    return np.concatenate((corners[below == 3], tips, first, second))
