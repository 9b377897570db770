"""URDF, from a file or from text, as the XML that Pinocchio is given.

URDF's "continuous" joints become revolute ones with a range that no angle in use reaches: Pinocchio would describe each
by two numbers instead of one.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from invariantqp.errors import RobotModelError

# The range of a joint without limits [rad]; a limit as large as this is read as none.
UNLIMITED = 1e9
# What may stand before the "<" of a text.
BLANK = "\ufeff \t\r\n"


def is_text(source: str) -> bool:
    """Whether this is XML rather than a name or a path."""
    return source.lstrip(BLANK).startswith("<")


def read_urdf(source: Path | str) -> tuple[str, str]:
    """What to call a robot in messages, and its XML.

    Args:
        source: the path of a URDF file, or its text.

    Raises:
        RobotModelError: a file that cannot be read, or no URDF in it.
    """
    name = str(source) if isinstance(source, Path) else "the URDF text"
    try:
        root = ET.parse(source).getroot() if isinstance(source, Path) else ET.fromstring(source.lstrip(BLANK))  # noqa: S314 (robot descriptions are the user's own)
    except OSError as error:
        raise RobotModelError(f"{name}: cannot be read ({error.strerror or error})") from error
    except ET.ParseError as error:
        raise RobotModelError(f"{name}: not XML ({error}); expected a URDF <robot>") from error
    if root.tag == "mujoco":
        raise RobotModelError(
            f"{name}: found a MuJoCo model (MJCF); expected a URDF <robot>. Give its URDF if there is one, or try "
            "load_robot(pinocchio.buildModelFromMJCF(path), tool=...)."
        )
    if root.tag != "robot" or root.find("joint") is None:
        raise RobotModelError(f"{name}: found <{root.tag}> without joints; expected a URDF <robot> with <joint>s")
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            _bound(joint)
    return name, ET.tostring(root, encoding="unicode")


def _bound(joint: ET.Element) -> None:
    """Make a continuous joint a revolute one without limits."""
    joint.set("type", "revolute")
    limit = joint.find("limit")
    limit = ET.SubElement(joint, "limit", effort="0", velocity="0") if limit is None else limit
    limit.set("lower", str(-UNLIMITED))
    limit.set("upper", str(UNLIMITED))
