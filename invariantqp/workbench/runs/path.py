"""The [path] table: paths of the tool in the base frame.

All but `hold` and `poses` start and end at rest, by minimum jerk:

    sigma(t) = 10 u^3 - 15 u^4 + 6 u^5,   u = t / duration clipped to [0, 1]

A path starts at the tool's pose at the start of the run.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, StrictBool, model_validator

from invariantqp.control.target import Target
from invariantqp.errors import BadInput
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.robots.kinematics import Robot
from invariantqp.workbench.runs.section import Direction, NotNegative, Number, Positive, Section, Vector3

PoseAt = Callable[[float], Array]


def minimum_jerk(u: float) -> float:
    """Progress in [0, 1] at a share u of the duration, with zero velocity and acceleration at both ends."""
    u = min(max(u, 0.0), 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


class _Path(Section):
    duration: Positive = Field(description="[s]", examples=[4.0])
    timing: Literal["fixed", "elastic"] = Field(
        "fixed",
        description='"elastic": where limits bind the tool stays on the path, is late, and the run takes longer',
        examples=["elastic"],
    )
    target: Literal["pose", "point", "point and axis", "axis"] = Field(
        "pose",
        description="the part of the tool that follows the path: its pose, or law.point, tool_axis or both",
        examples=["point"],
    )
    tool_axis: Direction = Field((0.0, 0.0, 1.0), description="the axis, in the tool frame", examples=[[0, 0, 1]])
    jumps: ClassVar[bool] = False  # whether the target jumps, and so has no velocity to feed forward

    def part(self, tool_point: ArrayLike) -> Target | None:
        """The constrained part of the path's poses, with the point (3,) in the tool frame; None where all is."""
        if self.target == "pose":
            return None
        parts = {
            name: value for name, value in (("point", np.zeros(3)), ("axis", self.tool_axis)) if name in self.target
        }
        return Target(**parts, tool_point=tool_point, tool_axis=self.tool_axis)


class LinePath(_Path):
    """A straight line with a turn about a fixed axis, one way or there and back."""

    kind: Literal["line"]
    move: Vector3 = Field((0.0, 0.0, 0.0), description="displacement in base axes [m]", examples=[[0.1, 0.0, 0.0]])
    turn: Vector3 = Field((0.0, 0.0, 0.0), description="rotation vector in base axes [rad]", examples=[[0.0, 0.0, 0.5]])
    there_and_back: StrictBool = Field(False, description="and back to the start", examples=[True])

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        T0 = robot.pose(start)
        move, turn = np.array(self.move), np.array(self.turn)

        def pose(t: float) -> Array:
            share = _progress(t / self.duration, self.there_and_back)
            return _displaced(T0, share * move, share * turn)

        return pose


class CirclePath(_Path):
    """Turns of a circle through the start, while the tool rocks about an axis and back."""

    kind: Literal["circle"]
    centre: Vector3 = Field(description="from the start, in base axes [m]", examples=[[0.0, 0.05, 0.0]])
    normal: Direction = Field((0.0, 0.0, 1.0), description="axis of the circle in base axes", examples=[[0, 0, 1]])
    turns: Number = Field(1.0, description="how many", examples=[2.0])
    rock: Vector3 = Field(
        (0.0, 0.0, 0.0), description="largest rotation vector, reached once a turn [rad]", examples=[[0.2, 0, 0]]
    )

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        T0 = robot.pose(start)
        centre, normal, rock = np.array(self.centre), np.array(self.normal), np.array(self.rock)
        if np.linalg.norm(centre) < NEGLIGIBLE:
            raise BadInput("path.centre", "the start itself", "a centre away from the start, such as [0.0, 0.05, 0.0]")
        normal = normal / np.linalg.norm(normal)

        def pose(t: float) -> Array:
            angle = 2.0 * np.pi * self.turns * minimum_jerk(t / self.duration)
            move = centre - se3.rotation(angle * normal).dot(centre)
            return _displaced(T0, move, 0.5 * (1.0 - np.cos(angle)) * rock)

        return pose


