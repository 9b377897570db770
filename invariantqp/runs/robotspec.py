"""The [robot] table of a task file: a robot by name or URDF, or joint screws; and where it starts."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
from pydantic import Field, model_validator

from invariantqp.errors import BadInput
from invariantqp.geometry import screws, se3
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.load import load_robot
from invariantqp.runs.section import Direction, Number, OpenNumber, Section, Vector3


class Screw(Section):
    """A joint described by its axis."""

    axis: Direction = Field(description="in the base frame at q = 0", examples=[[0.0, 0.0, 1.0]])
    point: Vector3 = Field((0.0, 0.0, 0.0), description="of the axis [m]", examples=[[0.0, 0.3, 0.0]])
    pitch: OpenNumber = Field(0.0, description="[m/rad]; inf for a prismatic joint", examples=[0.0])
    lower: OpenNumber = Field(-np.inf, description="position limit [rad, m]", examples=[-2.0])
    upper: OpenNumber = Field(np.inf, description="position limit [rad, m]", examples=[2.0])
    speed: OpenNumber = Field(np.inf, gt=0.0, description="velocity limit [rad/s, m/s]", examples=[1.0])


class RobotSpec(Section):
    """A robot by name or URDF (`source`), or from joint screws with the place of the tool at q = 0 (`screws`)."""

    source: str | None = Field(
        None, min_length=1, description="a known name, or the path of a URDF beside this file", examples=["panda"]
    )
    tool: str | None = Field(None, min_length=1, description="name of the tool frame", examples=["panda_hand_tcp"])
    joints: list[str] | None = Field(None, description="names of the joints that move", examples=[["panda_joint1"]])
    screws: list[Screw] | None = Field(
        None, min_length=1, description="joints by their axes, base first", examples=[[{"axis": [0.0, 0.0, 1.0]}]]
    )
    tool_point: Vector3 = Field(
        (0.0, 0.0, 0.0), description="place of the tool at q = 0, with screws [m]", examples=[[0.0, 0.6, 0.0]]
    )
    start: list[Number] = Field(description="joint positions [rad, m]", examples=[[0.0, 0.5, 0.0]])

    @model_validator(mode="after")
    def _one_robot(self) -> RobotSpec:
        if (self.source is None) == (self.screws is None):
            given = "neither source nor screws is" if self.source is None else "both source and screws are"
            raise ValueError(f"{given} given; give one of them")
        return self

    def load(self, folder: FilePath | None) -> Robot:
        """The robot; relative URDF paths are looked up beside the task file.

        Raises:
            BadInput: a tool frame named for joint screws, which have only their own.
            RobotModelError, UnknownName, MissingExtra: as `invariantqp.load_robot`.
        """
        if self.screws is None:
            return load_robot(self.beside(folder), self.tool, self.joints)
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

    def beside(self, folder: FilePath | None) -> str | FilePath:
        """The source: the file of that name beside the task file if there is one."""
        beside = None if folder is None else folder / str(self.source)
        return beside if beside is not None and beside.is_file() else str(self.source)
