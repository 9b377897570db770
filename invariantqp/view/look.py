"""What an arm looks like: the visual shapes of its URDF, reduced to a few thousand triangles.

What i joints move is drawn at  exp(s_1 q_1) ... exp(s_i q_i) p,  p its points at q = 0 in the base frame.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from invariantqp.errors import BadInput, MissingExtra, RobotModelError
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.tree import displacement, path_to, rest
from invariantqp.robots.urdf import MOVING, TreeJoint, joints_of, read_xml, rotation
from invariantqp.runs.taskfile import Task

if TYPE_CHECKING:
    from invariantqp.view.meshes import Mesh

# Triangles of a whole robot, about: 200 kB of a page.
TRIANGLES = 9000
# What a file without a colour is drawn in.
GREY = (205, 210, 215)


class Part(NamedTuple):
    """A rigid part of an arm, of one colour."""

    joint: int  # how many of the arm's joints move it
    colour: tuple[int, int, int]  # red, green, blue, 0 ... 255.
    vertices: Array  # (n, 3) at q = 0 in the base frame [length]
    faces: Array  # (f, 3) indices of corners, anticlockwise as seen from outside


class Look(NamedTuple):
    """The parts of an arm; none where it can only be drawn by its joints."""

    parts: tuple[Part, ...] = ()  # in no order
    missing: str = ""  # the extra that would draw them, or the mesh that cannot be read; "" if nothing is missing


def look_of(task: Task, names: Iterable[str]) -> Look:
    """What a task's robot looks like, if it is a name or a URDF; joints not among `names` are held."""
    try:
        file = task.urdf()
    except (BadInput, RobotModelError):  # joint screws alone
        return Look()
    return read_look(file, tuple(names))


def read_look(file: Path, names: tuple[str, ...]) -> Look:
    """What the arm of these joints looks like, by a URDF file; read anew where it or one of its meshes has changed."""
    try:
        meshes = read_xml(file)[1].findall("link/visual/geometry/mesh")
        files = {file, *(_file(file, mesh.get("filename", "")) for mesh in meshes)}
        return _read(file, names, frozenset((each, each.stat().st_mtime_ns) for each in files if each.exists()))
    except RobotModelError as error:
        return Look(missing=f"drawn by its joints: {error}")
    except ValueError:
        return Look(missing="drawn by its joints: a visual shape of its URDF has numbers that are none")
    except MissingExtra as error:
        return Look(missing=f"{error.install} draws its meshes")


@lru_cache(maxsize=8)
def _read(file: Path, names: tuple[str, ...], _changed: frozenset[tuple[Path, int]]) -> Look:
    name, root = read_xml(file)
    if root.find("link/visual") is None:  # an MJCF among others
        return Look()
    return Look(tuple(_parts(file, root, joints_of(name, root), list(names))))


def _parts(file: Path, root: ET.Element, joints: list[TreeJoint], names: list[str]) -> Iterator[Part]:
    from invariantqp.view.meshes import read_meshes, reduced

    read = cache(read_meshes)
    above = {joint.child: joint for joint in joints}
    colours = {m.get("name"): _rgb(m) for m in root.findall("material")}
    found: list[tuple[int, Mesh]] = []
    for link in root.findall("link"):
        joint, T = _place(path_to(above, link.get("name", ""), file.name), names)
        for visual in link.findall("visual"):
            place = T.dot(_origin(visual.find("origin")))
            for mesh in _shapes(file, visual.find("geometry"), read):
                material = visual.find("material")
                own = None if material is None else _rgb(material) or colours.get(material.get("name"))
                vertices = mesh.vertices.dot(place[:3, :3].T) + place[:3, 3]
                found.append((joint, mesh._replace(vertices=vertices, colour=mesh.colour or own or GREY)))
    merged = _merged(found)
    for (joint, colour), mesh in zip(merged, reduced(list(merged.values()), TRIANGLES), strict=True):
        if len(mesh.faces):
            yield Part(joint, colour, mesh.vertices, mesh.faces)


def _merged(found: list[tuple[int, Mesh]]) -> dict[tuple[int, tuple[int, int, int]], Mesh]:
    """One mesh for each joint and colour."""
    groups: dict[tuple[int, tuple[int, int, int]], list[Mesh]] = {}
    for joint, mesh in found:
        groups.setdefault((joint, mesh.colour or GREY), []).append(mesh)
    merged = {}
    for key, meshes in groups.items():
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
        faces = np.vstack([mesh.faces + n for mesh, n in zip(meshes, first, strict=True)])
        merged[key] = meshes[0]._replace(vertices=np.vstack([mesh.vertices for mesh in meshes]), faces=faces)
    return merged


def _place(path: list[TreeJoint], names: list[str]) -> tuple[int, Array]:
    """How many of the arm's joints move the link at the end of a path, and its (4, 4) pose at q = 0."""
    count, T = 0, np.eye(4)
    for joint in path:
        T = T.dot(joint.origin)
        if joint.name in names:
            count = names.index(joint.name) + 1
        elif joint.kind in MOVING:
            T = T.dot(displacement(joint, rest(joint)))
    return count, T


def _shapes(file: Path, geometry: ET.Element | None, read: Callable[[Path], list[Mesh]]) -> list[Mesh]:
    """The shapes of a visual, in its own frame; `read` reads a mesh file."""
    from invariantqp.view import meshes

    for shape in () if geometry is None else geometry:
        if shape.tag == "mesh":
            scale = _numbers(shape.get("scale", "1 1 1"))
            found = read(_file(file, shape.get("filename", "")))
            order = slice(None, None, -1 if np.prod(scale) < 0.0 else 1)  # a mirror image turns its triangles over
            return [mesh._replace(vertices=mesh.vertices * scale, faces=mesh.faces[:, order]) for mesh in found]
        if shape.tag == "box":
            return [meshes.box(_numbers(shape.get("size", "")))]
        if shape.tag == "cylinder":
            return [meshes.cylinder(float(shape.get("radius", "")), float(shape.get("length", "")))]
        if shape.tag == "sphere":
            return [meshes.sphere(float(shape.get("radius", "")))]
    return []


def _file(urdf: Path, name: str) -> Path:
    """The file of a mesh: beside the URDF, or, after "package://", in a folder of the package's name above it."""
    if not name.startswith("package://"):
        return urdf.parent / name.removeprefix("file://")
    package, _, rest_of_path = name.removeprefix("package://").partition("/")
    folder = next((folder for folder in urdf.resolve().parents if folder.name == package), urdf.parent)
    return folder / rest_of_path


def _origin(element: ET.Element | None) -> Array:
    if element is None:
        return np.eye(4)
    xyz, rpy = (_numbers(element.get(key, "0 0 0")) for key in ("xyz", "rpy"))
    return se3.transform(rotation(rpy), xyz)


def _rgb(material: ET.Element) -> tuple[int, int, int] | None:
    colour = material.find("color")
    if colour is None:
        return None
    red, green, blue = (round(255 * min(max(x, 0.0), 1.0)) for x in _numbers(colour.get("rgba", "1 1 1 1"))[:3])
    return red, green, blue


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]
