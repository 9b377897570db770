"""Task files: TOML in, a `Task` out, or all errors, each with its key and an example.

A task is data: robot, path, law and acceptance limits, in SI units, radians and the base frame. Keys have the names of
the Python arguments that they become.
"""

from __future__ import annotations

import difflib
import re
import sys
import warnings
from collections.abc import Callable
from functools import partial
from importlib import resources
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field, PlainValidator, PrivateAttr, StrictBool, ValidationError, model_validator

from invariantqp.control.controller import Controller
from invariantqp.control.demands import ExactPoint, Named
from invariantqp.control.measure import tool_metric
from invariantqp.control.target import Target
from invariantqp.errors import BadInput, InvariantQPError, TaskFileError, UnknownName
from invariantqp.geometry import arrays, screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.sizes import LENGTH_LIMIT
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import KNOWN, load_robot, urdf_of
from invariantqp.velocity.limits import ToolSpeed
from invariantqp.workbench.runs.clearancespec import ClearanceSpec, ObstacleScene, ObstacleSpec
from invariantqp.workbench.runs.contactspec import ContactSpec, ForceSpec, OperatorSpec, Physics, SensorSpec
from invariantqp.workbench.runs.path import Path
from invariantqp.workbench.runs.section import (
    Direction,
    NotNegative,
    Number,
    OpenNumber,
    Positive,
    Section,
    Vector3,
    problems,
    without_errors,
)

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")

# Folders of the tasks that come with the package.
GROUPS = ("", "stability", "compare")


class Screw(Section):
    """A joint by its screw axis."""

    axis: Direction = Field(description="in the base frame at q = 0", examples=[[0.0, 0.0, 1.0]])
    point: Vector3 = Field((0.0, 0.0, 0.0), description="of the axis [m]", examples=[[0.0, 0.3, 0.0]])
    pitch: OpenNumber = Field(0.0, description="[m/rad]; inf for a prismatic joint", examples=[0.0])
    lower: OpenNumber = Field(-np.inf, description="position limit [rad, m]", examples=[-2.0])
    upper: OpenNumber = Field(np.inf, description="position limit [rad, m]", examples=[2.0])
    speed: OpenNumber = Field(np.inf, gt=0.0, description="velocity limit [rad/s, m/s]", examples=[1.0])


class RobotSpec(Section):
    """A robot by name or URDF (`source`), or from joint screws (`screws`) with the tool at `tool_point` at q = 0."""

    source: str | None = Field(
        None, min_length=1, description="a known name, or the path of a URDF beside this file", examples=["panda"]
    )
    tool: str | None = Field(None, min_length=1, description="name of the tool frame", examples=["panda_hand_tcp"])
    joints: list[str] | None = Field(None, description="names of the joints that move", examples=[["panda_joint1"]])
    screws: list[Screw] | None = Field(
        None, min_length=1, description="joints by their axes, base first", examples=[[{"axis": [0.0, 0.0, 1.0]}]]
    )
    tool_point: Vector3 = Field(
        (0.0, 0.0, 0.0), description="position of the tool at q = 0, with screws [m]", examples=[[0.0, 0.6, 0.0]]
    )
    start: list[Number] = Field(description="joint positions [rad, m]", examples=[[0.0, 0.5, 0.0]])

    @model_validator(mode="after")
    def _one_robot(self) -> RobotSpec:
        if (self.source is None) == (self.screws is None):
            given = "neither source nor screws is" if self.source is None else "both source and screws are"
            raise ValueError(f"{given} given; give one of them")
        return self

    def load(self, folder: FilePath | None) -> Chain:
        """The robot; relative URDF paths start at the folder of the task file."""
        if self.screws is None:
            return load_robot(_resolve_source(self.source, folder), self.tool, self.joints)
        if self.tool is not None:
            raise BadInput("tool", repr(self.tool), "none with joint screws", "Their tool is at tool_point.")
        return Chain(
            np.column_stack([screws.helical(s.axis, s.point, s.pitch) for s in self.screws]),
            se3.transform(translation=self.tool_point),
            position_lower=[s.lower for s in self.screws],
            position_upper=[s.upper for s in self.screws],
            velocity_limit=[s.speed for s in self.screws],
            tool="tool_point",
        )


