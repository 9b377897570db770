"""Reading URDF and SRDF: joints, collision and visual geometry, exclusions; joints of a `yourdfpy.URDF`.

An origin is T = (Rz(yaw) Ry(pitch) Rx(roll), xyz); an axis is normalised.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, hypot, inf, isfinite, sin
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np

from invariantqp.errors import RobotModelError
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain, Geometry
from invariantqp.robots.description import read_xml, require_robot
from invariantqp.robots.kinematics import UNLIMITED
from invariantqp.robots.tree import (
    JOINT_TYPES,
    SINGLE_AXIS_TYPES,
    Exclusions,
    Mimic,
    TreeJoint,
    displacement,
    path_to,
    rest_position,
)


def joints_of(name: str, root: ET.Element) -> list[TreeJoint]:
    """The joints of a URDF's root element, in its order; `name` is the robot's in messages."""
    require_robot(name, root)
    if root.tag != "robot":
        raise RobotModelError(f"{name}: found <{root.tag}>; expected a URDF <robot> with <joint>s")
    joints = [_joint(name, element) for element in root.findall("joint")]
    names = [joint.name for joint in joints]
    twice = next((called for called in names if names.count(called) > 1), None)
    if twice is not None:
        raise RobotModelError(f"{name}: two joints are called {twice!r}")
    links = {element.get("name") for element in root.findall("link")}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise RobotModelError(f"{name}: joint {joint.name!r}: no <link> is called {link!r}")
    return joints


def collision_geometry(name: str, root: ET.Element, folder: Path | None) -> dict[str, tuple[Geometry, ...]]:
    """The collision geometry of each link of a URDF's root element; mesh files are searched from a folder.

    Geometry with an error is "unreadable", which is an error only where shapes are needed.
    """
    return {
        link.get("name", ""): tuple(_geometry(name, link, element, folder) for element in link.findall("collision"))
        for link in root.findall("link")
    }


class Visual(NamedTuple):
    """A visual geometry of a link."""

    link: str
    part: Geometry
    colour: tuple[float, ...] | None  # red, green, blue, opacity, 0 ... 1; None where the URDF names none


def visual_geometry(name: str, root: ET.Element, folder: Path | None) -> list[Visual]:
    """The visual geometry of a URDF's root element; errors as in `collision_geometry`."""
    colours = {material.get("name"): _colour(material) for material in root.findall("material")}
    visuals = []
    for link in root.findall("link"):
        for element in link.findall("visual"):
            material = element.find("material")
            own = None if material is None else _colour(material) or colours.get(material.get("name"))
            visuals.append(Visual(link.get("name", ""), _geometry(name, link, element, folder), own))
    return visuals


def _colour(material: ET.Element) -> tuple[float, ...] | None:
    """The colour of a material, within 0 ... 1; None where there is none that can be read."""
    colour = material.find("color")
    try:
        rgba = [] if colour is None else [float(word) for word in colour.get("rgba", "1 1 1 1").split()]
    except ValueError:
        return None
    return tuple(min(max(x, 0.0), 1.0) for x in rgba) if len(rgba) == 4 else None


# Attributes with the size of each geometry, and how many numbers each has.
SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}


def _geometry(name: str, link: ET.Element, element: ET.Element, folder: Path | None) -> Geometry:
    where = f"{name}: link {link.get('name')!r}"
    shape = next(iter(element.find("geometry") or ()), None)
    kind = "" if shape is None else shape.tag
    if shape is None or kind not in SIZES:
        why = f"{where}: <geometry> with {kind!r}; expected a box, sphere, cylinder or mesh"
        return Geometry("unreadable", (), np.eye(4), why)
    left_out = "1 1 1" if kind == "mesh" else ""
    try:
        size = [x for key, count in SIZES[kind].items() for x in _numbers(where, shape, key, left_out, count)]
        file = _mesh_file(shape.get("filename", ""), folder) if kind == "mesh" else None
        return Geometry(kind, tuple(size), _origin(where, element), file)
    except RobotModelError as error:
        return Geometry("unreadable", (), np.eye(4), str(error))


def _origin(where: str, element: ET.Element) -> Array:
    """(4, 4) of an element's <origin>."""
    pose, origin = np.eye(4), element.find("origin")
    pose[:3, :3] = rotation(_numbers(where, origin, "rpy", "0 0 0"))
    pose[:3, 3] = _numbers(where, origin, "xyz", "0 0 0")
    return pose


def _mesh_file(uri: str, folder: Path | None) -> str:
    """The mesh file of a URI; of a package:// URI, in the first folder above the description that contains it."""
    path = uri.partition("://")[2] or uri
    folders = () if folder is None else (folder, *folder.parents)
    for place in folders:
        for inside in (path, path.partition("/")[2]):  # the package's folder itself may be called otherwise
            if inside and (place / inside).is_file():
                return str(place / inside)
    return path if folder is None else str(folder / path)


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


def infinite_if_large(value: float) -> float:
    """A limit, infinite where it is so large that it means none."""
    return value if abs(value) < UNLIMITED else inf if value > 0.0 else -inf


def _joint(name: str, element: ET.Element) -> TreeJoint:
    called, kind = element.get("name", ""), element.get("type", "")
    where = f"{name}: joint {called!r}"
    if kind not in JOINT_TYPES:
        raise RobotModelError(f"{where}: type {kind!r}; expected one of {', '.join(JOINT_TYPES)}")
    parent, child = (getattr(element.find(tag), "attrib", {}).get("link", "") for tag in ("parent", "child"))
    if not (called and parent and child):
        raise RobotModelError(f"{where}: expected a name, and <parent> and <child> with a link each")
    origin = _origin(where, element)
    axis = np.array(_numbers(where, element.find("axis"), "xyz", "1 0 0"))
    length = hypot(*axis.tolist())
    if kind in SINGLE_AXIS_TYPES and length == 0.0:
        raise RobotModelError(f"{where}: an axis of length 0; expected a direction")
    mimic = element.find("mimic")
    limits = _limits(where, kind, element)
    follows = None
    if mimic is not None:
        ratio, offset = (
            _numbers(where, mimic, key, usual, 1)[0] for key, usual in (("multiplier", "1"), ("offset", "0"))
        )
        follows = Mimic(mimic.get("joint", ""), ratio, offset)
    return TreeJoint(called, kind, parent, child, origin, axis / (length or 1.0), *limits, follows)


