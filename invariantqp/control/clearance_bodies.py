"""The bodies of a clearance, an arm's links, obstacles and other arms, and which of them it keeps apart.

All that can touch: links on one body, neighbours at a joint, what a description excludes or a caller does, and bodies
that are shown to be nearer than the distance wherever the joints between them are, are left out, each with its reason.
Nothing is left out because samples did not meet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.clearance_rows import OF_SHAPE, levers_of, moved_by, placed_at, starts_of
from invariantqp.control.limits import no_degrees, not_believed, refuse
from invariantqp.errors import BadInput, UnknownName, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Place, Solid, places
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, continuous_turns
from invariantqp.robots.tree import Exclusions
from invariantqp.robots.urdf import excluded
from invariantqp.velocity.limits import accelerations

# Whether a pair is always near is looked at in so many states, at most; one that is not shown to be is kept.
STATES = 2000


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
        turns: (m,) whole turns of its continuous joints; 0 of other joints.
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
        self.turns = continuous_turns(*ranges, self.robot.screws)
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
        return len(robot.names), np.asarray(robot.home)
    if name in robot.names:
        return robot.names.index(name) + 1, np.eye(4)
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


class Pairs:
    """The shapes of a clearance, and which of them are kept apart."""

    def __init__(
        self,
        robots: Sequence[Chain],
        parts: Sequence[Part],
        distance: float,
        pairs: Iterable[tuple[str, str]] | None,
        exclude: Iterable[tuple[str, str]] | str | PathLike[str],
    ) -> None:
        """The pairs of parts of robots, the arm and those around it; the rest is as in `Clearance`."""
        self.parts, self.robots, self._robot, self._distance = tuple(parts), robots, robots[0], distance
        self.screws = np.hstack([robot.screws for robot in robots])  # (6, M) of all their joints
        self.starts = starts_of(robots).astype(float)  # (M + 1,) at which joint the arm of each body begins
        self.moving = [i for i, part in enumerate(parts) if part.frame is None]  # which parts are obstacles
        # (n, 18) of the shapes, as the core takes them; (n, M) how far any point of one moves at most by each joint.
        self.numbers = np.array([self._numbers(part) for part in parts]).reshape(-1, OF_SHAPE)
        self.levers = levers_of(robots, self.numbers)
        solids = tuple(part.shape.solid for part in parts)  # None of what is no mesh
        self.solids: tuple[Solid | None, ...] = solids if any(solid is not None for solid in solids) else ()
        self._given = pairs is not None
        self.of_shapes, self.dropped = self._chosen(pairs, exclude)

    def _numbers(self, part: Part) -> Array:
        """(18,) of a shape; bodies are numbered one arm after the other, 0 is the world."""
        shape, before = part.shape, sum(len(robot.names) for robot in self.robots[: max(-part.around, 0)])
        T = (shape.pose if part.frame is None else part.frame).dot(shape.place)
        body = before + part.body if part.body else 0
        return np.concatenate(((body, shape.core, shape.radius), shape.half, T[:3, :3].ravel(), T[:3, 3]))

    def _chosen(
        self, pairs: Iterable[tuple[str, str]] | None, exclude: Iterable[tuple[str, str]] | str | PathLike[str]
    ) -> tuple[list[tuple[int, int]], tuple[Dropped, ...]]:
        """The pairs of shapes that are kept apart, and those of bodies that are not."""
        wanted = None if pairs is None else {frozenset(pair) for pair in self._named(pairs, "pairs")}
        apart: Exclusions = excluded(self._robot, exclude if isinstance(exclude, (str, PathLike)) else None)
        if not isinstance(exclude, (str, PathLike)):
            apart = {**apart, **{frozenset(pair): "excluded" for pair in self._named(exclude, "exclude")}}
        dropped: dict[tuple[str, str], str] = {}
        kept = []
        for i, j in combinations(range(len(self.parts)), 2):
            a, b = self.parts[i], self.parts[j]
            if a.around or a.name == b.name:
                continue
            if reason := self._needless(a, b, wanted, apart):
                dropped[a.name, b.name] = reason
            else:
                kept.append((i, j))
        bodies = [(self.parts[i].name, self.parts[j].name) for i, j in kept]
        for (i, j), two in zip(kept, bodies, strict=True):
            if not self.parts[j].around and two not in dropped and (reason := self.always_near(i, j, self.numbers)):
                dropped[two] = reason
        kept = [pair for pair, two in zip(kept, bodies, strict=True) if two not in dropped]
        return kept, tuple(Dropped(*two, reason) for two, reason in dropped.items())

    def _needless(self, a: Part, b: Part, wanted: set[frozenset[str]] | None, apart: Exclusions) -> str:
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
        return (
            "" if floor or abs(a.body - b.body) > 1 else f"neighbours at {self._robot.names[max(a.body, b.body) - 1]}"
        )

    def always_near(self, i: int, j: int, numbers: Array, others: Array | None = None) -> str:
        """The reason, where two shapes are nearer than the distance wherever the joints between them are; "" else.

        In other states they are at most as far apart as a place of theirs is, and a joint moves that by how far it is
        from its axis. So some states show it. The first shape is a link's; `others` (M - m,) are the joint positions of
        other arms.
        """
        m, bodies, around = len(self._robot.names), [int(numbers[k, 0]) for k in (i, j)], self.parts[j].around
        between = np.arange(bodies[0]) if around else np.arange(min(bodies), max(bodies))
        if self._given or not self._robot.screws[:3, between].any(axis=0).all():
            return ""  # asked for; a slide goes as far as it goes
        two = [i, j] if around or bodies[0] > bodies[1] else [j, i]  # the one that the joints move is the first
        solids = [self.parts[k].shape.solid for k in two]
        lowest, highest = np.maximum(self._robot.position_lower, -np.pi), np.minimum(self._robot.position_upper, np.pi)
        cells = [(lowest[between], highest[between])]
        q = np.concatenate((np.zeros(m), np.zeros(self.screws.shape[1] - m) if others is None else others))
        apart = (1.0 - 1e-9) * self._distance  # at the distance, but for rounding, is not nearer
        for _ in range(STATES):
            if not cells:
                return f"always nearer than {1e3 * self._distance:.1f} mm"
            low, high = cells.pop()
            q[between] = 0.5 * (low + high)
            J, motions = moved_by(self.robots, q)
            found = places(*placed_at(numbers[two], motions, (), solids))
            if found[0].distance > apart:
                return ""
            farthest, ways = min(self._farthest(place, J[:, between], 0.5 * (high - low)) for place in found)
            if farthest > apart:
                axis = int(np.argmax(ways))
                upper, lower = high.copy(), low.copy()
                upper[axis] = lower[axis] = q[between[axis]]
                cells += [(low, upper), (lower, high)]
        return ""

    @staticmethod
    def _farthest(place: Place, J: Array, turned: Array) -> tuple[float, list[float]]:
        """How far a place is at most, joints having turned by so much, and what of that is by which."""
        speed, turn = (
            np.linalg.norm(J[3:] + np.cross(J[:3], place.point, axis=0), axis=0),
            np.linalg.norm(J[:3], axis=0),
        )
        ways: list[float] = []
        for k in reversed(range(len(turned))):  # the inner joint moves it from where the outer joint has
            ways.insert(0, float(turned[k] * (speed[k] + turn[k] * sum(ways))))
        return place.distance + sum(ways), ways

    def _named(self, pairs: Iterable[tuple[str, str]], argument: str) -> list[tuple[str, str]]:
        """Pairs of names, each of a body that is there."""
        known = list(dict.fromkeys(part.name for part in self.parts))
        found = []
        for pair in arrays.listed(pairs, argument, "pairs of names, [(link, link), (link, obstacle), ...]"):
            if isinstance(pair, str) or not isinstance(pair, (list, tuple)) or len(pair) != 2:
                raise BadInput(argument, excerpt(pair), "the names of two bodies")
            for name in pair:
                if name not in known:
                    raise UnknownName("body", str(name), [], known)
            found.append((pair[0], pair[1]))
        return found
