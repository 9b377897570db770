"""Task files: TOML in, a `Task` out, or every problem with its path and an example of what is right.

A task is data: robot, path, law, and the numbers at which it counts as done. SI units, radians, base frame.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterator
from importlib import resources
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BaseModel,
    Field,
    PrivateAttr,
    Strict,
    StrictBool,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from invariantqp.errors import BadInput, TaskFileError, UnknownName
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import load_robot, urdf_of
from invariantqp.runs.contactspec import ContactSpec, ForceSpec, OperatorSpec, PhysicsSpec
from invariantqp.runs.path import Number, Path, Positive, Section, Vector3

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


# Infinity is a fair answer for a limit that is not there, or for the pitch of a slide.
OpenNumber = Annotated[float, Strict()]


class Screw(Section):
    """A joint from geometry alone."""

    axis: Vector3 = Field(examples=[[0.0, 0.0, 1.0]])
    point: Vector3 = Field((0.0, 0.0, 0.0), description="a point of the axis [m]", examples=[[0.0, 0.3, 0.0]])
    pitch: OpenNumber = Field(0.0, description="[m/rad], inf for a prismatic joint", examples=[0.0])
    lower: OpenNumber = Field(-np.inf, description="[rad, m]", examples=[-2.0])
    upper: OpenNumber = Field(np.inf, description="[rad, m]", examples=[2.0])
    speed: OpenNumber = Field(np.inf, gt=0.0, description="[rad/s, m/s]", examples=[1.0])


class RobotSpec(Section):
    """A robot by name or URDF, or joint screws with the tool's place at q = 0."""

    source: str | None = Field(None, description="a known name or the path of a URDF", examples=["panda"])
    tool: str | None = Field(None, examples=["panda_hand_tcp"])
    joints: list[str] | None = Field(None, examples=[["panda_joint1"]])
    screws: list[Screw] | None = Field(None, min_length=1, examples=[[{"axis": [0.0, 0.0, 1.0]}]])
    tool_point: Vector3 = Field(
        (0.0, 0.0, 0.0), description="tool at q = 0, with screws [m]", examples=[[0.0, 0.6, 0.0]]
    )
    start: list[Number] = Field(description="joint positions [rad, m]", examples=[[0.0, 0.5, 0.0]])

    def load(self, folder: FilePath | None) -> Robot:
        """The robot; relative URDF paths are looked up beside the task file."""
        if (self.source is None) == (self.screws is None):
            raise BadInput("robot", "both or neither of source and screws", "one of them")
        if self.screws is not None:
            if self.tool is not None:
                raise BadInput("tool", repr(self.tool), "none with joint screws", "Their tool is at tool_point.")
            return Chain(
                np.column_stack([screws.helical(s.axis, s.point, s.pitch) for s in self.screws]),
                se3.transform(translation=self.tool_point),
                position_lower=[s.lower for s in self.screws],
                position_upper=[s.upper for s in self.screws],
                velocity_limit=[s.speed for s in self.screws],
            )
        return load_robot(self.beside(folder), self.tool, self.joints)

    def beside(self, folder: FilePath | None) -> str | FilePath:
        """The source: a file beside the task file where there is one."""
        beside = None if folder is None else folder / str(self.source)
        return beside if beside is not None and beside.is_file() else str(self.source)


class LawSpec(Section):
    """The law's knobs; what is left out is what `Controller` does by itself."""

    dt: Positive = Field(0.001, description="tick [s]", examples=[0.001])
    gain: Positive | None = Field(None, description="[1/s]", examples=[20.0])
    form: Literal["pitch", "carried"] | None = Field(
        None,
        description="a pitch form, or a metric carried by the tool; left out: what inspect recommends",
        examples=["carried"],
    )
    pitch: Number | None = Field(None, description="h [m/rad]; left out: the arm's own length", examples=[0.3])
    damping: Number | None = Field(None, ge=0.0, description="lambda [m]; left out: adaptive", examples=[0.0])
    exact: Literal["position"] | None = Field(None, examples=["position"])
    point: Vector3 = Field((0.0, 0.0, 0.0), description="of the tool, met exactly [m]", examples=[[0.0, 0.0, 0.1]])
    guard: StrictBool = True
    posture: StrictBool = True
    joint_metric: list[Positive] | None = Field(
        None, description="what counts as a short joint velocity, one weight a joint", examples=[[1.0, 1.0, 25.0]]
    )
    backend: str = Field("daqp", examples=["daqp"])
    acceleration: Positive | list[Positive] | None = Field(
        None, description="limit, one for all joints or one each [rad/s^2, m/s^2]", examples=[10.0]
    )
    margin: Number = Field(0.0, ge=0.0, description="kept from position limits [rad, m]", examples=[0.01])
    tool_speed: Positive | None = Field(None, description="limit of a point of the tool [m/s]", examples=[0.25])
    tool_speed_point: Vector3 = Field(
        (0.0, 0.0, 0.0), description="that point, in the tool frame [m]", examples=[[0.0, 0.0, 0.1]]
    )

    @field_validator("pitch")
    @classmethod
    def _pitch_of_a_pitch_form(cls, pitch: float | None, info: ValidationInfo) -> float | None:
        if pitch is not None and info.data.get("form") == "carried":
            raise ValueError('a carried metric has no pitch; leave out pitch, or form = "carried"')
        return pitch


class Acceptance(Section):
    """The numbers at which a run counts as done; what is left out is not asked."""

    position_error_mm: Positive | None = Field(None, description="largest", examples=[0.1])
    orientation_error_deg: Positive | None = Field(None, description="largest", examples=[0.1])
    final_position_error_mm: Positive | None = Field(None, examples=[0.01])
    final_orientation_error_deg: Positive | None = Field(None, examples=[0.01])
    force_error: Positive | None = Field(
        None, description="rms of the true contact force's error, relative to the wanted one", examples=[0.02]
    )
    limit_violation: Positive = Field(1e-9, description="[rad, m] and [rad/s, m/s]", examples=[1e-9])


