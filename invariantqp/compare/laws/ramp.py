"""Acceleration limits as bounds on the next joint velocity, for loops that have none of their own."""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits import accelerations


class RampBounds:
    """The velocities within reach of the one commanded last; all of them where a law has no acceleration limit.

    Attributes:
        last: (m,) the velocity commanded last, zero at first.
    """

    def __init__(self, law: LawSpec, m: int) -> None:
        limit = law.acceleration_limit
        self._most = None if limit is None else law.dt * accelerations(limit, m)
        self.last: Array = np.zeros(m)

    def within(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Bounds (m,) cut to what is within reach: never empty, since an arm cannot do more."""
        if self._most is None:
            return lower, upper
        low, high = self.last - self._most, self.last + self._most
        return np.minimum(np.maximum(lower, low), high), np.minimum(np.maximum(upper, low), high)

    def cut(self, x: Array) -> Array:
        """A velocity cut to what is within reach, joint by joint; it is the last one from now on."""
        self.last, _ = self.within(x, x)
        return self.last
