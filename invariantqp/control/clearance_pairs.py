"""Which bodies a clearance keeps apart: all that can touch; each pair that is left out, with its reason.

Links on one body, neighbours at a joint, what a description excludes or a caller does, and links that are shown to be
nearer than the distance wherever their joints are. Nothing is left out because samples did not meet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from os import PathLike
from typing import Any, NamedTuple

import numpy as np

from invariantqp.control.clearance_rows import OF_SHAPE, levers_of, placed_at
from invariantqp.errors import BadInput, UnknownName, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.distance import Solid, places
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.bodies import bodies_of
from invariantqp.robots.chain import Chain
from invariantqp.robots.srdf import Exclusions, excluded

# Whether a pair is always near is looked at in so many states, at most; one that is not shown to be is kept.
STATES = 2000


class Dropped(NamedTuple):
    """A pair that is not kept apart, and why."""

    first: str
    second: str
    reason: str


class Part(NamedTuple):
    """A shape as one of the bodies."""

    name: str
    shape: Shape
    body: int  # moved by the first so many joints
    frame: Array | None  # (4, 4) of its link at q = 0; None for an obstacle, which is where it was moved to
    owner: int = 0  # the arm that it is a link of, where that is another one


class Pairs:
    """The shapes of a clearance, and which of them are kept apart.

    Attributes:
        parts: all shapes, links' and obstacles'.
        numbers: (n, 18) of the shapes, as the compiled core takes them.
        levers: (n, m) how far any point of a shape moves at most for a radian or length of each joint.
        solids: what tells distances of meshes, None of other shapes; empty without a mesh.
        of_shapes: the shapes of each pair.
        dropped: the pairs of bodies that are not kept apart, each with its reason.
    """

    def __init__(
        self,
        robot: Chain,
        parts: Sequence[Part],
        distance: float,
        pairs: Iterable[tuple[str, str]] | None,
        exclude: Iterable[tuple[str, str]] | str | PathLike[str],
    ) -> None:
        """The pairs of some parts; the rest is as in `Clearance`.

        Raises:
            BadInput: no pairs of names.
            UnknownName: no such body.
            RobotModelError: an SRDF that cannot be read.
        """
        self.parts, self._robot, self._distance = tuple(parts), robot, distance
        self.numbers = np.array([_numbers(part) for part in parts]).reshape(-1, OF_SHAPE)
        self.levers = levers_of(robot, self.numbers)
        solids = tuple(part.shape.solid for part in parts)
        self.solids: tuple[Solid | None, ...] = solids if any(solid is not None for solid in solids) else ()
        self.of_shapes, self.dropped = self._chosen(pairs, exclude)

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
            if a.frame is None and b.frame is None:
                continue
            names = frozenset((a.name, b.name))
            if len(names) == 1:
                continue
            reason = "not among the pairs given" if wanted is not None and names not in wanted else apart.get(names, "")
            if not reason and not (wanted is not None and names in wanted):
                reason = self._needless(a, b)
            if reason:
                dropped[a.name, b.name] = reason
            else:
                kept.append((i, j))
        if wanted is None:
            kept, always = self._without_always_near(kept)
            dropped.update(always)
        return kept, tuple(Dropped(*names, reason) for names, reason in dropped.items())

    def _needless(self, a: Part, b: Part) -> str:
        """Why two bodies need not be kept apart, "" where they must be."""
        if a.body == b.body:
            return "no joint moves it" if b.frame is None else "fixed to one another"
        floor = Core.HALF_SPACE in (a.shape.core, b.shape.core)  # nobody's neighbour
        if b.frame is None or floor or abs(a.body - b.body) > 1:
            return ""
        return f"neighbours at {self._robot.names[max(a.body, b.body) - 1]}"

    def _without_always_near(
        self, kept: list[tuple[int, int]]
    ) -> tuple[list[tuple[int, int]], dict[tuple[str, str], str]]:
        """Pairs of shapes less those of links that are nearer than the distance wherever the joints are.

        Two links with one or two joints between them: in other states they are at most as far apart as those points are
        that are nearest in one, and a joint moves these by how far they are from its axis. So some states show it.
        """
        always: dict[tuple[str, str], str] = {}
        by_name: dict[tuple[str, str], list[tuple[int, int]]] = {}
        for i, j in kept:
            by_name.setdefault((self.parts[i].name, self.parts[j].name), []).append((i, j))
        for names, shapes in by_name.items():
            if any(self._is_always_near(i, j) for i, j in shapes):
                always[names] = f"always nearer than {1e3 * self._distance:.1f} mm"
        return [(i, j) for i, j in kept if (self.parts[i].name, self.parts[j].name) not in always], always

    def _is_always_near(self, i: int, j: int) -> bool:
        a, b = sorted((self.parts[i], self.parts[j]), key=lambda part: part.body)
        if a.frame is None or b.frame is None or b.body - a.body > 2:
            return False
        between = np.arange(a.body, b.body)
        if not self._robot.screws[:3, between].any(axis=0).all():
            return False  # a slide goes as far as it goes
        limits = np.maximum(self._robot.position_lower, -np.pi), np.minimum(self._robot.position_upper, np.pi)
        cells = [(limits[0][between], limits[1][between])]
        q = np.zeros(len(self._robot.names))
        for _ in range(STATES):
            if not cells:
                return True
            low, high = cells.pop()
            q[between] = 0.5 * (low + high)
            motions = self._robot.motions(q)
            one, other = placed_at(self.numbers[[i, j]], motions)
            nearest = places(one, other)[0]
            if nearest.distance > self._distance:
                return False
            # The outer one's nearest point, by a point of the one core or of the other.
            d, (near, far) = nearest.distance, (one.radius, other.radius)
            beside = (d + near, -far) if self.parts[j] is b else (near, -d - far)
            J = self._robot.jacobian(q)[:, between]
            points = [nearest.point + by * nearest.normal for by in beside]
            speed = np.max([np.linalg.norm(J[3:] + np.cross(J[:3], p, axis=0), axis=0) for p in points], axis=0)
            turn = np.linalg.norm(J[:3], axis=0)
            ways: list[float] = []
            for k in reversed(range(len(between))):  # the inner joint moves it from where the outer joint has
                ways.insert(0, float(0.5 * (high - low)[k] * (speed[k] + turn[k] * sum(ways))))
            if max(nearest.distance, 0.0) + sum(ways) > self._distance:
                axis = int(np.argmax(ways))
                middle = 0.5 * (low + high)
                upper, lower = high.copy(), low.copy()
                upper[axis] = lower[axis] = middle[axis]
                cells += [(low, upper), (lower, high)]
        return False

    def _named(self, pairs: Iterable[tuple[str, str]], argument: str) -> list[tuple[str, str]]:
        """Pairs of names, each of a body that is there.

        Raises:
            BadInput: no pairs of names.
            UnknownName: no such body.
        """
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
    raise UnknownName("link", str(name), [], [*(link.name for link in robot.links), "tool", "base", *robot.names])


def _numbers(part: Part) -> Array:
    shape = part.shape
    T = (shape.pose if part.frame is None else part.frame).dot(shape.place)
    return np.concatenate(((part.body, shape.core, shape.radius), shape.half, T[:3, :3].ravel(), T[:3, 3]))


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
