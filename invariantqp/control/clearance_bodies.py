"""The bodies of a clearance: shapes of an arm's links, obstacles, and other arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.limits import no_degrees, not_believed, refuse
from invariantqp.errors import BadInput, UnknownName, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits import accelerations


class Part(NamedTuple):
    """A shape as one of the bodies."""

    name: str
    shape: Shape
    body: int  # moved by the first so many joints of its arm
    frame: Array | None  # (4, 4) of its link at q = 0; None for an obstacle, which is where it was moved to
    around: int = 0  # 1 for an obstacle; for a link of another arm -1, -2, ..., by which one it is


class OtherArm:
    """Another arm as an obstacle: its links move when `move` is called. Each of two arms has the other as one.

    Attributes:
        robot: that arm; both have the same base frame: put it where it stands with `load_robot(base=)`.
        bodies: the shapes of its links.
        name: what its links' names begin with.
        q: (m,) where its joints are.
        velocity: (m,) how fast, as it was told; zero where it was not.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Mapping[str, Sequence[Shape]] | None = None,
        *,
        name: str = "other",
        acceleration_limit: ArrayLike | None = None,
    ) -> None:
        """Another arm.

        Args:
            robot: that arm, its base frame the same as this one's.
            bodies: as in `Clearance`.
            name: what its links' names begin with.
            acceleration_limit: (m,) or one for all [rad/s^2, length/s^2], of an arm that has a clearance from this one
                in its own loop: it brakes for it as this one does, and each takes half of the room. None is an arm that
                goes where its velocity says, whatever is in its way.

        Raises:
            BadInput: as `Clearance`; accelerations that are not above zero.
        """
        self.robot: Chain = chain_of(robot)
        self.bodies = shapes_of(self.robot, bodies)
        self.name = name if isinstance(name, str) else arrays.strings([name], "name")[0]
        m = len(self.robot.names)
        self._brakes = acceleration_limit is not None
        a = np.zeros(m) if acceleration_limit is None else accelerations(acceleration_limit, m)
        ranges = self.robot.position_lower, self.robot.position_upper
        self.limits = np.array((self.robot.velocity_limit, a, *ranges))
        self.q, self.velocity, self.knows_velocity = np.zeros(m), np.zeros(m), False
        self._no_degrees = no_degrees(self.robot, self.robot.screws)

    @property
    def yields(self) -> bool:
        """Whether it makes way too, and each takes half of the room: it is said to, or its velocity is not known."""
        return self._brakes or not self.knows_velocity

    def move(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Say where its joints are from now on, between ticks.

        Args:
            q: (m,) its joint positions.
            velocity: (m,) its joint velocity; None is as its last two positions say, over the ticks between them, and
                each arm may then take half of the room between them, or what the other one leaves: two arms that stop
                at once, each with the other as an obstacle.

        Raises:
            BadInput: NaN, wrong lengths, or degrees.
        """
        self.q, m = self.believed(q), len(self.robot.names)
        self.velocity = np.zeros(m) if velocity is None else np.array(arrays.vector(velocity, m, "velocity"))
        self.knows_velocity = velocity is not None

    def believed(self, q: ArrayLike, argument: str = "q") -> Array:
        """Its joint positions (m,), copied; errors name the argument.

        Raises:
            BadInput: NaN, a wrong length, or a joint outside its range and two turns from zero.
        """
        positions = np.array(arrays.vector(q, len(self.robot.names), argument))
        refuse(not_believed(self.robot, positions, self._no_degrees), argument)
        return positions


def parts_of(robot: Chain, bodies: Mapping[str, Sequence[Shape]], obstacles: Sequence[Shape | OtherArm]) -> list[Part]:
    """All shapes, each with what moves it.

    Raises:
        BadInput: obstacles that are none, or of one name.
    """
    parts: list[Part] = []
    for link, shapes in bodies.items():
        body, frame = frame_of(robot, link)
        parts += [Part(link, shape, body, frame) for shape in shapes]
    names, arms = list(bodies), 0
    for obstacle in obstacles:
        if isinstance(obstacle, (Shape, OtherArm)) and obstacle.name in names:
            expected = "names of their own for obstacles, or none for shapes: these are numbered"
            raise BadInput("obstacles", f"a second body {obstacle.name!r}", expected)
        if isinstance(obstacle, OtherArm):
            arms += 1
            names.append(obstacle.name)
            for link, shapes in obstacle.bodies.items():
                body, frame = frame_of(obstacle.robot, link)
                parts += [Part(f"{obstacle.name}/{link}", shape, body, frame, -arms) for shape in shapes]
            continue
        if not isinstance(obstacle, Shape):
            raise BadInput("obstacles", excerpt(obstacle), "a Sphere, Capsule, Box, HalfSpace, Mesh or OtherArm")
        name = obstacle.called
        if not obstacle.name:
            name = next(n for i in range(len(names) + 1) if (n := name if i == 0 else f"{name} {i + 1}") not in names)
        names.append(name)
        parts.append(Part(name, obstacle, 0, None, 1))
    return parts


def frame_of(robot: Chain, name: str) -> tuple[int, Array]:
    """How many joints move a link, and its (4, 4) frame at q = 0; as `Clearance` takes the names of bodies.

    Raises:
        UnknownName: no such link or joint.
    """
    for link in robot.links:
        if link.name == name:
            return link.body, link.frame
    if name in (robot.tool, "tool"):
        return len(robot.names), np.asarray(robot.home)
    if name in robot.names:
        return robot.names.index(name) + 1, np.eye(4)
    if name == "base":
        return 0, np.eye(4)
    known = dict.fromkeys((*(link.name for link in robot.links), "tool", "base", *robot.names))
    raise UnknownName("link", str(name), [], list(known))


def chain_of(robot: Any) -> Chain:
    """A robot that is known joint by joint.

    Raises:
        BadInput: another one.
    """
    if not isinstance(robot, Chain):
        raise BadInput("robot", excerpt(robot), "a robot that load_robot returned")
    return robot


def shapes_of(robot: Chain, bodies: Mapping[str, Sequence[Shape]] | None) -> dict[str, list[Shape]]:
    """The shapes of each link; those behind joints that this arm does not have are left out."""
    if bodies is None:
        unknown = {link.name for link in robot.links if link.unknown}
        return {name: shapes for name, shapes in bodies_of(robot).items() if name not in unknown}
    expected = "{link: [shapes in its frame]}"
    if not isinstance(bodies, Mapping):
        raise BadInput("bodies", excerpt(bodies), expected)
    made: dict[str, list[Shape]] = {}
    for link, shapes in bodies.items():
        if not isinstance(link, str):
            raise BadInput("bodies", excerpt(link), f"{expected}, links by name")
        given: list[Shape] = [shapes] if isinstance(shapes, Shape) else list(arrays.listed(shapes, "bodies", expected))
        wrong = next((shape for shape in given if not isinstance(shape, Shape) or shape.core is Core.MESH), None)
        if wrong is not None:
            raise BadInput(
                "bodies",
                f"{excerpt(wrong)} of {link!r}",
                "shapes: Sphere, Capsule, Box, HalfSpace",
                "Meshes are for obstacles; capsules about a link's meshes are made where bodies= is left out.",
            )
        frame_of(robot, link)
        made[link] = given
    return made
