"""Meshes by coal, from the extra `pin`: as obstacles and collision geometry; and shapes as coal geometries.

This is the only file that imports coal.
"""

from __future__ import annotations

from functools import lru_cache
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import ConvexHull, QhullError

from invariantqp.errors import BadInput, RobotModelError, excerpt
from invariantqp.extras import optional
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import CollisionObject, DistanceResult, corners
from invariantqp.geometry.shapes import Core, Shape

with optional("pin", "coal"):
    import coal

# Largest number of triangles of an obstacle to display.
LARGEST_DISPLAY = 4000
SOURCE = "the path of a mesh file, or (points (n, 3), triangles (f, 3) of their indices); points alone with hull=True"


class Mesh(Shape):
    """An obstacle of triangles: their surface or, with `hull`, all that is inside their convex hull.

    Distances are coal's, some ten microseconds for each near body; those of the other shapes are exact and faster.

    Attributes:
        points: (n, 3) corners, about the middle of their bounding box [length].
        faces: (f, 3) corner indices of each triangle.
        hull: whether it is solid.
    """

    points: Array
    faces: NDArray[np.intp]
    hull: bool

    def __init__(
        self,
        source: str | PathLike[str] | ArrayLike | tuple[ArrayLike, ArrayLike],
        pose: ArrayLike | None = None,
        *,
        scale: float = 1.0,
        hull: bool = False,
        name: str = "",
    ) -> None:
        """A mesh.

        Args:
            source: the path of an STL, OBJ, DAE or PLY file; or its corners (n, 3) and the triangles (f, 3) of their
                indices; or, with `hull`, points (n, 3) alone.
            pose: (4, 4) of the frame in which the corners are given; None is the base frame.
            scale: factor of the corners, 0.001 for a file in millimetres.
            hull: use the convex hull, which is solid: a body inside of it is moved out. A surface does not move out a
                body whose axis has passed through it.
            name: its name in reasons.
        """
        solid, size = arrays.flag(hull, "hull"), arrays.number(scale, "scale", "a factor", positive=True)
        points, faces = _read(source, solid)
        points = size * points
        if solid:
            points, faces = _convex_hull(points)
        low, high = points.min(axis=0), points.max(axis=0)
        middle = 0.5 * (low + high)
        frame = np.eye(4) if pose is None else arrays.pose(pose, "pose")
        super().__init__(Core.MESH, 0.0, 0.5 * (high - low), frame.dot(se3.transform(translation=middle)), name)
        points = points - middle
        vars(self).update(points=points, faces=faces, hull=solid, mesh=CoalMesh(points, faces, solid))


