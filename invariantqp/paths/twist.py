"""A twist of the tool as joint velocities that change inside the joints' acceleration and jerk limits.

    x = law(J, s, box),     dv/dt = min(A / |d|, sqrt(2 J / |d|)) d,   d = x - v

All joints change together, along d: the direction of what is done goes straight from one twist to the next.
"""

from __future__ import annotations

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.geometry.arrays import Array
from invariantqp.paths.time_law import JointLimits


def towards_twist(unbraked: Controller, q: Array, v: Array, twist: Array, limits: JointLimits) -> Array:
    """(m,) joint velocity of the next tick, at q and v (m,) now, on the way to what a loop makes of a twist (6,)."""
    x = unbraked.follow(q, twist, v).velocity if twist.any() else np.zeros(len(q))
    d, a = x - v, limits.towards(v, x)
    away = d != 0.0
    if not away.any():
        return x
    share = float((a[away] / d[away]).min())
    return x if share * limits.dt >= 1.0 else v + limits.dt * share * d
