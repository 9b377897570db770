"""A velocity as it may be commanded for a demand: without rounding past its limits, or standing still."""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.legacy.law import Demand
from invariantqp.velocity.reasons import Reason
from invariantqp.velocity.solution import ACTIVE_TOLERANCE, Status, VelocitySolution, at_bounds


def clipped(demand: Demand, x: Array) -> tuple[Array, tuple[int, ...]]:
    """The velocity without rounding past its limits, and the joints at them."""
    x = np.minimum(np.maximum(_shortened(demand, x), demand.lower), demand.upper)
    return x, tuple(at_bounds(x, demand.lower, demand.upper).nonzero()[0].tolist())


def _shortened(demand: Demand, x: Array) -> Array:
    """The velocity shortened until rows and tool speed hold exactly, where only rounding exceeds them.

    Not where standing still is outside a row or the box, which a shorter one would be too.
    """
    rows, cone, still = demand.rows, demand.cone, np.zeros_like(x)
    boxed = bool(((demand.lower <= still) & (demand.upper >= still)).all())
    if not boxed or (rows is not None and not rows.allow(still)):
        return x
    used = np.empty(0) if rows is None else rows.used(x)
    if cone is not None:
        used = np.append(used, cone.speed(x) / cone.limit)
    most = float(used[used < 1.0 / (1.0 - ACTIVE_TOLERANCE)].max(initial=1.0))  # what is exceeded by more gave way
    return x / most


def held(demand: Demand, why: tuple[Reason, ...]) -> VelocitySolution:
    """Standing still or, where the bounds do not allow that, moving back inside them."""
    x, active = clipped(demand, np.zeros(len(demand.lower)))
    residual = demand.s - demand.J.dot(x)
    return VelocitySolution(x, "hold", Status.HELD, why, active, residual, 0.0, 0.0, 0.0, "")
