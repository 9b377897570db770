"""The bodies of a clearance, an arm's links, obstacles and other arms, and which of them it keeps apart.

All that can touch: links on one body, neighbours at a joint, and what a description excludes or a caller does are left
out, each with its reason. The engine leaves out bodies that it shows to be nearer than the distance wherever the joints
between them are; nothing is left out because samples did not meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.limits import no_degrees, not_believed, refuse
from invariantqp.engine import law
from invariantqp.errors import BadInput, UnknownName, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Placed, places
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, continuous_turns
from invariantqp.robots.tree import Exclusions
from invariantqp.robots.urdf import excluded_pairs
from invariantqp.velocity.limits import accelerations


class Part(NamedTuple):
    """A shape as one of the bodies."""

    name: str
    shape: Shape
    body: int  # moved by the first so many joints of its arm
    frame: Array | None  # (4, 4) of its link at q = 0; None for an obstacle, which is where it was moved to
    around: int = 0  # 1 for an obstacle; for a link of another arm -1, -2, ..., by which one it is

    def at(self, pose: Array) -> Placed:
        """The shape, its core at a (4, 4) pose in the base frame."""
        return Placed(self.shape.core, self.shape.radius, self.shape.half, pose, self.shape.solid)


class OtherArm:
    """Another arm as an obstacle: its links move when `move` is called. Each of two arms has the other as one.

    Attributes:
        robot: that arm; both have the same base frame: put it where it stands with `load_robot(base=)`.
        bodies: the shapes of its links.
        name: what its links' names begin with.
        q: (m,) where its joints are.
        velocity: (m,) how fast, as it was told; zero where it was not.
        turns: (m,) whole turns of its continuous joints; 0 of other joints.
        brakes: whether it has a clearance from this one in its own loop.
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
        self.brakes = acceleration_limit is not None
        a = np.zeros(m) if acceleration_limit is None else accelerations(acceleration_limit, m)
        ranges = self.robot.position_lower, self.robot.position_upper
        self.limits = np.array((self.robot.velocity_limit, a, *ranges))
        self.q, self.velocity, self.knows_velocity = np.zeros(m), np.zeros(m), False
        self.turns = continuous_turns(*ranges, self.robot.screws)
        self._no_degrees = no_degrees(self.robot, self.robot.screws)

    @property
    def yields(self) -> bool:
        """Whether it makes way too, and each takes half of the room: it is said to, or its velocity is not known."""
        return self.brakes or not self.knows_velocity

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
        positions = np.array(arrays.joints(q, self.robot.names, argument))
        refuse(not_believed(self.robot, positions, self._no_degrees), argument)
        return positions


def parts_of(robot: Chain, bodies: Mapping[str, Sequence[Shape]], obstacles: Sequence[Shape | OtherArm]) -> list[Part]:
    """All shapes, each with what moves it."""
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
    """How many joints move a link, and its (4, 4) frame at q = 0; as `Clearance` takes the names of bodies."""
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
    """A robot that is known joint by joint."""
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


class Dropped(NamedTuple):
    """A pair that is not kept apart, and why."""

    first: str
    second: str
    reason: str

    def __str__(self) -> str:
        return f"{self.first} and {self.second}: {self.reason}"


def pairs_of(
    robot: Chain,
    parts: Sequence[Part],
    pairs: Iterable[tuple[str, str]] | None,
    exclude: Iterable[tuple[str, str]] | str | PathLike[str],
) -> tuple[list[tuple[int, int]], tuple[Dropped, ...]]:
    """The pairs of parts that are kept apart, by their numbers, and those of bodies that are not, as in `Clearance`."""
    names = list(dict.fromkeys(part.name for part in parts))
    wanted = None if pairs is None else {frozenset(pair) for pair in _named(pairs, "pairs", names)}
    apart: Exclusions = excluded_pairs(robot, exclude if isinstance(exclude, (str, PathLike)) else None)
    if not isinstance(exclude, (str, PathLike)):
        apart = {**apart, **{frozenset(pair): "excluded" for pair in _named(exclude, "exclude", names)}}
    dropped: dict[tuple[str, str], str] = {}
    kept = []
    for i, j in combinations(range(len(parts)), 2):
        a, b = parts[i], parts[j]
        if a.around or a.name == b.name:
            continue
        if reason := _needless(robot, a, b, wanted, apart):
            dropped[a.name, b.name] = reason
        else:
            kept.append((i, j))
    return kept, tuple(Dropped(*two, reason) for two, reason in dropped.items())


