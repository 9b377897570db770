"""Shapes that must not touch: what an arm's links and the things around it are taken to be.

Each is a core with a round of constant thickness about it: the core of a sphere is a point, that of a capsule a
segment, that of a box the box itself. A half-space is all that lies behind a plane.

A shape is given in some frame: that of the link it belongs to or, as an obstacle, the base frame. An obstacle that
moves is given where that frame has gone.
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
    """What a shape is round of."""

    SEGMENT = 0  # along z, a point where it has no length
    BOX = 1
    HALF_SPACE = 2  # its free side is along z
    MESH = 3  # triangles, inside a box of its half sizes


class Shape:
    """A shape in a frame, and where that frame is now."""

    name: str  # what reasons call it, "" for what it is ("box")
    core: Core  # what it is round of
    radius: float  # thickness of the round [length]
    half: Array  # (3,) half sizes of the core along its own axes [length]
    place: Array  # (4, 4) the core in the frame in which the shape is given
    pose: Array  # (4, 4) that frame now, in the base frame; the identity until it is moved
    twist: Array  # (6,) of that frame now, in the base frame [rad/s; length/s]; zero where it is not declared
    declared: bool  # whether it is declared, or else follows from the frame's last two poses
    solid: Any = None  # the mesh of `Core.MESH`, whose distances another library finds

    def __init__(self, core: Core, radius: float, half: ArrayLike, place: Array, name: str) -> None:
        """A shape from its parts; use Sphere, Capsule, Box or HalfSpace."""
        arrays.instance(name, str, "name", "text, which reasons call it by")
        vars(self).update(name=name, core=core, radius=radius, half=own(np.asarray(half, float)), place=own(place))
        vars(self).update(pose=own(np.eye(4)), twist=own(np.zeros(6)), declared=False)

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{name} of a shape does not change; move(pose, twist) moves it, another one is made anew")

    def move(self, pose: ArrayLike, twist: ArrayLike | None = None) -> None:
        """Say where an obstacle is from now on, between ticks.

        Args:
            pose: (4, 4) in the base frame, of the frame in which its centre, ends, pose or point were given; of a Box
                at the identity that is the box's own pose.
            twist: (6,) of that frame, (omega; v) in the base frame [rad/s; length/s], zeros at rest; None is as its
                last two poses say, over the ticks between them.
        """
        where = own(arrays.pose(pose, "pose"))
        speed = own(np.zeros(6) if twist is None else arrays.twist(twist))
        vars(self).update(pose=where, twist=speed, declared=twist is not None)

    @property
    def called(self) -> str:
        """Its name, or what it is."""
        return self.name or {"HalfSpace": "half-space"}.get(type(self).__name__, type(self).__name__.lower())

    def __repr__(self) -> str:
        if "core" not in vars(self):  # refused while it was made
            return f"<{type(self).__name__}>"
        size = "" if self.core is Core.HALF_SPACE else f", {2.0 * (self.half + self.radius)} in size"
        return f"<{self.called} at {np.round(self.pose.dot(self.place)[:3, 3], 4)}{size}>"


class Sphere(Shape):
    """All points nearer to a centre than a radius."""

    def __init__(self, centre: ArrayLike, radius: float, *, name: str = "") -> None:
        """A sphere: centre (3,) and radius [length], 0 for a point; `name` is what reasons call it."""
        place = se3.transform(translation=arrays.vector(centre, 3, "centre"))
        super().__init__(Core.SEGMENT, _radius(radius), np.zeros(3), place, name)


class Capsule(Shape):
    """All points nearer to a segment than a radius: a cylinder with round ends."""

    def __init__(self, a: ArrayLike, b: ArrayLike, radius: float, *, name: str = "") -> None:
        """A capsule: the ends (3,) of its axis and its radius [length]; a sphere where they are one point.

        `name` is what reasons call it.
        """
        one, other = arrays.vector(a, 3, "a"), arrays.vector(b, 3, "b")
        with np.errstate(over="ignore"):
            half = 0.5 * se3.norm(other - one)
        if not isfinite(half):
            raise BadInput("b", excerpt(other.tolist()), "an end that is a finite length from a")
        middle = one + 0.5 * (other - one)
        place = se3.facing((other - one) / (2.0 * half), middle) if half > 0.0 else se3.transform(translation=middle)
        super().__init__(Core.SEGMENT, _radius(radius), (0.0, 0.0, half), place, name)


class Box(Shape):
    """A box, with sharp edges."""

    def __init__(self, pose: ArrayLike, size: ArrayLike, *, name: str = "") -> None:
        """A box: the (4, 4) pose of its middle, its axes along the edges, and the whole lengths (3,) of these [length].

        0 makes it flat; `name` is what reasons call it.
        """
        edges = arrays.vector(size, 3, "size")
        if (edges < 0.0).any():
            raise BadInput("size", excerpt(edges.tolist()), "three lengths that are not negative")
        super().__init__(Core.BOX, 0.0, 0.5 * edges, arrays.pose(pose, "pose"), name)


class HalfSpace(Shape):
    """All that lies behind a plane: a floor, a table, a wall."""

    def __init__(self, point: ArrayLike, normal: ArrayLike, *, name: str = "") -> None:
        """A half-space: a point (3,) of its plane [length], and the normal (3,) out of it, to the side that is free.

        `name` is what reasons call it.
        """
        place = se3.facing(arrays.direction(normal, "normal"), arrays.vector(point, 3, "point"))
        super().__init__(Core.HALF_SPACE, 0.0, np.zeros(3), place, name)


def _radius(value: float) -> float:
    return arrays.not_negative(value, "radius", "a radius in lengths")