class ScrewPath(_Path):
    """A turn about an axis, with a slide along it: the motion of a hinge or of a thread."""

    kind: Literal["screw"]
    axis: Direction = Field(description="in base axes", examples=[[0.0, 0.0, 1.0]])
    point: Vector3 = Field(description="of the axis, from the start [m]", examples=[[-0.4, 0.0, 0.0]])
    angle: Number = Field(description="[rad]", examples=[0.8])
    pitch: Number = Field(0.0, description="[m/rad]", examples=[0.0])
    there_and_back: StrictBool = Field(False, description="and back to the start", examples=[True])

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        T0 = robot.pose(start)
        turn = self.angle * screws.helical(self.axis, T0[:3, 3] + self.point, self.pitch)
        return lambda t: se3.exp(_progress(t / self.duration, self.there_and_back) * turn).dot(T0)


class JointsPath(_Path):
    """The tool poses of a joint motion through waypoints: a task-space path that the arm can follow exactly."""

    kind: Literal["joints"]
    waypoints: Annotated[list[list[Number]], Field(min_length=1)] = Field(
        description="joint positions after the start [rad, m]", examples=[[[0.0, 0.5, 0.0]]]
    )

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        from scipy.interpolate import CubicSpline  # 0.3 s to import: only where it is needed

        for i, waypoint in enumerate(self.waypoints):
            if len(waypoint) != len(start):
                found = f"{len(waypoint)} number{'s' if len(waypoint) != 1 else ''}"
                raise BadInput(f"path.waypoints[{i}]", found, f"{len(start)}, one for each joint")
        knots = np.vstack((start, self.waypoints))
        spline = CubicSpline(np.linspace(0.0, 1.0, len(knots)), knots, bc_type="natural")
        return lambda t: robot.pose(spline(minimum_jerk(t / self.duration)))


class HoldPath(_Path):
    """A pose displaced from the start. The target jumps there, and back if `end` is given."""

    kind: Literal["hold"]
    move: Vector3 = Field((0.0, 0.0, 0.0), description="displacement in base axes [m]", examples=[[3.0, 0.0, 0.0]])
    turn: Vector3 = Field((0.0, 0.0, 0.0), description="rotation vector [rad]", examples=[[0.0, 0.0, 3.1]])
    begin: NotNegative = Field(0.0, description="when the target jumps there [s]", examples=[0.5])
    end: Positive | None = Field(None, description="when it jumps back [s]; left out: never", examples=[1.5])
    jumps: ClassVar[bool] = True

    @model_validator(mode="after")
    def _in_order(self) -> HoldPath:
        if self.timing == "elastic":
            raise ValueError('timing = "elastic" is for paths along which the target moves')
        if self.end is not None and self.end <= self.begin:
            raise ValueError(f"end = {self.end:g} is not after begin = {self.begin:g}")
        return self

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        T0 = robot.pose(start)
        there = _displaced(T0, np.array(self.move), np.array(self.turn))
        end = np.inf if self.end is None else self.end
        return lambda t: there if self.begin <= t < end else T0


class PosesPath(_Path):
    """Poses at equal intervals, as they were recorded, by the screw motion from each to the next."""

    kind: Literal["poses"]
    poses: Annotated[list[Annotated[list[Number], Field(min_length=6, max_length=6)]], Field(min_length=2)] = Field(
        description="from the start, in base axes: rotation vector [rad], displacement [m]",
        examples=[[[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.2, 0.0, 0.0, -0.05]]],
    )

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        T0 = robot.pose(start)
        poses = np.array([_displaced(T0, np.array(pose[3:]), np.array(pose[:3])) for pose in self.poses])
        moves = [se3.log(after @ se3.inverse(before)) for before, after in pairwise(poses)]

        def pose(t: float) -> Array:
            at = min(max(t / self.duration, 0.0), 1.0) * len(moves)
            i = min(int(at), len(moves) - 1)
            T: Array = se3.exp((at - i) * moves[i]).dot(poses[i])
            return T

        return pose


Path = Annotated[LinePath | CirclePath | ScrewPath | JointsPath | HoldPath | PosesPath, Field(discriminator="kind")]


def _progress(u: float, there_and_back: bool) -> float:
    return minimum_jerk(2.0 * u) - minimum_jerk(2.0 * u - 1.0) if there_and_back else minimum_jerk(u)


def _displaced(T0: Array, move: Array, turn: Array) -> Array:
    """A pose moved, and turned about its own origin, both in base axes."""
    T = T0.copy()
    T[:3, :3] = se3.rotation(turn).dot(T0[:3, :3])
    T[:3, 3] += move
    return T
