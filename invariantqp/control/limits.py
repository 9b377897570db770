"""What a loop may not leave: all that a controller's `limits=` takes, and what it comes to in a tick.

    lower <= x <= upper      joint limits, and with acceleration limits the room to brake; they never give way
    lower <= C x <= upper    rows at joint positions q; where joint limits leave no velocity for them, they give way
    |v_p(x)| <= limit        the speed of a point of the tool; it gives way to both

Every kind of limit is a `Limit`: it narrows what never gives way, or answers with rows, or both. One of your own is a
class with one method. Where limits contradict each other, they give way by the least, and the reason names them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from functools import cached_property, lru_cache
from math import inf
from operator import le
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.robots.kinematics import (
    PLAUSIBLE_ANGLE,
    Robot,
    middle,
    plausible_distance,
    require_plausible_distance,
    warn_if_implausible_range,
    warn_if_implausible_speed,
)
from invariantqp.velocity.limits import JointBox, LimitRows, ToolSpeed, accelerations
from invariantqp.velocity.reasons import Code, Reason

# A joint that turns is never this far outside its position range [rad]: its position is no measurement in radians.
FAR_OUTSIDE = 0.5
LIMITS = (
    "LimitRows, a function of q that returns them, JointLimits, AccelerationLimit, ToolSpeed, Clearance, a Limit of "
    "your own, or a limit made for Pink: compute_qp_inequalities(...)"
)


class Loop(NamedTuple):
    """What a limit may know of the loop that it is in, and narrow.

    Attributes:
        robot: the arm.
        dt: tick [s].
        delay: dead time between a command and its effect on the next measurement, beyond one tick [s].
        position_lower: (m,) [rad, length], -inf where there is none.
        position_upper: (m,) likewise, +inf.
        velocity_limit: (m,) [rad/s, length/s], inf where there is none.
        acceleration: (m,) what joints may speed up and brake by [rad/s^2, length/s^2], inf where there is no limit.
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
    """A limit of a loop. Derive from it, and write `rows`, or `narrowed` for what is never to give way.

    Attributes:
        name: what reasons call its rows, where these have no names of their own.
    """

    name: str = ""

    def narrowed(self, loop: Loop) -> Loop:
        """The loop with narrower limits of joints and accelerations; by default as it is.

        Args:
            loop: as the limits before this one left it.
        """
        return loop

    def begin(self, q: Array) -> None:
        """A tick of the loop that it is in begins: once in each, before rows are asked for.

        Args:
            q: (m,) measured joint positions [rad, length].
        """
        del q

    def for_loop(self, loop: Loop) -> Limit | LimitRows:
        """The limit as it is in a loop, made once; rows that never change cost least where they are given here.

        Args:
            loop: what is known of it.
        """
        del loop
        return self

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows of a tick; they give way to joint limits.

        Args:
            q: (m,) where the joints are when the command of this tick acts [rad, length].
            velocity: (m,) joint velocity before [rad/s, length/s].

        Returns:
            LimitRows, or None where nothing is limited now.

        Raises:
            BadInput: no velocity is known to be safe here; the arm is then held, with these words.
        """
        del q, velocity
        return None

    def after(self, q: Array, velocity: Array) -> LimitRows | None:
        """More rows, where the answer of a tick does not keep the limit to the tick's end; it is then made again.

        The next answer is asked about too, up to four times in a tick.

        Args:
            q: (m,) as in `rows`, which were asked for before.
            velocity: (m,) the answer [rad/s, length/s].

        Returns:
            LimitRows, or None where the limit is kept.
        """
        del q, velocity
        return None

    def broken(self) -> str:
        """What of it does not hold where rows were last asked for, "" where all does: such a tick is not "ok"."""
        return ""

    def blocked(self, q: Array) -> str:
        """Why an arm cannot come to rest at joint positions q (m,), "" where it can: a path then ends before them.

        Args:
            q: (m,) [rad, length].
        """
        del q
        return ""


class LimitInEngine(Limit):
    """A clearance in a loop: a controller's tick asks the engine for its rows, without Python.

    Attributes:
        engine: the engine's `ClearanceInLoop`.
        clearance: the `Clearance`, which knows where obstacles are now and how pairs of bodies are called.
    """

    engine: Any
    clearance: Any


@frozen(init=False, eq=False, repr=False, slots=False)
class JointLimits(Value, Limit):
    """Position and velocity limits beside the robot's own; the narrower counts. They never give way.

    Attributes:
        position_lower: (m,) or one for all joints [rad, length], -inf where there is none.
        position_upper: likewise, +inf.
        velocity_limit: likewise [rad/s, length/s], zero or more, inf where there is none.
        margin: distance kept from position limits, the robot's too [rad, length].
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
        """As its attributes; no lower limit is above the upper one."""
        low, high = _numbers(position_lower, "position_lower"), _numbers(position_upper, "position_upper")
        if low.ndim == high.ndim == 1 and low.shape != high.shape:
            raise BadInput("position_upper", f"{len(high)} limits", f"{len(low)}, one for each lower limit")
        if (low > high).any():
            raise BadInput("position_lower", f"{excerpt(low)} above {excerpt(high)}", "lower <= upper for every joint")
        speed = _numbers(velocity_limit, "velocity_limit")
        if (speed < 0.0).any():
            raise BadInput("velocity_limit", f"{speed[speed < 0.0][0]:g}", "speeds, zero or more")
        kept = arrays.not_negative(margin, "margin", "a distance kept from position limits")
        self.__attrs_init__(low, high, speed, kept)

    def narrowed(self, loop: Loop) -> Loop:
        """The loop inside these limits.

        Raises:
            BadInput: another number of joints; a range that has nothing in common with the loop's, or that the margin
                takes whole.
        """
        m = len(loop.velocity_limit)
        for limits in (self.position_lower, self.position_upper, self.velocity_limit):
            if limits.shape not in ((), (m,)):
                raise BadInput("limits", f"JointLimits on {limits.size} joints", f"{m} limits, or one for all")
        low, high = (
            np.maximum(loop.position_lower, self.position_lower),
            np.minimum(loop.position_upper, self.position_upper),
        )
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
    """Refuse a margin that leaves a joint with a range [low, high] none of it; one that is locked has none to leave."""
    gone = (high > low) & (2.0 * margin >= high - low)
    if gone.any():
        i = int(gone.argmax())
        raise BadInput(
            argument,
            f"a margin of {margin:g}, which leaves joint {i} nothing between {low[i]:g} and {high[i]:g}",
            "less than half of every joint's range",
        )


