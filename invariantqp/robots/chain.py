"""`Chain`, an open kinematic chain of joint screws, evaluated by the product of exponentials.

    T(q) = exp(s_1 q_1) ... exp(s_m q_m) T_0,    column i of J:  Ad(exp(s_1 q_1) ... exp(s_{i-1} q_{i-1})) s_i

Reference: [DS] Sect. 2.2; Brockett's product of exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import inf
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import axis
from invariantqp.geometry.shapes import Core, Shape
from invariantqp.robots.kinematics import RobotState, joint_limits

# The limits of a chain.
LIMITS = ("position_lower", "position_upper", "velocity_limit")


@frozen(eq=False, repr=False, slots=False)
class Geometry(Value):
    """One collision or visual geometry of a link."""

    kind: str  # "sphere", "capsule", "cylinder", "box", "plane", "mesh", or "unreadable"
    size: tuple[float, ...]  # radius; radius and length of the straight part, along z; whole edges; a mesh's scale
    pose: Array = field(converter=own)  # (4, 4) in the link's frame
    mesh: Any = None  # path of its file, or (n, 3) points of its convex hull; why, of an unreadable one
    exact: bool = False  # a shape given to `with_tool`, never replaced by an enclosing one


class Link(NamedTuple):
    """A link of an arm with its collision geometry; mesh files are opened only when shapes are needed."""

    name: str
    body: int  # number of joints between the base and it; 0 is the base
    frame: Array  # (4, 4) at q = 0, in the base frame
    parts: tuple[Geometry, ...] = ()
    unknown: str = ""  # the joint outside the arm that moves it, so that its pose is not known
    excludes: tuple[tuple[str, str], ...] = ()  # links excluded from collision with it, and the reason


class CoupledJoints(NamedTuple):
    """The joints of a chain with mimic joints, base first; joints that mimic each other share a coordinate.

    T(q) = exp(s_1 q_c1) ... exp(s_k q_ck) T_0
    """

    screws: Array  # (6, k) their twists at q = 0, for a unit of the coordinate
    coordinates: tuple[int, ...]  # (k,) index of the coordinate of each
    drivers: tuple[int, ...]  # (m,) index, among the k joints, of each joint of the chain

    def columns(self) -> Array:
        """(6, m) joint twists of the chain at q = 0: the sum over the joints that share each coordinate."""
        J = np.zeros((6, len(self.drivers)))
        np.add.at(J.T, list(self.coordinates), self.screws.T)
        return J


@frozen(init=False, eq=False, repr=False, slots=False)
class Chain(Value):
    """An open chain of joints, a robot by its joint screws.

    Attributes:
        screws: (6, m) joint twists at q = 0 in the base frame, base first.
        home: (4, 4) tool pose at q = 0.
        names: joint names.
        position_lower: (m,) [rad, length], -inf where there is none.
        position_upper: (m,) likewise, +inf.
        velocity_limit: (m,) [rad/s, length/s], positive, inf where there is none.
        tool: name of the tool frame.
        places: (m, 3) a point of each joint's axis at q = 0.
        links: the links of its description with frames and collision geometry; none for a chain from screws.
        coupled: all joints, where there are mimic joints; else None.
        notes: joints of the description that are held or left out, and why.
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
    coupled: CoupledJoints | None = field(default=None, repr=False, kw_only=True)
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
        coupled: CoupledJoints | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        """A chain from its screws; the arguments are the attributes.

        Names must differ; the default is "joint1", ... A scalar limit holds for all joints. Default `places` are the
        points of the axes that make links short. `links`, `coupled` and `notes` come from the reader of a description;
        with `coupled`, the screws are `coupled.columns()`.

        Raises:
            BadInput: wrong shapes, a zero twist, names that repeat, limits in the wrong order.
        """
        twists, pose = arrays.columns(screws, "screws"), arrays.pose(home, "home")
        m = twists.shape[1]
        still = ~twists.any(axis=0)
        if still.any():
            raise BadInput("screws", f"the zero twist in column {int(still.argmax())}", "non-zero joint twists")
        joint_names = arrays.strings(names, "names") or tuple(f"joint{i + 1}" for i in range(m))
        if len(joint_names) != m or len(set(joint_names)) != m:
            raise BadInput("names", excerpt(joint_names), f"{m} different names")
        limits = joint_limits(m, position_lower, position_upper, velocity_limit)
        where = _places(twists, pose) if places is None else arrays.matrix(places, (m, 3), "places")
        arrays.instance(tool, str, "tool", "the name of the tool frame")
        all_links = arrays.sequence(links, "links", "a list of links")
        if not all(isinstance(link, Link) for link in all_links):
            raise BadInput("links", excerpt(links), "a list of links")
        if coupled is not None:
            arrays.instance(coupled, CoupledJoints, "coupled", "CoupledJoints, or None")
        more: dict[str, Any] = {"links": all_links, "coupled": coupled, "notes": arrays.strings(notes, "notes")}
        self.__attrs_init__(twists, pose, joint_names, *limits, tool, places=where, **more)

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) tool pose in the base frame."""
        pose: Array = self.in_engine.state(arrays.joint_vector(q, self.names, "q"), None)[1]
        return pose

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists in the base frame."""
        twists: Array = self.in_engine.state(arrays.joint_vector(q, self.names, "q"), None)[0]
        return twists

    def origins(self, q: ArrayLike) -> Array:
        """(m, 3) a point of each joint's axis, in the base frame."""
        before = self.motions(arrays.joint_vector(q, self.names, "q"))[:-1]
        own = zip(before[list(self.joints.drivers)], self.places, strict=True)
        return np.array([T[:3, :3].dot(p) + T[:3, 3] for T, p in own])

    def target(self, pose: ArrayLike) -> CheckedPose:
        """A checked (4, 4) target pose with an exactly orthonormal rotation; a checked one is returned as it is."""
        return (
            pose
            if isinstance(pose, CheckedPose)
            else CheckedPose(own(arrays.orthonormalised(arrays.pose(pose, "target"))))
        )

    def state(self, q: Array, target: ArrayLike | CheckedPose) -> RobotState:
        """Joint twists, error twist and tool pose, in the base frame."""
        wanted = self.target(target).pose
        J, T, error = self.in_engine.state(q, wanted)
        return RobotState(J, error, T)

    def points(self, state: RobotState, target: ArrayLike | CheckedPose, point: Array) -> tuple[Array, Array]:
        """The current and the target position of a point (3,) of the tool frame, in the base frame."""
        T, wanted = state.pose, self.target(target).pose
        return T[:3, :3].dot(point) + T[:3, 3], wanted[:3, :3].dot(point) + wanted[:3, 3]

    def with_tool(
        self,
        offset: ArrayLike,
        bodies: Sequence[Shape] | Shape = (),
        *,
        name: str | None = None,
        without: Sequence[str] = (),
    ) -> Chain:
        """The same chain with another tool: frame, bodies, and without the links that the tool replaces.

        Args:
            offset: (4, 4) pose of the new tool frame in the old one.
            bodies: of the tool, each a Sphere, Capsule or Box in the new tool frame. They make a link called `name`,
                fixed to the last joint's link.
            name: of the tool frame; None is the old name with "+offset".
            without: names of links that the tool replaces, among those that the last joint moves.

        Raises:
            BadInput: another kind of shape, the name of an existing link, a link that the last joint does not move.
        """
        label = f"{self.tool}+offset" if name is None else name
        arrays.instance(label, str, "name", "the name of the tool frame")
        home = self.home.dot(arrays.pose(offset, "offset"))
        links = self._links_without(arrays.strings(without, "without"))
        if parts := _geometry(bodies):
            if any(link.name == label for link in links):
                raise BadInput("name", f"{label!r}, which is a link", "a name of its own for the tool's bodies")
            links += (Link(label, len(self.joints.coordinates), home, parts),)
        return evolve(self, home=home, tool=label, links=links)

    @property
    def joints(self) -> CoupledJoints:
        """All joints, base first, mimic joints included; `Link.body` counts these."""
        each = tuple(range(len(self.names)))
        return self.coupled or CoupledJoints(self.screws, each, each)

    def _links_without(self, removed: tuple[str, ...]) -> tuple[Link, ...]:
        """The links without those removed, which also leave the exclusions of the others."""
        last = [link.name for link in self.links if link.body == len(self.joints.coordinates)]
        for name in removed:
            if name not in last:
                movable = f"links that the last joint moves: {', '.join(last) or 'it moves none that is known'}"
                raise BadInput("without", repr(name), movable)
        others = (link for link in self.links if link.name not in removed)
        return tuple(
            link._replace(excludes=tuple(pair for pair in link.excludes if pair[0] not in removed)) for link in others
        )

    def with_limits(
        self,
        position_lower: ArrayLike | None = None,
        position_upper: ArrayLike | None = None,
        velocity_limit: ArrayLike | None = None,
    ) -> Chain:
        """The same chain with other limits, (m,) each or one for all joints; None keeps the old ones."""
        given = zip(LIMITS, (position_lower, position_upper, velocity_limit), strict=True)
        changes: dict[str, Any] = {name: value for name, value in given if value is not None}
        return evolve(self, **changes)

    def __eq__(self, other: object) -> bool:
        equal = super().__eq__(other)
        return equal and self._tool_links == other._tool_links if isinstance(other, Chain) else equal

    __hash__ = Value.__hash__

    @property
    def _tool_links(self) -> tuple[tuple[Any, ...], ...]:
        """The links that `with_tool` added: the only ones that count in comparisons."""
        return tuple(
            (link.name, link.body, tuple(link.frame.ravel().tolist()), link.parts)
            for link in self.links
            if any(part.exact for part in link.parts)
        )

    @cached_property
    def model(self) -> Any:
        """These joints and the tool frame as a `pinocchio.Model` without masses, for Pink's limits and barriers.

        It is made once: copy it before changing it.

        Raises:
            BadInput: mimic joints, or screws that are not of unit size.
            MissingExtra: Pinocchio is not installed (extra `pin`).
        """
        from invariantqp.robots.pinocchio import model_of  # Pinocchio is loaded only here

        if self.coupled is not None:
            raise BadInput("robot", "joints that share a coordinate", "an arm without mimic joints")

        return model_of(
            self.screws, self.places, self.home, self.names, [getattr(self, name) for name in LIMITS], self.tool
        )

    @cached_property
    def in_engine(self) -> Any:
        """The compiled chain, which computes the kinematics."""
        return law.Chain(self.joints.screws, self.home, self.joints.coordinates)

    def motions(self, q: Array) -> Array:
        """(k + 1, 4, 4) motions of the base and of each joint's link from q = 0: exp(q_1 S_1) ... exp(q_i S_i).

        For a checked q (m,); k counts mimic joints too.
        """
        motions: Array = self.in_engine.motions(q)
        return motions


