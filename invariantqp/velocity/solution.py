"""The result of a tick: a joint velocity, how it was found, and why."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.reasons import Code, Explained, Why, parts

# A limit this close, relative to its value (or 1), is at it.
ACTIVE_TOLERANCE = 1e-6
# A joint is at a bound within `ACTIVE_TOLERANCE` of its speed, or of this one [rad/s, length/s] where it is slower; the
# rest is rounding of an arm that stands still.
SLOWEST = 1e-6


class Status(str, Enum):
    """The status of a tick, in the order of their gravity for each loop; `reason` says why, in words.

    The velocity law, and every loop for what becomes of its velocity:

    ==========  ====================================================================================================
    OK          at most 5 % of the twist is missed, or the errors of position and orientation each shrink at least
                half as fast as requested
    LIMITED     limits, a singularity or fewer than six joints keep more of the twist away: the best inside the limits
    GUARDED     the descent guard blended in least squares
    SCALED      limits slow exact rows down; their direction is kept
    DEGRADED    something declared does not hold, or the joints do not move as commanded: see the reason
    HELD        no usable answer, or input that is certainly wrong: at rest, or on the way back inside limits
    ==========  ====================================================================================================

    A path: WAITING (on the way to its start, or planning), MOVING, SLOWED (limits rule the speed), PAUSED (at rest on
    it, or back at its start), LEFT (it cannot be had here, and is passed by the least), BLOCKED (it cannot be had, or
    got to, and the tool has stopped before it), DONE, HELD (joint positions that cannot be true). A `Follower` has the
    same but SLOWED, LATE (what is wanted is faster than the joints may be, which catch up; or these are not where they
    were sent), and of the law's LIMITED (a twist that cannot be done, or limits that move the arm), SCALED and
    DEGRADED.

    A contact, also of a `Follower` of streams: LOST (there is none), OVERLOAD (more force than allowed), FAULT (of the
    sensor).
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

    # Printed as the plain word, in all versions of Python.
    __str__ = str.__str__
    __repr__ = str.__repr__
    __format__ = str.__format__  # type: ignore[assignment]


class _Solution(NamedTuple):
    velocity: Array
    method: str
    status: Status
    reasons: Why
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


class VelocitySolution(Explained, _Solution):
    """A joint velocity and how it was found. A tuple, because one is made in every tick.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the bounds.
        method: "closed-form" (no limit is active), "damped" (likewise, with damping), "qp" (a limit is active), "hold".
        status: "ok", "limited", "guarded", "scaled", "degraded" or "held": see `Status`.
        reasons: why, as data, the worst first: codes, joints, limits by name, numbers; () where there is nothing to
            report.
        reason: the same in words, "" for nothing.
        active: joints at a bound.
        residual: (6,) s - J x in the frame of J.
        scale: share of the exact rows' speed that was possible, in [0, 1], 1 unless scaled.
        damping: lambda used [length; unit of root J], 0 where the whole twist is met all the same.
        guard: t, share of least squares blended in by the guard; 0 when it did not act.
        backend: the solver that answered, "" without one.
        multipliers: (m,) what each joint's bound costs in the objective: positive at the upper bound, negative at the
            lower, 0 away from them. None where no limit is active.
        row_multipliers: (k,) the same for the rows of `LimitRows`.
        row_names: (k,) what these rows are called, "" for one without a name; () where none has one.
        joint_names: (m,) what joints are called, which reasons say; () where none are named or nobody said.
    """

    __slots__ = ()


def at_bounds(x: Array, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """(..., m) which joints of x (..., m) are at a bound."""
    margin = ACTIVE_TOLERANCE * np.maximum(SLOWEST, np.abs(x))
    return np.asarray((x <= lower + margin) | (x >= upper - margin))


def with_trouble(solution: VelocitySolution, trouble: Why) -> VelocitySolution:
    """The solution with more reasons: status "degraded", unless it is "held"."""
    status = Status.HELD if solution.status is Status.HELD else Status.DEGRADED
    return solution._replace(status=status, reasons=both(trouble, solution))


def no_motion(solution: VelocitySolution) -> bool:
    """Whether joints of the arm that a solution is for do not move although they are commanded to."""
    return solution.status is Status.DEGRADED and any(one.code is Code.NO_MOTION for one in solution.reasons)


def both(first: Why, solution: VelocitySolution) -> Why:
    """Some reasons before those of a solution, which are not read for that."""
    return (*parts(first), *parts(solution[3]))
