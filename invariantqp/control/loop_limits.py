"""The limits of one loop: all that `limits=` takes, gathered into joint limits, a tool speed and the rows of a tick."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property, lru_cache
from math import inf
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.limits import (
    EXPECTED_LIMITS,
    JointLimits,
    Limit,
    Loop,
    RowLimit,
    Rows,
    ToolSpeedLimit,
    UnusableRows,
)
from invariantqp.control.pink_limit import ForPink, PinkLimit, is_for_pink
from invariantqp.control.plausibility import PositionBounds, implausible
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import (
    Robot,
    plausible_distance,
    require_plausible_distance,
    warn_if_implausible_range,
    warn_if_implausible_speed,
)
from invariantqp.velocity.limits import JointBox, LimitRows, ToolSpeed
from invariantqp.velocity.reasons import Code, Reason

# How far outside its position range a turning joint may be [rad]; farther out, its position is not in radians.
FAR_OUTSIDE = 0.5
AnyLimit: TypeAlias = Rows | Limit | ToolSpeed | ForPink


def limits_of(limits: Sequence[AnyLimit]) -> list[Limit]:
    """The argument `limits=` as limits."""
    if not isinstance(limits, (list, tuple)):
        raise BadInput("limits", excerpt(limits), f"a list: {EXPECTED_LIMITS}")
    made: list[Limit] = []
    for limit in limits:
        if isinstance(limit, Limit):
            made.append(limit)
        elif isinstance(limit, ToolSpeed):
            made.append(ToolSpeedLimit(limit))
        else:
            made.append(PinkLimit(limit) if is_for_pink(limit) else RowLimit(limit, "limits"))
    return made


def loop_of(robot: Robot, dt: float, delay: float) -> Loop:
    """A loop with only the robot's own limits."""
    ranges = robot.position_lower, robot.position_upper
    return Loop(robot, dt, delay, *ranges, robot.velocity_limit, np.full(len(robot.names), inf))


def _tightened(loop: Loop, limits: Iterable[Limit]) -> Loop:
    """The loop tightened by each limit in turn."""
    for limit in limits:
        loop = limit.tightened(loop)
    return loop


def box_of(loop: Loop, rate: float | None = None) -> JointBox:
    """The joint limits of a loop; position limits are approached at a rate [1/s], by default the tracking gain."""
    rate = tracking_gain(None, loop.dt, loop.delay) if rate is None else rate
    return JointBox(loop.position_lower, loop.position_upper, loop.velocity_limit, rate, loop.margin)


def limit_fields(loop: Loop, rate: float) -> dict[str, Any]:
    """The joint limits of a loop as the engine takes them."""
    box = box_of(loop, rate)
    return {
        "position_lower": box.position_lower,
        "position_upper": box.position_upper,
        "velocity_limit": box.velocity_limit,
        "acceleration": loop.acceleration,
        "dt": loop.dt,
        "rate": rate,
    }


class RowLimits:
    """The limits of a loop that return rows, in their order."""

    def __init__(self, given: Sequence[Limit], loop: Loop) -> None:
        """The limits `given` in a loop."""
        self._given, self._loop = tuple(given), loop
        self._m = len(loop.velocity_limit)
        self._limits: list[Limit | LimitRows] = []
        for limit in given:
            made = limit.for_loop(loop)
            if isinstance(made, LimitRows):
                self._limits.append(self._named(made, limit))
            elif type(made).rows is not Limit.rows:
                self._limits.append(made)
            elif type(limit).tightened is Limit.tightened:
                expected = "a Limit that has rows, tightened or for_loop: this limits nothing"
                raise BadInput("limits", excerpt(limit), expected)

    def __bool__(self) -> bool:
        return bool(self._limits)

    def __iter__(self) -> Iterator[Limit | LimitRows]:
        return iter(self._limits)

    def __deepcopy__(self, memo: dict[int, Any]) -> RowLimits:
        """The limits of another loop, made from the same objects, such as moving obstacles."""
        return RowLimits(self._given, self._loop)

    @cached_property
    def fixed(self) -> LimitRows | None:
        """The rows if all are constant, else None."""
        rows = [limit for limit in self._limits if isinstance(limit, LimitRows)]
        return stacked(rows) if len(rows) == len(self._limits) else None

    def without_pink(self, q: Array) -> LimitRows | None:
        """The rows at rest at joint positions q (m,), without those of limits made for Pink; None if unusable."""
        limits = [limit for limit in self._limits if not isinstance(limit, PinkLimit)]
        return self.rows_from("rows", limits, q, np.zeros(self._m))[0]

    def blocked(self, q: Array) -> str:
        """Why an arm cannot stop at joint positions q (m,), "" if it can."""
        limits = (limit for limit in self._limits if isinstance(limit, Limit))
        return next((why for limit in limits if (why := limit.blocked(q))), "")

    def rows_from(
        self, method: Literal["rows", "after"], limits: Sequence[Limit | LimitRows], q: Array, velocity: Array
    ) -> tuple[LimitRows | None, Reason | None]:
        """The rows that a method of some of these limits returns, stacked, and the reason if they cannot be used."""
        found = []
        for limit in limits:
            if isinstance(limit, LimitRows):
                found.append(limit)
                continue
            try:
                rows = getattr(limit, method)(q, velocity)
            except UnusableRows as unusable:
                return None, unusable.reason
            except BadInput as error:
                if error.argument == "limits":
                    raise
                return None, Reason(Code.LIMIT_FAILED, rows=(limit.name or "rows",), words=str(error))
            if rows is not None:
                found.append(self._named(rows, limit))
        return stacked(found), None

    def _named(self, rows: object, limit: Limit) -> LimitRows:
        """Rows on the arm's joints, checked, with the name of their limit if they have no names."""
        if not isinstance(rows, LimitRows):
            expected = "LimitRows(C, lower, upper), or None for no limit"
            raise BadInput(getattr(limit, "argument", "limits"), type(rows).__name__, expected)
        k, m = rows.C.shape
        if m != self._m:
            argument = getattr(limit, "argument", "limits")
            raise BadInput(argument, f"rows on {m} joints", f"rows on {self._m}, one for each joint")
        if rows.names or not limit.name:
            return rows
        return rows.renamed(_names_of(limit.name, k))


