"""URDF, from a file or from text: the joints that a serial chain is made of. Only the standard library is needed.

Read are each joint's name, type, links, origin, axis, limits and whether it mimics another. An origin is
T = (Rz(yaw) Ry(pitch) Rx(roll), xyz), an axis is made a unit vector. Document types, where entities are declared, are
refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, inf, isfinite, sin
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from invariantqp.errors import RobotModelError
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import UNLIMITED
from invariantqp.robots.links import Geometry

# What may stand before the "<" of a text.
BLANK = "\ufeff \t\r\n"
# Types of joints with one coordinate, without one, and with several.
MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed", "floating", "planar")


class TreeJoint(NamedTuple):
    """A joint of a tree of links."""

    name: str  # of the joint
    kind: str  # one of `TYPES`
    parent: str  # the link that it stands on
    child: str  # the link that it moves
    origin: Array  # (4, 4) its frame in that of the parent link, at zero
    axis: Array  # (3,) unit vector in its frame
    lower: float = -inf  # position limit [rad, m], -inf where there is none
    upper: float = inf  # likewise, inf
    speed: float = inf  # velocity limit [rad/s, m/s], inf where there is none
    mimics: str = ""  # the joint that it follows, "" for none


def is_text(source: str) -> bool:
    """Whether this is XML rather than a name or a path."""
    return source.lstrip(BLANK).startswith("<")


def read_xml(source: Path | str) -> tuple[str, ET.Element]:
    """What to call a robot in messages, and the root element of its description: the path of a file, or its text.

    Raises:
        RobotModelError: a file that cannot be read, no XML, or XML with a document type.
    """
    name = str(source) if isinstance(source, Path) else "the URDF text"
    parser = ET.XMLParser(target=_Tree(name))  # noqa: S314 (without a document type there are no entities)
    try:
        return name, ET.fromstring(source.read_bytes() if isinstance(source, Path) else source.lstrip(BLANK), parser)  # noqa: S314
    except OSError as error:
        raise RobotModelError(f"{name}: cannot be read ({error.strerror or error})") from error
    except (ET.ParseError, ValueError) as error:  # ValueError: an encoding that text cannot declare
        raise RobotModelError(f"{name}: not XML ({error}); expected a URDF <robot>") from error


def joints_of(name: str, root: ET.Element) -> list[TreeJoint]:
    """The joints of a URDF's root element, in its order; `name` is what messages call the robot.

    Raises:
        RobotModelError: no URDF, or joints that are not what URDF says.
    """
    elements = root.findall("joint")
    if root.tag != "robot" or not elements:
        raise RobotModelError(f"{name}: found <{root.tag}> without joints; expected a URDF <robot> with <joint>s")
    joints = [_joint(name, element) for element in elements]
    names = [joint.name for joint in joints]
    twice = next((called for called in names if names.count(called) > 1), None)
    if twice is not None:
        raise RobotModelError(f"{name}: two joints are called {twice!r}")
    return joints


def parts_of(name: str, root: ET.Element, folder: Path | None) -> dict[str, tuple[Geometry, ...]]:
    """The collision geometry of each link of a URDF's root element; meshes are looked up from a folder.

    What is wrong with one is told when it is asked for: an arm moves without.
    """
    found = {}
    for link in root.findall("link"):
        where = f"{name}: link {link.get('name')!r}"
        found[link.get("name", "")] = tuple(_part(where, element, folder) for element in link.findall("collision"))
    return found


def _part(where: str, element: ET.Element, folder: Path | None) -> Geometry:
    pose = np.eye(4)
    try:
        pose[:3, :3] = rotation(_numbers(where, element.find("origin"), "rpy", "0 0 0"))
        pose[:3, 3] = _numbers(where, element.find("origin"), "xyz", "0 0 0")
        shape = next(iter(element.find("geometry") or ()), None)
        kind = "" if shape is None else shape.tag
        if kind == "box":
            return Geometry(kind, tuple(_numbers(where, shape, "size", "")), pose)
        if kind == "sphere":
            return Geometry(kind, tuple(_numbers(where, shape, "radius", "", 1)), pose)
        if kind in ("cylinder", "capsule"):
            size = (_numbers(where, shape, key, "", 1)[0] for key in ("radius", "length"))
            return Geometry(kind, tuple(size), pose)
        if kind == "mesh" and shape is not None:
            scale = _numbers(where, shape, "scale", "1 1 1")
            return Geometry(kind, tuple(scale), pose, _mesh_file(shape.get("filename", ""), folder))
    except RobotModelError as error:
        return Geometry("unreadable", (), pose, str(error))
    return Geometry(
        "unreadable", (), pose, f"{where}: <geometry> with {kind!r}; expected a box, sphere, cylinder or mesh"
    )


def _mesh_file(uri: str, folder: Path | None) -> str:
    """Where the mesh of a URI is: of a package, in the first folder above the description that has it."""
    path = uri.partition("://")[2] or uri
    folders = () if folder is None else (folder, *folder.parents)
    for place in folders:
        for inside in (path, path.partition("/")[2]):  # the package's folder itself may be called otherwise
            if inside and (place / inside).is_file():
                return str(place / inside)
    return path


def rotation(rpy: Sequence[float]) -> Array:
    """(3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll) of the angles (roll, pitch, yaw) [rad]."""
    (a, b, c), (x, y, z) = map(cos, rpy), map(sin, rpy)
    return np.array(
        (
            (b * c, x * y * c - a * z, a * y * c + x * z),
            (b * z, x * y * z + a * c, a * y * z - x * c),
            (-y, x * b, a * b),
        )
    )


def open_limit(value: float) -> float:
    """A limit, infinite where it is so large that it stands for none."""
    return value if abs(value) < UNLIMITED else inf if value > 0.0 else -inf


class _Tree(ET.TreeBuilder):
    """Elements of a document without a document type, in which entities would be declared."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name

    def doctype(self, *_: Any) -> None:
        """Refuse it."""
        raise RobotModelError(f"{self._name}: a <!DOCTYPE>, which may declare entities; take it out of the file")