def _resolve_source(source: str | None, folder: FilePath | None) -> str | FilePath:
    """The file of that name in the folder of the task file, if there is one; else the source itself."""
    file = None if folder is None else folder / str(source)
    return file if file is not None and file.is_file() else str(source)


def _form(given: Any) -> Any:
    """A pitch, "tool" or None, checked."""
    if given is None or given == "tool":
        return given
    if isinstance(given, (int, float)) and not isinstance(given, bool) and abs(given) <= LENGTH_LIMIT:
        return float(given)
    raise ValueError(f'a pitch h in metres per radian or "tool" is expected, not {given!r}')


class LawSpec(Section):
    """The [law] table: arguments of `Controller`. What is left out has the controller's own default."""

    dt: Positive = Field(0.001, description="tick [s]", examples=[0.001])
    gain: Positive | None = Field(None, description="tracking gain [1/s]", examples=[20.0])
    form: Annotated[float | Literal["tool"] | None, PlainValidator(_form)] = Field(
        None,
        description="approximation of a twist that the joints cannot do: a pitch h [m/rad]; left out: least squares at "
        'the point; "tool": least squares at the origin of the tool frame',
        examples=[0.3],
    )
    damping: NotNegative | None = Field(None, description="lambda of a pitch form; left out: 0", examples=[0.0])
    exact: Named | None = Field(
        None,
        description='exact demand: "position", or "twist", the whole twist, which limits then only scale',
        examples=["position"],
    )
    point: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="the point of the tool where accuracy counts, in the tool frame [m]; left out: its origin, "
        'in contact the point of contact; exact = "position" meets it exactly',
        examples=[[0.0, 0.0, 0.1]],
    )
    length: Positive | None = Field(
        None, description="length L that counts as one radian there [m/rad]; left out: the arm's reach", examples=[0.5]
    )
    guard: StrictBool = Field(True, description="whether the descent guard is on", examples=[True])
    posture: StrictBool | list[Number] = Field(
        True,
        description="joint positions to stay near in the null space of the path; true is the middle of their ranges, "
        "for more than six joints",
        examples=[True],
    )
    posture_gain: NotNegative = Field(1.0, description="gain of the posture while the tool moves [1/s]", examples=[1.0])
    joint_metric: list[Positive] | None = Field(
        None, description="one weight for each joint velocity", examples=[[1.0, 1.0, 25.0]]
    )
    backend: str | None = Field(
        None, description="a QP solver that solves the definition of the law; left out: the engine", examples=["daqp"]
    )
    acceleration_limit: Positive | list[Positive] | None = Field(
        None, description="one for all joints, or one for each [rad/s^2, m/s^2]", examples=[10.0]
    )
    delay: NotNegative = Field(0.0, description="dead time of the robot beyond one tick [s]", examples=[0.01])
    position_margin: NotNegative = Field(
        0.0, description="distance kept from position limits [rad, m]", examples=[0.01]
    )
    tool_speed: Positive | None = Field(None, description="speed limit of a point of the tool [m/s]", examples=[0.25])
    tool_speed_point: Vector3 = Field(
        (0.0, 0.0, 0.0), description="that point, in the tool frame [m]", examples=[[0.0, 0.0, 0.1]]
    )


def law_options(robot: Robot, law: LawSpec) -> dict[str, Any]:
    """The keyword arguments of `Controller` for a [law]."""
    speed = None if law.tool_speed is None else ToolSpeed(law.tool_speed, law.tool_speed_point)
    return law.model_dump(exclude={"tool_speed_point"}) | {
        "form": tool_metric(robot) if law.form == "tool" else law.form,
        "exact": ExactPoint(law.point) if law.exact == "position" else law.exact,
        "point": law.point if any(law.point) else None,  # None is the point of contact, in contact
        "tool_speed": speed,
    }


class Acceptance(Section):
    """The [accept] table: limits that a run has to meet. A key that is left out is not required."""

    position_error_mm: Positive | None = Field(None, description="largest", examples=[0.1])
    orientation_error_deg: Positive | None = Field(None, description="largest", examples=[0.1])
    final_position_error_mm: Positive | None = Field(None, description="at the end", examples=[0.01])
    final_orientation_error_deg: Positive | None = Field(None, description="at the end", examples=[0.01])
    force_error: Positive | None = Field(
        None, description="rms error of the true contact force over the desired force", examples=[0.02]
    )
    clearance_mm: NotNegative | None = Field(None, description="least distance of bodies, at least", examples=[19.9])
    limit_violation: Positive = Field(
        1e-9,
        description="largest excess [rad, m; rad/s, m/s]; of an acceleration limit as a velocity in a tick",
        examples=[1e-9],
    )


