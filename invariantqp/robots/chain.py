"""A robot from its joint screws alone: the product of exponentials, numpy and nothing else.

    T(q) = exp(s_1 q_1) ... exp(s_m q_m) T_0,    column i of J:  Ad(exp(s_1 q_1) ... exp(s_{i-1} q_{i-1})) s_i

Reference: [DS] Sect. 2.2; Brockett's product of exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import inf
from typing import Any, NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import axis
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.kinematics import Sighting, joint_limits

# What a chain is made from, besides the engine that computes it.
LIMITS = ("position_lower", "position_upper", "velocity_limit")
ARGUMENTS = ("screws", "home", "names", *LIMITS, "tool", "places", "links", "coupled", "notes")


@frozen(eq=False, repr=False, slots=False)
class Geometry(Value):
    """A part of a link."""

    kind: str  # "sphere", "capsule", "cylinder", "box", "plane", "mesh", or "unreadable"
    size: tuple[float, ...]  # radius; radius and length of the straight part, along z; whole edges; a mesh's scale
    pose: Array = field(converter=own)  # (4, 4) in the link's frame
    mesh: Any = None  # path of its file, or (n, 3) points of which it is the hull; of the unreadable, why
    given: bool = False  # by `with_tool`: it stays as it is beside others


class Link(NamedTuple):
    """A link of an arm; a chain needs it only where it is asked what must not touch: meshes are not opened before."""

    name: str
    body: int  # it is moved by the first so many joints; 0 is the base
    frame: Array  # (4, 4) at q = 0, in the base frame
    parts: tuple[Geometry, ...] = ()
    unknown: str = ""  # the joint that it is behind and that is not one of the arm's: where it is, is not known
    excludes: tuple[tuple[str, str], ...] = ()  # links that its description lets it touch, and why


class Coupled(NamedTuple):
    """The joints of a chain of which several share a coordinate, base first: those of a parallelogram, for instance.

    T(q) = exp(s_1 q_c1) ... exp(s_k q_ck) T_0
    """

    screws: Array  # (6, k) their twists at q = 0, for a unit of the coordinate
    coordinates: tuple[int, ...]  # (k,) the joint of the chain that drives each
    drivers: tuple[int, ...]  # (m,) which of the k joints those of the chain are

    def columns(self) -> Array:
        """(6, m) the joint twists of the chain at q = 0: each the sum of those that it drives."""
        J = np.zeros((6, len(self.drivers)))
        np.add.at(J.T, list(self.coordinates), self.screws.T)
        return J


@frozen(init=False, eq=False, repr=False, slots=False)
class Chain(Value):
    """An open chain of joints, each with a coordinate of its own unless they are `coupled`.

    Attributes:
        screws: (6, m) joint twists at q = 0 in the base frame, base first.
        home: (4, 4) tool pose at q = 0.
        names: joint names.
        position_lower: (m,) [rad, length], -inf where there is none.
        position_upper: (m,) likewise, +inf.
        velocity_limit: (m,) [rad/s, length/s], positive, inf where there is none.
        tool: name of the tool frame.
        places: (m, 3) a point of each joint's axis at q = 0, to draw the arm by.
        links: the links that its description tells of, with their frames and collision geometry; of screws alone none.
        coupled: all joints, where several share a coordinate, as mimic joints do; else None.
        notes: what the reader of a description held still or left out, and why.
    """

    screws: Array = field(converter=own)
    home: Array = field(converter=own, repr=False)
    names: tuple[str, ...]
    position_lower: Array = field(converter=own, repr=False)
    position_upper: Array = field(converter=own, repr=False)
    velocity_limit: Array = field(converter=own, repr=False)
    tool: str = field(default="tool", repr=False)
    places: Array = field(converter=own, repr=False, eq=False, kw_only=True)
    links: tuple[Link, ...] = field(default=(), repr=False, eq=False, kw_only=True)
    coupled: Coupled | None = field(default=None, repr=False, kw_only=True)
    notes: tuple[str, ...] = field(default=(), repr=False, eq=False, kw_only=True)

    def __init__(
        self,
        screws: ArrayLike,
        home: ArrayLike,
        names: Sequence[str] = (),
        position_lower: ArrayLike = -inf,
        position_upper: ArrayLike = inf,
        velocity_limit: ArrayLike = inf,
        tool: str = "tool",
        places: ArrayLike | None = None,
        links: tuple[Link, ...] = (),
        coupled: Coupled | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        """A chain from its screws.

        Names are "joint1", ... by default, all different; one limit may stand for all joints. Without `places` they are
        the points of the axes that make links short. `links`, `coupled` and `notes` are what readers of descriptions
        tell; the screws of a coupled chain are then `coupled.columns()`.
        """
        twists, pose = arrays.columns(screws, "screws"), arrays.pose(home, "home")
        m = twists.shape[1]
        still = ~twists.any(axis=0)
        if still.any():
            raise BadInput("screws", f"the zero twist in column {int(still.argmax())}", "non-zero joint twists")
        called = arrays.strings(names, "names") or tuple(f"joint{i + 1}" for i in range(m))
        if len(called) != m or len(set(called)) != m:
            raise BadInput("names", excerpt(called), f"{m} different names")
        limits = joint_limits(m, position_lower, position_upper, velocity_limit)
        where = _places(twists, pose) if places is None else arrays.matrix(places, (m, 3), "places")
        arrays.instance(tool, str, "tool", "the name of the tool frame")
        made_of = arrays.sequence(links, "links", "the links that a reader of descriptions tells of")
        if not all(isinstance(link, Link) for link in made_of):
            raise BadInput("links", excerpt(links), "the links that a reader of descriptions tells of")
        if coupled is not None:
            arrays.instance(coupled, Coupled, "coupled", "what a reader of descriptions tells of shared coordinates")
        said = arrays.strings(notes, "notes")
        more: dict[str, Any] = {"links": made_of, "coupled": coupled, "notes": said}
        self.__attrs_init__(twists, pose, called, *limits, tool, places=where, **more)

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) tool pose in the base frame."""
        pose: Array = self.in_engine.state(arrays.joint_vector(q, self.names, "q"), None)[1]
        return pose

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists in the base frame."""
        twists: Array = self.in_engine.state(arrays.joint_vector(q, self.names, "q"), None)[0]
        return twists

    def origins(self, q: ArrayLike) -> Array:
        """(m, 3) a point of each joint's axis, to draw the arm by."""
        before = self.motions(arrays.joint_vector(q, self.names, "q"))[:-1]
        own = zip(before[list(self.joints.drivers)], self.places, strict=True)
        return np.array([T[:3, :3].dot(p) + T[:3, 3] for T, p in own])

    def target(self, pose: ArrayLike) -> CheckedPose:
        """A (4, 4) target pose, checked, its rotation to all digits."""
        return (
            pose
            if isinstance(pose, CheckedPose)
            else CheckedPose(own(arrays.orthonormalised(arrays.pose(pose, "target"))))
        )

    def sight(self, q: Array, target: ArrayLike | CheckedPose) -> Sighting:
        """Joint twists and tool error, in the base frame."""
        wanted = self.target(target).pose
        J, T, error = self.in_engine.state(q, wanted)
        return Sighting(J, error, T)

    def points(self, sighting: Sighting, target: ArrayLike | CheckedPose, point: Array) -> tuple[Array, Array]:
        """Where a point (3,) of the tool frame is, and where it should be."""
        T, wanted = sighting.pose, self.target(target).pose
        return T[:3, :3].dot(point) + T[:3, 3], wanted[:3, :3].dot(point) + wanted[:3, 3]

    def with_tool(
        self,
        offset: ArrayLike,
        bodies: Sequence[Shape] | Shape = (),
        *,
        name: str | None = None,
        without: Sequence[str] = (),
    ) -> Chain:
        """The same chain with another tool: its frame, its bodies, and without the links that it replaces.

        Args:
            offset: (4, 4) pose of the new tool frame in the old one.
            bodies: what is mounted, each a Sphere, Capsule or Box in the new tool frame. They are a link of this name,
                fixed to what the last joint moves, and a clearance keeps it from all else.
            name: of the tool frame; None is the old name with "+offset".
            without: links that are not mounted any more, by name, of those that the last joint moves: the old tool's.

        Raises:
            BadInput: something that is no such shape, the name of another link, a link that the last joint does not
                move.
        """
        called = f"{self.tool}+offset" if name is None else name
        arrays.instance(called, str, "name", "the name of the tool frame")
        home = self.home.dot(arrays.pose(offset, "offset"))
        links = self._links_without(arrays.strings(without, "without"))
        if parts := _geometry(bodies):
            if any(link.name == called for link in links):
                raise BadInput("name", f"{called!r}, which is a link", "a name of its own for the tool's bodies")
            links += (Link(called, len(self.joints.coordinates), home, parts),)
        return self._changed(home=home, tool=called, links=links)

    @property
    def joints(self) -> Coupled:
        """All joints, base first, those that share a coordinate among them; bodies are counted by these."""
        each = tuple(range(len(self.names)))
        return self.coupled or Coupled(self.screws, each, each)

    def _links_without(self, removed: tuple[str, ...]) -> tuple[Link, ...]:
        """The links but some that the last joint moves; what may touch these is forgotten."""
        last = [link.name for link in self.links if link.body == len(self.joints.coordinates)]
        for name in removed:
            if name not in last:
                movable = f"links that the last joint moves: {', '.join(last) or 'it moves none that is known'}"
                raise BadInput("without", repr(name), movable)
        kept = (link for link in self.links if link.name not in removed)
        return tuple(
            link._replace(excludes=tuple(pair for pair in link.excludes if pair[0] not in removed)) for link in kept
        )

    def with_limits(
        self,
        position_lower: ArrayLike | None = None,
        position_upper: ArrayLike | None = None,
        velocity_limit: ArrayLike | None = None,
    ) -> Chain:
        """The same chain with other limits, (m,) each or one for all joints; None is as it was."""
        given = {"position_lower": position_lower, "position_upper": position_upper, "velocity_limit": velocity_limit}
        return self._changed(**{name: value for name, value in given.items() if value is not None})

    def __eq__(self, other: object) -> bool:
        found = super().__eq__(other)
        return found and self._given == other._given if isinstance(other, Chain) else found

    __hash__ = Value.__hash__

    @property
    def _given(self) -> tuple[tuple[Any, ...], ...]:
        """The links that `with_tool` mounted; what else descriptions tell of links says nothing of the arm's motion."""
        return tuple(
            (link.name, link.body, tuple(link.frame.ravel().tolist()), link.parts)
            for link in self.links
            if any(part.given for part in link.parts)
        )

    def _changed(self, **changes: Any) -> Chain:
        """The same chain with other arguments of `Chain`."""
        return Chain(**{name: getattr(self, name) for name in ARGUMENTS} | changes)

    @cached_property
    def model(self) -> Any:
        """These joints and the tool frame as a `pinocchio.Model` without masses, for limits and barriers made for Pink.

        Made once: copy it before changing it. Screws have to be of unit size. Raises MissingExtra without Pinocchio.
        """
        from invariantqp.robots.pinocchio import model_of  # only where it is asked for

        if self.coupled is not None:
            raise BadInput("robot", "joints that share a coordinate", "an arm without mimic joints")

        return model_of(
            self.screws, self.places, self.home, self.names, [getattr(self, name) for name in LIMITS], self.tool
        )

    @cached_property
    def in_engine(self) -> Any:
        """The same chain in the engine, which computes its kinematics."""
        return law.Chain(self.joints.screws, self.home, self.joints.coordinates)

    def motions(self, q: Array) -> Array:
        """(m + 1, 4, 4) the motions of the base and of what each joint moves, from where they are at q = 0.

        exp(q_1 S_1) ... exp(q_i S_i), i = 0 ... m, for a checked q (m,); of a coupled chain one for each of its joints.
        """
        found: Array = self.in_engine.motions(q)
        return found


