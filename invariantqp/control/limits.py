"""Limits that a controller takes: the class to derive from, joint limits, acceleration limits, tool speed, rows.

    lower <= x <= upper      joint limits, with acceleration limits the velocities from which a joint can still brake
    lower <= C x <= upper    rows at joint positions q; relaxed where the joint limits leave no velocity for them
    |v_p(x)| <= limit        the speed of a point of the tool; relaxed after both

A `Limit` tightens the joint limits, which are never relaxed, or returns rows, or both. Limits that contradict each
other are relaxed by the least amount, and the reason names them.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits import LimitRows, ToolSpeed, accelerations
from invariantqp.velocity.reasons import Reason

# What `limits=` takes, in messages.
EXPECTED_LIMITS = (
    "LimitRows, a function of q that returns them, JointLimits, AccelerationLimit, ToolSpeed, Clearance, a Limit of "
    "your own, or a limit made for Pink: compute_qp_inequalities(...)"
)
Rows: TypeAlias = LimitRows | Callable[[Array], LimitRows | None]


class Loop(NamedTuple):
    """The arm, the tick and the joint limits of a loop, as a limit reads and tightens them.

    Attributes:
        robot: the arm.
        dt: tick [s].
        delay: dead time between a command and its effect on the next measurement, beyond one tick [s].
        position_lower: (m,) [rad, length], -inf for no limit.
        position_upper: (m,) likewise, +inf for no limit.
        velocity_limit: (m,) [rad/s, length/s], inf for no limit.
        acceleration: (m,) acceleration limits [rad/s^2, length/s^2], inf for no limit.
        margin: distance kept from position limits [rad, length].
        tool_speed: the speed limit of a point of the tool, or None.
    """

    robot: Robot
    dt: float
    delay: float
    position_lower: Array
    position_upper: Array
    velocity_limit: Array
    acceleration: Array
    margin: float = 0.0
    tool_speed: ToolSpeed | None = None


class Limit:
    """A limit of a loop. Derive from it and write `rows`, or `tightened` for limits that are never relaxed.

    Attributes:
        name: the name of its rows in reasons, unless the rows have names.
    """

    name: str = ""

    def tightened(self, loop: Loop) -> Loop:
        """The loop with tighter joint limits and acceleration limits; by default unchanged.

        Args:
            loop: the loop after the limits before this one.
        """
        return loop

    def begin(self, q: Array) -> None:
        """Called once at the beginning of each tick, before `rows`.

        Args:
            q: (m,) measured joint positions [rad, length].
        """
        del q

    def for_loop(self, loop: Loop) -> Limit | LimitRows:
        """The limit in a loop, called once when the controller is made; return LimitRows here if they are constant.

        Args:
            loop: the loop's arm, tick and joint limits.
        """
        del loop
        return self

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows of a tick; they are relaxed where they contradict joint limits.

        Args:
            q: (m,) joint positions when the command of this tick acts [rad, length].
            velocity: (m,) joint velocity before the tick [rad/s, length/s].

        Returns:
            LimitRows, or None if nothing is limited now.

        Raises:
            BadInput: no velocity is known to be safe; the arm is held, and the reason repeats the message.
        """
        del q, velocity
        return None

    def after(self, q: Array, velocity: Array) -> LimitRows | None:
        """More rows if the solution of a tick violates the limit at the end of the tick; the tick is then solved again.

        Called for each solution, up to four times in a tick.

        Args:
            q: (m,) as in `rows`, which was called before.
            velocity: (m,) the solution [rad/s, length/s].

        Returns:
            LimitRows, or None if the solution keeps the limit.
        """
        del q, velocity
        return None

    def violation(self) -> str:
        """How the limit was violated at the last call of `rows`, "" if it was not; the status is then not "ok"."""
        return ""

    def blocked(self, q: Array) -> str:
        """Why an arm cannot stop at joint positions q (m,), "" if it can; a path then ends before them.

        Args:
            q: (m,) [rad, length].
        """
        del q
        return ""


class EngineLimit(Limit):
    """A clearance in a loop, whose rows the engine computes without a call of Python.

    Attributes:
        engine: the engine's `ClearanceInLoop`.
        clearance: the `Clearance`, with the poses of obstacles and the names of pairs.
    """

    engine: Any
    clearance: Any


