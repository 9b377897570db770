"""An arm from whatever names one on a command line: a known robot, a URDF, a task of the library or a task file."""

from __future__ import annotations

import difflib
from pathlib import Path

from invariantqp.errors import UnknownName
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import KNOWN, load_robot
from invariantqp.runs.taskfile import load_task, shipped_tasks


def arm(source: str | Path, tool: str | None = None) -> Robot:
    """The robot of a name, a URDF file, a task's name or a task file.

    Raises:
        UnknownName: none of these; near ones are listed.
        BadInput, TaskFileError, RobotModelError, MissingExtra: as `load_task` and `load_robot`.
    """
    known = shipped_tasks()
    if str(source) in known or Path(source).suffix.lower() == ".toml":
        return load_task(source).load_robot(tool)
    try:
        return load_robot(source, tool)
    except UnknownName as error:
        if error.kind != "robot":
            raise
        names = [*KNOWN, *known]
        near = difflib.get_close_matches(str(source).lower(), names)
        raise UnknownName("robot", str(source), near, [*names, "or the path of a .urdf or .toml file"]) from error