def _geometry(bodies: Sequence[Shape] | Shape) -> tuple[Geometry, ...]:
    """Shapes as parts of a link whose frame they are given in."""
    expected, made = "Sphere, Capsule or Box, in the new tool frame", []
    for shape in (bodies,) if isinstance(bodies, Shape) else arrays.sequence(bodies, "bodies", f"a list of {expected}"):
        if not isinstance(shape, Shape) or shape.core not in (Core.SEGMENT, Core.BOX):
            raise BadInput("bodies", excerpt(shape), expected)
        length = 2.0 * float(shape.half[2])
        if shape.core is Core.BOX:
            made.append(Geometry("box", tuple((2.0 * shape.half).tolist()), shape.placement, given=True))
        elif length > 0.0:
            made.append(Geometry("capsule", (shape.radius, length), shape.placement, given=True))
        else:
            made.append(Geometry("sphere", (shape.radius,), shape.placement, given=True))
    return tuple(made)


def _places(screws: Array, home: Array) -> Array:
    """(m, 3) points of the axes at q = 0, each the one nearest to the hinge before: it makes the links short.

    A slide has no axis line: its place is that of the next hinge, or of the tool.
    """
    found = np.empty((screws.shape[1], 3))
    before, slides = np.zeros(3), []
    for i, screw in enumerate(screws.T):
        if not screw[:3].any():
            slides.append(i)
            continue
        along, foot = axis(screw)
        before = foot + along.dot(before) * along
        found[[*slides, i]] = before
        slides = []
    found[slides] = home[:3, 3]
    return found


def shares_coordinate(robot: object) -> Any:
    """(m,) which joints of a robot drive several, () of one that is no coupled `Chain`."""
    coupled = robot.coupled if isinstance(robot, Chain) else None
    if coupled is None:
        return False
    return np.bincount(coupled.coordinates) > 1


class CheckedPose(NamedTuple):
    """A target pose (4, 4) that has been checked."""

    pose: Array

    @property
    def homogeneous(self) -> Array:
        """The same, by the name that a `pinocchio.SE3` has for it."""
        return self.pose