class Task(Section):
    """A problem to run; `load_task` makes one from a file."""

    name: str = Field(min_length=1, description="name in reports", examples=["panda_path"])
    about: str = Field("", description="one sentence about it", examples=["A Panda draws a circle."])
    robot: RobotSpec
    path: Path
    law: LawSpec = LawSpec()
    accept: Acceptance = Acceptance()
    contact: ContactSpec | None = None
    force: ForceSpec | None = None
    sensor: SensorSpec = SensorSpec()
    operator: OperatorSpec | None = None
    physics: Physics = Physics()
    accept_mujoco: Acceptance | None = Field(None, description="replaces [accept] in runs with MuJoCo")
    obstacle: list[ObstacleSpec] = Field([], description="obstacles around the arm")
    clearance: ClearanceSpec | None = Field(
        None, description="least distance of the arm from obstacles and from itself"
    )
    encoder_noise: Positive | None = Field(
        None, description="standard deviation of the measured joint positions [rad, m]", examples=[1e-4]
    )
    _folder: FilePath | None = PrivateAttr(None)  # where relative URDF paths are looked up

    @model_validator(mode="after")
    def _fits_together(self) -> Task:
        if (self.contact is None) != (self.force is None):
            raise ValueError("[contact] and [force] go together")
        if self.operator is not None and self.contact is not None:
            raise ValueError("[operator] is for a tool that touches nothing; leave out [contact] and [force]")
        if self.path.timing == "elastic" and (self.contact is not None or self.operator is not None):
            raise ValueError('timing = "elastic" is for a path alone; leave out [contact] and [operator]')
        needs_pose = self.contact is not None or self.operator is not None or isinstance(self.law.form, float)
        if self.path.target != "pose" and (needs_pose or self.law.exact is not None):
            raise ValueError(
                f'target = "{self.path.target}" is for a path alone; leave out [contact], [operator], form and exact'
            )
        return self

    @property
    def part(self) -> Target | None:
        """The constrained part of the path's poses; None where all is."""
        return self.path.part(self.law.point)

    @property
    def settle(self) -> float:
        """Time for which the path waits for the contact to settle [s]; 0 without contact."""
        return 0.0 if self.contact is None else self.contact.settle

    @property
    def ticks(self) -> int:
        """Number of ticks of a run."""
        duration, dt = self.path.duration, self.law.dt
        ticks = (self.settle + duration) / dt
        if round(duration / dt) < 1 or ticks > arrays.LARGEST_COUNT:
            expected = f"1 to {arrays.LARGEST_COUNT} ticks of {dt:g} s each"
            raise BadInput("path.duration", f"{duration:g} s, {ticks:.3g} ticks", expected, "Change it, or law.dt.")
        return round(ticks)

    def urdf(self) -> FilePath:
        """The robot's URDF file."""
        if self.robot.source is None:
            raise BadInput("physics", "a robot from joint screws", "one from a URDF", "Screws have no masses.")
        return urdf_of(_resolve_source(self.robot.source, self._folder))

    def load_robot(self, tool: str | None = None) -> Chain:
        """The task's robot, with another tool frame if one is named."""
        spec = self.robot if tool is None else self.robot.model_copy(update={"tool": tool})
        robot = spec.load(self._folder)
        n, m = len(self.robot.start), len(robot.names)
        if tool is None and n != m:
            found = f"$.robot.start: {n} number{'s' if n != 1 else ''} (give {m}: {', '.join(robot.names)})"
            raise TaskFileError(self.name, [found])
        return robot

    def obstacle_scene(self, robot: Chain) -> ObstacleScene | None:
        """Obstacles and clearance; None where the task has neither an [[obstacle]] nor a [clearance]."""
        if self.clearance is None and not self.obstacle:
            return None
        resolve_source = partial(_resolve_source, folder=self._folder)
        return ObstacleScene(robot, self.clearance or ClearanceSpec(), self.obstacle, resolve_source)

    def start(self) -> Array:
        """(m,) joint positions at the start."""
        return np.array(self.robot.start)

    def mismatches(self) -> list[str]:
        """Errors between its tables, or with its robot, one message each as in `problems`."""
        errors: list[str] = []

        def check(table: str, make: Callable[[], T]) -> T | None:
            try:
                return make()
            except TaskFileError as error:
                errors.extend(error.problems)
            except BadInput as error:
                known = re.split(r"[.\[]", error.argument)[0] in Task.model_fields
                errors.append(f"$.{error}" if known else f"$.{table}.{error}")
            except InvariantQPError as error:
                errors.append(f"$.{table}: {error}")
            return None

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are given when a run begins
            check("path", lambda: self.ticks)
            robot = check("robot", self.load_robot)
            if robot is not None:
                check("robot", lambda: checked_start(robot, self.start()))
                check("path", lambda: self.path.along(robot, self.start()))
                check("law", lambda: Controller(robot, **law_options(robot, self.law)))
                check("clearance", lambda: self.obstacle_scene(robot))
        return errors


