"""An arm by whatever may name one on a command line: a known robot, a URDF file, a shipped task, or a task file."""

from __future__ import annotations

import difflib
from pathlib import Path

from invariantqp.errors import BadInput, UnknownName
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import KNOWN, load_robot
from invariantqp.runs.taskfile import load_task, shipped_tasks


def arm(source: str | Path, tool: str | None = None) -> Robot:
    """The robot of a name, a URDF file, a task's name or a task file.

    Raises:
        UnknownName: none of these; similar names are listed.
        BadInput, TaskFileError, RobotModelError, MissingExtra: as `load_task` and `load_robot`.
    """
    if tool == "":
        raise BadInput("tool", "an empty name", "the name of a frame")
    name, known = str(source), shipped_tasks()
    if name in known or Path(source).suffix.lower() == ".toml":
        return load_task(source).load_robot(tool)
    if name in KNOWN or Path(source).suffix.lower() == ".urdf" or _is_file(source):
        return load_robot(source, tool)
    names = [*KNOWN, *known]
    near = difflib.get_close_matches(name.lower(), names)
    raise UnknownName("robot", name, near, [*names, "or the path of a .urdf or .toml file"])


def _is_file(source: str | Path) -> bool:
    try:
        return Path(source).is_file()
    except OSError:  # a name that no file can have
        return False
