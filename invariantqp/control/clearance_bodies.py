"""The bodies of a clearance: links, obstacles and other arms, and the pairs of bodies that are checked.

A pair is dropped, with a reason, if both bodies are fixed to one another or neighbours at a joint, or if the robot's
description or the user excludes it. The engine drops pairs that are provably always nearer than the distance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.plausibility import bounds_against_degrees, require_plausible
from invariantqp.engine import law
from invariantqp.errors import BadInput, UnknownName, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import CollisionObject, distances
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, continuous_turns
from invariantqp.robots.tree import Exclusions
from invariantqp.robots.urdf import excluded_pairs
from invariantqp.velocity.limits import accelerations


class Geom(NamedTuple):
    """A shape of a body.

    Attributes:
        name: of the body.
        shape: the shape.
        joints: number of joints of its arm that move it.
        frame: (4, 4) pose of its link at q = 0; None for an obstacle.
        arm: 0 for the arm itself, 1, 2, ... for other arms; 0 for an obstacle.
    """

    name: str
    shape: Shape
    joints: int
    frame: Array | None
    arm: int = 0

    @property
    def is_obstacle(self) -> bool:
        """Whether it is an obstacle, moved by `Shape.move`."""
        return self.frame is None

    @property
    def is_own_link(self) -> bool:
        """Whether it is a link of the arm itself."""
        return self.frame is not None and self.arm == 0

    def at(self, pose: Array) -> CollisionObject:
        """The shape with its core at a (4, 4) pose in the base frame."""
        return CollisionObject(self.shape.core, self.shape.radius, self.shape.half, pose, self.shape.mesh)


class OtherArm:
    """Another arm as an obstacle, moved by `move`. Two arms that avoid each other each have an OtherArm of the other.

    Attributes:
        robot: that arm, in the same base frame (`load_robot(base=)` sets its base).
        bodies: the shapes of its links.
        name: prefix of its links' names.
        q: (m,) its joint positions.
        velocity: (m,) its joint velocity as given to `move`, else zero.
        has_velocity: whether `move` was given a velocity.
        turns: (m,) period of its continuous joints; 0 for other joints.
        brakes: whether it has a clearance from this arm in its own loop.
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
            name: prefix of its links' names.
            acceleration_limit: (m,) or one for all [rad/s^2, length/s^2], of an arm that has a clearance from this one
                in its own loop: both brake, and each may use half of the margin. None is an arm that keeps its
                velocity.

        Raises:
            BadInput: as `Clearance`; accelerations that are not above zero.
        """
        self.robot: Chain = chain_of(robot)
        self.bodies = shapes_of(self.robot, bodies)
        self.name = name if isinstance(name, str) else arrays.strings([name], "name")[0]
        m = len(self.robot.names)
        self.brakes = acceleration_limit is not None
        a = np.zeros(m) if acceleration_limit is None else accelerations(acceleration_limit, m)
        ranges = self.robot.position_lower, self.robot.position_upper
        self.limits = np.array((self.robot.velocity_limit, a, *ranges))
        self.q, self.velocity, self.has_velocity = np.zeros(m), np.zeros(m), False
        self.turns = continuous_turns(*ranges, self.robot.screws)
        self._plausible = bounds_against_degrees(self.robot, self.robot.screws)

    def move(self, q: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Set its joint positions, between ticks.

        Args:
            q: (m,) its joint positions.
            velocity: (m,) its joint velocity; None is estimated from its last two positions, and each arm may then use
                half of the margin between them.

        Raises:
            BadInput: NaN, wrong lengths, or degrees.
        """
        self.q, m = self.checked_positions(q), len(self.robot.names)
        self.velocity = np.zeros(m) if velocity is None else np.array(arrays.vector(velocity, m, "velocity"))
        self.has_velocity = velocity is not None

    def checked_positions(self, q: ArrayLike, argument: str = "q") -> Array:
        """Plausible joint positions (m,), copied; errors name the argument.

        Raises:
            BadInput: NaN, a wrong length, or a joint outside its range and two turns from zero.
        """
        positions = np.array(arrays.joint_vector(q, self.robot.names, argument))
        require_plausible(self.robot, positions, self._plausible, argument)
        return positions


