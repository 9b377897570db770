"""A task file to change, from the tables themselves: given keys with their meaning, the others as comments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from textwrap import wrap
from typing import Any, NamedTuple, get_args

from pydantic.fields import FieldInfo

from invariantqp.runs.clearancespec import BodySpec, ClearanceSpec, ObstacleSpec
from invariantqp.runs.contactspec import ContactSpec, ForceSpec, OperatorSpec, SensorSpec
from invariantqp.runs.path import Path
from invariantqp.runs.physics import Physics
from invariantqp.runs.problems import toml
from invariantqp.runs.robotspec import RobotSpec, Screw
from invariantqp.runs.section import Section
from invariantqp.runs.taskfile import Acceptance, LawSpec, Task

# Where the meaning of a key begins, and the last column of a line.
COLUMN, WIDTH = 42, 120


class TaskTable(NamedTuple):
    """A table of a task file: how it is headed, which of several kinds it is ("" for the only one), and its keys."""

    header: str
    kind: str
    section: type[Section]


PATHS = {get_args(path.model_fields["kind"].annotation)[0]: path for path in get_args(get_args(Path)[0])}
TABLES = (
    TaskTable("robot", "", RobotSpec),
    TaskTable("robot.screws", "", Screw),
    *(TaskTable("path", kind, path) for kind, path in PATHS.items()),
    TaskTable("law", "", LawSpec),
    TaskTable("accept", "", Acceptance),
    TaskTable("contact", "", ContactSpec),
    TaskTable("force", "", ForceSpec),
    TaskTable("sensor", "", SensorSpec),
    TaskTable("operator", "", OperatorSpec),
    TaskTable("obstacle", "", ObstacleSpec),
    TaskTable("clearance", "", ClearanceSpec),
    TaskTable("clearance.body", "", BodySpec),
    TaskTable("physics", "", Physics),
)


def draft(content: Mapping[str, Any]) -> str:
    """A task file with comments, as TOML, from the keys that are given.

    Each table that is given is there with all of its keys, those that are not given as comments.
    """
    lines = [*_keys({name: Task.model_fields[name] for name in ("name", "about")}, content)]
    for header, kind, section in TABLES:
        given = content.get(header)
        if given is None or (kind and given["kind"] != kind):
            continue
        fields = {name: field for name, field in section.model_fields.items() if name != "screws"}
        lines += ["", f"# {meaning(section)}", f"[{header}]", *_keys(fields, given)]
    others = dict.fromkeys(f"[{table.header}]" for table in TABLES if table.header not in {*content, "robot.screws"})
    return "\n".join([*lines, "", f"# Further tables: {', '.join(others)}; [accept_mujoco] is as [accept].", ""])


def _keys(fields: Mapping[str, FieldInfo], given: Mapping[str, Any]) -> Iterator[str]:
    """A line for each key, given ones first; what a key means is beside it, or above where that is too long."""
    for name, field in sorted(fields.items(), key=lambda item: item[0] not in given):
        value = given[name] if name in given else default_of(field)
        if value is None:
            value = (field.examples or [""])[0]
        line = f"{'' if name in given else '# '}{name} = {toml(value)}"
        beside = f"{line:<{COLUMN}}  # {field.description}" if field.description else line
        if len(beside) <= WIDTH:
            yield beside
        else:
            yield from wrap(f"{name}: {field.description}", WIDTH, initial_indent="# ", subsequent_indent="#   ")
            yield line


def default_of(field: FieldInfo) -> Any:
    """The default of a key, None where it has none."""
    return None if field.is_required() else field.get_default(call_default_factory=True)


def meaning(section: type[Section]) -> str:
    """The first paragraph of a section's docstring, in one line."""
    return " ".join((section.__doc__ or "").split("\n\n")[0].split())
