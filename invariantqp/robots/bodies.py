"""Collision shapes of an arm's links: spheres, capsules and boxes that contain its collision geometry.

In: the geometry of a `Chain`'s links. Out: a list of shapes for each link, in the link's frame. Spheres, capsules and a
single box stay as they are; meshes, cylinders and several boxes are replaced by one to three capsules or boxes.
"""

from __future__ import annotations

from contextlib import suppress
from functools import lru_cache
from itertools import product
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, QhullError

from invariantqp.errors import BadInput, RobotModelError, excerpt
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Box, Capsule, HalfSpace, Shape, Sphere
from invariantqp.robots.chain import Chain, Geometry, Link
from invariantqp.robots.kinematics import Robot

# Two shapes replace one where their volume is below this share of its volume.
SPLIT_RATIO = 0.7
# A box replaces a capsule where its volume is below this share: distances of boxes take longer.
BOX_RATIO = 0.5
# Faces of a box are tried along so many of the convex hull's largest triangles.
HULL_FACES = 12
# Two directions span a face where the sine of the angle between them is above this.
MIN_SINE = 0.1
# Corners of the prism that stands for a cylinder.
PRISM_SIDES = 24
# Axes and cuts are chosen with one corner for each cell of a grid: so many cells along the longer two extents, in the
# geometric mean.
GRID_CELLS = 80
# Shares of the longest axis where cuts are tried, and one of how many triangles they are compared on.
CUTS, SAMPLE_STEP = (0.35, 0.5, 0.65), 4
# The search for a capsule's axis, in units of its size: it ends where a step saves less volume.
START = 0.2 * np.vstack((np.zeros(4), np.eye(4)))
AXIS_SEARCH = {"maxiter": 300, "fatol": 1e-3, "xatol": 1e-2, "initial_simplex": START}
# A triangle of a binary STL file, and the length of the header before the first.
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
STL_HEADER = 84


def bodies_of(robot: Robot) -> dict[str, list[Shape]]:
    """The collision shapes of each link, in the link's frame; links without geometry are left out.

    Includes the bodies given to `with_tool`. The shapes of a link are computed once in a process.

    Raises:
        BadInput: the robot's description has no collision geometry.
        RobotModelError: geometry that cannot be read.
        MissingExtra: meshes that are no binary STL, without coal (extra `pin`).
    """
    if not isinstance(robot, Chain):
        raise BadInput("robot", excerpt(robot), "a robot that load_robot returned")
    if not any(link.parts for link in robot.links):
        raise BadInput(
            "bodies",
            "none, and a robot known without collision geometry",
            "shapes of its links: bodies={link: [Capsule(a, b, radius), ...]}",
        )
    made = {link.name: list(_shapes(link.parts, _modified_at(link))) for link in robot.links}
    return {name: shapes for name, shapes in made.items() if shapes}


def _modified_at(link: Link) -> tuple[int, ...]:
    """When the mesh files of a link were last modified [ns]."""
    files = [Path(part.mesh) for part in link.parts if part.kind == "mesh" and isinstance(part.mesh, str)]
    return tuple(file.stat().st_mtime_ns for file in files if file.is_file())


@lru_cache(maxsize=256)
def _shapes(parts: tuple[Geometry, ...], _modified: tuple[int, ...]) -> tuple[Shape, ...]:
    """The collision shapes of a link; computed again where a mesh file has been modified."""
    made: list[Shape] = []
    triangles: list[Array] = []
    joined = {"mesh", "cylinder"} | ({"box"} if sum(part.kind != "sphere" for part in parts) > 1 else set())
    for part in parts:
        if part.kind in joined and not part.exact:
            triangles.append(_triangles(part).dot(part.pose[:3, :3].T) + part.pose[:3, 3])
        else:
            made.append(_same_shape(part))
    return (*made, *(enclosing_shapes(np.concatenate(triangles)) if triangles else ()))


def _same_shape(part: Geometry) -> Shape:
    """The shape of a part that needs no replacement."""
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


def _triangles(part: Geometry) -> Array:
    """(f, 3, 3) triangles of a mesh, a box, or a prism about a cylinder."""
    if part.kind == "cylinder":
        radius, length = part.size
        around = radius / cos(pi / PRISM_SIDES)  # outside the circle
        ring = [
            (around * cos(2.0 * pi * i / PRISM_SIDES), around * sin(2.0 * pi * i / PRISM_SIDES))
            for i in range(PRISM_SIDES)
        ]
        return _hull(np.array([(x, y, z) for z in (-0.5 * length, 0.5 * length) for x, y in ring]))
    if part.kind == "box":
        return _hull(0.5 * np.array(part.size) * np.array(list(product((-1.0, 1.0), repeat=3))))
    if isinstance(part.mesh, np.ndarray):
        return _hull(part.mesh)
    return np.asarray(_mesh_triangles(str(part.mesh)) * np.array(part.size))


