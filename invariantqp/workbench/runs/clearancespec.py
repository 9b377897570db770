"""The [[obstacle]] and [clearance] tables of a task file, and the obstacles and clearance of a run."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Box, Capsule, HalfSpace, Shape, Sphere
from invariantqp.robots.load import load_robot
from invariantqp.workbench.runs.section import Direction, NotNegative, Number, Positive, Section, Vector3

if TYPE_CHECKING:
    from invariantqp.control.clearance import Clearance
    from invariantqp.control.clearance_bodies import OtherArm

# Required and optional keys of each kind of obstacle.
OBSTACLE_KEYS = {
    "sphere": (("radius",), ("moves",)),
    "capsule": (("radius", "to"), ("moves",)),
    "box": (("size",), ("turn", "moves")),
    "mesh": (("source",), ("turn", "scale", "hull", "moves")),
    "half-space": ((), ("normal", "moves")),
    "arm": (("source", "start"), ("turn", "end")),
}


class BodySpec(Section):
    """A capsule of a link, in the link's frame; a ball where `a` is `b`."""

    link: str = Field(min_length=1, description="a link, a joint's name for what it moves, or tool", examples=["tool"])
    a: Vector3 = Field(description="one end of its axis [m]", examples=[[0.0, 0.0, 0.0]])
    b: Vector3 = Field(description="the other end [m]", examples=[[0.0, 0.0, 0.1]])
    radius: Positive = Field(description="[m]", examples=[0.05])


class ObstacleSpec(Section):
    """One [[obstacle]]: a sphere, capsule, box, mesh, half-space, or another arm."""

    kind: Literal["sphere", "capsule", "box", "mesh", "half-space", "arm"] = Field(
        description="kind of obstacle", examples=["box"]
    )
    name: str = Field("", description="its name in reasons", examples=["shelf"])
    at: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="its middle, one end of a capsule's axis, a point of a half-space's plane, the base of an arm, the "
        "origin of a mesh [m]",
        examples=[[0.5, 0.0, 0.4]],
    )
    turn: Vector3 = Field(
        (0.0, 0.0, 0.0), description="axis times angle of a box, a mesh or an arm [rad]", examples=[[0, 0, 1.57]]
    )
    size: tuple[NotNegative, NotNegative, NotNegative] | None = Field(
        None, description="whole edges of a box [m]", examples=[[0.4, 0.6, 0.02]]
    )
    radius: NotNegative | None = Field(None, description="of a sphere or a capsule [m]", examples=[0.1])
    to: Vector3 | None = Field(None, description="the other end of a capsule's axis [m]", examples=[[0.5, 0.3, 0.4]])
    normal: Direction = Field((0.0, 0.0, 1.0), description="out of a half-space", examples=[[0.0, 0.0, 1.0]])
    moves: Vector3 = Field(
        (0.0, 0.0, 0.0),
        description="displacement to the other end of its motion there and back [m]",
        examples=[[0.0, 0.3, 0.0]],
    )
    source: str | None = Field(
        None, description="an arm's name or URDF; a mesh's file, beside this one or by its path", examples=["ur5"]
    )
    scale: Positive = Field(1.0, description="of a mesh: 0.001 for a file in millimetres", examples=[0.001])
    hull: bool = Field(False, description="use the convex hull of a mesh, which is solid", examples=[True])
    start: list[Number] | None = Field(None, description="an arm's joint positions [rad, m]", examples=[[0.0, -1.2]])
    end: list[Number] | None = Field(
        None, description="joint positions at the other end of their motion there and back", examples=[[1.0, -1.2]]
    )
    period: Positive = Field(4.0, description="of that motion [s]", examples=[4.0])

    @model_validator(mode="after")
    def _is_whole(self) -> ObstacleSpec:
        one, (needs, may) = f"{'a' if self.kind[0] != 'a' else 'an'} {self.kind}", OBSTACLE_KEYS[self.kind]
        missing = [key for key in needs if getattr(self, key) is None]
        if missing:
            raise ValueError(f"{one} needs {' and '.join(missing)}")
        known = ("kind", "name", "at", *needs, *may, "period")
        if more := sorted(self.model_fields_set.difference(known)):
            raise ValueError(f"{one} has no {' and no '.join(more)} (known keys: {', '.join(known)})")
        if self.kind == "arm" and self.end is not None and len(self.end) != len(self.start or ()):
            raise ValueError("start and end of an arm have as many joints")
        return self

    def progress(self, t: float) -> tuple[float, float]:
        """The progress between its ends at t [s], from 0 to 1, and its rate [1/s]."""
        rate = 2.0 * pi / self.period
        return 0.5 * (1.0 - cos(rate * t)), 0.5 * rate * sin(rate * t)