class Task(Section):
    """A problem to run: `load_task` makes one from a file."""

    name: str = Field(min_length=1, examples=["panda_path"])
    about: str = ""
    robot: RobotSpec
    path: Path
    law: LawSpec = LawSpec()
    accept: Acceptance = Acceptance()
    contact: ContactSpec | None = None
    force: ForceSpec | None = None
    operator: OperatorSpec | None = None
    physics: PhysicsSpec = PhysicsSpec()
    accept_mujoco: Acceptance | None = Field(None, description="instead of [accept], with MuJoCo")
    encoder_noise: Positive | None = Field(
        None, description="standard deviation of the joint positions a controller is told [rad, m]", examples=[1e-4]
    )
    _folder: FilePath | None = PrivateAttr(None)  # where relative URDF paths are looked up

    @model_validator(mode="after")
    def _whole(self) -> Task:
        if (self.contact is None) != (self.force is None):
            raise ValueError("[contact] and [force] go together")
        if self.operator is not None and self.contact is not None:
            raise ValueError("[operator] is for a tool that touches nothing; leave out [contact] and [force]")
        return self

    def urdf(self) -> FilePath:
        """The robot's URDF file.

        Raises:
            BadInput: a robot from joint screws, which has none.
            RobotModelError, UnknownName, MissingExtra: as `invariantqp.load_robot`.
        """
        if self.robot.source is None:
            raise BadInput("physics", "a robot from joint screws", "one from a URDF", "Screws have no masses.")
        return urdf_of(self.robot.beside(self._folder))

    def load_robot(self, tool: str | None = None) -> Robot:
        """The task's robot, to another tool frame where one is named.

        Raises:
            BadInput: a tool named for joint screws, which have their own.
            TaskFileError: the start is not one number a joint.
            RobotModelError, UnknownName, MissingExtra: as `invariantqp.load_robot`.
        """
        spec = self.robot if tool is None else self.robot.model_copy(update={"tool": tool})
        robot = spec.load(self._folder)
        if tool is None and len(self.robot.start) != len(robot.names):
            found = (
                f"$.robot.start: {len(self.robot.start)} numbers (give {len(robot.names)}: {', '.join(robot.names)})"
            )
            raise TaskFileError(self.name, [found])
        return robot

    def start(self) -> Array:
        """(m,) joint positions at the start."""
        return np.array(self.robot.start)


def shipped_tasks(group: str = "") -> dict[str, FilePath]:
    """The problem library: names and files, of one group: "" is the tasks to start from.

    The group "stability" holds what breaks velocity control, under names like "stability/jump".
    """
    packaged = FilePath(str(resources.files("invariantqp"))) / "tasks"
    folder = packaged if packaged.is_dir() else packaged.parent.parent / "tasks"
    files = sorted((folder / group).glob("*.toml"))
    return {f.relative_to(folder).with_suffix("").as_posix(): f for f in files}


def load_task(path_or_name: str | FilePath) -> Task:
    """A task from a TOML file, or from the library by name ("panda_path").

    Raises:
        UnknownName: neither a file nor a known name; near ones are listed.
        TaskFileError: not TOML, or keys and values that do not fit: every problem with its path.
    """
    known = shipped_tasks() | shipped_tasks("stability")
    path = FilePath(path_or_name)
    if str(path_or_name) in known:
        path = known[str(path_or_name)]
    elif not path.is_file():
        names = list(known)
        raise UnknownName("task", str(path_or_name), difflib.get_close_matches(str(path.with_suffix("")), names), names)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TaskFileError(str(path), [f"$: not TOML: {error}"]) from error
    return task_from(content, str(path), path.parent)


def task_from(content: dict[str, Any], source: str, folder: FilePath | None = None) -> Task:
    """A task from decoded TOML.

    Raises:
        TaskFileError: every problem with its path.
    """
    try:
        task = Task.model_validate(content)
    except ValidationError as error:
        raise TaskFileError(source, list(_problems(error))) from error
    task._folder = folder  # noqa: SLF001 (set once, here)
    return task


def _problems(error: ValidationError) -> Iterator[str]:
    for e in error.errors():
        # The names of a union's members are pydantic's business, not the file's.
        place = [p for p in e["loc"] if p not in ("line", "circle", "screw", "joints", "hold") or e["loc"][0] != "path"]
        where = "$" + "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in place)
        said = e["msg"][0].lower() + e["msg"][1:]
        yield f"{where}: {said}{_advice(e['type'], list(place))}"


def _advice(kind: str, place: list[int | str]) -> str:
    names = [p for p in place if isinstance(p, str)]
    fields = _fields_at(names[:-1])
    if kind == "extra_forbidden":
        near = difflib.get_close_matches(names[-1], list(fields), 1)
        return f" (did you mean {near[0]!r}?)" if near else f" (known keys: {', '.join(sorted(fields))})"
    example = fields.get(names[-1]) if names else None
    return "" if example is None else f" (for example: {names[-1]} = {example})"


def _fields_at(names: list[str]) -> dict[str, Any]:
    """Known keys below a path of names, each with its example."""
    models: list[type[BaseModel]] = [Task]
    for name in names:
        below: list[type[BaseModel]] = []
        for model in models:
            below.extend(_models_in(model.model_fields[name].annotation) if name in model.model_fields else [])
        models = below
    return {name: (field.examples or [None])[0] for model in models for name, field in model.model_fields.items()}


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in getattr(annotation, "__args__", ()):
        yield from _models_in(inner)
