"""The result of a tick: a joint velocity, how it was found, and why."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import compared
from invariantqp.velocity.law import Demand
from invariantqp.velocity.qp.quadratic import ACTIVE_TOLERANCE

# A joint is at a bound within `ACTIVE_TOLERANCE` of its speed, or of this one [rad/s, length/s] where it is slower; the
# rest is rounding of an arm that stands still.
SLOWEST = 1e-6


@compared
class VelocitySolution(NamedTuple):
    """A joint velocity and how it was found. A tuple, because one is made in every tick.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the bounds.
        method: "closed-form" (no limit is active), "damped" (likewise, with damping), "qp" (a limit is active), "hold".
        status: "ok" (at most 5 % of the twist is missed, or errors of position and angle each fall at half the asked
            rate), "limited" (limits or a singularity keep more away), "scaled" (exact rows slowed down), "guarded" (the
            descent guard blended in least squares), "degraded" (something declared does not hold: see the reason),
            "held" (standing still).
        reason: why, in words, "" where there is nothing to report.
        active: joints at a bound.
        residual: (6,) s - J x in the frame of J.
        scale: share of the exact rows' speed that was possible, in [0, 1], 1 unless scaled.
        damping: lambda used [length; unit of root J].
        guard: t, share of least squares blended in by the guard; 0 when it did not act.
        backend: the solver that answered, "" without one.
        multipliers: (m,) what each joint's bound costs in the objective: positive at the upper bound, negative at the
            lower, 0 away from them. None where no limit is active.
        row_multipliers: (k,) the same for the rows of `LimitRows`.
    """

    velocity: Array
    method: str
    status: str
    reason: str
    active: tuple[int, ...]
    residual: Array
    scale: float
    damping: float
    guard: float
    backend: str
    multipliers: Array | None = None
    row_multipliers: Array | None = None


def clipped(demand: Demand, x: Array) -> tuple[Array, tuple[int, ...]]:
    """The velocity without rounding past its bounds, and the joints at them."""
    x = np.minimum(np.maximum(x, demand.lower), demand.upper)
    return x, tuple(at_bounds(x, demand.lower, demand.upper).nonzero()[0].tolist())


def at_bounds(x: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """(..., m) which joints of x (..., m) are at a bound."""
    margin = ACTIVE_TOLERANCE * np.maximum(SLOWEST, np.abs(x))
    return np.asarray((x <= lower + margin) | (x >= upper - margin))


def with_trouble(solution: VelocitySolution, trouble: str) -> VelocitySolution:
    """The solution with a reason more: status "degraded", unless it is "held"."""
    status = "held" if solution.status == "held" else "degraded"
    return solution._replace(status=status, reason="; ".join(filter(None, (trouble, solution.reason))))


def held(demand: Demand, reason: str) -> VelocitySolution:
    """Standing still or, where the bounds do not allow that, moving back inside them."""
    x, active = clipped(demand, np.zeros(len(demand.lower)))
    residual = demand.s - demand.J.dot(x)
    return VelocitySolution(x, "hold", "held", reason, active, residual, 0.0, 0.0, 0.0, "")