@frozen(init=False, eq=False, repr=False, slots=False)
class AccelerationLimit(Value, Limit):
    """What joints may speed up and brake by; they also keep room to brake before their position limits.

    Attributes:
        limit: (m,) or one for all joints [rad/s^2, length/s^2], above zero, inf where there is none.
    """

    limit: Array = field(converter=own)

    def __init__(self, limit: ArrayLike) -> None:
        """As its attribute."""
        a = _numbers(limit, "limit")
        self.__attrs_init__(accelerations(a, a.size, "limit").reshape(a.shape))

    def narrowed(self, loop: Loop) -> Loop:
        """The loop inside these limits."""
        a = accelerations(self.limit, len(loop.acceleration), "limits")
        return loop._replace(acceleration=np.minimum(loop.acceleration, a))


class _OfTool(Limit):
    """The speed of a point of the tool: one for all limits of a loop."""

    def __init__(self, limit: ToolSpeed) -> None:
        self._limit = limit

    def narrowed(self, loop: Loop) -> Loop:
        known, limit = loop.tool_speed, self._limit
        if known is not None:
            if limit.point is not None and not np.array_equal(_limited_point(known), limit.point):
                raise BadInput("limits", "tool speeds of two points", "those of one point of the tool")
            limit = ToolSpeed(min(known.limit, limit.limit), known.point)
        return loop._replace(tool_speed=limit)


class ForPink(Protocol):
    """A limit or barrier made for Pink from `robot.model`: G dq <= h for the joint displacement dq of a tick."""

    def compute_qp_inequalities(self, configuration: Any, dt: float) -> tuple[Any, Any] | None:
        """G (k, m) and h (k,) in a `pink.Configuration` for a tick of dt [s]; None where nothing is limited now."""
        ...


