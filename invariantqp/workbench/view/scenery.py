"""What is around an arm, as faces to draw: what its tool touches, and the shapes that a clearance keeps apart.

A tool touches part of a plane near its path, or turns a door about an axis. Bodies of the arm are seen through;
obstacles may move.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Placed
from invariantqp.geometry.shapes import Core
from invariantqp.robots.kinematics import Robot
from invariantqp.workbench.runs.clearancespec import ObstacleScene
from invariantqp.workbench.runs.plant import HingeSprings
from invariantqp.workbench.runs.scene import scene_of
from invariantqp.workbench.runs.taskfile import Task

# Faces along each side: small ones, because viewers sort faces by depth.
SIDE = 8
# How much of a plane is drawn beyond the path, and half the height of a door, relative to the distance of the
# tool from the base.
MARGIN = 0.13
# Faces about a round shape.
SIDES = 12


class Surroundings(NamedTuple):
    """What a robot's tool touches."""

    faces: Array = np.empty((0, 4, 3))  # corners, in order, of what does not move
    axis: Array | None = None  # (2, 3) the ends of the axis of a door; None without one


def surroundings(task: Task, robot: Robot, path: Array) -> Surroundings:
    """What a task's tool really touches, near the points (n, 3) of its path."""
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
    corners = patch(path, surface.point, *se3.across(surface.normal), margin)
    for edge in surface.edges:
        beyond = np.maximum((corners - surface.point - edge).dot(edge) / edge.dot(edge), 0.0)
        corners = corners - beyond[..., None] * edge
    return Surroundings(tiles(corners))


def patch(path: Array, foot: Array, u: Array, v: Array, margin: float) -> Array:
    """(SIDE + 1, SIDE + 1, 3) points of the plane through a foot (3,) along u and v, about a path (n, 3)."""
    ways = ((path - foot).dot(along) for along in (u, v))
    a, b = (np.linspace(way.min() - margin, way.max() + margin, SIDE + 1) for way in ways)
    return np.asarray(foot + a[:, None, None] * u + b[None, :, None] * v)


class Solid(NamedTuple):
    """A shape to draw."""

    joint: int  # how many of the arm's joints move it; 0 does not move with the arm
    faces: Array  # (n, 4, 3) at q = 0 in the base frame; of an obstacle in its own frame
    poses: Array | None  # (k, 4, 4) where an obstacle is in each frame; None for a body of the arm


def solids(around: ObstacleScene, time: Array, m: int, reach: float) -> tuple[Solid, ...]:
    """The bodies of an arm with m joints and the obstacles, at the times (k,) of a timeline."""
    made = []
    clearance = around.clearance
    frames = []
    for t in time.tolist() if around.is_moving else time.tolist()[:1]:
        around.move(t)
        frames.append([placed for _, _, placed in clearance.shapes(np.zeros(m))])
    for i, (_, body, placed) in enumerate(clearance.shapes(np.zeros(m))):
        if body is None:
            poses = np.array([frame[i].pose for frame in frames])
            made.append(Solid(0, faces(placed, reach), np.broadcast_to(poses, (len(time), 4, 4))))
        else:
            here = faces(placed, reach)
            made.append(Solid(body, here.dot(placed.pose[:3, :3].T) + placed.pose[:3, 3], None))
    return tuple(made)


def faces(placed: Placed, reach: float) -> Array:
    """(n, 4, 3) faces of a shape in its own frame."""
    if placed.core is Core.HALF_SPACE:
        at = np.linspace(-reach, reach, SIDE + 1)  # to each side of the arm
        return tiles(np.array([[(x, y, 0.0) for y in at] for x in at]))
    if placed.solid is not None:
        corners = placed.solid.drawn()
        return np.concatenate((corners, corners[:, 2:]), axis=1)
    if placed.core is Core.BOX:
        across = [[(s, -s, -1.0), (s, s, -1.0), (s, s, 1.0), (s, -s, 1.0)] for s in (-1.0, 1.0)]  # x, outwards
        return np.array([np.roll(side, k, axis=1) for k in range(3) for side in across]) * placed.half
    angles = np.linspace(0.0, 0.5 * np.pi, SIDES // 4 + 1)
    low = [(-placed.half[2] - placed.radius * np.cos(a), placed.radius * np.sin(a)) for a in angles]
    profile = low + [(-z, r) for z, r in reversed(low)]
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES + 1)
    return tiles(np.array([[(r * np.cos(a), r * np.sin(a), z) for a in turn] for z, r in profile]))


def tiles(corners: Array) -> Array:
    """(n, 4, 3) faces between the points (a, b, 3) of a grid."""
    around = (corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:])
    return np.stack(around, axis=2).reshape(-1, 4, 3)
