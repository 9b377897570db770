"""coal, which comes with the extra `pin`: meshes of collision geometry, and an arm's shapes for Pink's barriers.

This is the only file that imports it.
"""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from invariantqp.errors import RobotModelError
from invariantqp.extras import optional
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.pinocchio import pin
from invariantqp.robots.srdf import excluded

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


def collision_model(robot: Chain) -> pin.GeometryModel:
    """The shapes of an arm's links as a `pinocchio.GeometryModel` beside `robot.model`, for SelfCollisionBarrier.

    Its pairs are those of links that are neither neighbours nor excluded by the robot's description.

    Raises:
        BadInput: a robot without collision geometry.
        RobotModelError: geometry that cannot be read.
    """
    bodies, known = bodies_of(robot), {link.name: link for link in robot.links}
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, np.zeros(robot.model.nq))
    made, apart = pin.GeometryModel(), excluded(robot)
    indices: dict[str, list[int]] = {}
    for name, shapes in bodies.items():
        link = known[name]
        for i, shape in enumerate(shapes if not link.unknown else ()):
            place = data.oMi[link.body].inverse() * pin.SE3(link.frame.dot(shape.place))
            one = pin.GeometryObject(f"{name}_{i}", link.body, place, _of_coal(shape))
            indices.setdefault(name, []).append(made.addGeometryObject(one))
    for one, other in combinations(indices, 2):
        if abs(known[one].body - known[other].body) > 1 and frozenset((one, other)) not in apart:
            for i in indices[one]:
                for j in indices[other]:
                    made.addCollisionPair(pin.CollisionPair(i, j))
    return made


def _of_coal(shape: Shape) -> coal.ShapeBase:
    if shape.core is Core.SEGMENT:
        return coal.Capsule(shape.radius, 2.0 * float(shape.half[2]))
    return coal.Box(*(2.0 * shape.half)) if shape.core is Core.BOX else coal.Halfspace(np.array((0.0, 0.0, 1.0)), 0.0)