class PinkLimit(Limit):
    """A limit or barrier made for Pink from `robot.model`, with the collision model that some of them read.

        G dq <= h  for the displacement of a tick:   G x <= h / dt, rows of unit length

    `limits=[barrier]` is short for `limits=[PinkLimit(barrier)]`.

    Attributes:
        limit: Pink's, anything with `compute_qp_inequalities(configuration, dt)`.
        collision_model: a `pinocchio.GeometryModel` on the joints of `robot.model` where the limit reads one, or None.
        name: the name of its class.
    """

    _configuration: Any  # of the loop that it is in, and its tick [s]
    _dt: float

    def __init__(self, limit: ForPink, collision_model: Any = None) -> None:
        """As its attributes."""
        if not _is_pinks(limit):
            raise BadInput("limit", excerpt(limit), "a limit made for Pink: compute_qp_inequalities(...)")
        self.limit: Any = limit
        self.collision_model = collision_model
        self.name = type(limit).__name__

    def for_loop(self, loop: Loop) -> Limit:
        """The limit with a configuration of its own, tried once.

        Raises:
            BadInput: a robot without a model; a limit that fails on this arm.
            MissingExtra: without Pink.
        """
        model: Any = getattr(loop.robot, "model", None)
        if model is None:
            raise BadInput("limits", "a robot of joint screws", "one of a URDF: Pink's limits read its model")
        from invariantqp.robots.pink import Configuration, SelfCollisionBarrier  # Pink is loaded when it is asked for

        made, q, shapes = copy(self), middle(loop.robot), self.collision_model
        if shapes is None and isinstance(self.limit, SelfCollisionBarrier):
            shapes = _shapes_of(loop.robot)
        collisions = {} if shapes is None else {"collision_model": shapes}
        configuration = Configuration(model, model.createData(), q, **collisions)
        vars(made).update(_configuration=configuration, _dt=loop.dt)
        try:
            made.rows(q, np.zeros(len(q)))
        except _Unusable:  # in that state
            pass
        except Exception as error:  # whatever a class of another library raises
            if isinstance(error, BadInput) and error.argument == "limits":
                raise
            remedy = (
                "One that reads collisions is given them by iq.limits.PinkLimit(limit, collision_model=...); "
                "iq.limits.Clearance(robot, bodies={link: [shapes]}) needs no model."
            )
            raise BadInput(
                "limits",
                f"{self.name}, which fails on this arm: {type(error).__name__}: {error}",
                "a limit made from robot.model",
                remedy if self.collision_model is None else "",
            ) from error
        return made

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows of a tick of the loop that it is in, of unit length."""
        self._configuration.update(q)
        if hasattr(self.limit, "set_last_integration"):  # an acceleration limit
            self.limit.set_last_integration(velocity.copy(), self._dt)
        with np.errstate(invalid="ignore"):  # NaN is checked for below
            answer = self.limit.compute_qp_inequalities(self._configuration, self._dt)
        if answer is None:
            return None
        G, h = answer
        C = np.array(G, dtype=np.float64).reshape(-1, np.shape(G)[-1])
        upper = np.array(h, dtype=np.float64).reshape(-1) / self._dt
        if C.shape != (len(upper), len(q)):
            raise BadInput(
                "limits",
                f"{self.name} with rows of shape {C.shape} and {len(upper)} bounds",
                f"rows on {len(q)} joints",
                "Make it from robot.model.",
            )
        length = np.linalg.norm(C, axis=1)
        if np.isnan(upper).any() or not np.isfinite(length).all():
            raise _Unusable(Reason(Code.ROWS_ARE_NAN, rows=(self.name,)))
        still = length == 0.0
        if (upper[still] < 0.0).any() or (upper == -inf).any():
            raise _Unusable(Reason(Code.ROWS_ALLOW_NOTHING, rows=(self.name,)))
        kept = np.flatnonzero(~still & (upper < inf))
        if not len(kept):
            return None
        names = [f"{self.name} row {i}" for i in kept] if len(upper) > 1 else self.name
        return LimitRows(C[kept] / length[kept, None], np.full(len(kept), -inf), upper[kept] / length[kept], names)


def _shapes_of(robot: Robot) -> Any:
    """The shapes of an arm's links that SelfCollisionBarrier keeps apart, None for an arm that is known without."""
    if not any(link.parts for link in getattr(robot, "links", ())):
        return None
    from invariantqp.robots.pinocchio_arms import collision_model

    return collision_model(robot)  # type: ignore[arg-type]