def overrides(limit: Limit | LimitRows, method: str) -> bool:
    """Whether a limit has its own version of a method of `Limit`."""
    return isinstance(limit, Limit) and getattr(type(limit), method) is not getattr(Limit, method)


@lru_cache
def _names_of(limit: str, k: int) -> tuple[str, ...]:
    """The names of k rows of a limit."""
    return (limit,) if k == 1 else tuple(f"{limit} row {i}" for i in range(k))


def stacked(parts: list[LimitRows]) -> LimitRows | None:
    """All rows together, or None."""
    if len(parts) < 2:
        return parts[0] if parts else None
    named = any(part.names for part in parts)
    names = [name for part in parts for name in part.names or ("",) * len(part.C)] if named else ()
    C, lower, upper = (np.concatenate([getattr(part, side) for part in parts]) for side in ("C", "lower", "upper"))
    return LimitRows(C, lower, upper, names)


class TickChanges(NamedTuple):
    """Speed and limits of one tick where they differ from the controller's.

    v_max(tick) = max(speed v_max, |x_before| - a dt):   joints above the limit slow down at their acceleration limit
    """

    speed: float  # share of the motion's speed, in [0, 1]
    loop: Loop  # with the limits of this tick
    joint_rows: RowLimits  # additional rows


class LoopLimits(NamedTuple):
    """The limits of a controller."""

    box: JointBox  # position and velocity limits
    acceleration_limit: Array | None  # (m,) [rad/s^2, length/s^2], or None
    tool_speed: ToolSpeed | None  # the speed limit of a point of the tool, or None
    joint_rows: RowLimits | None  # limits on combinations of joint velocities, or None
    loop: Loop  # the tightened joint limits
    plausible: PositionBounds  # bounds of measured joint positions
    tip: Array  # (3,) position of the tool at the middle of the joint range
    farthest: float  # largest plausible distance of a target from there [length], inf for no bound

    @classmethod
    def of(
        cls, loop: Loop, limits: Sequence[Limit], far_outside: Literal["hold", "return"], J: Array, tip: Array
    ) -> LoopLimits:
        """The robot's limits in `loop` and all `limits`, for joint twists J (6, m) with the tool at `tip` (3,).

        Raises:
            BadInput: limits of another number of joints, or limits that exclude each other.
            MissingExtra: a limit of Pink's without Pink.
        """
        robot, turning = loop.robot, np.array(J[:3].any(axis=0))
        for limit in limits:
            if isinstance(limit, JointLimits):
                warn_if_implausible_range(limit.position_lower, limit.position_upper, turning, "JointLimits")
        loop = _tightened(loop, limits)
        acceleration = loop.acceleration if np.isfinite(loop.acceleration).any() else None
        rows = RowLimits(limits, loop)
        holds = arrays.choice(far_outside, "far_outside", ("hold", "return")) == "hold"
        outside = np.where(turning & holds, FAR_OUTSIDE, inf)
        plausible = (robot.position_lower - outside).tolist(), (robot.position_upper + outside).tolist()
        farthest = plausible_distance(robot, J, tip)
        if loop.tool_speed is not None:
            warn_if_implausible_speed(loop.tool_speed.limit, farthest, "tool_speed")
        return cls(box_of(loop), acceleration, loop.tool_speed, rows or None, loop, plausible, tip, farthest)

    def changed(
        self, speed: float, velocity_limit: ArrayLike | None, tool_speed: float | None, limits: Sequence[AnyLimit]
    ) -> TickChanges | None:
        """The changes of a tick, from the arguments of `Controller.step`; None for no change."""
        if type(speed) is float and speed == 1.0 and velocity_limit is None and tool_speed is None and limits == ():
            return None
        share = arrays.not_negative(speed, "speed", "a share of the speed, from 0 to 1")
        if share > 1.0:
            raise BadInput("speed", f"{share:g}", "a share of the speed, from 0 to 1")
        more = limits_of(limits)
        if velocity_limit is not None:
            m, slower = len(self.loop.velocity_limit), JointLimits(velocity_limit=velocity_limit)
            if slower.velocity_limit.shape not in ((), (m,)):
                found = f"shape {slower.velocity_limit.shape}"
                raise BadInput("velocity_limit", found, f"{m} speeds, zero or more, or one for all")
            more.append(slower)
        if tool_speed is not None:
            speed_limit = arrays.number(tool_speed, "tool_speed", "a speed (speed=0 stops)", positive=True)
            more.append(ToolSpeedLimit(speed_limit))
        if share == 1.0 and not more:
            return None
        loop = _tightened(self.loop, more)
        if loop.tool_speed is not None and loop.tool_speed is not self.loop.tool_speed:
            warn_if_implausible_speed(loop.tool_speed.limit, self.farthest, "tool_speed")
        return TickChanges(share, loop, RowLimits(more, loop))

    def implausible(self, q: Array) -> Reason | None:
        """Why measured joint positions (m,) cannot be true, None if they can."""
        return implausible(self.loop.robot, q, self.plausible)

    def require_near(self, points: Array, argument: str) -> None:
        """Raise BadInput for points (..., 3) too far away to be in the arm's unit of length."""
        require_plausible_distance(points, self.tip, self.farthest, argument)