def geoms_of(robot: Chain, bodies: Mapping[str, Sequence[Shape]], obstacles: Sequence[Shape | OtherArm]) -> list[Geom]:
    """All shapes: of the arm's links, then of obstacles and other arms."""
    geoms = [Geom(link, shape, *frame_of(robot, link)) for link, shapes in bodies.items() for shape in shapes]
    names, arms = list(bodies), 0
    for obstacle in obstacles:
        if not isinstance(obstacle, (Shape, OtherArm)):
            raise BadInput("obstacles", excerpt(obstacle), "a Sphere, Capsule, Box, HalfSpace, Mesh or OtherArm")
        if obstacle.name in names:
            expected = "names of their own for obstacles, or none for shapes: these are numbered"
            raise BadInput("obstacles", f"a second body {obstacle.name!r}", expected)
        if isinstance(obstacle, OtherArm):
            arms, name = arms + 1, obstacle.name
            geoms += [
                Geom(f"{name}/{link}", shape, *frame_of(obstacle.robot, link), arms)
                for link, shapes in obstacle.bodies.items()
                for shape in shapes
            ]
        else:
            name, number = obstacle.label, 1
            while not obstacle.name and name in names:
                number += 1
                name = f"{obstacle.label} {number}"
            geoms.append(Geom(name, obstacle, 0, None))
        names.append(name)
    return geoms


def frame_of(robot: Chain, name: str) -> tuple[int, Array]:
    """The number of joints that move a body named as in `Clearance`, and its (4, 4) frame at q = 0."""
    for link in robot.links:
        if link.name == name:
            return link.body, link.frame
    if name in (robot.tool, "tool"):
        return len(robot.joints.coordinates), np.asarray(robot.home)
    if name in robot.names:
        return robot.joints.drivers[robot.names.index(name)] + 1, np.eye(4)
    if name == "base":
        return 0, np.eye(4)
    known = dict.fromkeys((*(link.name for link in robot.links), "tool", "base", *robot.names))
    raise UnknownName("link", str(name), [], list(known))


def chain_of(robot: Any) -> Chain:
    """The robot, checked to be a `Chain`."""
    if not isinstance(robot, Chain):
        raise BadInput("robot", excerpt(robot), "a robot that load_robot returned")
    return robot


def shapes_of(robot: Chain, bodies: Mapping[str, Sequence[Shape]] | None) -> dict[str, list[Shape]]:
    """The shapes of each link; without `bodies`, those of the robot's description whose pose is known."""
    if bodies is None:
        unknown = {link.name for link in robot.links if link.unknown}
        return {name: shapes for name, shapes in bodies_of(robot).items() if name not in unknown}
    expected = "{link: [shapes in its frame]}"
    if not isinstance(bodies, Mapping):
        raise BadInput("bodies", excerpt(bodies), expected)
    checked: dict[str, list[Shape]] = {}
    for link, shapes in bodies.items():
        if not isinstance(link, str):
            raise BadInput("bodies", excerpt(link), f"{expected}, links by name")
        given: list[Shape] = (
            [shapes] if isinstance(shapes, Shape) else list(arrays.sequence(shapes, "bodies", expected))
        )
        wrong = next((shape for shape in given if not isinstance(shape, Shape) or shape.core is Core.MESH), None)
        if wrong is not None:
            raise BadInput(
                "bodies",
                f"{excerpt(wrong)} of {link!r}",
                "shapes: Sphere, Capsule, Box, HalfSpace",
                "Meshes are for obstacles; capsules about a link's meshes are made where bodies= is left out.",
            )
        frame_of(robot, link)
        checked[link] = given
    return checked


class Dropped(NamedTuple):
    """A pair of bodies that is not checked, and why."""

    first: str
    second: str
    reason: str

    def __str__(self) -> str:
        return f"{self.first} and {self.second}: {self.reason}"


def pairs_of(
    robot: Chain,
    geoms: Sequence[Geom],
    pairs: Iterable[tuple[str, str]] | None,
    exclude: Iterable[tuple[str, str]] | str | PathLike[str],
) -> tuple[list[tuple[int, int]], tuple[Dropped, ...]]:
    """The pairs of shapes that are checked, by index, and the pairs of bodies that are not, as in `Clearance`."""
    names = list(dict.fromkeys(geom.name for geom in geoms))
    chosen = None if pairs is None else {frozenset(pair) for pair in _checked_names(pairs, "pairs", names)}
    exclusions: Exclusions = excluded_pairs(robot, exclude if isinstance(exclude, (str, PathLike)) else None)
    if not isinstance(exclude, (str, PathLike)):
        added = _checked_names(exclude, "exclude", names)
        exclusions = {**exclusions, **{frozenset(pair): "excluded" for pair in added}}
    dropped: dict[tuple[str, str], str] = {}
    checked = []
    for i, j in combinations(range(len(geoms)), 2):
        a, b = geoms[i], geoms[j]
        if not a.is_own_link or a.name == b.name:
            continue
        if reason := _drop_reason(robot, a, b, chosen, exclusions):
            dropped[a.name, b.name] = reason
        else:
            checked.append((i, j))
    return checked, tuple(Dropped(*names, reason) for names, reason in dropped.items())


