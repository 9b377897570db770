"""What a tool touches, as faces to draw: part of a plane or of a round bar near the path, or the axis of a door."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Cylinder, Plane, Surface
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.make_scene import scene_of
from invariantqp.runs.plants.springs import HingeSprings
from invariantqp.runs.taskfile import Task

# Faces along each side: small ones, because viewers sort faces by depth.
SIDE = 8
# How much of a plane or a bar is drawn beyond the path, and half the height of a door, relative to the distance of the
# tool from the base.
MARGIN = 0.13
# How much of a bar is drawn to either side of where it is touched [rad].
ROUND = 1.3


class Surroundings(NamedTuple):
    """What a robot's tool touches."""

    faces: Array  # (p, 4, 3) corners, in order, of what does not move
    axis: Array | None = None  # (2, 3) the ends of the axis of a door; None without one


def surroundings(task: Task, robot: Robot, path: Array) -> Surroundings:
    """What a task's tool really touches, near the points (n, 3) of its path."""
    T = robot.pose(task.start())
    scene = scene_of(task, T)
    if scene is None:
        return Surroundings(np.empty((0, 4, 3)))
    margin = MARGIN * float(np.linalg.norm(T[:3, 3]))
    springs = scene.springs
    if isinstance(springs, HingeSprings):
        along, foot = screws.axis(springs.screw)
        middle = foot + along * along.dot(T[:3, 3])
        return Surroundings(np.empty((0, 4, 3)), np.stack((middle - margin * along, middle + margin * along)))
    return Surroundings(_faces(springs.surface, path, margin))


def _faces(surface: Surface, path: Array, margin: float) -> Array:
    """(SIDE^2, 4, 3) of a surface near a path."""
    if isinstance(surface, Plane):
        u, v = se3.across(surface.normal)
    else:
        u, v = surface.axis, surface.depth(path.mean(axis=0))[1]
    from_point = path - surface.point
    a = _grid(from_point.dot(u), margin)
    if isinstance(surface, Plane):
        b = _grid(from_point.dot(v), margin)
        corners = surface.point + a[:, None, None] * u + b[None, :, None] * v
        for edge in surface.edges:
            beyond = np.maximum((corners - surface.point - edge).dot(edge) / edge.dot(edge), 0.0)
            corners = corners - beyond[..., None] * edge
    else:
        corners = _bent(surface, a, v)
    return np.stack((corners[:-1, :-1], corners[1:, :-1], corners[1:, 1:], corners[:-1, 1:]), axis=2).reshape(-1, 4, 3)


def _bent(bar: Cylinder, along: Array, outward: Array) -> Array:
    """(SIDE + 1, SIDE + 1, 3) points of a bar: at places along it, at angles about where it is touched."""
    angle = np.linspace(-ROUND, ROUND, SIDE + 1)[:, None]
    rim = bar.radius * (np.cos(angle) * outward + np.sin(angle) * np.cross(bar.axis, outward))
    points: Array = bar.point + along[:, None, None] * bar.axis + rim[None]
    return points


def _grid(values: Array, margin: float) -> Array:
    return np.linspace(values.min() - margin, values.max() + margin, SIDE + 1)
