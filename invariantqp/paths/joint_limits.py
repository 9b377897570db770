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

# Tolerance of joint positions at a limit, or at their goal [rad, length]; and the share of its limit, or of the largest
# on the way, below which a speed is rest.
AT_LIMIT = AT_REST = 1e-6


def speed_scale(limit: Array) -> Array:
    """(m,) the scale of joint speeds: their limits, a unit where there is none."""
    return np.where(np.isfinite(limit), limit, 1.0)


class JointLimits(NamedTuple):
    """Limits of m joints, (m,) each, infinite where there is no limit."""

    lower: Array  # positions [rad, length]
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    dt: float

    def scaled(self, share: Array) -> JointLimits:
        """The limits with speeds that are shares (m,) of these, or of a unit where there is no limit."""
        return self._replace(velocity=np.maximum(share, AT_REST) * speed_scale(self.velocity))

    def peak_speed(self, distance: Array) -> Array:
        """(m,) the largest speeds of joints that move distances (m,) from rest to rest, nearly."""
        found: Array = law.peak_speed(self, distance)
        return found