class _OfJoints(Limit):
    """Rows that never change, or a function of q that returns rows."""

    def __init__(self, rows: Rows, argument: str) -> None:
        self._rows, self.argument = rows, argument
        called = getattr(rows, "name", getattr(rows, "__name__", ""))
        self.name = called if isinstance(called, str) and called != "<lambda>" else ""

    def for_loop(self, loop: Loop) -> Limit | LimitRows:
        del loop
        return self._rows if isinstance(self._rows, LimitRows) else self

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        del velocity
        return None if isinstance(self._rows, LimitRows) else self._rows(q.copy())


Rows: TypeAlias = LimitRows | Callable[[Array], LimitRows | None]
AnyLimit: TypeAlias = Rows | Limit | ToolSpeed | ForPink


class _Unusable(Exception):
    """The rows of this tick cannot be used."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(str(reason))
        self.reason = reason


def limits_of(limits: Sequence[AnyLimit]) -> list[Limit]:
    """Everything that `limits=` takes, as limits."""
    if not isinstance(limits, (list, tuple)):
        raise BadInput("limits", excerpt(limits), f"a list: {LIMITS}")
    return [_limit_of(limit) for limit in limits]


def _limit_of(limit: object) -> Limit:
    if isinstance(limit, Limit):
        return limit
    if isinstance(limit, ToolSpeed):
        return _OfTool(limit)
    return PinkLimit(limit) if _is_pinks(limit) else row_limit(limit, "limits")  # type: ignore[arg-type]


def row_limit(rows: Any, argument: str = "rows") -> Limit:
    """What `rows=` takes, as a limit."""
    if isinstance(rows, type) or not (callable(rows) or isinstance(rows, LimitRows)):
        of_rows = "LimitRows(C, lower, upper), or a function of q that returns it"
        raise BadInput(argument, excerpt(rows), LIMITS if argument == "limits" else of_rows)
    return _OfJoints(rows, argument)


def _is_pinks(limit: object) -> bool:
    return hasattr(limit, "compute_qp_inequalities") and not isinstance(limit, type)


def loop_of(robot: Robot, dt: float, delay: float) -> Loop:
    """A loop with the robot's own limits alone."""
    ranges = robot.position_lower, robot.position_upper
    return Loop(robot, dt, delay, *ranges, robot.velocity_limit, np.full(len(robot.names), inf))


def _within(loop: Loop, limits: Iterable[Limit]) -> Loop:
    """A loop as some limits narrow it."""
    for limit in limits:
        loop = limit.narrowed(loop)
    return loop


def box_of(loop: Loop, rate: float | None = None) -> JointBox:
    """The joint limits of a loop; the rate [1/s] at which positions are approached is by default that of targets."""
    rate = tracking_gain(None, loop.dt, loop.delay) if rate is None else rate
    return JointBox(loop.position_lower, loop.position_upper, loop.velocity_limit, rate, loop.margin)


def limit_fields(loop: Loop, rate: float) -> dict[str, Any]:
    """Joint limits of a loop as the engine takes them."""
    box = box_of(loop, rate)
    return {
        "position_lower": box.position_lower,
        "position_upper": box.position_upper,
        "velocity_limit": box.velocity_limit,
        "acceleration": loop.acceleration,
        "dt": loop.dt,
        "rate": rate,
    }


def tool_speed_fields(limit: ToolSpeed) -> tuple[float, Array]:
    """A tool speed as the engine takes it."""
    return limit.limit, _limited_point(limit)


class TickRows(NamedTuple):
    """The rows of one tick, None where there are none; and why they cannot be used, None where they can."""

    rows: LimitRows | None
    trouble: Reason | None = None