def _limits(where: str, kind: str, element: ET.Element) -> tuple[float, float, float]:
    """Lower, upper and velocity limit; missing position limits are 0, as in URDF, a missing velocity limit is inf."""
    limit = element.find("limit")
    if kind not in SINGLE_AXIS_TYPES:
        return -inf, inf, inf
    if limit is None and kind != "continuous":
        raise RobotModelError(f'{where}: a {kind} joint without <limit>; one without limits is type="continuous"')
    lower, upper, speed = (_numbers(where, limit, key, "0", 1)[0] for key in ("lower", "upper", "velocity"))
    if kind == "continuous":
        lower, upper = -inf, inf
    if lower > upper:
        raise RobotModelError(f"{where}: lower limit {lower:g} above the upper one, {upper:g}")
    return infinite_if_large(lower), infinite_if_large(upper), infinite_if_large(speed) if speed > 0.0 else inf


def _numbers(where: str, element: ET.Element | None, key: str, default: str, count: int = 3) -> list[float]:
    text = default if element is None else element.get(key, default)
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(isfinite, numbers)):
        raise RobotModelError(f"{where}: {key}={text!r}; expected {count} finite number{'s'[: count - 1]}.")
    return numbers


def joint_of_yourdfpy(joint: Any) -> TreeJoint:
    """A joint of a `yourdfpy.URDF`."""
    origin = np.eye(4) if joint.origin is None else np.array(joint.origin, np.float64)
    axis = np.array((1.0, 0.0, 0.0) if joint.axis is None else joint.axis, np.float64)
    limit = None if joint.type == "continuous" else joint.limit
    # As in a URDF, positions that are left out are 0.
    lower, upper = (-inf, inf) if limit is None else (infinite_if_large(x or 0.0) for x in (limit.lower, limit.upper))
    speed = (joint.limit and joint.limit.velocity) or inf
    length = float(np.linalg.norm(axis)) or 1.0
    mimic = joint.mimic
    follows = None if mimic is None else Mimic(mimic.joint, mimic.multiplier or 1.0, mimic.offset or 0.0)
    return TreeJoint(
        joint.name, joint.type, joint.parent, joint.child, origin, axis / length, lower, upper, speed, follows
    )


def chain_xml(path: Path, tool: str, moving: Sequence[str]) -> str:
    """The URDF text of the chain to a tool link, without meshes and branches; joints not in `moving` are fixed."""
    name, root = read_xml(path)
    links = {link.get("name", ""): link for link in root.findall("link")}
    if tool not in links:
        raise RobotModelError(f"{path.name}: no link {tool!r}; name a link as the tool")
    elements = {element.get("name"): element for element in root.findall("joint")}
    chain = path_to({joint.child: joint for joint in joints_of(name, root)}, tool, name)
    cut = ET.Element("robot", name=root.get("name", "robot"))
    cut.append(links[chain[0].parent if chain else tool])
    for joint in chain:
        if joint.name not in moving:
            _fix(elements[joint.name], joint)
        cut.extend((elements[joint.name], links[joint.child]))
    for link in cut.findall("link"):
        for mesh in (*link.findall("visual"), *link.findall("collision")):
            link.remove(mesh)
    # MuJoCo's own section: every link stays a body, and inertias that CAD has rounded are corrected.
    compiler = {"fusestatic": "false", "balanceinertia": "true", "discardvisual": "false"}
    ET.SubElement(ET.SubElement(cut, "mujoco"), "compiler", compiler)
    return ET.tostring(cut, encoding="unicode")


def _fix(element: ET.Element, joint: TreeJoint) -> None:
    """Fix a joint at its rest position."""
    from scipy.spatial.transform import Rotation  # slow to import

    if joint.kind in SINGLE_AXIS_TYPES and rest_position(joint):
        place = joint.origin.dot(displacement(joint, rest_position(joint)))
        origin = element.find("origin")
        origin = ET.SubElement(element, "origin") if origin is None else origin
        origin.set("xyz", " ".join(map(repr, place[:3, 3].tolist())))
        origin.set("rpy", " ".join(map(repr, Rotation.from_matrix(place[:3, :3]).as_euler("xyz").tolist())))
    element.set("type", "fixed")


def excluded_pairs(robot: Chain, file: str | PathLike[str] | None = None) -> Exclusions:
    """Pairs of links that a robot's own description and an SRDF file exclude from collision, with the reason."""
    own = {frozenset((link.name, other)): reason for link in robot.links for other, reason in link.excludes}
    return own if file is None else {**own, **srdf_exclusions(Path(file))}


def srdf_exclusions(file: Path) -> Exclusions:
    """The pairs of an SRDF file: <disable_collisions link1="hand" link2="finger" reason="Adjacent"/>."""
    name, root = read_xml(file)
    if root.tag != "robot":
        raise RobotModelError(f"{name}: found <{root.tag}>; expected the <robot> of an SRDF")
    return {
        frozenset((pair.get("link1", ""), pair.get("link2", ""))): ": ".join(
            filter(None, ("by the SRDF", pair.get("reason")))
        )
        for pair in root.findall("disable_collisions")
    }