def checked_start(robot: Robot, start: Array) -> Array:
    """Joint positions (m,) at the start of a run, which must be plausible for a controller."""
    return Controller(robot, dt=LawSpec().dt).checked_positions(start, "robot.start")


def shipped_tasks(group: str = "") -> dict[str, FilePath]:
    """The files of the tasks that come with the package, by name; of a group the names are such as "stability/jump".

    Groups: "" are examples, "stability" are hard cases for velocity control, "compare" are those of the comparison.
    """
    arrays.choice(group, "group", GROUPS)
    installed = FilePath(str(resources.files("invariantqp"))) / "task_files"
    folder = installed if installed.is_dir() else installed.parent.parent / "tasks"
    files = sorted((folder / group).glob("*.toml"))
    return {f.relative_to(folder).with_suffix("").as_posix(): f for f in files}


def load_task(path_or_name: str | FilePath) -> Task:
    """A task from a TOML file, or by name one that comes with the package ("panda_path").

    Raises:
        UnknownName: no such file and no such name; similar names are listed.
        TaskFileError: a file that cannot be read, is not TOML, or has wrong keys or values: each with its path.
    """
    arrays.instance(path_or_name, (str, FilePath), "path_or_name", "the name of a task, or the path of a task file")
    name = str(path_or_name)
    known = {task: file for group in GROUPS for task, file in shipped_tasks(group).items()}
    path = known.get(name, FilePath(name))
    try:
        if not path.is_file():
            near = difflib.get_close_matches(name.removesuffix(".toml"), known)
            raise UnknownName("task", name, near, [*shipped_tasks(), "or the path of a .toml file"])
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise TaskFileError(name, [f"$: cannot be read: {error.strerror}"]) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise TaskFileError(name, [f"$: not TOML: {error}"]) from error
    return task_from(content, str(path), path.parent)


def task_from(content: dict[str, Any], source: str, folder: FilePath | None = None) -> Task:
    """A task from decoded TOML; `source` names the file in errors, relative URDF paths are searched in `folder`."""
    errors: dict[str, str] = {}
    task: Task | None = None
    left: dict[str, Any] | None = content
    while task is None and left is not None:  # read the rest without the keys in error
        try:
            task = Task.model_validate(left)
        except ValidationError as error:
            for line in problems(error, Task):
                errors.setdefault(line.partition(": ")[0], line)
            left = without_errors(left, error, Task)
    if task is not None:
        task._folder = folder  # noqa: SLF001 (set once, here)
    if task is None or errors:
        raise TaskFileError(source, [*errors.values(), *(task.mismatches() if task is not None else ())])
    return task


def load_arm(source: str | FilePath, tool: str | None = None) -> Chain:
    """The robot of a name, a URDF or MJCF, a task's name or a task file."""
    if tool == "":
        raise BadInput("tool", "an empty name", "the name of a frame")
    name, known = str(source), shipped_tasks()
    if name in known or FilePath(source).suffix.lower() == ".toml":
        return load_task(source).load_robot(tool)
    try:
        return load_robot(source, tool)
    except UnknownName as error:
        if error.kind != "robot":
            raise
        near = difflib.get_close_matches(name.lower(), [*KNOWN, *known])
        raise UnknownName("robot", name, near, [*KNOWN, *known, "or the path of a .urdf or .toml file"]) from None