class RowLimits:
    """All limits of a loop that answer with rows, in their order."""

    def __init__(self, given: Sequence[Limit], loop: Loop) -> None:
        """As they are in a loop."""
        self._given, self._loop = tuple(given), loop
        self._m = len(loop.velocity_limit)
        self._limits: list[Limit | LimitRows] = []
        for limit in given:
            made = limit.for_loop(loop)
            if isinstance(made, LimitRows):
                self._limits.append(self._named(made, limit))
            elif type(made).rows is not Limit.rows:
                self._limits.append(made)
            elif type(limit).narrowed is Limit.narrowed:
                raise BadInput(
                    "limits", excerpt(limit), "a Limit that has rows, narrowed or for_loop: this limits nothing"
                )
        self.does = {  # which limits do more in a tick than answer with rows: nobody else is asked
            name: [one for one in self._limits if isinstance(one, Limit) and overrides(one, name)]
            for name in ("begin", "after", "broken")
        }

    def __bool__(self) -> bool:
        return bool(self._limits)

    def __iter__(self) -> Iterator[Limit | LimitRows]:
        return iter(self._limits)

    def begin(self, q: ArrayLike) -> None:
        """A tick begins at measured joint positions q (m,)."""
        for limit in self.does["begin"]:
            limit.begin(arrays.vector(q, self._m, "q"))

    def __deepcopy__(self, memo: dict[int, Any]) -> RowLimits:
        """Those of another loop, which shares what it was given, obstacles that move for instance."""
        return RowLimits(self._given, self._loop)

    def at(self, q: Array, velocity: Array) -> TickRows:
        """The rows at joint positions q (m,), coming from a joint velocity (m,)."""
        return self.answers("rows", self._limits, q, velocity)

    def after(self, q: Array, x: Array) -> LimitRows | None:
        """More rows, where the answer x (m,) of a tick at q (m,) does not keep some limit to its end."""
        return self.answers("after", self.does["after"], q, x).rows

    @cached_property
    def fixed(self) -> LimitRows | None:
        """The rows where they are the same in every tick."""
        rows = [limit for limit in self._limits if isinstance(limit, LimitRows)]
        return stacked(rows) if len(rows) == len(self._limits) else None

    def own(self, q: Array) -> LimitRows | None:
        """The rows at joint positions q (m,) but Pink's, None where there are none or they cannot be used."""
        known = [limit for limit in self._limits if not isinstance(limit, PinkLimit)]
        return self.answers("rows", known, q, np.zeros(self._m)).rows

    def broken(self) -> str:
        """What of some limit does not hold where rows were last asked for, "" where all do."""
        return next((why for limit in self.does["broken"] if (why := limit.broken())), "")

    def blocked(self, q: Array) -> str:
        """Why an arm cannot come to rest at joint positions q (m,), "" where it can."""
        limits = (limit for limit in self._limits if isinstance(limit, Limit))
        return next((why for limit in limits if (why := limit.blocked(q))), "")

    def answers(
        self, method: Literal["rows", "after"], limits: Sequence[Limit | LimitRows], q: Array, velocity: Array
    ) -> TickRows:
        """What a method of some of these limits answers, together."""
        found = []
        for limit in limits:
            if isinstance(limit, LimitRows):
                found.append(limit)
                continue
            try:
                rows = getattr(limit, method)(q, velocity)
            except _Unusable as trouble:
                return TickRows(None, trouble.reason)
            except BadInput as error:
                if error.argument == "limits":
                    raise
                return TickRows(None, Reason(Code.ROWS_REFUSED, rows=(limit.name or "rows",), words=str(error)))
            if rows is not None:
                found.append(self._named(rows, limit))
        return TickRows(stacked(found))

    def _named(self, rows: object, limit: Limit) -> LimitRows:
        """Rows on the arm's joints, by the name of their limit where they have none."""
        if not isinstance(rows, LimitRows):
            expected = "LimitRows(C, lower, upper), or None for no limit"
            raise BadInput(getattr(limit, "argument", "limits"), type(rows).__name__, expected)
        k, m = rows.C.shape
        if m != self._m:
            argument = getattr(limit, "argument", "limits")
            raise BadInput(argument, f"rows on {m} joints", f"rows on {self._m}, one for each joint")
        if rows.names or not limit.name:
            return rows
        return rows.called(_names_of(limit.name, k))


