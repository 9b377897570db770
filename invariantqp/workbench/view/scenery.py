"""The surroundings of an arm as faces to draw: the surface in contact, and the shapes of a clearance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import CollisionObject
from invariantqp.geometry.shapes import Core
from invariantqp.robots.kinematics import Robot
from invariantqp.workbench.runs.clearancespec import ObstacleScene
from invariantqp.workbench.runs.plant import HingeSprings
from invariantqp.workbench.runs.scene import scene_of
from invariantqp.workbench.runs.taskfile import Task

# Faces along each side of a surface: small ones, because viewers sort faces by depth.
SIDE = 8
# Margin of a plane beyond the path, and half the height of a door, relative to the tool's distance from the base.
MARGIN = 0.13
# Faces around a round shape.
SIDES = 12


class Surroundings(NamedTuple):
    """The surface or door in contact with the tool."""

    faces: Array = np.empty((0, 4, 3))  # (n, 4, 3) corners of a fixed surface
    axis: Array | None = None  # (2, 3) ends of a door's axis


def surroundings(task: Task, robot: Robot, path: Array) -> Surroundings:
    """The true surface or door of a task, near the points (n, 3) of its path."""
    T = robot.pose(task.start())
    scene = scene_of(task, T)
    if scene is None:
        return Surroundings()
    margin = MARGIN * float(np.linalg.norm(T[:3, 3]))
    springs = scene.springs
    if isinstance(springs, HingeSprings):
        along, foot = screws.axis(springs.screw)
        middle = foot + along * along.dot(T[:3, 3])
        return Surroundings(axis=np.stack((middle - margin * along, middle + margin * along)))
    surface = springs.surface
    corners = patch(path, surface.point, *se3.perpendicular_axes(surface.normal), margin)
    for edge in surface.edges:
        beyond = np.maximum((corners - surface.point - edge).dot(edge) / edge.dot(edge), 0.0)
        corners = corners - beyond[..., None] * edge
    return Surroundings(tiles(corners))


def patch(path: Array, foot: Array, u: Array, v: Array, margin: float) -> Array:
    """(SIDE + 1, SIDE + 1, 3) points of the plane through a foot (3,) along u and v, about a path (n, 3)."""
    coordinates = ((path - foot).dot(along) for along in (u, v))
    a, b = (np.linspace(x.min() - margin, x.max() + margin, SIDE + 1) for x in coordinates)
    return np.asarray(foot + a[:, None, None] * u + b[None, :, None] * v)


class Solid(NamedTuple):
    """A shape to draw."""

    joint: int  # number of joints that move it; 0 for an obstacle
    faces: Array  # (n, 4, 3) at q = 0 in the base frame; of an obstacle in its own frame
    poses: Array | None  # (k, 4, 4) poses of an obstacle; None for a body of the arm


def solids(scene: ObstacleScene, time: Array, m: int, reach: float) -> tuple[Solid, ...]:
    """The bodies of an arm with m joints and the obstacles, at the times (k,) of a timeline."""
    shapes, placed_at, clearance = [], [], scene.clearance
    zero = np.zeros(m)  # the faces of links are at q = 0, and obstacles do not depend on q
    for t in time.tolist() if scene.is_moving else time.tolist()[:1]:
        scene.move(t)
        placed_at.append([placed for _, _, placed in clearance.shapes(zero)])
    for i, (_, body, placed) in enumerate(clearance.shapes(zero)):
        if body is None:
            poses = np.array([placed[i].pose for placed in placed_at])
            shapes.append(Solid(0, faces(placed, reach), np.broadcast_to(poses, (len(time), 4, 4))))
        else:
            local = faces(placed, reach)
            shapes.append(Solid(body, local.dot(placed.pose[:3, :3].T) + placed.pose[:3, 3], None))
    return tuple(shapes)


def faces(placed: CollisionObject, reach: float) -> Array:
    """(n, 4, 3) faces of a shape in its own frame."""
    if placed.core is Core.HALF_SPACE:
        at = np.linspace(-reach, reach, SIDE + 1)  # to each side of the arm
        return tiles(np.array([[(x, y, 0.0) for y in at] for x in at]))
    if placed.mesh is not None:
        corners = placed.mesh.display_triangles()
        return np.concatenate((corners, corners[:, 2:]), axis=1)  # a triangle repeats a corner
    if placed.core is Core.BOX:
        across = [
            [(s, -s, -1.0), (s, s, -1.0), (s, s, 1.0), (s, -s, 1.0)] for s in (-1.0, 1.0)
        ]  # the faces across x; rolled, those across y and z
        return np.array([np.roll(side, k, axis=1) for k in range(3) for side in across]) * placed.half
    angles = np.linspace(0.0, 0.5 * np.pi, SIDES // 4 + 1)
    lower_half = [(-placed.half[2] - placed.radius * np.cos(a), placed.radius * np.sin(a)) for a in angles]
    profile = lower_half + [(-z, r) for z, r in reversed(lower_half)]
    around = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)
    return tiles(np.array([[(r * np.cos(a), r * np.sin(a), z) for a in around] for z, r in profile]))


def tiles(corners: Array) -> Array:
    """(n, 4, 3) faces between the points (a, b, 3) of a grid."""
    four = (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:])
    return np.stack(four, axis=2).reshape(-1, 4, 3)