class UnusableRows(Exception):
    """The rows of this tick allow no velocity, or are NaN."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(str(reason))
        self.reason = reason


@frozen(init=False, eq=False, repr=False, slots=False)
class JointLimits(Value, Limit):
    """Position and velocity limits in addition to the robot's own; the tighter one counts. They are never relaxed.

    Attributes:
        position_lower: (m,) or one for all joints [rad, length], -inf for no limit.
        position_upper: likewise, +inf for no limit.
        velocity_limit: likewise [rad/s, length/s], zero or more, inf for no limit.
        margin: distance kept from all position limits, the robot's too [rad, length].
    """

    position_lower: Array = field(converter=own)
    position_upper: Array = field(converter=own)
    velocity_limit: Array = field(converter=own)
    margin: float

    def __init__(
        self,
        position_lower: ArrayLike = -inf,
        position_upper: ArrayLike = inf,
        velocity_limit: ArrayLike = inf,
        margin: float = 0.0,
    ) -> None:
        """See the attributes; no lower limit is above the upper one."""
        low, high = _numbers(position_lower, "position_lower"), _numbers(position_upper, "position_upper")
        if low.ndim == high.ndim == 1 and low.shape != high.shape:
            raise BadInput("position_upper", f"{len(high)} limits", f"{len(low)}, one for each lower limit")
        if (low > high).any():
            raise BadInput("position_lower", f"{excerpt(low)} above {excerpt(high)}", "lower <= upper for every joint")
        speed = _numbers(velocity_limit, "velocity_limit")
        if (speed < 0.0).any():
            raise BadInput("velocity_limit", f"{speed[speed < 0.0][0]:g}", "speeds, zero or more")
        distance = arrays.not_negative(margin, "margin", "a distance kept from position limits")
        self.__attrs_init__(low, high, speed, distance)

    def tightened(self, loop: Loop) -> Loop:
        """The loop with these limits.

        Raises:
            BadInput: limits of another number of joints, a range that does not overlap the loop's, or a margin that
                leaves nothing of a range.
        """
        m = len(loop.velocity_limit)
        for limits in (self.position_lower, self.position_upper, self.velocity_limit):
            if limits.shape not in ((), (m,)):
                raise BadInput("limits", f"JointLimits on {limits.size} joints", f"{m} limits, or one for all")
        low = np.maximum(loop.position_lower, self.position_lower)
        high = np.minimum(loop.position_upper, self.position_upper)
        if (low > high).any():
            i = int((low > high).argmax())
            raise BadInput(
                "limits",
                f"JointLimits that leave joint {i} no position: from {low[i]:g} to {high[i]:g}",
                "a range in common with the robot's",
            )
        fastest = np.minimum(loop.velocity_limit, self.velocity_limit)
        margin = max(loop.margin, self.margin)
        require_range(low, high, margin, "limits")
        return loop._replace(position_lower=low, position_upper=high, velocity_limit=fastest, margin=margin)


def require_range(low: Array, high: Array, margin: float, argument: str) -> None:
    """Raise BadInput for a margin that leaves nothing of a joint's range [low, high]; locked joints do not count."""
    empty = (high > low) & (2.0 * margin >= high - low)
    if empty.any():
        i = int(empty.argmax())
        raise BadInput(
            argument,
            f"a margin of {margin:g}, which leaves joint {i} nothing between {low[i]:g} and {high[i]:g}",
            "less than half of every joint's range",
        )


@frozen(init=False, eq=False, repr=False, slots=False)
class AccelerationLimit(Value, Limit):
    """Acceleration limits of the joints, which also keep the distance to brake before their position limits.

    Attributes:
        limit: (m,) or one for all joints [rad/s^2, length/s^2], above zero, inf for no limit.
    """

    limit: Array = field(converter=own)

    def __init__(self, limit: ArrayLike) -> None:
        """See the attribute."""
        a = _numbers(limit, "limit")
        self.__attrs_init__(accelerations(a, a.size, "limit").reshape(a.shape))

    def tightened(self, loop: Loop) -> Loop:
        """The loop with these limits."""
        a = accelerations(self.limit, len(loop.acceleration), "limits")
        return loop._replace(acceleration=np.minimum(loop.acceleration, a))


class ToolSpeedLimit(Limit):
    """A `ToolSpeed` as a limit; a loop limits one point of the tool.

    Attributes:
        limit: the tool speed; of a number, that of the tool frame's origin.
    """

    def __init__(self, limit: ToolSpeed | float) -> None:
        """See the attribute."""
        if not isinstance(limit, ToolSpeed):
            limit = ToolSpeed(arrays.number(limit, "tool_speed", "a speed", positive=True))
        self.limit = limit

    def tightened(self, loop: Loop) -> Loop:
        """The loop with the lower of its tool speed and this one."""
        current, limit = loop.tool_speed, self.limit
        if current is not None:
            if limit.point is not None and not np.array_equal(_point_of(current), limit.point):
                raise BadInput("limits", "tool speeds of two points", "those of one point of the tool")
            limit = ToolSpeed(min(current.limit, limit.limit), current.point)
        return loop._replace(tool_speed=limit)


def tool_speed_fields(limit: ToolSpeed) -> tuple[float, Array]:
    """A tool speed as the engine takes it: the limit and its point (3,) in the tool frame."""
    return limit.limit, _point_of(limit)


def _point_of(limit: ToolSpeed) -> Array:
    """(3,) the limited point in the tool frame."""
    return np.zeros(3) if limit.point is None else np.asarray(limit.point)


class RowLimit(Limit):
    """Constant rows, or a function of q that returns rows, as a limit.

    Attributes:
        argument: the argument that they were given by, for messages.
    """

    def __init__(self, rows: Any, argument: str = "rows") -> None:
        """From LimitRows or a function of q (m,)."""
        if isinstance(rows, type) or not (callable(rows) or isinstance(rows, LimitRows)):
            expected = "LimitRows(C, lower, upper), or a function of q that returns it"
            raise BadInput(argument, excerpt(rows), EXPECTED_LIMITS if argument == "limits" else expected)
        self._rows: Rows = rows
        self.argument = argument
        name = getattr(rows, "name", getattr(rows, "__name__", ""))
        self.name = name if isinstance(name, str) and name != "<lambda>" else ""

    def for_loop(self, loop: Loop) -> Limit | LimitRows:
        """The rows if they are constant."""
        del loop
        return self._rows if isinstance(self._rows, LimitRows) else self

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows of the function."""
        del velocity
        return None if isinstance(self._rows, LimitRows) else self._rows(q.copy())


def _numbers(value: ArrayLike, argument: str) -> Array:
    """(m,) numbers, or one for all joints; no NaN."""
    a = arrays.array(value, argument, "numbers, one a joint or one for all, infinite where there is no limit")
    if a.ndim > 1 or a.size == 0:
        raise BadInput(argument, f"shape {a.shape}", "numbers, one a joint or one for all")
    if np.isnan(a).any():
        raise BadInput(argument, "NaN", "numbers, infinite where there is no limit")
    return a.copy()
