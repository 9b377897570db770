"""What touches as solids, for a physics engine: shapes that stand in the world and shapes on the tool.

Springs of a task file become solids by `solids_of`; a scene of another kind, such as a peg in a hole, gives its own.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Plane, Surface
from invariantqp.runs.plants.springs import SurfaceSprings

# Radius of the tip of a pen and of an edge, thickness of a face [m].
TIP = 2e-3
# Half the length of a bar, and of a side of a table that has an edge elsewhere; half the thickness of a table [m].
FAR = 1.0
THICK = 0.05
# Edges of a table this far from a right angle, as the sine of the angle, make no box.
SQUARE = 1e-6

SolidKind = Literal["plane", "sphere", "capsule", "cylinder", "box"]


class Solid(NamedTuple):
    """A shape at a pose."""

    kind: SolidKind  # its shape; its axis is z, a plane's normal likewise
    size: tuple[float, ...]  # radius of a sphere; radius and half length; half sides of a box; nothing of a plane [m]
    pose: Array  # (4, 4), of its middle


class Solids(NamedTuple):
    """What touches."""

    world: tuple[Solid, ...]  # what does not move, in the base frame
    tool: tuple[Solid, ...]  # what is on the tool, in the tool frame
    stiffness: float  # of each of their contact points [N/m]


def solids_of(springs: SurfaceSprings, T: Array) -> Solids:
    """The surface, and on the tool at pose T a ball, an edge or a face that touches it at the points of the springs.

    Raises:
        BadInput: a contact that has no such shapes.
    """
    surface = springs.surface
    if not isinstance(surface, Plane) and springs.shape != "point":
        raise BadInput("physics", f"a {springs.shape} on a round bar", "a point there, or a plane, with MuJoCo")
    return Solids((_surface(surface),), (_tip(springs, T),), springs.stiffness / len(springs.points))


def ball_at(point: Array, outwards: Array) -> Solid:
    """The tip of a pen that ends at a point (3,), below its middle against a direction (3,), in one frame."""
    return Solid("sphere", (TIP,), se3.transform(None, point + TIP * outwards))


def _surface(surface: Surface) -> Solid:
    """A plane, a table with its edges, or a round bar, in the base frame."""
    if not isinstance(surface, Plane):
        return Solid("cylinder", (surface.radius, FAR), se3.facing(surface.axis, surface.point))
    if not surface.edges:
        return Solid("plane", (), se3.facing(surface.normal, surface.point))
    x = surface.edges[0] / np.linalg.norm(surface.edges[0])
    R = np.column_stack((x, np.cross(surface.normal, x), surface.normal))
    low, high = np.full(2, -FAR), np.full(2, FAR)
    for edge in surface.edges:
        inside = edge.dot(R)[:2]
        i = int(np.abs(inside).argmax())
        if abs(inside[1 - i]) > SQUARE * abs(inside[i]):
            raise BadInput("contact.edges", "edges at another angle", "edges at right angles, with MuJoCo")
        if inside[i] > 0.0:
            high[i] = min(high[i], inside[i])
        else:
            low[i] = max(low[i], inside[i])
    middle = surface.point + R.dot([*(0.5 * (low + high)), -THICK])
    return Solid("box", (*(0.5 * (high - low)).tolist(), THICK), se3.transform(R, middle))


def _tip(springs: SurfaceSprings, T: Array) -> Solid:
    """The part of the tool that touches, in the tool frame."""
    p = springs.points.mean(axis=0)
    _, normal = springs.surface.depth(T[:3, :3].dot(p) + T[:3, 3])
    up = T[:3, :3].T.dot(normal)  # in the tool frame
    if springs.shape == "point":
        return ball_at(p, up)
    if springs.shape == "edge":
        along = springs.points[1] - springs.points[0]
        half = 0.5 * float(np.linalg.norm(along))
        return Solid("capsule", (TIP, half), se3.facing(along, p + TIP * up))
    a, b = springs.points[1] - springs.points[0], springs.points[2] - springs.points[1]
    sides = 0.5 * float(np.linalg.norm(a)), 0.5 * float(np.linalg.norm(b))
    R = np.column_stack((a / (2.0 * sides[0]), b / (2.0 * sides[1]), np.cross(a, b) / (4.0 * sides[0] * sides[1])))
    return Solid("box", (*sides, 0.5 * TIP), se3.transform(R, p + 0.5 * TIP * up))
