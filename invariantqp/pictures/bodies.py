"""The bodies of an arm from the front and from the side, as its clearance has them; the two nearest stand out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from invariantqp.errors import BadInput
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Placed, corners
from invariantqp.geometry.shapes import Core
from invariantqp.pictures.figure import figure_file
from invariantqp.pictures.palette import BLUE, RULE, SKY, TEXT, VERMILION
from invariantqp.robots.bodies import SIDES

if TYPE_CHECKING:
    from invariantqp.control.clearance import Clearance


def bodies_picture(clearance: Clearance, q: ArrayLike, path: Path | str) -> Path:
    """Write what a clearance keeps apart, at joint positions q (m,), to a .png, .svg or .pdf file."""
    shapes = [one for one in clearance.shapes(q) if one[2].core is not Core.HALF_SPACE]
    if not shapes:
        raise BadInput("clearance", "no bodies", "a robot with collision geometry, or bodies=")
    near = clearance.at(q)
    with figure_file(path, (9.0, 4.8), {"font.size": 9, "svg.fonttype": "none"}) as figure:
        for panel, axis, title in zip(figure.subplots(1, 2), (1, 0), ("along y", "along x"), strict=True):
            seen = [i for i in range(3) if i != axis]
            for name, body, placed in shapes:
                hue = RULE if body is None else VERMILION if name in near[:2] else BLUE if body % 2 else SKY
                panel.fill(*_outline(placed, seen).T, facecolor=hue, edgecolor=TEXT, alpha=0.45, linewidth=0.8)
            panel.set_aspect("equal", "datalim")
            panel.set_xlabel("xyz"[seen[0]])
            panel.set_ylabel("xyz"[seen[1]])
            panel.set_title(f"seen {title}")
        figure.suptitle(f"nearest: {near}" if near.first else "no two bodies can touch")
    return Path(path)


def _outline(placed: Placed, seen: list[int]) -> Array:
    """(n, 2) corners of a shape's shadow."""
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    if placed.solid is not None:
        flat = placed.solid.drawn().reshape(-1, 3).dot(placed.pose[:3, :3].T)[:, seen] + placed.pose[seen, 3]
        return np.asarray(flat[ConvexHull(flat).vertices])
    ends = np.array(corners(placed.half)).dot(placed.pose[:3, :3].T) + placed.pose[:3, 3]
    circle = placed.radius * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    points = (ends[:, None, seen] + circle[None]).reshape(-1, 2)
    return np.asarray(points[ConvexHull(points).vertices])
