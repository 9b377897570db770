"""Paths of the tool in the base frame, as functions of time: start and end at rest, by a minimum-jerk time scaling.

    sigma(t) = 10 u^3 - 15 u^4 + 6 u^5,   u = t / duration clipped to [0, 1]

A path starts where the robot's tool is, so a task file says how to move, not where the world is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AllowInfNan, BaseModel, ConfigDict, Field, Strict, StrictBool
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from invariantqp.errors import BadInput
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot

# A number in a file is a number: no strings, no booleans, nothing infinite unless a field says so.
Number = Annotated[float, Strict(), AllowInfNan(False)]
Positive = Annotated[Number, Field(gt=0.0)]
Vector3 = tuple[Number, Number, Number]
PoseAt = Callable[[float], Array]


def eased(u: float) -> float:
    """Minimum-jerk progress in [0, 1] at a share u of the duration, at rest at both ends."""
    u = min(max(u, 0.0), 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


class Section(BaseModel):
    """A table of a task file: unknown keys are refused."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True)


class _Path(Section):
    duration: Positive = Field(description="[s]", examples=[4.0])
    jumps: ClassVar[bool] = False  # whether the target gets where it is without a velocity to feed forward


class LinePath(_Path):
    """A straight line with a turn about a fixed axis, there, or there and back."""

    kind: Literal["line"]
    move: Vector3 = Field((0.0, 0.0, 0.0), description="displacement in base axes [m]", examples=[[0.1, 0.0, 0.0]])
    turn: Vector3 = Field((0.0, 0.0, 0.0), description="rotation vector in base axes [rad]", examples=[[0.0, 0.0, 0.5]])
    there_and_back: StrictBool = False

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        T0 = robot.pose(start)
        move, turn = np.array(self.move), np.array(self.turn)

        def pose(t: float) -> Array:
            share = _share(t / self.duration, self.there_and_back)
            return _displaced(T0, share * move, share * turn)

        return pose


class CirclePath(_Path):
    """Turns of a circle through the start, while the tool rocks about an axis and back."""

    kind: Literal["circle"]
    centre: Vector3 = Field(description="from the start, in base axes [m]", examples=[[0.0, 0.05, 0.0]])
    normal: Vector3 = Field((0.0, 0.0, 1.0), description="axis of the circle in base axes", examples=[[0.0, 0.0, 1.0]])
    turns: Number = Field(1.0, examples=[2.0])
    rock: Vector3 = Field(
        (0.0, 0.0, 0.0), description="largest rotation vector, once a turn [rad]", examples=[[0.2, 0, 0]]
    )

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`.

        Raises:
            BadInput: a centre at the start or a zero normal.
        """
        T0 = robot.pose(start)
        centre, normal, rock = np.array(self.centre), np.array(self.normal), np.array(self.rock)
        if not centre.any() or not normal.any():
            raise BadInput("path", "a zero centre or normal", "a centre away from the start and an axis direction")
        normal = normal / np.linalg.norm(normal)

        def pose(t: float) -> Array:
            angle = 2.0 * np.pi * self.turns * eased(t / self.duration)
            move = centre - Rotation.from_rotvec(angle * normal).apply(centre)
            return _displaced(T0, move, 0.5 * (1.0 - np.cos(angle)) * rock)

        return pose


class ScrewPath(_Path):
    """A turn about an axis, with a slide along it: what a hinge or a thread allows."""

    kind: Literal["screw"]
    axis: Vector3 = Field(description="in base axes", examples=[[0.0, 0.0, 1.0]])
    point: Vector3 = Field(description="of the axis, from the start [m]", examples=[[-0.4, 0.0, 0.0]])
    angle: Number = Field(description="[rad]", examples=[0.8])
    pitch: Number = Field(0.0, description="[m/rad]", examples=[0.0])
    there_and_back: StrictBool = False

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`.

        Raises:
            BadInput: a zero axis.
        """
        T0 = robot.pose(start)
        screw = screws.helical(self.axis, T0[:3, 3] + self.point, self.pitch)
        turn = self.angle * screw
        return lambda t: se3.exp(_share(t / self.duration, self.there_and_back) * turn, check=False).dot(T0)


class JointsPath(_Path):
    """The tool poses of a joint motion through waypoints: what the arm can do, asked for in task space."""

    kind: Literal["joints"]
    waypoints: Annotated[list[list[Number]], Field(min_length=1)] = Field(
        description="joint positions after the start [rad, m]", examples=[[[0.0, 0.5, 0.0]]]
    )

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`.

        Raises:
            BadInput: a waypoint with another number of joints.
        """
        for i, waypoint in enumerate(self.waypoints):
            if len(waypoint) != len(start):
                raise BadInput(f"path.waypoints[{i}]", f"{len(waypoint)} joints", f"{len(start)}, one a joint")
        knots = np.vstack((start, self.waypoints))
        spline = CubicSpline(np.linspace(0.0, 1.0, len(knots)), knots, bc_type="natural")
        return lambda t: robot.pose(spline(eased(t / self.duration)))


class HoldPath(_Path):
    """A pose displaced from the start, there at once and gone at once where it goes back: a target that jumps."""

    kind: Literal["hold"]
    move: Vector3 = Field((0.0, 0.0, 0.0), description="displacement in base axes [m]", examples=[[3.0, 0.0, 0.0]])
    turn: Vector3 = Field((0.0, 0.0, 0.0), description="rotation vector [rad]", examples=[[0.0, 0.0, 3.1]])
    begin: Annotated[Number, Field(ge=0.0)] = Field(0.0, description="when it jumps there [s]", examples=[0.5])
    end: Positive | None = Field(None, description="when it jumps back [s]; left out: never", examples=[1.5])
    jumps: ClassVar[bool] = True

    def along(self, robot: Robot, start: Array) -> PoseAt:
        """The pose at a time, for a robot that starts at joint positions `start`."""
        T0 = robot.pose(start)
        there = _displaced(T0, np.array(self.move), np.array(self.turn))
        end = np.inf if self.end is None else self.end
        return lambda t: there if self.begin <= t < end else T0


Path = Annotated[LinePath | CirclePath | ScrewPath | JointsPath | HoldPath, Field(discriminator="kind")]


def _share(u: float, there_and_back: bool) -> float:
    return eased(2.0 * u) - eased(2.0 * u - 1.0) if there_and_back else eased(u)


def _displaced(T0: Array, move: Array, turn: Array) -> Array:
    T = T0.copy()
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix().dot(T0[:3, :3])
    T[:3, 3] += move
    return T
