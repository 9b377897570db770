"""A robot from its joint screws alone: the product of exponentials, numpy and nothing else.

    T(q) = exp(s_1 q_1) ... exp(s_m q_m) T_0,    column i of J:  Ad(exp(s_1 q_1) ... exp(s_{i-1} q_{i-1})) s_i

Reference: [DS] Sect. 2.2; Brockett's product of exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.screws import axis
from invariantqp.robots.kinematics import Sighting, joint_limits


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
    """

    screws: Array = field(converter=own)
    home: Array = field(converter=own, repr=False)
    names: tuple[str, ...]
    position_lower: Array = field(converter=own, repr=False)
    position_upper: Array = field(converter=own, repr=False)
    velocity_limit: Array = field(converter=own, repr=False)

    def __init__(
        self,
        screws: ArrayLike,
        home: ArrayLike,
        names: Sequence[str] = (),
        position_lower: ArrayLike = -inf,
        position_upper: ArrayLike = inf,
        velocity_limit: ArrayLike = inf,
    ) -> None:
        """A chain from its screws.

        Args:
            screws: (6, m) joint twists at q = 0 in the base frame, base first.
            home: (4, 4) tool pose at q = 0.
            names: joint names; "joint1", ... by default.
            position_lower: (m,) or one number for all joints [rad, length], -inf where there is none.
            position_upper: likewise, +inf where there is none.
            velocity_limit: likewise [rad/s, length/s], positive, inf where there is none.

        Raises:
            BadInput: NaN, shapes, a zero screw, lower limits above upper ones, names that are not all different.
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
        self.__attrs_init__(twists, pose, called, *limits)

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) tool pose in the base frame."""
        return self._kinematics(arrays.vector(q, len(self.names), "q"))[1]

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists in the base frame."""
        return self._kinematics(arrays.vector(q, len(self.names), "q"))[0]

    def origins(self, q: ArrayLike) -> Array:
        """(m, 3) a point of each joint's axis, the one nearest to the hinge before: it makes the links short."""
        T = np.eye(4)
        found = np.empty((len(self.names), 3))
        for i, angle in enumerate(arrays.vector(q, len(self.names), "q").tolist()):
            found[i] = T[:3, :3].dot(self._origins[i]) + T[:3, 3]
            T = T.dot(se3.exp(angle * self.screws[:, i], check=False))
        return found

    def target(self, pose: ArrayLike) -> Target:
        """A (4, 4) target pose, checked.

        Raises:
            BadInput: not a rigid motion.
        """
        return pose if isinstance(pose, Target) else Target(own(arrays.pose(pose, "target")))

    def sight(self, q: Array, target: ArrayLike | Target) -> Sighting:
        """Joint twists and tool error, in the base frame.

        Raises:
            BadInput: a target that is not a rigid motion.
        """
        J, T = self._kinematics(q)
        return Sighting(J, se3.log(self.target(target).pose.dot(se3.inverse(T, check=False)), check=False), T)

    def points(self, sighting: Sighting, target: ArrayLike | Target, point: Array) -> tuple[Array, Array]:
        """Where a point (3,) of the tool frame is, and where it should be."""
        T, wanted = sighting.pose, self.target(target).pose
        return T[:3, :3].dot(point) + T[:3, 3], wanted[:3, :3].dot(point) + wanted[:3, 3]

    def with_tool(self, offset: ArrayLike) -> Chain:
        """The same chain with its tool frame moved by a (4, 4) offset in the old tool frame."""
        home = self.home.dot(arrays.pose(offset, "offset"))
        limits = (self.position_lower, self.position_upper, self.velocity_limit)
        return Chain(self.screws, home, self.names, *limits)

    @cached_property
    def _origins(self) -> Array:
        """Origins at q = 0. A slide has no axis line: its origin is that of the next hinge, or of the tool."""
        found = np.empty((len(self.names), 3))
        before, slides = np.zeros(3), []
        for i, screw in enumerate(self.screws.T):
            if not screw[:3].any():
                slides.append(i)
                continue
            along, foot = axis(screw)
            before = foot + along.dot(before) * along
            found[[*slides, i]] = before
            slides = []
        found[slides] = self.home[:3, 3]
        return found

    def _kinematics(self, q: Array) -> tuple[Array, Array]:
        """Joint twists and tool pose at a checked q."""
        J = np.empty_like(self.screws)
        T = np.eye(4)
        for i, angle in enumerate(q.tolist()):
            screw = self.screws[:, i]
            J[:, i] = se3.adjoint(T, check=False).dot(screw)
            T = T.dot(se3.exp(angle * screw, check=False))
        return J, T.dot(self.home)


class Target(NamedTuple):
    """A target pose (4, 4) that has been checked."""

    pose: Array
