"""Triangles of mesh files and plain shapes, and their reduction. The only file that imports trimesh.

STL and OBJ are read by trimesh alone, DAE with pycollada; triangles are merged by fast-simplification (quadric errors).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from invariantqp.errors import RobotModelError
from invariantqp.extras import optional
from invariantqp.geometry.arrays import Array

with optional("meshes", "trimesh, pycollada or fast-simplification"):
    import collada  # noqa: F401 (trimesh reads DAE with it)
    import fast_simplification
    import trimesh

# Grid cells along a mesh's longest side: half a millimetre on a link at first; at a millimetre the inside of a Panda's
# wrist shows.
CELLS = (400, 200, 100, 50)
# Least number of triangles of a mesh, and tolerance of that number.
FEWEST = 24


class Mesh(NamedTuple):
    """Triangles of one colour."""

    vertices: Array  # (n, 3)
    faces: Array  # (f, 3) indices of corners, anticlockwise as seen from outside
    colour: tuple[int, int, int] | None  # red, green, blue, 0 ... 255; None where the file says none.


def read_meshes(file: Path) -> list[Mesh]:
    """The meshes of a file."""
    try:
        scene = trimesh.load_scene(file)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # readers of broken files raise anything
        why = "is not there" if not file.is_file() else "cannot be read as a mesh"
        raise RobotModelError(f"{file.name} {why}") from error
    if not parts:
        raise RobotModelError(f"{file.name} has no triangles")
    materials = [getattr(part.visual, "material", None) for part in parts]  # a file of triangles alone has none
    colours: list[Any] = [None if one is None else tuple(map(int, one.main_color[:3])) for one in materials]
    return [Mesh(np.array(part.vertices), np.array(part.faces), c) for part, c in zip(parts, colours, strict=True)]


def plain(kind: str, size: Sequence[float]) -> Mesh:
    """A box, sphere, cylinder or capsule about the origin, of a size as `robots.chain.Geometry` has it."""
    create = trimesh.creation
    if kind == "box":
        part = create.box(size)
    elif kind == "sphere":
        part = create.icosphere(2)
    elif kind == "cylinder":
        part = create.cylinder(*size, sections=24)
    else:
        part = create.capsule(size[1], size[0], count=(24, 12))
    scale = size[0] if kind == "sphere" else 1.0
    return Mesh(scale * np.array(part.vertices), np.array(part.faces), None)


def reduced(meshes: Sequence[Mesh], most: int) -> list[Mesh]:
    """Meshes reduced to about `most` triangles in all, in proportion to the root of their areas."""
    corners = (mesh.vertices[mesh.faces] for mesh in meshes)
    weight = np.sqrt([float(trimesh.triangles.area(part).sum()) for part in corners])
    share = most * weight / (weight.sum() or 1.0)
    return [_fewer(mesh, max(FEWEST, int(n))) for mesh, n in zip(meshes, share, strict=True)]


def _fewer(mesh: Mesh, most: int) -> Mesh:
    """A mesh reduced to about `most` triangles.

    Small holes keep triangles from being merged, so corners are first merged in the cells of a grid, which is made
    coarser until that is enough.
    """
    size = float(np.ptp(mesh.vertices, axis=0).max())
    if not size:
        return mesh._replace(faces=mesh.faces[:0])
    for cells in CELLS:
        mesh = _merged_corners(mesh, size / cells)
        if len(mesh.faces) <= most + FEWEST:
            break
        vertices, faces = fast_simplification.simplify(
            np.ascontiguousarray(mesh.vertices, np.float32),
            np.ascontiguousarray(mesh.faces, np.int32),
            target_count=most,
        )
        mesh = Mesh(vertices.astype(float), faces, mesh.colour)
    return mesh


def _merged_corners(mesh: Mesh, reach: float) -> Mesh:
    """A mesh with the corners in each cell of a grid merged; many files repeat them for each triangle."""
    cell = np.round((mesh.vertices - mesh.vertices.min(axis=0)) / reach).astype(np.int64)
    _, at = np.unique(cell @ (1, 1 << 20, 1 << 40), return_inverse=True)
    count = np.bincount(at)
    vertices = np.column_stack([np.bincount(at, x) / count for x in mesh.vertices.T])
    a, b, c = at[mesh.faces].T
    return Mesh(vertices, at[mesh.faces][(a != b) & (b != c) & (c != a)], mesh.colour)
