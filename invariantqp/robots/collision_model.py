"""An arm's shapes beside its `pinocchio.Model`, for barriers made for Pink that keep them apart."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from invariantqp.geometry.coal import shape_of
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.pinocchio import pin
from invariantqp.robots.srdf import excluded


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
            one = pin.GeometryObject(f"{name}_{i}", link.body, place, shape_of(shape))
            indices.setdefault(name, []).append(made.addGeometryObject(one))
    for one, other in combinations(indices, 2):
        if abs(known[one].body - known[other].body) > 1 and frozenset((one, other)) not in apart:
            for i in indices[one]:
                for j in indices[other]:
                    made.addCollisionPair(pin.CollisionPair(i, j))
    return made