def overrides(limit: Limit | LimitRows, method: str) -> bool:
    """Whether a limit has a method of its own of a name."""
    return isinstance(limit, Limit) and getattr(type(limit), method) is not getattr(Limit, method)


@lru_cache
def _names_of(limit: str, k: int) -> tuple[str, ...]:
    """What k rows of a limit are called."""
    return (limit,) if k == 1 else tuple(f"{limit} row {i}" for i in range(k))


def stacked(parts: list[LimitRows]) -> LimitRows | None:
    """All rows together, None where there are none."""
    if len(parts) < 2:
        return parts[0] if parts else None
    named = any(part.names for part in parts)
    names = [name for part in parts for name in part.names or ("",) * len(part.C)] if named else ()
    C, lower, upper = (np.concatenate([getattr(part, side) for part in parts]) for side in ("C", "lower", "upper"))
    return LimitRows(C, lower, upper, names)


class Changes(NamedTuple):
    """What is other in this tick than the controller was made with: slower, and inside more limits.

    v_max(tick) = max(speed v_max, |x_before| - a dt)

    A limit below what the joints have now is approached as fast as their accelerations allow.
    """

    speed: float  # share of the motion's speed, in [0, 1]
    loop: Loop  # inside the limits of this tick, too
    joint_rows: RowLimits  # more rows


class LoopLimits(NamedTuple):
    """The limits of a loop."""

    box: JointBox  # position and velocity limits
    acceleration_limit: Array | None  # (m,) [rad/s^2, length/s^2], or None where there is none
    tool_speed: ToolSpeed | None  # the speed limit of a point of the tool, or None
    joint_rows: RowLimits | None  # limits on combinations of joint velocities, or None
    loop: Loop  # what limits are given of it
    beyond: Array  # (m,) how far outside its range a joint's position is believed, inf where it always is
    believed: tuple[list[float], list[float]]  # bounds of those positions
    tip: Array  # (3,) where the tool is in the middle of the joint range
    far: float  # how far away from there a pose is believed [length], inf where it always is

    @classmethod
    def of(
        cls, loop: Loop, limits: Sequence[Limit], far_outside: Literal["hold", "return"], J: Array, tip: Array
    ) -> LoopLimits:
        """The limits of a loop with the robot's own alone, for its joint twists J (6, m) with the tool at `tip` (3,).

        Raises:
            BadInput: limits for another number of joints, or that have nothing in common.
            MissingExtra: a limit of Pink's without Pink.
        """
        robot, turning = loop.robot, np.array(J[:3].any(axis=0))
        for limit in limits:
            if isinstance(limit, JointLimits):
                warn_if_implausible_range(limit.position_lower, limit.position_upper, turning, "JointLimits")
        loop = _within(loop, limits)
        acceleration = loop.acceleration if np.isfinite(loop.acceleration).any() else None
        rows = RowLimits(limits, loop)
        held = arrays.choice(far_outside, "far_outside", ("hold", "return")) == "hold"
        beyond = np.where(turning & held, FAR_OUTSIDE, inf)
        believed = (robot.position_lower - beyond).tolist(), (robot.position_upper + beyond).tolist()
        far = plausible_distance(robot, J, tip)
        if loop.tool_speed is not None:
            warn_if_implausible_speed(loop.tool_speed.limit, far, "tool_speed")
        return cls(box_of(loop), acceleration, loop.tool_speed, rows or None, loop, beyond, believed, tip, far)

    def changed(
        self, speed: float, velocity_limit: ArrayLike | None, tool_speed: float | None, limits: Sequence[AnyLimit]
    ) -> Changes | None:
        """What a tick changes; None for nothing."""
        if type(speed) is float and speed == 1.0 and velocity_limit is None and tool_speed is None and limits == ():
            return None
        share = arrays.not_negative(speed, "speed", "a share of the speed, from 0 to 1")
        if share > 1.0:
            raise BadInput("speed", f"{share:g}", "a share of the speed, from 0 to 1")
        told = limits_of(limits)
        if velocity_limit is not None:
            told.append(_slower(velocity_limit, len(self.loop.velocity_limit)))
        if tool_speed is not None:
            told.append(
                tool_speed_of(arrays.number(tool_speed, "tool_speed", "a speed (speed=0 stops)", positive=True))
            )
        if share == 1.0 and not told:
            return None
        loop = _within(self.loop, told)
        if loop.tool_speed is not None and loop.tool_speed is not self.loop.tool_speed:
            warn_if_implausible_speed(loop.tool_speed.limit, self.far, "tool_speed")
        return Changes(share, loop, RowLimits(told, loop))

    def wrong(self, q: Array) -> Reason | None:
        """Why joint positions (m,) cannot be true, None where they may be; of several joints, the worst."""
        return not_believed(self.loop.robot, q, self.believed)

    def near(self, places: Array, argument: str) -> None:
        """Refuse places (..., 3) of a pose that are farther away than is believed."""
        require_plausible_distance(places, self.tip, self.far, argument)


