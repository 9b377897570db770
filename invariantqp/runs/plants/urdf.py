"""A URDF reduced to the chain from its root to a tool, without meshes and branches. Joints that do not move are fixed.

For other readers of URDF than Pinocchio, which reduces models itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from invariantqp.errors import RobotModelError


def chain_xml(path: Path, tool: str, moving: Sequence[str]) -> str:
    """The URDF text of the chain to a tool link, in which the named joints move.

    Raises:
        RobotModelError: the tool is not a link of the file.
    """
    root = ET.parse(path).getroot()  # noqa: S314 (robot descriptions are the user's own files)
    links = {link.get("name", ""): link for link in root.iter("link")}
    if tool not in links:
        raise RobotModelError(f"{path.name}: no link {tool!r}; name a link as the tool")
    above = {_of(joint, "child"): joint for joint in root.iter("joint") if joint.find("child") is not None}
    chain = [links[tool]]
    name = tool
    while name in above:
        joint = above[name]
        name = _of(joint, "parent")
        chain[:0] = [links[name], joint]
        if joint.get("name") not in moving:
            _hold(joint)
    for link in chain:
        for mesh in (*link.findall("visual"), *link.findall("collision")):
            link.remove(mesh)
    cut = ET.Element("robot", name=root.get("name", "robot"))
    cut.extend(chain)
    # MuJoCo's own section: every link stays a body, and inertias that CAD has rounded are corrected.
    compiler = {"fusestatic": "false", "balanceinertia": "true", "discardvisual": "false"}
    ET.SubElement(ET.SubElement(cut, "mujoco"), "compiler", compiler)
    return ET.tostring(cut, encoding="unicode")


def _of(joint: ET.Element, tag: str) -> str:
    found = joint.find(tag)
    return "" if found is None else found.get("link", "")


def _hold(joint: ET.Element) -> None:
    """Fix a joint at zero, or at the limit nearest to it."""
    limit, axis, origin = joint.find("limit"), joint.find("axis"), joint.find("origin")
    low, high = (0.0, 0.0) if limit is None else (float(limit.get(k, 0.0)) for k in ("lower", "upper"))
    rest = 0.0 if joint.get("type") in ("fixed", "continuous") else min(max(0.0, low), high)
    if rest != 0.0:
        along = np.array([1.0, 0.0, 0.0]) if axis is None else _numbers(axis.get("xyz", "1 0 0"))
        origin = ET.SubElement(joint, "origin") if origin is None else origin
        R, p = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"))), _numbers(origin.get("xyz", "0 0 0"))
        if joint.get("type") == "prismatic":
            p = p + R.apply(rest * along)
        else:
            R = R * Rotation.from_rotvec(rest * along)
        origin.set("xyz", " ".join(map(repr, p.tolist())))
        origin.set("rpy", " ".join(map(repr, R.as_euler("xyz").tolist())))
    joint.set("type", "fixed")


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])