class ClearanceSpec(Section):
    """The [clearance] table: arguments of `limits.Clearance`."""

    distance: NotNegative = Field(0.02, description="least distance that is kept [m]", examples=[0.02])
    exclude: list[tuple[str, str]] = Field(
        [], description="pairs without a least distance", examples=[[["tool", "table"]]]
    )
    body: list[BodySpec] | None = Field(
        None,
        description="capsules of the links; left out: fitted to the collision geometry of the robot's description",
        examples=[[{"link": "tool", "a": [0, 0, 0], "b": [0, 0, 0.1], "radius": 0.05}]],
    )


class ObstacleScene:
    """The obstacles of a run, and the clearance that the arm keeps from them."""

    def __init__(
        self, robot: Any, clearance: ClearanceSpec, obstacles: list[ObstacleSpec], resolve_source: Callable[[str], Any]
    ) -> None:
        """From the tables of a task; `resolve_source` finds the file of a robot that is an obstacle."""
        from invariantqp.control.clearance import Clearance

        self._specs = obstacles
        self.obstacles: list[Shape | OtherArm] = [_obstacle(spec, resolve_source) for spec in obstacles]
        for i, (spec, obstacle) in enumerate(zip(obstacles, self.obstacles, strict=True)):
            if not isinstance(obstacle, Shape):
                for key in ("start",) if spec.end is None else ("start", "end"):
                    obstacle.checked_positions(getattr(spec, key), f"obstacle[{i}].{key}")
        bodies: dict[str, list[Shape]] | None = None
        if clearance.body is not None:
            bodies = {}
            for body in clearance.body:
                bodies.setdefault(body.link, []).append(Capsule(body.a, body.b, body.radius))
        self.move(0.0)
        distance, exclude = clearance.distance, clearance.exclude
        self.clearance: Clearance = Clearance(robot, bodies, self.obstacles, distance, exclude=exclude)

    def move(self, t: float) -> None:
        """Move all obstacles to their poses at t [s]."""
        for spec, obstacle in zip(self._specs, self.obstacles, strict=True):
            progress, rate = spec.progress(t)
            if not isinstance(obstacle, Shape):
                start = np.array(spec.start)
                stroke = np.zeros(len(start)) if spec.end is None else np.array(spec.end) - start
                obstacle.move(start + progress * stroke, rate * stroke)
            elif any(spec.moves):
                stroke = np.array(spec.moves)
                obstacle.move(
                    se3.transform(translation=progress * stroke), np.concatenate((np.zeros(3), rate * stroke))
                )

    @property
    def is_moving(self) -> bool:
        """Whether any obstacle moves."""
        return any(spec.end is not None or any(spec.moves) for spec in self._specs)


def _obstacle(spec: ObstacleSpec, resolve_source: Callable[[str], Any]) -> Shape | OtherArm:
    from invariantqp.control.clearance_bodies import OtherArm  # loaded only where there are obstacles

    at: Array = np.array(spec.at)
    place = se3.transform(se3.rotation(np.array(spec.turn)), at)
    if spec.kind == "arm":
        return OtherArm(load_robot(resolve_source(str(spec.source)), base=place), name=spec.name or "other")
    if spec.kind == "mesh":
        from invariantqp.geometry.coal import Mesh  # coal is loaded where there is a mesh

        return Mesh(resolve_source(str(spec.source)), place, scale=spec.scale, hull=spec.hull, name=spec.name)
    if spec.kind == "sphere":
        return Sphere(at, spec.radius or 0.0, name=spec.name)
    if spec.kind == "capsule":
        return Capsule(at, spec.to or spec.at, spec.radius or 0.0, name=spec.name)
    if spec.kind == "box":
        return Box(place, spec.size or (0.0, 0.0, 0.0), name=spec.name)
    return HalfSpace(at, spec.normal, name=spec.name)