class CoalMesh:
    """A coal geometry of triangles; it may be copied and pickled."""

    def __init__(self, points: Array, faces: NDArray[np.intp], hull: bool) -> None:
        """From corners (n, 3) and triangles (f, 3), anticlockwise as seen from outside for a hull."""
        self.points, self.faces, self.hull = points, faces, hull
        corner, triangle = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for point in points:
            corner.append(point)
        for a, b, c in faces.tolist():
            triangle.append(coal.Triangle(a, b, c))
        self.model = coal.Convex(corner, triangle) if hull else coal.BVHModelOBBRSS()
        if not hull:
            self.model.beginModel(len(faces), len(points))
            self.model.addSubModel(corner, triangle)
            self.model.endModel()
        self._here, self._there = coal.Transform3s(), coal.Transform3s()
        self._request = coal.DistanceRequest(True, True)

    def __reduce__(self) -> tuple[Any, ...]:
        return CoalMesh, (self.points, self.faces, self.hull)

    def distances(self, pose: Array, other: CollisionObject) -> list[DistanceResult]:
        """Distances from another shape's core to the mesh at a (4, 4) pose: the nearest, and of the core's ends."""
        self._there.setTranslation(pose[:3, 3])
        self._there.setRotation(pose[:3, :3])
        if other.core is Core.HALF_SPACE:
            normal = other.pose[:3, 2]
            points = self.points.dot(pose[:3, :3].T) + pose[:3, 3]
            heights = (points - other.pose[:3, 3]).dot(normal)
            i = int(heights.argmin())
            return [DistanceResult(float(heights[i]), normal, points[i])]
        R, p = other.pose[:3, :3], other.pose[:3, 3]
        results = [self._distance(_of(other.core, other.radius, *other.half.tolist()), other.radius, R, p)]
        ends = corners(other.half)
        if len(ends) > 1:
            ball = _of(Core.SEGMENT, other.radius, 0.0, 0.0, 0.0)
            results += [self._distance(ball, other.radius, R, R.dot(end) + p) for end in ends]
        return results

    def display_triangles(self) -> Array:
        """(n, 3, 3) corners of triangles to display, in its own frame: of the convex hull if there are too many."""
        points, faces = self.points, self.faces
        if len(faces) > LARGEST_DISPLAY:
            points, faces = _convex_hull(points)
        return np.asarray(points[faces[:: 1 + len(faces) // LARGEST_DISPLAY]])

    def _distance(self, shape: coal.ShapeBase, radius: float, R: Array, p: Array) -> DistanceResult:
        self._here.setTranslation(p)
        self._here.setRotation(R)
        result = coal.DistanceResult()
        d = coal.distance(shape, self._here, self.model, self._there, self._request, result)
        return DistanceResult(d + radius, result.normal, result.getNearestPoint1())


def _read(source: Any, solid: bool) -> tuple[Array, NDArray[np.intp]]:
    """Corners (n, 3) and triangles (f, 3) of a mesh's source."""
    if isinstance(source, (str, PathLike)):
        try:
            points, faces = triangles(fspath(source))
        except RobotModelError as error:
            raise BadInput("source", str(error), "a mesh file that coal reads: STL, OBJ, DAE, PLY") from error
    elif isinstance(source, tuple) and len(source) == 2:
        points, given = _points(source[0]), arrays.matrix(source[1], (None, 3), "source")
        if not (given == np.round(given)).all():
            raise BadInput("source", excerpt(source[1]), SOURCE)
        faces = given.astype(np.intp)
    elif solid and not isinstance(source, tuple):
        points, faces = _points(source), np.zeros((1, 3), np.intp)
    else:
        raise BadInput("source", excerpt(source), SOURCE)
    if not len(faces) or faces.min() < 0 or faces.max() >= len(points):
        raise BadInput("source", "triangles of corners that are not there", SOURCE)
    return points, faces


def _points(value: Any) -> Array:
    points = arrays.matrix(value, (None, 3), "source")
    if len(points) < 3:
        raise BadInput("source", f"{len(points)} points", SOURCE)
    return points


def _convex_hull(points: Array) -> tuple[Array, NDArray[np.intp]]:
    """Corners and triangles of a convex hull, anticlockwise as seen from outside."""
    try:
        hull: Any = ConvexHull(points)
    except QhullError as error:
        raise BadInput("source", "points without a volume", "points about a solid", "Or hull=False.") from error
    place = np.zeros(len(points), np.intp)
    place[hull.vertices] = np.arange(len(hull.vertices))
    corner = points[hull.simplices]
    turn = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    inward = (turn * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces = place[hull.simplices]
    faces[inward] = faces[inward][:, [0, 2, 1]]
    return points[hull.vertices], faces


def triangles(file: str) -> tuple[Array, NDArray[np.intp]]:
    """Corners (n, 3) of a mesh file and the corner indices (f, 3) of its triangles."""
    if not Path(file).is_file():
        raise RobotModelError(f"no mesh at {file}")
    try:
        mesh = coal.MeshLoader().load(file, np.ones(3))
        corners_of = map(mesh.tri_indices, range(mesh.num_tris))
        return np.array(mesh.vertices(), np.float64), np.array([[t[0], t[1], t[2]] for t in corners_of], np.intp)
    except Exception as error:  # of any type
        raise RobotModelError(f"{file}: cannot be read as a mesh ({error})") from error


def shape_of(shape: Shape) -> coal.ShapeBase:
    """The coal geometry of a shape, in its own frame."""
    if isinstance(shape, Mesh):
        return shape.mesh.model
    return _of(shape.core, shape.radius, *shape.half.tolist())


@lru_cache(maxsize=1024)
def _of(core: Core, radius: float, a: float, b: float, c: float) -> coal.ShapeBase:
    if core is Core.SEGMENT:
        return coal.Capsule(radius, 2.0 * c) if c > 0.0 else coal.Sphere(radius)
    return coal.Box(2.0 * a, 2.0 * b, 2.0 * c) if core is Core.BOX else coal.Halfspace(np.array((0.0, 0.0, 1.0)), 0.0)
