"""coal, which comes with the extra `pin`: meshes of collision geometry, and shapes as it has them.

This is the only file that imports it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from invariantqp.errors import RobotModelError
from invariantqp.extras import optional
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Core, Shape

with optional("pin", "coal"):
    import coal


def triangles(file: str) -> tuple[Array, NDArray[np.intp]]:
    """(n, 3) corners of a mesh and (f, 3) which of them each triangle has.

    Raises:
        RobotModelError: no such file, or not a mesh.
    """
    if not Path(file).is_file():
        raise RobotModelError(f"no mesh at {file}; give bodies= for its link")
    try:
        mesh = coal.MeshLoader().load(file, np.ones(3))
        corners = np.array(mesh.vertices(), dtype=np.float64)
        faces = np.array([[t[0], t[1], t[2]] for t in map(mesh.tri_indices, range(mesh.num_tris))], dtype=np.intp)
    except Exception as error:  # whatever its reader raises
        raise RobotModelError(f"{file}: cannot be read as a mesh ({error})") from error
    return corners, faces


def shape_of(shape: Shape) -> coal.ShapeBase:
    """A shape as coal has it, about its own frame."""
    if shape.core is Core.SEGMENT:
        return coal.Capsule(shape.radius, 2.0 * float(shape.half[2]))
    return coal.Box(*(2.0 * shape.half)) if shape.core is Core.BOX else coal.Halfspace(np.array((0.0, 0.0, 1.0)), 0.0)