def _mesh_triangles(file: str) -> Array:
    """(f, 3, 3) triangles of a mesh file; binary STL files are read here, others by coal."""
    data = Path(file).read_bytes() if Path(file).is_file() else b""
    count = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little")
    if len(data) > STL_HEADER and len(data) == STL_HEADER + STL_TRIANGLE.itemsize * count:
        corners = np.frombuffer(data, STL_TRIANGLE, offset=STL_HEADER)["corners"].astype(np.float64)
        if np.isfinite(corners).all():
            return corners
    from invariantqp.geometry.coal import triangles  # coal is loaded where there is such a mesh

    try:
        points, faces = triangles(file)
    except RobotModelError as error:
        raise RobotModelError(f"{error}; give bodies= for its link") from error
    return np.asarray(points[faces])


def _hull(points: Array) -> Array:
    """(f, 3, 3) triangles of the convex hull of points (n, 3)."""
    hull: Any = ConvexHull(points)
    return np.asarray(points[hull.simplices])


def enclosing_shapes(triangles: Array, most: int = 3) -> list[Shape]:
    """At most `most` capsules or boxes that contain all triangles (f, 3, 3)."""
    few = _decimated(triangles)
    pieces = [(triangles, few, _enclosing_shape(few.reshape(-1, 3)))]  # all triangles, few of them, their shape
    splits: list[tuple[Array, list[Array], list[Capsule | Box]] | None] = []
    while len(pieces) < most:
        splits += [_split(few, shape) for _, few, shape in pieces[len(splits) :]]
        gains = [
            0.0 if split is None else _volume(shape) - sum(map(_volume, split[2]))
            for (_, _, shape), split in zip(pieces, splits, strict=True)
        ]
        i = int(np.argmax(gains))
        best = splits.pop(i)
        if best is None or gains[i] <= (1.0 - SPLIT_RATIO) * _volume(pieces[i][2]):
            break
        plane, (whole, _, _) = best[0], pieces.pop(i)
        pieces += zip(_both_sides(whole, plane), *best[1:], strict=True)
    return [_refitted(shape, whole.reshape(-1, 3)) for whole, _, shape in pieces]


def _decimated(part: Array) -> Array:
    """Triangles (f, 3, 3) with one corner for each cell of a grid, without those that degenerate."""
    points = part.reshape(-1, 3)
    up = points - points.min(axis=0)
    _, middle, longest = np.sort(up.max(axis=0))
    cells = (up * (GRID_CELLS / (np.sqrt(middle * longest) or 1.0))).astype(int)
    count = cells.max(axis=0) + 1
    key = (cells[:, 0] * count[1] + cells[:, 1]) * count[2] + cells[:, 2]
    chosen = np.zeros(count.prod(), dtype=np.intp)
    chosen[key] = np.arange(len(key))
    of = chosen[key].reshape(-1, 3)
    of = of[(of[:, 0] != of[:, 1]) & (of[:, 1] != of[:, 2]) & (of[:, 2] != of[:, 0])]
    return points[of] if len(of) else part


def _enclosing_shape(points: Array, *, searched: bool = True) -> Capsule | Box:
    """A small capsule that contains points (n, 3), or a box where its volume is much smaller."""
    points = np.unique(points, axis=0)  # corners of triangles, once each
    normals = np.zeros((0, 3))
    with suppress(QhullError):  # all on one plane or line
        hull: Any = ConvexHull(points)
        x = points[hull.simplices]
        area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
        normals = hull.equations[np.argsort(-area)[:HULL_FACES], :3]
        points = points[hull.vertices]
    of_capsule, of_box = enclosing_capsule(points, searched=searched), enclosing_box(points, normals)
    return of_box if _volume(of_box) < BOX_RATIO * _volume(of_capsule) else of_capsule


def enclosing_box(points: Array, normals: Array) -> Box:
    """A small box that contains points (n, 3), two of its axes among normals (k, 3) and principal axes."""
    V = points - points.mean(axis=0)
    directions, boxes = np.vstack((np.linalg.eigh(V.T.dot(V))[1].T, normals)), []
    for n in directions:
        u = np.cross(n, directions)
        size = np.linalg.norm(u, axis=1)
        u = u[size > MIN_SINE] / size[size > MIN_SINE, None]
        sides = np.stack((u, np.cross(n, u), np.tile(n, (len(u), 1))), axis=1)
        volumes = np.ptp(sides.dot(points.T), axis=2).prod(axis=1)
        boxes.append((float(volumes.min()), sides[int(volumes.argmin())]))
    return _box(min(boxes, key=lambda one: one[0])[1], points)