def _needless(robot: Chain, a: Part, b: Part, wanted: set[frozenset[str]] | None, apart: Exclusions) -> str:
    """Why two bodies need not be kept apart, "" where they must be."""
    names = frozenset((a.name, b.name))
    if wanted is not None:
        return apart.get(names, "") if names in wanted else "not among the pairs given"
    if names in apart:
        return apart[names]
    if b.around:
        return "" if a.body else "no joint moves it"
    if a.body == b.body:
        return "fixed to one another"
    floor = Core.HALF_SPACE in (a.shape.core, b.shape.core)  # nobody's neighbour
    if floor or abs(a.body - b.body) > 1:
        return ""
    return f"neighbours at {robot.names[robot.joints.coordinates[max(a.body, b.body) - 1]]}"


def _named(pairs: Iterable[tuple[str, str]], argument: str, known: list[str]) -> list[tuple[str, str]]:
    """Pairs of names, each of a body that is there."""
    found = []
    for pair in arrays.listed(pairs, argument, "pairs of names, [(link, link), (link, obstacle), ...]"):
        if isinstance(pair, str) or not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise BadInput(argument, excerpt(pair), "the names of two bodies")
        for name in pair:
            if name not in known:
                raise UnknownName("body", str(name), [], known)
        found.append((pair[0], pair[1]))
    return found


def engine_of(
    robot: Chain,
    arms: Sequence[OtherArm],
    parts: Sequence[Part],
    pairs: Sequence[tuple[int, int]],
    distance: float,
    *,
    chosen: bool,
) -> Any:
    """The engine's clearance of an arm, arms around it and parts; pairs of these that somebody chose all count."""
    m, free = len(robot.names), np.full(len(robot.names), np.inf)
    limits = np.array((robot.velocity_limit, free, robot.position_lower, robot.position_upper))
    moved = [(*robot.joints[:2], limits, np.zeros(m), False)]
    moved += [(*arm.robot.joints[:2], arm.limits, arm.turns, arm.brakes) for arm in arms]
    before = np.cumsum([0, *(len(coordinates) for _, coordinates, *_ in moved)])
    obstacles = sum(part.around == 1 for part in parts)
    shapes, placed = [], 0
    for part in parts:
        other = max(-part.around, 0)
        mover = placed if part.around == 1 else obstacles + other - 1 if other else -1
        placed += part.around == 1
        T = part.shape.place if part.frame is None else part.frame.dot(part.shape.place)
        shapes.append((before[other] + part.body if part.body else 0, mover, *part.at(T).numbers))
    of_bodies = {two: k for k, two in enumerate(dict.fromkeys((parts[i].name, parts[j].name) for i, j in pairs))}
    table = [(i, j, of_bodies[parts[i].name, parts[j].name]) for i, j in pairs]
    return law.Clearance(
        distance,
        moved,
        np.array(shapes, float).reshape(-1, 19),
        np.array(table, float).reshape(-1, 3),
        obstacles,
        chosen,
        _places_of(tuple(parts)) if any(part.shape.solid is not None for part in parts) else None,
    )


def _places_of(parts: tuple[Part, ...]) -> Callable[[int, int, Array, Array], Array]:
    """What finds (k, 7) distance, normal and point of each place of two parts, one a mesh, at poses (4, 4) of both."""

    def found(i: int, j: int, one: Array, other: Array) -> Array:
        near = places(parts[i].at(one[0]), parts[j].at(other[0]))
        return np.array([(place.distance, *place.normal, *place.point) for place in near]).reshape(-1, 7)

    return found
