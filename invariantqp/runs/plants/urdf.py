"""A URDF reduced to the chain from its root to a tool, without meshes and branches. Joints that do not move are fixed.

For other readers of URDF than Pinocchio, which reduces models itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from scipy.spatial.transform import Rotation

from invariantqp.errors import RobotModelError
from invariantqp.robots.tree import displacement, path_to, rest
from invariantqp.robots.urdf import MOVING, TreeJoint, joints_of, read_xml


def chain_xml(path: Path, tool: str, moving: Sequence[str]) -> str:
    """The URDF text of the chain to a tool link, in which the named joints move.

    Raises:
        RobotModelError: the tool is not a link of the file.
    """
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
            _hold(elements[joint.name], joint)
        cut.extend((elements[joint.name], links[joint.child]))
    for link in cut.findall("link"):
        for mesh in (*link.findall("visual"), *link.findall("collision")):
            link.remove(mesh)
    # MuJoCo's own section: every link stays a body, and inertias that CAD has rounded are corrected.
    compiler = {"fusestatic": "false", "balanceinertia": "true", "discardvisual": "false"}
    ET.SubElement(ET.SubElement(cut, "mujoco"), "compiler", compiler)
    return ET.tostring(cut, encoding="unicode")


def _hold(element: ET.Element, joint: TreeJoint) -> None:
    """Fix a joint where a held one stands."""
    if joint.kind in MOVING and rest(joint):
        place = joint.origin.dot(displacement(joint, rest(joint)))
        found = element.find("origin")
        origin = ET.SubElement(element, "origin") if found is None else found
        origin.set("xyz", " ".join(map(repr, place[:3, 3].tolist())))
        origin.set("rpy", " ".join(map(repr, Rotation.from_matrix(place[:3, :3]).as_euler("xyz").tolist())))
    element.set("type", "fixed")
