"""The appearance of an arm: the visual shapes of its URDF, reduced to a few thousand triangles.

A part moved by i joints is drawn at exp(s_1 q_1) ... exp(s_i q_i) p, with its points p at q = 0 in the base frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from invariantqp.errors import BadInput, MissingExtra, RobotModelError
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain, Geometry, Link
from invariantqp.robots.description import read_xml
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.urdf import Visual, visual_geometry

if TYPE_CHECKING:
    from invariantqp.workbench.view.meshes import Mesh

# Triangles of a whole robot: 200 kB of a page.
TRIANGLES = 9000
# The default colour.
GREY = (205, 210, 215)


class Part(NamedTuple):
    """A rigid part of one colour."""

    joint: int  # number of joints that move it
    colour: tuple[int, int, int]  # red, green, blue, 0 ... 255.
    vertices: Array  # (n, 3) at q = 0 in the base frame [length]
    faces: Array  # (f, 3) indices of corners, anticlockwise as seen from outside


class Appearance(NamedTuple):
    """The parts of an arm; none if it is drawn by its joints."""

    parts: tuple[Part, ...] = ()
    missing: str = ""  # why parts are missing: an extra to install, or a mesh that cannot be read


def appearance_of(robot: Robot, urdf: Callable[[], Path]) -> Appearance:
    """The appearance of an arm with the URDF `urdf()`; read again after that file or a mesh has changed."""
    try:
        file = urdf()
    except (BadInput, RobotModelError, MissingExtra):  # joint screws alone
        return Appearance()
    if not isinstance(robot, Chain):
        return Appearance()
    try:
        visuals = visual_geometry(*read_xml(file), file.resolve().parent)  # none of an MJCF
        files = [Path(visual.part.mesh) for visual in visuals if visual.part.kind == "mesh"]
        return _cached(tuple(visuals), robot, tuple(each.stat().st_mtime_ns for each in files if each.exists()))
    except RobotModelError as error:
        return Appearance(missing=f"drawn by its joints: {error}")
    except MissingExtra as error:
        return Appearance(missing=f"{error.install} draws its meshes")


@lru_cache(maxsize=8)
def _cached(visuals: tuple[Visual, ...], robot: Chain, _changed: tuple[int, ...]) -> Appearance:
    return Appearance(tuple(_parts(visuals, {link.name: link for link in robot.links})) if visuals else ())


def _parts(visuals: Sequence[Visual], links: dict[str, Link]) -> Iterator[Part]:
    from invariantqp.workbench.view.meshes import read_meshes, reduced

    read = cache(read_meshes)
    groups: dict[tuple[int, tuple[int, int, int]], list[Mesh]] = {}  # by joint and colour
    for name, part, colour in visuals:
        if name not in links:  # beyond the tool frame
            continue
        link = links[name]
        place = link.frame.dot(part.pose)
        own: Any = None if colour is None else tuple(round(255 * each) for each in colour[:3])
        for mesh in _shapes(part, read):
            vertices = mesh.vertices.dot(place[:3, :3].T) + place[:3, 3]
            groups.setdefault((link.body, mesh.colour or own or GREY), []).append(mesh._replace(vertices=vertices))
    merged = [_merged(meshes) for meshes in groups.values()]
    for (joint, hue), mesh in zip(groups, reduced(merged, TRIANGLES), strict=True):
        if len(mesh.faces):
            yield Part(joint, hue, mesh.vertices, mesh.faces)


def _merged(meshes: list[Mesh]) -> Mesh:
    """One mesh of all triangles."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = np.vstack([mesh.faces + n for mesh, n in zip(meshes, first, strict=True)])
    return meshes[0]._replace(vertices=np.vstack([mesh.vertices for mesh in meshes]), faces=faces)


def _shapes(part: Geometry, read: Callable[[Path], list[Mesh]]) -> list[Mesh]:
    """The meshes of a visual, in its own frame; `read` reads a mesh file."""
    from invariantqp.workbench.view import meshes

    if part.kind == "unreadable":
        raise RobotModelError(str(part.mesh))
    if part.kind == "mesh":
        order = slice(None, None, -1 if np.prod(part.size) < 0.0 else 1)  # a reflection reverses the triangles
        return [
            mesh._replace(vertices=mesh.vertices * part.size, faces=mesh.faces[:, order])
            for mesh in read(Path(part.mesh))
        ]
    return [meshes.plain(part.kind, part.size)]
