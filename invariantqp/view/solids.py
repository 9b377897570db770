"""The shapes of a clearance, as faces to draw: the bodies of the arm, seen through, and what is around it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Placed
from invariantqp.geometry.shapes import Core
from invariantqp.runs.clearancespec import Around

# Faces about a round shape, and over half of one of its ends.
ROUND, CAP = 12, 3
# How far a half-space is drawn to each side of the arm, by its reach, and in how many faces a side.
WIDE, SIDE = 0.8, 6


class Solid(NamedTuple):
    """A shape to draw."""

    joint: int  # how many of the arm's joints move it; 0 does not move with the arm
    faces: Array  # (n, 4, 3) at q = 0 in the base frame; of an obstacle in its own frame
    poses: Array | None  # (k, 4, 4) where an obstacle is in each frame; None for a body of the arm


def solids(around: Around, time: Array, m: int, reach: float) -> tuple[Solid, ...]:
    """The bodies of an arm with m joints and the obstacles, at the times (k,) of a film."""
    made = []
    clearance = around.clearance
    frames = []
    for t in time.tolist() if around.moving else time.tolist()[:1]:
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
        at = np.linspace(-WIDE * reach, WIDE * reach, SIDE + 1)
        return _grid(np.array([[(x, y, 0.0) for y in at] for x in at]))
    if placed.core is Core.BOX:
        h = placed.half
        sides = []
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            for s in (-1.0, 1.0):
                corners = np.zeros((4, 3))
                corners[:, k] = s * h[k]
                corners[:, i] = h[i] * np.array((-s, s, s, -s))
                corners[:, j] = h[j] * np.array((-1.0, -1.0, 1.0, 1.0))
                sides.append(corners)
        return np.array(sides)
    angles = np.linspace(0.0, 0.5 * np.pi, CAP + 1)
    low = [(-placed.half[2] - placed.radius * np.cos(a), placed.radius * np.sin(a)) for a in angles]
    profile = low + [(-z, r) for z, r in reversed(low)]
    turn = np.linspace(0.0, 2.0 * np.pi, ROUND + 1)
    return _grid(np.array([[(r * np.cos(a), r * np.sin(a), z) for a in turn] for z, r in profile]))


def _grid(corners: Array) -> Array:
    """(n, 4, 3) faces between the points (a, b, 3) of a grid."""
    around = (corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1])
    return np.stack(around, axis=2).reshape(-1, 4, 3)
