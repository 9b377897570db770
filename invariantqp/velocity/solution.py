"""The solution of a tick: a joint velocity, its method and status, and the reasons."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.reasons import Code, Stored, WithReasons, parts

# Relative distance to a limit that counts as active; slower joints are compared at this speed [rad/s, length/s].
ACTIVE_TOLERANCE = 1e-6


class Status(str, Enum):
    """The status of a tick; `reason` says why.

    Of the velocity law and of every loop:

    ==========  ====================================================================================================
    OK          at most 5 % of the twist is missed, or the errors of position and orientation each shrink at least
                half as fast as requested
    LIMITED     more is missed: limits, a singularity or fewer than six joints; the best inside the limits
    GUARDED     the descent guard blended in least squares
    SCALED      the exact rows are slowed down by limits, in their direction
    DEGRADED    a declared limit or parameter does not hold, or the joints do not follow their commands
    HELD        no usable solution, or implausible input: at rest, or moving back inside the limits
    ==========  ====================================================================================================

    Of a path: WAITING (planning, or on the way to its start), MOVING, SLOWED (by limits), PAUSED (at rest on it or at
    its start), LEFT (infeasible here, and left by the least), BLOCKED (infeasible; stopped before it), DONE, HELD. Of a
    `Follower`: the same without SLOWED; LATE (behind the commanded motion, catching up); LIMITED, SCALED, DEGRADED.

    Of a contact: LOST (no contact), OVERLOAD (force above its maximum), FAULT (of the sensor).
    """

    OK = "ok"
    LIMITED = "limited"
    GUARDED = "guarded"
    SCALED = "scaled"
    DEGRADED = "degraded"
    HELD = "held"
    WAITING = "waiting"
    MOVING = "moving"
    SLOWED = "slowed"
    LATE = "late"
    PAUSED = "paused"
    LEFT = "left"
    BLOCKED = "blocked"
    DONE = "done"
    LOST = "lost"
    OVERLOAD = "overload"
    FAULT = "fault"

    # Printed as the plain string in all versions of Python.
    __str__ = str.__str__
    __repr__ = str.__repr__
    __format__ = str.__format__  # type: ignore[assignment]


class _Solution(NamedTuple):
    velocity: Array
    method: str
    status: Status
    reasons: Stored
    active: tuple[int, ...]
    residual: Array
    scale: float
    damping: float
    guard: float
    backend: str
    multipliers: Array | None = None
    row_multipliers: Array | None = None
    row_names: Iterable[str] = ()
    joint_names: tuple[str, ...] = ()


class VelocitySolution(WithReasons, _Solution):
    """A joint velocity and how it was found. A tuple, for speed.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the bounds.
        method: "closed-form" (no limit is active), "damped" (likewise, with damping), "qp" (a limit is active), "hold".
        status: "ok", "limited", "guarded", "scaled", "degraded" or "held": see `Status`.
        reasons: why, as data, the most severe first; () for none.
        reason: the same in words, "" for none.
        active: joints at a bound.
        residual: (6,) s - J x in the frame of J.
        scale: share of the exact rows' speed that was possible, in [0, 1], 1 unless scaled.
        damping: lambda used [length; unit of root J], 0 where the whole twist is achieved.
        guard: t, share of least squares blended in by the guard, 0 where it is inactive.
        backend: name of the solver of a QP, else "".
        multipliers: (m,) Lagrange multipliers of the bounds, positive at upper and negative at lower ones; None where
            no limit is active.
        row_multipliers: (k,) the same for the rows of `LimitRows`.
        row_names: (k,) names of these rows, "" for one without; () where none has one.
        joint_names: (m,) names of the joints in reasons; () if unknown.
    """

    __slots__ = ()


def at_bounds(x: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """(..., m) which joints of x (..., m) are at a bound."""
    margin = ACTIVE_TOLERANCE * np.maximum(ACTIVE_TOLERANCE, np.abs(x))
    return np.asarray((x <= lower + margin) | (x >= upper - margin))


def degraded(solution: VelocitySolution, reasons: Stored) -> VelocitySolution:
    """The solution with status "degraded", unless it is "held", and these reasons first."""
    status = Status.HELD if solution.status is Status.HELD else Status.DEGRADED
    return solution._replace(status=status, reasons=with_reasons_first(reasons, solution))


def has_no_motion(solution: VelocitySolution) -> bool:
    """Whether some joints do not move although they are commanded to."""
    return solution.status is Status.DEGRADED and any(one.code is Code.NO_MOTION for one in solution.reasons)


def with_reasons_first(first: Stored, solution: VelocitySolution) -> Stored:
    """Reasons followed by those of a solution, without decoding these."""
    return (*parts(first), *parts(solution[3]))