def _box(axes: Array, points: Array) -> Box:
    """The box along axes (3, 3), a row each, that contains points (n, 3)."""
    along = points.dot(axes.T)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = axes.T, 0.5 * (along.max(axis=0) + along.min(axis=0)).dot(axes)
    return Box(place, np.ptp(along, axis=0))


def enclosing_capsule(points: Array, *, searched: bool = True) -> Capsule | Box:
    """A small capsule that contains all points (n, 3): along a principal axis, or the best of a search about each."""
    centre = points.mean(axis=0)
    size = float(np.abs(points - centre).max())
    if size == 0.0:
        return Capsule(centre, centre, 0.0)
    V = (points - centre) / size
    principal = np.linalg.eigh(V.T.dot(V))[1].T

    def axis(x: Array, along: Array, across: Array) -> Array:
        return np.concatenate((along + x[:2].dot(across), x[2:].dot(across)))

    def volume(x: Array, along: Array, across: Array) -> float:
        return _capsule_along(V, axis(x, along, across))[0]

    axes = []
    for k, along in enumerate(principal):
        frame = along, principal[[k - 2, k - 1]]  # leaning and shifted across it
        x = minimize(volume, np.zeros(4), frame, "Nelder-Mead", options=AXIS_SEARCH).x if searched else np.zeros(4)
        axes.append((volume(x, *frame), axis(x, *frame)))
    best = min(axes, key=lambda one: one[0])[1]
    _, a, b = _capsule_along(V, best)
    return _refitted(Capsule(centre + size * a, centre + size * b, 0.0), points)


def _refitted(one: Capsule | Box, points: Array) -> Capsule | Box:
    """The shape with its axes kept and its radius or edges fitted to points (n, 3)."""
    if isinstance(one, Box):
        return _box(one.placement[:3, :3].T, points)
    centre, u, half = one.placement[:3, 3], one.placement[:3, 2], float(one.half[2])
    W = points - centre
    t = W.dot(u)
    beyond = np.maximum(np.abs(t) - half, 0.0)
    far = float((np.einsum("ij,ij->i", W, W) - t * t + beyond * beyond).max())
    return Capsule(centre - half * u, centre + half * u, float(np.sqrt(max(far, 0.0))))


def _capsule_along(V: Array, x: Array) -> tuple[float, Array, Array]:
    """Volume and ends of the least capsule about points whose axis has direction x[:3] and goes through x[3:]."""
    u, W = x[:3] / (se3.norm(x[:3]) or 1.0), V - x[3:]
    t = W.dot(u)
    across = np.maximum(np.einsum("ij,ij->i", W, W) - t * t, 0.0)
    r2 = float(across.max())
    cap = np.sqrt(r2 - across)
    low, high = float((t + cap).min()), float((t - cap).max())
    if high < low:
        low = high = 0.5 * (low + high)
    return r2 * (high - low) + 4.0 / 3.0 * r2**1.5, x[3:] + low * u, x[3:] + high * u


def _volume(one: Capsule | Box) -> float:
    """[length^3]."""
    if isinstance(one, Box):
        return 8.0 * float(one.half.prod())
    return pi * one.radius**2 * (2.0 * float(one.half[2]) + 4.0 / 3.0 * one.radius)


def _split(part: Array, one: Capsule | Box) -> tuple[Array, list[Array], list[Capsule | Box]] | None:
    """The plane (4,) that cuts triangles (f, 3, 3) across their longest axis, both halves, and a shape of each.

    None where all triangles lie on one side.
    """
    points = part.reshape(-1, 3)
    n = one.placement[:3, int(one.half.argmax())] if one.half.any() else np.linalg.eigh(np.cov(points.T))[1][:, -1]
    heights, rated = points.dot(n), []
    for share in CUTS:
        plane = np.append(n, heights.min() + share * np.ptp(heights))
        sides = _both_sides(part[::SAMPLE_STEP], plane)
        if all(len(side) for side in sides):
            rated.append((sum(_volume(_enclosing_shape(side.reshape(-1, 3), searched=False)) for side in sides), plane))
    if not rated:
        return None
    plane = min(rated, key=lambda one: one[0])[1]
    halves = _both_sides(part, plane)
    return plane, halves, [_enclosing_shape(half.reshape(-1, 3)) for half in halves]


def _both_sides(part: Array, plane: Array) -> list[Array]:
    """The triangles (f, 3, 3) clipped to each side of a plane (4,), n'x = level."""
    return [_clipped(part, sign * plane[:3], sign * plane[3]) for sign in (1.0, -1.0)]


def _clipped(part: Array, n: Array, level: float) -> Array:
    """The triangles (f, 3, 3) clipped to n'x <= level."""
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