def _drop_reason(robot: Chain, a: Geom, b: Geom, chosen: set[frozenset[str]] | None, exclusions: Exclusions) -> str:
    """Why a pair of a link and another body is not checked, "" if it is."""
    names = frozenset((a.name, b.name))
    if chosen is not None:
        return exclusions.get(names, "") if names in chosen else "not among the pairs given"
    if names in exclusions:
        return exclusions[names]
    if not b.is_own_link:
        return "" if a.joints else "no joint moves it"
    if a.joints == b.joints:
        return "fixed to one another"
    is_half_space = Core.HALF_SPACE in (a.shape.core, b.shape.core)  # without neighbours
    if is_half_space or abs(a.joints - b.joints) > 1:
        return ""
    return f"neighbours at {robot.names[robot.joints.coordinates[max(a.joints, b.joints) - 1]]}"


def _checked_names(pairs: Iterable[tuple[str, str]], argument: str, known: list[str]) -> list[tuple[str, str]]:
    """Pairs of names of known bodies."""
    checked = []
    for pair in arrays.sequence(pairs, argument, "pairs of names, [(link, link), (link, obstacle), ...]"):
        if isinstance(pair, str) or not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise BadInput(argument, excerpt(pair), "the names of two bodies")
        for name in pair:
            if name not in known:
                raise UnknownName("body", str(name), [], known)
        checked.append((pair[0], pair[1]))
    return checked


def engine_of(
    robot: Chain,
    arms: Sequence[OtherArm],
    geoms: Sequence[Geom],
    pairs: Sequence[tuple[int, int]],
    distance: float,
    *,
    keep_all: bool,
) -> Any:
    """The engine's clearance; `keep_all` keeps pairs that are always nearer than the distance."""
    m, free = len(robot.names), np.full(len(robot.names), np.inf)
    limits = np.array((robot.velocity_limit, free, robot.position_lower, robot.position_upper))
    engine_arms = [(*robot.joints[:2], limits, np.zeros(m), False)]
    engine_arms += [(*arm.robot.joints[:2], arm.limits, arm.turns, arm.brakes) for arm in arms]
    first_joint = np.cumsum([0, *(len(coordinates) for _, coordinates, *_ in engine_arms)])
    obstacles = sum(geom.is_obstacle for geom in geoms)
    shapes, obstacle = [], 0
    for geom in geoms:
        mover = obstacle if geom.is_obstacle else obstacles + geom.arm - 1 if geom.arm else -1
        obstacle += geom.is_obstacle
        T = geom.shape.placement if geom.frame is None else geom.frame.dot(geom.shape.placement)
        shapes.append((first_joint[geom.arm] + geom.joints if geom.joints else 0, mover, *geom.at(T).numbers))
    names = [(geoms[i].name, geoms[j].name) for i, j in pairs]
    number = {pair: k for k, pair in enumerate(dict.fromkeys(names))}
    table = [(i, j, number[pair]) for (i, j), pair in zip(pairs, names, strict=True)]
    return law.Clearance(
        distance,
        engine_arms,
        np.array(shapes, float).reshape(-1, 19),
        np.array(table, float).reshape(-1, 3),
        obstacles,
        keep_all,
        _mesh_witnesses(tuple(geoms)) if any(geom.shape.mesh is not None for geom in geoms) else None,
    )


def _mesh_witnesses(geoms: tuple[Geom, ...]) -> Callable[[int, int, Array, Array], Array]:
    """A function that returns (k, 7) distance, normal and point of the witnesses of a mesh and another shape."""

    def witnesses(i: int, j: int, first: Array, second: Array) -> Array:
        near = distances(geoms[i].at(first[0]), geoms[j].at(second[0]))
        return np.array([(place.distance, *place.normal, *place.point) for place in near]).reshape(-1, 7)

    return witnesses
