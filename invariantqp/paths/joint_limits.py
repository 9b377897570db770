"""Limits of the joints in time: position, velocity, acceleration and jerk, in every tick.

    v = v_before + dt a,    |v| <= V,   |a| <= A,   |a - a_before| <= J dt,    lower <= q <= upper

A tick is taken only if the joint can come to rest inside all of them afterwards: then there is always a next tick. The
engine computes it (`core/joint_motion.hpp`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.engine import law
from invariantqp.geometry.arrays import Array

# A joint this close to a position limit [rad, length] is at it, and one that is off by as little is where it is wanted.
AT_LIMIT = 1e-6
# A speed below this share of its limit, or of the largest on the way, is rest.
AT_REST = 1e-6


def speed_scale(limit: Array) -> Array:
    """(m,) speeds beside which those of joints count: their limits, a unit where there is none."""
    return np.where(np.isfinite(limit), limit, 1.0)


class JointLimits(NamedTuple):
    """What joints may do, (m,) each, infinite where there is no limit."""

    lower: Array  # positions [rad, length]
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    dt: float

    def scaled(self, share: Array) -> JointLimits:
        """With speeds that are shares (m,) of these, or of a unit where there is no limit."""
        return self._replace(velocity=np.maximum(share, AT_REST) * speed_scale(self.velocity))

    def acceleration_towards(self, velocity: Array, wanted: Array) -> Array:
        """(m,) accelerations that bring a velocity to the wanted one soonest, jerk taking them back in time."""
        found: Array = law.acceleration_towards(self, velocity, wanted)
        return found

    def approach_speed(self, way: Array, gain: float) -> Array:
        """(m,) speeds at which joints go a way (m,), and stop at its end: at a gain [1/s] where that is little."""
        found: Array = law.approach_speed(self, way, gain)
        return found

    def peak_speed(self, way: Array) -> Array:
        """(m,) the largest speeds of joints that catch up a way (m,) from rest to rest, nearly."""
        found: Array = law.peak_speed(self, way)
        return found

    def admissible_acceleration(self, q: Array, velocity: Array, acceleration: Array, wanted: Array) -> Array:
        """(m,) the acceleration of a tick nearest the wanted one, after which every joint can still stop.

        `velocity` and `acceleration` are those of the tick before.
        """
        found: Array = law.admissible_acceleration(self, q, velocity, acceleration, wanted)
        return found
