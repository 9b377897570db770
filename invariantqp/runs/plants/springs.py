"""Contact as springs at points of the tool: one point, the two ends of an edge, the four corners of a face or a handle.

    on a surface:  f_i = (k / n) max(depth_i, 0) normal_i,     on a hinge:  f_i = (k / n) (g_i(angle) - p_i)

Wrenches are what the surroundings exert on the tool, about the origin of the base frame. How strongly an edge or a face
resists being tilted follows from where its points are: k L^2 / 4 for an edge of length L.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Plane, Surface

# Gauss-Newton steps for the angle of a hinge: two reach rounding from the angle of a tick ago.
ANGLE_STEPS = 3


@dataclass(frozen=True, eq=False)
class SurfaceSprings:
    """Points of a tool on a surface that pushes and does not pull."""

    shape: Literal["point", "edge", "face"]  # the part of the tool that touches
    points: Array  # (n, 3) in the tool frame [m]: one, the two ends of an edge, or the four corners of a face in order
    surface: Surface  # what they touch
    stiffness: float  # of all points together [N/m]

    def wrench(self, T: Array) -> Array:
        """(6,) of the surface on the tool at pose T."""
        total = np.zeros(6)
        each = self.stiffness / len(self.points)
        for p in self.points.dot(T[:3, :3].T) + T[:3, 3]:
            depth, normal = self.surface.depth(p)
            if depth > 0.0 and (not isinstance(self.surface, Plane) or self.surface.extent(p) > 0.0):
                total += force_at(each * depth * normal, p)
        return total


@dataclass(frozen=True, eq=False)
class HingeSprings:
    """A tool that holds the handle of a door, which turns about an axis."""

    points: Array  # (n, 3) of the tool frame [m], each tied to the point of the door that it is on at angle 0
    home: Array  # (4, 4) tool pose at angle 0
    screw: Array  # (6,) twist of the door, in the base frame
    stiffness: float  # of all points together [N/m]
    shape: Literal["hinge"] = "hinge"

    def handle(self, angle: float) -> Array:
        """(n, 3) where the points of the door are at an angle [rad]."""
        T = se3.exp(angle * self.screw).dot(self.home)
        points: Array = self.points.dot(T[:3, :3].T) + T[:3, 3]
        return points

    def angle(self, T: Array, guess: float) -> float:
        """The angle [rad] of a door that only the springs hold, with the tool at pose T: where they stretch least."""
        p = self.points.dot(T[:3, :3].T) + T[:3, 3]
        for _ in range(ANGLE_STEPS):
            g = self.handle(guess)
            along = np.cross(self.screw[:3], g) + self.screw[3:]
            guess += float(np.vdot(along, p - g) / np.vdot(along, along))
        return guess

    def wrench(self, T: Array, angle: float) -> Array:
        """(6,) of the door on the tool at pose T."""
        p = self.points.dot(T[:3, :3].T) + T[:3, 3]
        forces = self.stiffness / len(p) * (self.handle(angle) - p)
        return np.concatenate((np.cross(p, forces).sum(axis=0), forces.sum(axis=0)))


Springs = SurfaceSprings | HingeSprings


def force_at(force: Array, point: Array) -> Array:
    """(6,) wrench of a force (3,) along the line through a point (3,)."""
    return np.concatenate((se3.cross(point, force), force))
