"""Where two shapes are near: the nearest points, and the ends and corners of each against the other.

The engine has closed forms, exact to rounding, inside one another as well (`core/distance.hpp`); meshes have their own.
"""

from __future__ import annotations

from itertools import product
from operator import itemgetter
from typing import NamedTuple, Protocol

import numpy as np

from invariantqp.engine import law
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Core


class Place(NamedTuple):
    """Where two shapes are near."""

    distance: float  # negative inside
    normal: Array  # (3,) unit vector from the first to the second
    point: Array  # (3,) of the first core; both nearest points are on one line along the normal


class Solid(Protocol):
    """A mesh, whose distances another library finds."""

    def places(self, pose: Array, other: Placed) -> list[Place]:
        """Where another shape's core is near, from that to the mesh at a (4, 4) pose."""

    def drawn(self) -> Array:
        """(n, 3, 3) corners of triangles to draw, few enough for a page, in the mesh's own frame."""


class Placed(NamedTuple):
    """A shape in the base frame."""

    core: Core
    radius: float
    half: Array  # (3,)
    pose: Array  # (4, 4)
    solid: Solid | None = None  # the mesh, of one

    @property
    def numbers(self) -> Array:
        """(17,) core, radius, half sizes, rotation and place, as the engine takes them."""
        return np.concatenate(((self.core, self.radius), self.half, self.pose[:3, :3].ravel(), self.pose[:3, 3]))


def places(a: Placed, b: Placed) -> list[Place]:
    """All places of two shapes, by their distance; two half-spaces have none."""
    if b.solid is not None:
        near = b.solid.places(b.pose, a)
    elif a.solid is not None:
        near = [Place(d, -normal, point + d * normal) for d, normal, point in a.solid.places(a.pose, b)]
    else:
        return [Place(float(row[0]), row[1:4], row[4:]) for row in law.witnesses(a.numbers, b.numbers)]
    thick = a.radius + b.radius
    return sorted((Place(d - thick, normal, point) for d, normal, point in near), key=itemgetter(0))


def corners(half: Array) -> list[Array]:
    """Of a box or of what is left of one where half sizes are zero."""
    sides = [(-h, h) if h > 0.0 else (0.0,) for h in half.tolist()]
    return [np.array(corner) for corner in product(*sides)]
