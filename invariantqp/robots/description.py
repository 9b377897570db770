"""Reading the XML of a robot's description, and messages for files that are not one.

Undeclared namespace prefixes are accepted: Drake and CAD exporters use them. A document type is refused, since it may
declare entities.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.parsers import expat

from invariantqp.errors import RobotModelError

# Characters allowed before the first "<".
BLANK = "\ufeff \t\r\n"
# The $(...) and ${...} of xacro.
XACRO = re.compile(r"\$[({]")
# Root elements of other kinds of files, and what these are.
OTHER_ROOTS = {
    "sdf": "a world or model of Gazebo (SDF); expected a URDF or MJCF",
    "world": "a world; expected the URDF or MJCF of a robot",
    "package": "the manifest of a ROS package; expected the path of a URDF in it",
    "launch": "a launch file of ROS; expected the URDF that it loads",
    "COLLADA": "a mesh; expected the URDF or MJCF that uses it",
}


def is_text(source: str) -> bool:
    """Whether a source is XML text rather than a name or a path."""
    return source.lstrip(BLANK).startswith("<")


def read_xml(source: Path | str) -> tuple[str, ET.Element]:
    """The name of a description for messages, and its root element; `source` is a path or the text.

    Raises:
        RobotModelError: not XML, or XML with a document type.
    """
    name = str(source) if isinstance(source, Path) else "the URDF text"
    builder = ET.TreeBuilder()
    parser = expat.ParserCreate(None if isinstance(source, Path) else "utf-8")

    def doctype(*_: object) -> None:
        raise RobotModelError(f"{name}: a <!DOCTYPE>, which may declare entities; take it out of the file")

    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = builder.data, doctype
    try:
        parser.Parse(source.read_bytes() if isinstance(source, Path) else source.lstrip(BLANK).encode(), True)
        return name, builder.close()
    except OSError as error:
        raise RobotModelError(f"{name}: cannot be read ({error.strerror or error})") from error
    except (expat.ExpatError, AssertionError, ValueError) as error:
        raise RobotModelError(f"{name}: not XML ({error}); expected a URDF <robot>") from error


def require_robot(name: str, root: ET.Element) -> None:
    """Raise where a root element is neither a URDF with joints nor a whole MJCF.

    Raises:
        RobotModelError: a xacro file, a part of an MJCF, a single body, another kind of file.
    """
    if root.tag == "robot":
        if is_xacro(root):
            file = "FILE" if name == "the URDF text" else Path(name).name
            made = Path(file).name.split(".")[0] + ".urdf"
            command = f"Expand it first: xacro {file} > {made} (pip install xacro, or ROS), and load {made}"
            raise RobotModelError(f"{name}: a xacro file, which is made into a URDF. {command}")
        if root.find("joint") is None:
            raise RobotModelError(f"{name}: found <robot> without joints, a single body; expected a URDF of an arm")
    elif root.tag == "mujocoinclude" or (
        root.tag == "mujoco" and not any(part.tag in ("worldbody", "include") for part in root.iter())
    ):
        raise RobotModelError(
            f"{name}: a part of an MJCF, found <{root.tag}> without <worldbody>. {files_that_include(name)}"
        )
    elif root.tag != "mujoco":
        what = OTHER_ROOTS.get(root.tag, "which is no robot; expected the <robot> of a URDF or the <mujoco> of an MJCF")
        raise RobotModelError(f"{name}: found <{root.tag}>, {what}")


def is_xacro(root: ET.Element) -> bool:
    """Whether a <robot> still contains xacro macros."""
    if any(child.tag.startswith("xacro:") for child in root):
        return True
    elements = (element for child in root if child.tag in ("joint", "link") for element in child.iter())
    return any(XACRO.search(value) for element in elements for value in element.attrib.values())


def files_that_include(name: str) -> str:
    """Advice that names the files, in the folder of an MJCF or the one above, that include it."""
    file = Path(name)
    including = []
    if file.is_file():
        for folder in (file.parent, file.parent.parent):
            including += [
                other.name for other in sorted(folder.glob("*.xml")) if other != file and _includes(other, file)
            ]
    return (
        f"Load a file that includes it: {', '.join(including[:3])}" if including else "Load the file that includes it"
    )


def _includes(other: Path, file: Path) -> bool:
    try:
        return (
            re.search(rf"<include[^>]*[\"'/]{re.escape(file.name)}[\"']", other.read_text(errors="replace")) is not None
        )
    except OSError:
        return False
