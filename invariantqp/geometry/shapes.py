"""Collision shapes of an arm's links and of obstacles.

Each is a core with a round of constant radius: the core of a sphere is a point, that of a capsule a segment, that of a
box the box itself. A half-space is all points behind a plane.

A shape is given in the frame of its link or, as an obstacle, in the base frame; `move` sets the pose of that frame.
"""

from __future__ import annotations

from enum import IntEnum
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import own


class Core(IntEnum):
    """The core of a shape."""

    SEGMENT = 0  # along z; a point if its length is zero
    BOX = 1
    HALF_SPACE = 2  # its free side is along z
    MESH = 3  # triangles in a bounding box of its half sizes


class Shape:
    """A shape in a frame, and the current pose of that frame."""

    name: str  # its name in reasons, "" for its kind ("box")
    core: Core
    radius: float  # of the round [length]
    half: Array  # (3,) half sizes of the core along its own axes [length]
    placement: Array  # (4, 4) the core in the frame in which the shape is given
    pose: Array  # (4, 4) of that frame in the base frame; the identity until it is moved
    twist: Array  # (6,) of that frame in the base frame [rad/s; length/s]; zero unless declared
    declared: bool  # whether the twist is declared, else it follows from the last two poses
    mesh: Any = None  # the `CollisionMesh` of `Core.MESH`

    def __init__(self, core: Core, radius: float, half: ArrayLike, placement: Array, name: str) -> None:
        """A shape from its parts; use Sphere, Capsule, Box or HalfSpace."""
        arrays.instance(name, str, "name", "text, which reasons call it by")
        vars(self).update(
            name=name, core=core, radius=radius, half=own(np.asarray(half, float)), placement=own(placement)
        )
        vars(self).update(pose=own(np.eye(4)), twist=own(np.zeros(6)), declared=False)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{name} of a shape does not change: move(pose, twist) moves it; or make another shape")

    def move(self, pose: ArrayLike, twist: ArrayLike | None = None) -> None:
        """Set the pose of an obstacle's frame, between ticks.

        Args:
            pose: (4, 4) in the base frame, of the frame in which its centre, ends, pose or point were given; for a Box
                given at the identity, the pose of the box.
            twist: (6,) of that frame, (omega; v) in the base frame [rad/s; length/s], zeros at rest; None estimates it
                from the last two poses and the ticks between them.
        """
        frame = own(arrays.pose(pose, "pose"))
        velocity = own(np.zeros(6) if twist is None else arrays.twist(twist))
        vars(self).update(pose=frame, twist=velocity, declared=twist is not None)

    @property
    def label(self) -> str:
        """Its name, or its kind."""
        return self.name or {"HalfSpace": "half-space"}.get(type(self).__name__, type(self).__name__.lower())

    def __repr__(self) -> str:
        if "core" not in vars(self):  # its constructor raised
            return f"<{type(self).__name__}>"
        size = "" if self.core is Core.HALF_SPACE else f", {2.0 * (self.half + self.radius)} in size"
        return f"<{self.label} at {np.round(self.pose.dot(self.placement)[:3, 3], 4)}{size}>"


class Sphere(Shape):
    """All points nearer to a centre than a radius."""

    def __init__(self, centre: ArrayLike, radius: float, *, name: str = "") -> None:
        """A sphere: centre (3,) and radius [length], 0 for a point; `name` is its name in reasons."""
        placement = se3.transform(translation=arrays.vector(centre, 3, "centre"))
        super().__init__(Core.SEGMENT, _radius(radius), np.zeros(3), placement, name)


class Capsule(Shape):
    """All points nearer to a segment than a radius: a cylinder with round ends."""

    def __init__(self, a: ArrayLike, b: ArrayLike, radius: float, *, name: str = "") -> None:
        """A capsule: the ends (3,) of its axis and its radius [length]; a sphere if the ends coincide.

        `name` is its name in reasons.
        """
        one, other = arrays.vector(a, 3, "a"), arrays.vector(b, 3, "b")
        with np.errstate(over="ignore"):
            half = 0.5 * se3.norm(other - one)
        if not isfinite(half):
            raise BadInput("b", excerpt(other.tolist()), "an end that is a finite length from a")
        middle = one + 0.5 * (other - one)
        placement = (
            se3.pose_along_z((other - one) / (2.0 * half), middle) if half > 0.0 else se3.transform(translation=middle)
        )
        super().__init__(Core.SEGMENT, _radius(radius), (0.0, 0.0, half), placement, name)


class Box(Shape):
    """A box, with sharp edges."""

    def __init__(self, pose: ArrayLike, size: ArrayLike, *, name: str = "") -> None:
        """A box: the (4, 4) pose of its centre, axes along the edges, and the lengths (3,) of the edges [length].

        0 makes it flat; `name` is its name in reasons.
        """
        edges = arrays.vector(size, 3, "size")
        if (edges < 0.0).any():
            raise BadInput("size", excerpt(edges.tolist()), "three lengths that are not negative")
        super().__init__(Core.BOX, 0.0, 0.5 * edges, arrays.pose(pose, "pose"), name)


class HalfSpace(Shape):
    """All points behind a plane: a floor, a table, a wall."""

    def __init__(self, point: ArrayLike, normal: ArrayLike, *, name: str = "") -> None:
        """A half-space: a point (3,) of its plane [length], and the normal (3,) to its free side.

        `name` is its name in reasons.
        """
        placement = se3.pose_along_z(arrays.direction(normal, "normal"), arrays.vector(point, 3, "point"))
        super().__init__(Core.HALF_SPACE, 0.0, np.zeros(3), placement, name)


def _radius(value: float) -> float:
    return arrays.not_negative(value, "radius", "a radius in lengths")
