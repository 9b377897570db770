"""`new_task`: the text of a task file with every key explained, for a robot at a well-conditioned start."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from textwrap import wrap
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.robots.load import load_robot
from invariantqp.workbench.analysis.survey import spread, survey
from invariantqp.workbench.runs.contactspec import SIZE_COUNT
from invariantqp.workbench.runs.path import Path
from invariantqp.workbench.runs.section import models_in, toml
from invariantqp.workbench.runs.taskfile import Task, task_from

# States that are compared for a start.
START_CANDIDATES = 64
# Keys that each kind of path needs to move [m, rad].
PATH_EXAMPLES: dict[str, dict[str, Any]] = {
    "line": {"move": [0.0, 0.0, -0.05]},
    "circle": {"centre": [0.0, 0.03, 0.0]},
    "screw": {"axis": [0.0, 0.0, 1.0], "point": [-0.1, 0.0, 0.0], "angle": 0.3},
    "joints": {},
    "hold": {"move": [0.0, 0.0, -0.01]},
    "poses": {"poses": [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.2, 0.0, 0.0, -0.02]]},
}
# The column of the comment on a key, and the longest line.
COMMENT_COLUMN, WIDTH = 42, 120
PATHS = {get_args(path.model_fields["kind"].annotation)[0]: path for path in get_args(get_args(Path)[0])}


def new_task(name: str, robot: str, *, path: str = "line", contact: str | None = None) -> str:
    """The text of a task file, with every key of its tables explained.

    Args:
        name: of the task.
        robot: a known name, or the path of a URDF or MJCF; it starts in the best-conditioned of a few states around the
            middle of its range.
        path: kind of path: "line", "circle", "screw", "joints", "hold" or "poses".
        contact: kind of contact: "point", "edge", "face" or "hinge"; None is no contact.
    """
    for argument, text in (("name", name), ("robot", robot)):
        if not isinstance(text, str) or not text:
            raise BadInput(argument, excerpt(text), "a name")
    arrays.choice(path, "path", list(PATHS))
    if contact is not None:
        arrays.choice(contact, "contact", list(SIZE_COUNT))
    arm = load_robot(robot)
    m = len(arm.names)
    at = [round(x, 2) for x in well_conditioned_start(arm).tolist()]
    waypoint = [x + (0.1 if x + 0.1 <= high else -0.1) for x, high in zip(at, arm.position_upper, strict=True)]
    move = {"waypoints": [[round(x, 4) for x in waypoint]]} if path == "joints" else PATH_EXAMPLES[path]
    law: dict[str, Any] = {"dt": 0.002}
    if m < 6:
        law["exact"] = "position"
    content: dict[str, Any] = {
        "name": name,
        "about": f"{robot}: {path}{f', {contact} contact with 5 N' if contact else ''}",
        "robot": {"source": robot, "start": at},
        "path": {"kind": path, "duration": 2.0, **move},
        "law": law,
    }
    if contact is not None:
        shape: dict[str, Any] = {"size": [0.08, 0.05][: SIZE_COUNT[contact]]} if SIZE_COUNT[contact] else {}
        if contact == "hinge":
            shape["point"] = PATH_EXAMPLES["screw"]["point"]  # a screw path turns about it
        content |= {"contact": {"kind": contact, **shape}, "force": {"press": 5.0}, "sensor": {}}
    if path != "hold":
        content["accept"] = {"position_error_mm": 1.0}  # above what a run at these speeds leaves
    task_from(content, f"the task {name!r}")
    return toml_template(content)


def well_conditioned_start(robot: Robot) -> Array:
    """(m,) the joint positions farthest from a singularity, of some in the middle half of their ranges."""
    states = 0.5 * (middle(robot) + spread(robot, START_CANDIDATES))
    return np.asarray(states[survey(robot, states).distance.argmax()])


def _tables(of: type[BaseModel], above: str = "") -> Iterator[tuple[type[BaseModel], str]]:
    for name, field in of.model_fields.items():
        for section in models_in(field.annotation):
            yield section, f"{above}{name}"
            yield from _tables(section, f"{above}{name}.")


# The tables of a task file and their headers; each kind of path has one.
TABLES: dict[type[BaseModel], str] = {}
for _section, _header in _tables(Task):
    TABLES.setdefault(_section, _header)  # [accept_mujoco] is as [accept]


def toml_template(content: Mapping[str, Any]) -> str:
    """A task file as TOML from the given keys; the other keys of each given table are comments."""
    lines = [*_keys({name: Task.model_fields[name] for name in ("name", "about")}, content)]
    for section, header in TABLES.items():
        given = content.get(header)
        if given is None or (header == "path" and section is not PATHS[given["kind"]]):
            continue
        fields = {name: field for name, field in section.model_fields.items() if name != "screws"}
        lines += ["", f"# {section_description(section)}", f"[{header}]", *_keys(fields, given)]
    others = dict.fromkeys(f"[{header}]" for header in TABLES.values() if header not in {*content, "robot.screws"})
    return "\n".join([*lines, "", f"# Further tables: {', '.join(others)}; [accept_mujoco] is as [accept].", ""])


def _keys(fields: Mapping[str, FieldInfo], given: Mapping[str, Any]) -> Iterator[str]:
    """Lines for each key, given ones first, with the meaning as a comment at the end or, if too long, above."""
    for name, field in sorted(fields.items(), key=lambda item: item[0] not in given):
        value = given[name] if name in given else key_default(field)
        if value is None:
            value = (field.examples or [""])[0]
        line = f"{'' if name in given else '# '}{name} = {toml(value)}"
        with_comment = f"{line:<{COMMENT_COLUMN}}  # {field.description}" if field.description else line
        if len(with_comment) <= WIDTH:
            yield with_comment
        else:
            yield from wrap(f"{name}: {field.description}", WIDTH, initial_indent="# ", subsequent_indent="#   ")
            yield line


def key_default(field: FieldInfo) -> Any:
    """The default of a key, None where it has none."""
    return None if field.is_required() else field.get_default(call_default_factory=True)


def section_description(section: type[BaseModel]) -> str:
    """The first paragraph of a section's docstring, in one line."""
    return " ".join((section.__doc__ or "").split("\n\n")[0].split())