def no_degrees(robot: Robot, J: Array) -> tuple[list[float], list[float]]:
    """Bounds of joint positions (m,) inside their ranges or two turns of zero, of joints that turn in J (6, m)."""
    bounded = np.isfinite(robot.position_upper - robot.position_lower)
    far = np.where(np.logical_and(J[:3].any(axis=0), bounded), PLAUSIBLE_ANGLE, inf)
    return np.minimum(-far, robot.position_lower).tolist(), np.maximum(far, robot.position_upper).tolist()


def not_believed(robot: Robot, q: Array, believed: tuple[list[float], list[float]]) -> Reason | None:
    """Why joint positions (m,) outside such bounds cannot be true, None inside; of several joints, the worst."""
    lower, upper = believed
    here = q.tolist()
    if all(map(le, lower, here)) and all(map(le, here, upper)):
        return None
    beyond = np.maximum(q - upper, lower - q)
    i = int(beyond.argmax())
    outside = max(float(q[i] - robot.position_upper[i]), float(robot.position_lower[i] - q[i]))
    return Reason(Code.NOT_BELIEVED, (i,), numbers=(float(q[i]), outside), names=(robot.names[i],))


def refuse(wrong: Reason | None, argument: str) -> None:
    """Refuse joint positions that are not believed."""
    if wrong:
        raise BadInput(
            argument, str(wrong).partition(" Give")[0], "joint positions in radians, near the position ranges"
        )


def tool_speed_of(limit: ToolSpeed | float) -> Limit:
    """A tool speed, or a number for one of the tool frame's origin, as a limit."""
    if not isinstance(limit, ToolSpeed):
        limit = ToolSpeed(arrays.number(limit, "tool_speed", "a speed", positive=True))
    return _OfTool(limit)


def _limited_point(limit: ToolSpeed | None) -> Array:
    """(3,) in the tool frame, of a limit's point; its origin for none."""
    return np.zeros(3) if limit is None or limit.point is None else np.asarray(limit.point)


def _slower(value: ArrayLike, m: int) -> JointLimits:
    """The velocity limit of one tick."""
    expected = f"{m} speeds, zero or more, or one for all"
    a = arrays.array(value, "velocity_limit", expected)
    if a.shape not in ((), (m,)) or not (a >= 0.0).all():  # NaN is not above zero either
        raise BadInput("velocity_limit", f"{excerpt(value)}" if a.shape in ((), (m,)) else f"shape {a.shape}", expected)
    return JointLimits(velocity_limit=a)


def _numbers(value: ArrayLike, argument: str) -> Array:
    """(m,) numbers, or one for all."""
    a = arrays.array(value, argument, "numbers, one a joint or one for all, infinite where there is no limit")
    if a.ndim > 1 or a.size == 0:
        raise BadInput(argument, f"shape {a.shape}", "numbers, one a joint or one for all")
    if np.isnan(a).any():
        raise BadInput(argument, "NaN", "numbers, infinite where there is no limit")
    return a.copy()
