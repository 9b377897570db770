"""A robot from its joint screws alone: the product of exponentials, numpy and nothing else.

    T(q) = exp(s_1 q_1) ... exp(s_m q_m) T_0,    column i of J:  Ad(exp(s_1 q_1) ... exp(s_{i-1} q_{i-1})) s_i

Reference: [DS] Sect. 2.2; Brockett's product of exponentials.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Sighting, checked_limits


@dataclass(frozen=True, eq=False)
class Chain:
    """An open chain of one-degree-of-freedom joints.

    Attributes:
        screws: (6, m) joint twists at q = 0 in the base frame, base first.
        home: (4, 4) tool pose at q = 0.
        names: joint names; "joint1", ... by default.
        position_lower: (m,) or one number for all [rad, length].
        position_upper: likewise.
        velocity_limit: likewise [rad/s, length/s], positive.

    Raises:
        BadInput: NaN, shapes, a zero screw, crossed or empty limits.
    """

    screws: ArrayLike
    home: ArrayLike
    names: Sequence[str] = ()
    position_lower: ArrayLike = -inf
    position_upper: ArrayLike = inf
    velocity_limit: ArrayLike = inf

    def __post_init__(self) -> None:
        screws = arrays.columns(self.screws, "screws")
        m = screws.shape[1]
        still = ~screws.any(axis=0)
        if still.any():
            raise BadInput("screws", f"the zero twist in column {int(still.argmax())}", "non-zero joint twists")
        names = tuple(self.names) or tuple(f"joint{i + 1}" for i in range(m))
        if len(names) != m or len(set(names)) != m:
            raise BadInput("names", f"{names}", f"{m} different names")
        low, high, v_max = checked_limits(m, self.position_lower, self.position_upper, self.velocity_limit)
        checked = {
            "screws": screws,
            "home": arrays.pose(self.home, "home"),
            "names": names,
            "position_lower": low,
            "position_upper": high,
            "velocity_limit": v_max,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) tool pose in the base frame."""
        return self._moved(arrays.vector(q, len(self.names), "q"))[1]

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists in the base frame."""
        return self._moved(arrays.vector(q, len(self.names), "q"))[0]

    def target(self, pose: ArrayLike) -> Array:
        """A (4, 4) target pose, checked."""
        return arrays.pose(pose, "target")

    def sight(self, q: Array, target: ArrayLike) -> Sighting:
        """Joint twists and tool error, in the base frame."""
        J, T = self._moved(q)
        return Sighting(J, se3.log(self.target(target).dot(se3.inverse(T))), T)

    def points(self, sighting: Sighting, target: ArrayLike) -> tuple[Array, Array]:
        """(3,) tool point and (3,) target point."""
        return sighting.pose[:3, 3], self.target(target)[:3, 3]

    def with_tool(self, offset: ArrayLike) -> Chain:
        """The same chain with its tool frame moved by a (4, 4) offset in the old tool frame."""
        return replace(self, home=np.asarray(self.home).dot(arrays.pose(offset, "offset")))

    def _moved(self, q: Array) -> tuple[Array, Array]:
        """Joint twists and tool pose at a checked q."""
        screws = np.asarray(self.screws)
        J = np.empty_like(screws)
        T = np.eye(4)
        for i, angle in enumerate(q.tolist()):
            J[:, i] = se3.adjoint(T).dot(screws[:, i])
            T = T.dot(se3.exp(angle * screws[:, i]))
        return J, T.dot(np.asarray(self.home))
