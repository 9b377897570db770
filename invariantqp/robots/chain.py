"""A robot from its joint screws alone: the product of exponentials, numpy and nothing else.

    T(q) = exp(s_1 q_1) ... exp(s_m q_m) T_0,    column i of J:  Ad(exp(s_1 q_1) ... exp(s_{i-1} q_{i-1})) s_i

Reference: [DS] Sect. 2.2; Brockett's product of exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import hypot, inf
from typing import Any, NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.engine import ENGINES, Engine, core_for
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import axis
from invariantqp.robots.kinematics import Sighting, joint_limits

# What a chain is made from, besides the engine that computes it.
LIMITS = ("position_lower", "position_upper", "velocity_limit")
ARGUMENTS = ("screws", "home", "names", *LIMITS, "tool", "places", "links")


@frozen(eq=False, repr=False, slots=False)
class Geometry(Value):
    """A part of a link."""

    kind: str  # "sphere", "capsule", "cylinder", "box", "plane", "mesh", or "unreadable"
    size: tuple[float, ...]  # radius; radius and length of the straight part, along z; whole edges; a mesh's scale
    pose: Array = field(converter=own)  # (4, 4) in the link's frame
    mesh: Any = None  # path of its file, or (n, 3) points of which it is the hull; of the unreadable, why


class Link(NamedTuple):
    """A link of an arm; a chain needs it only where it is asked what must not touch: meshes are not opened before."""

    name: str
    body: int  # it is moved by the first so many joints; 0 is the base
    frame: Array  # (4, 4) at q = 0, in the base frame
    parts: tuple[Geometry, ...] = ()
    unknown: str = ""  # the joint that it is behind and that is not one of the arm's: where it is, is not known
    excludes: tuple[tuple[str, str], ...] = ()  # links that its description lets it touch, and why


@frozen(init=False, eq=False, repr=False, slots=False)
class Chain(Value):
    """An open chain of one-degree-of-freedom joints.

    Attributes:
        screws: (6, m) joint twists at q = 0 in the base frame, base first.
        home: (4, 4) tool pose at q = 0.
        names: joint names.
        position_lower: (m,) [rad, length], -inf where there is none.
        position_upper: (m,) likewise, +inf.
        velocity_limit: (m,) [rad/s, length/s], positive, inf where there is none.
        tool: name of the tool frame.
        places: (m, 3) a point of each joint's axis at q = 0, to draw the arm by.
        engine: what computes its kinematics: "compiled", the compiled core where there is one, or "python".
        links: the links that its description tells of, with their frames and collision geometry; of screws alone none.
    """

    screws: Array = field(converter=own)
    home: Array = field(converter=own, repr=False)
    names: tuple[str, ...]
    position_lower: Array = field(converter=own, repr=False)
    position_upper: Array = field(converter=own, repr=False)
    velocity_limit: Array = field(converter=own, repr=False)
    tool: str = field(default="tool", repr=False)
    places: Array = field(converter=own, repr=False, eq=False, kw_only=True)
    engine: Engine = field(default="compiled", repr=False, eq=False, kw_only=True)
    links: tuple[Link, ...] = field(default=(), repr=False, eq=False, kw_only=True)

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
    ) -> None:
        """A chain from its screws.

        Names are "joint1", ... by default, all different; one limit may stand for all joints. Without `places` they are
        the points of the axes that make links short. `links` are what readers of descriptions tell.
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
        made_of = arrays.listed(links, "links", "the links that a reader of descriptions tells of")
        if not all(isinstance(link, Link) for link in made_of):
            raise BadInput("links", excerpt(links), "the links that a reader of descriptions tells of")
        self.__attrs_init__(twists, pose, called, *limits, tool, places=where, links=made_of)

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) tool pose in the base frame."""
        return self._evaluated(arrays.vector(q, len(self.names), "q"))[1]

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists in the base frame."""
        return self._evaluated(arrays.vector(q, len(self.names), "q"))[0]

    def origins(self, q: ArrayLike) -> Array:
        """(m, 3) a point of each joint's axis, to draw the arm by."""
        before = self.motions(arrays.vector(q, len(self.names), "q"))[:-1]
        return np.array([T[:3, :3].dot(p) + T[:3, 3] for T, p in zip(before, self.places, strict=True)])

    def target(self, pose: ArrayLike) -> Target:
        """A (4, 4) target pose, checked, its rotation to all digits."""
        return pose if isinstance(pose, Target) else Target(own(arrays.with_rotation(arrays.pose(pose, "target"))))

    def sight(self, q: Array, target: ArrayLike | Target) -> Sighting:
        """Joint twists and tool error, in the base frame."""
        wanted = self.target(target).pose
        J, T, error = self._evaluated(q, wanted)
        if error is None:
            error = se3.displacement(T, wanted)
        return Sighting(J, error, T)

    def points(self, sighting: Sighting, target: ArrayLike | Target, point: Array) -> tuple[Array, Array]:
        """Where a point (3,) of the tool frame is, and where it should be."""
        T, wanted = sighting.pose, self.target(target).pose
        return T[:3, :3].dot(point) + T[:3, 3], wanted[:3, :3].dot(point) + wanted[:3, 3]

    def with_tool(self, offset: ArrayLike) -> Chain:
        """The same chain with its tool frame moved by a (4, 4) offset in the old tool frame."""
        return self._changed(home=self.home.dot(arrays.pose(offset, "offset")), tool=f"{self.tool}+offset")

    def with_limits(
        self,
        position_lower: ArrayLike | None = None,
        position_upper: ArrayLike | None = None,
        velocity_limit: ArrayLike | None = None,
    ) -> Chain:
        """The same chain with other limits, (m,) each or one for all joints; None is as it was."""
        given = {"position_lower": position_lower, "position_upper": position_upper, "velocity_limit": velocity_limit}
        return self._changed(**{name: value for name, value in given.items() if value is not None})

    def by_engine(self, engine: Engine) -> Chain:
        """The same chain, its kinematics, and what is made from it, by another engine: "compiled" or "python"."""
        by = arrays.choice(engine, "engine", ENGINES)
        return self if by == self.engine else self._changed(by)

    def _changed(self, engine: Engine | None = None, /, **changes: Any) -> Chain:
        """The same chain with other arguments of `Chain`, or by another engine."""
        made = Chain(**{name: getattr(self, name) for name in ARGUMENTS} | changes)
        object.__setattr__(made, "engine", engine or self.engine)
        return made

    @cached_property
    def model(self) -> Any:
        """These joints and the tool frame as a `pinocchio.Model` without masses, for limits and barriers made for Pink.

        Made once: copy it before changing it. Screws have to be of unit size. Raises MissingExtra without Pinocchio.
        """
        from invariantqp.robots.pinocchio import model_of  # only where it is asked for

        return model_of(
            self.screws, self.places, self.home, self.names, [getattr(self, name) for name in LIMITS], self.tool
        )

    @cached_property
    def powers(self) -> tuple[Array, Array]:
        """(m,) rates |omega| of the joints, 1 for slides, and (m, 3, 16) powers 1 to 3 of S / rate as 4x4 matrices."""
        rates = np.array([hypot(*s[:3].tolist()) or 1.0 for s in self.screws.T])
        S = np.zeros((len(rates), 4, 4))  # [[omega^, v], [0, 0]] of each
        for matrix, s in zip(S, (self.screws / rates).T, strict=True):
            matrix[:3, :3], matrix[:3, 3] = se3.cross_matrix(s[:3]), s[3:]
        return rates, np.stack((S, S @ S, S @ S @ S), axis=1).reshape(-1, 3, 16)

    def motions(self, q: Array) -> list[Array]:
        """The m + 1 motions (4, 4) of the base and of what each joint moves, from where they are at q = 0.

        exp(q_1 S_1) ... exp(q_i S_i), i = 0 ... m, for a checked q (m,).

        exp(tS) = 1 + tS + (1 - cos t) S^2 + (t - sin t) S^3 for a hinge or screw of rate 1, and 1 + tS for a slide.
        """
        rates, powers = self.powers
        t = rates * q
        half = np.sin(0.5 * t)
        parts = np.stack((t, 2.0 * half * half, t - np.sin(t)), axis=1)[:, None]
        steps = np.matmul(parts, powers).reshape(-1, 4, 4)
        T = np.eye(4)
        motions = [T]
        for step in steps + T:
            T = T.dot(step)
            motions.append(T)
        return motions

    def _evaluated(self, q: Array, wanted: Array | None = None) -> tuple[Array, Array, Array | None]:
        """Joint twists and tool pose at a checked q, and by the compiled core the error, None where it has none."""
        found: tuple[Array, Array, Array | None] | None
        core = core_for(self.engine)
        found = None if core is None else core.sight(self.screws, self.home, q, wanted)
        return (*self._kinematics(q), None) if found is None else found

    def _kinematics(self, q: Array) -> tuple[Array, Array]:
        """Joint twists and tool pose at a checked q."""
        motions = self.motions(q)
        before = np.array(motions[:-1])
        R, p = before[:, :3, :3], before[:, :3, 3].T
        turned = np.matmul(R, self.screws.T.reshape(-1, 2, 3).transpose(0, 2, 1))
        J = turned.transpose(2, 1, 0).reshape(6, -1)
        w, v = J[:3], J[3:]
        v[0] += p[1] * w[2] - p[2] * w[1]
        v[1] += p[2] * w[0] - p[0] * w[2]
        v[2] += p[0] * w[1] - p[1] * w[0]
        return J, motions[-1].dot(self.home)


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


class Target(NamedTuple):
    """A target pose (4, 4) that has been checked."""

    pose: Array

    @property
    def homogeneous(self) -> Array:
        """The same, by the name that a `pinocchio.SE3` has for it."""
        return self.pose