def _joint(name: str, element: ET.Element) -> TreeJoint:
    called, kind = element.get("name", ""), element.get("type", "")
    where = f"{name}: joint {called!r}"
    if kind not in TYPES:
        raise RobotModelError(f"{where}: type {kind!r}; expected one of {', '.join(TYPES)}")
    parent, child = (getattr(element.find(tag), "attrib", {}).get("link", "") for tag in ("parent", "child"))
    if not (called and parent and child):
        raise RobotModelError(f"{where}: expected a name, and <parent> and <child> with a link each")
    origin = np.eye(4)
    origin[:3, :3] = rotation(_numbers(where, element.find("origin"), "rpy", "0 0 0"))
    origin[:3, 3] = _numbers(where, element.find("origin"), "xyz", "0 0 0")
    axis = np.array(_numbers(where, element.find("axis"), "xyz", "1 0 0"))
    length = hypot(*axis.tolist())
    if kind in MOVING and length == 0.0:
        raise RobotModelError(f"{where}: an axis of length 0; expected a direction")
    mimic = element.find("mimic")
    follows = "" if mimic is None else mimic.get("joint", "")
    limits = _limits(where, kind, element)
    return TreeJoint(called, kind, parent, child, origin, axis / (length or 1.0), *limits, follows)


def _limits(where: str, kind: str, element: ET.Element) -> tuple[float, float, float]:
    """Position limits and the velocity limit; what is left out is 0 for positions, as in URDF, and no speed limit."""
    limit = element.find("limit")
    if kind not in MOVING:
        return -inf, inf, inf
    if limit is None and kind != "continuous":
        raise RobotModelError(f'{where}: a {kind} joint without <limit>; one without limits is type="continuous"')
    lower, upper, speed = (_numbers(where, limit, key, "0", 1)[0] for key in ("lower", "upper", "velocity"))
    if kind == "continuous":
        lower, upper = -inf, inf
    if lower > upper:
        raise RobotModelError(f"{where}: lower limit {lower:g} above the upper one, {upper:g}")
    return open_limit(lower), open_limit(upper), open_limit(speed) if speed > 0.0 else inf


def _numbers(where: str, element: ET.Element | None, key: str, default: str, count: int = 3) -> list[float]:
    text = default if element is None else element.get(key, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(isfinite, numbers)):
        hint = " Run xacro on the file first." if "$" in text else ""
        raise RobotModelError(f"{where}: {key}={text!r}; expected {count} finite number{'s'[: count - 1]}.{hint}")
    return numbers