def _geometry(bodies: Sequence[Shape] | Shape) -> tuple[Geometry, ...]:
    """Shapes in a link's frame as geometry of that link."""
    expected, made = "Sphere, Capsule or Box, in the new tool frame", []
    for shape in (bodies,) if isinstance(bodies, Shape) else arrays.sequence(bodies, "bodies", f"a list of {expected}"):
        if not isinstance(shape, Shape) or shape.core not in (Core.SEGMENT, Core.BOX):
            raise BadInput("bodies", excerpt(shape), expected)
        length = 2.0 * float(shape.half[2])
        if shape.core is Core.BOX:
            made.append(Geometry("box", tuple((2.0 * shape.half).tolist()), shape.placement, exact=True))
        elif length > 0.0:
            made.append(Geometry("capsule", (shape.radius, length), shape.placement, exact=True))
        else:
            made.append(Geometry("sphere", (shape.radius,), shape.placement, exact=True))
    return tuple(made)


def _places(screws: Array, home: Array) -> Array:
    """(m, 3) points of the axes at q = 0, each the one nearest to the hinge before, so that links are short.

    A slide has no axis line: its place is that of the next hinge, or of the tool.
    """
    places = np.empty((screws.shape[1], 3))
    before, slides = np.zeros(3), []
    for i, screw in enumerate(screws.T):
        if not screw[:3].any():
            slides.append(i)
            continue
        along, foot = axis(screw)
        before = foot + along.dot(before) * along
        places[[*slides, i]] = before
        slides = []
    places[slides] = home[:3, 3]
    return places


def drives_several(robot: object) -> Any:
    """(m,) which joints of a chain drive mimic joints; False of a robot without mimic joints."""
    coupled = robot.coupled if isinstance(robot, Chain) else None
    if coupled is None:
        return False
    return np.bincount(coupled.coordinates) > 1


class CheckedPose(NamedTuple):
    """A checked target pose (4, 4)."""

    pose: Array

    @property
    def homogeneous(self) -> Array:
        """The pose, under the name that `pinocchio.SE3` uses."""
        return self.pose
