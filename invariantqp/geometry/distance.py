"""Distances of two shapes: of the nearest points, and of the ends and corners of each to the other.

The engine has closed forms, exact to rounding, penetration included (`core/distance.hpp`); meshes use coal.
"""

from __future__ import annotations

from itertools import product
from operator import itemgetter
from typing import NamedTuple, Protocol

import numpy as np

from invariantqp.engine import law
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Core


class DistanceResult(NamedTuple):
    """A distance between two shapes."""

    distance: float  # negative for penetration
    normal: Array  # (3,) unit vector from the first to the second
    point: Array  # (3,) of the first core; the nearest point of the second is along the normal


class CollisionMesh(Protocol):
    """A mesh with distances by another library."""

    def distances(self, pose: Array, other: CollisionObject) -> list[DistanceResult]:
        """Distances from another shape's core to the mesh at a (4, 4) pose: the nearest, and of the core's ends."""

    def display_triangles(self) -> Array:
        """(n, 3, 3) corners of triangles to display, in the mesh's own frame; a limited number."""


class CollisionObject(NamedTuple):
    """A shape with its pose in the base frame."""

    core: Core
    radius: float
    half: Array  # (3,) half sizes
    pose: Array  # (4, 4) of the core
    mesh: CollisionMesh | None = None

    @property
    def numbers(self) -> Array:
        """(17,) core, radius, half sizes, rotation and position, as the engine takes them."""
        return np.concatenate(((self.core, self.radius), self.half, self.pose[:3, :3].ravel(), self.pose[:3, 3]))


def distances(a: CollisionObject, b: CollisionObject) -> list[DistanceResult]:
    """All distances of two shapes, ascending; two half-spaces have none."""
    if b.mesh is not None:
        results = b.mesh.distances(b.pose, a)
    elif a.mesh is not None:
        results = [DistanceResult(d, -normal, point + d * normal) for d, normal, point in a.mesh.distances(a.pose, b)]
    else:
        return [DistanceResult(float(row[0]), row[1:4], row[4:]) for row in law.witnesses(a.numbers, b.numbers)]
    thickness = a.radius + b.radius
    return sorted((DistanceResult(d - thickness, normal, point) for d, normal, point in results), key=itemgetter(0))


def corners(half: Array) -> list[Array]:
    """The corners (3,) of a box by its half sizes; a zero half size makes it flat."""
    sides = [(-h, h) if h > 0.0 else (0.0,) for h in half.tolist()]
    return [np.array(corner) for corner in product(*sides)]
