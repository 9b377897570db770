"""Surfaces that a tool touches: how deep a point is below one, and which way is out.

plane: depth = -n.(p - p0),     cylinder: depth = r - |distance from the axis|
"""

from __future__ import annotations

from math import hypot, inf
from typing import NamedTuple

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import across


class Plane(NamedTuple):
    """A plane through a point (3,), with its unit normal (3,) pointing out.

    It ends at straight edges, if there are any: each is the vector (3,) from the point to the edge and across it.
    """

    point: Array
    normal: Array
    edges: tuple[Array, ...] = ()

    def depth(self, p: Array) -> tuple[float, Array]:
        """How deep p (3,) is [length], negative outside, and the unit normal there."""
        return float(self.normal.dot(self.point - p)), self.normal

    def extent(self, p: Array) -> float:
        """How far the nearest edge is from p (3,) [length], negative beyond it; inf without edges."""
        return min((float(e.dot(self.point + e - p)) / hypot(*e.tolist()) for e in self.edges), default=inf)


class Cylinder(NamedTuple):
    """A round bar about the axis through a point (3,) along a unit direction (3,), touched from outside."""

    point: Array
    axis: Array
    radius: float

    def depth(self, p: Array) -> tuple[float, Array]:
        """How deep p (3,) is [length], negative outside, and the unit normal there."""
        r = p - self.point
        out = r - self.axis.dot(r) * self.axis
        distance = hypot(*out.tolist())
        # On the axis every direction across it leads out.
        return self.radius - distance, out / distance if distance else across(self.axis)[0]


Surface = Plane | Cylinder
