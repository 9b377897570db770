"""What a loop may not leave: all that a controller's `limits=` takes, and what it comes to in a tick.

    lower <= x <= upper      joint limits, and with acceleration limits the room to brake; they never give way
    lower <= C x <= upper    rows at joint positions q; where joint limits leave no velocity for them, they give way
    |v_p(x)| <= limit        the speed of a point of the tool; it gives way to both

Every limit that is not of the first or the last kind answers with rows: see `Limit`, of which one of your own is a
class with one method. Where limits contradict each other, they give way by the least, and the reason names them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import inf
from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Value, own
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, Sighting, middle
from invariantqp.velocity.limits.box import JointBox, accelerations
from invariantqp.velocity.limits.braking import BrakingBox
from invariantqp.velocity.limits.rows import LimitRows
from invariantqp.velocity.limits.toolspeed import ToolSpeed
from invariantqp.velocity.qp.quadratic import Cone
from invariantqp.velocity.reasons import Code, Reason, with_names
from invariantqp.velocity.solution import VelocitySolution, with_trouble

ORIGIN = np.zeros(3)
# A joint that turns is never this far outside its position range [rad]: its position is no measurement in radians.
FAR_OUTSIDE = 0.5
LIMITS = (
    "LimitRows, a function of q that returns them, JointLimits, AccelerationLimit, ToolSpeed, a Limit of your own, or "
    "a limit made for Pink: compute_qp_inequalities(...)"
)


class Loop(NamedTuple):
    """What a limit may know of the loop that it is in.

    Attributes:
        robot: the arm.
        dt: tick [s].
        delay: dead time between a command and its effect on the next measurement, beyond one tick [s].
        position_lower: (m,) [rad, length], -inf where there is none.
        position_upper: (m,) likewise, +inf.
        velocity_limit: (m,) [rad/s, length/s], inf where there is none.
        acceleration: (m,) what the joints may speed up and brake by [rad/s^2, length/s^2], inf where there is no limit.
    """

    robot: Robot
    dt: float
    delay: float
    position_lower: Array
    position_upper: Array
    velocity_limit: Array
    acceleration: Array


class Limit:
    """A limit of a loop, in rows: lower <= C x <= upper. Derive from it, and write `rows`.

    Attributes:
        name: what reasons call its rows, where these have no names of their own.
    """

    name: str = ""

    def for_loop(self, loop: Loop) -> Limit | LimitRows:
        """The limit as it is in a loop, asked for once; rows that never change cost least where they are given here.

        Args:
            loop: what is known of it.
        """
        del loop
        return self

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        """The rows of a tick.

        Args:
            q: (m,) where the joints are when the command of this tick acts [rad, length].
            velocity: (m,) joint velocity before [rad/s, length/s].

        Returns:
            LimitRows, or None where nothing is limited now.

        Raises:
            BadInput: no velocity can be told to be safe here; the arm is then held, with these words.
        """
        raise NotImplementedError(f"{type(self).__name__}.rows")


@frozen(init=False, eq=False, repr=False, slots=False)
class JointLimits(Value):
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
        """Joint limits.

        Args:
            position_lower: (m,) or one for all joints [rad, length], -inf where there is none.
            position_upper: likewise, +inf.
            velocity_limit: likewise [rad/s, length/s], zero or more, inf where there is none.
            margin: distance kept from position limits, the robot's too [rad, length].

        Raises:
            BadInput: NaN, a velocity limit below zero, a lower limit above the upper one.
        """
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


@frozen(init=False, eq=False, repr=False, slots=False)
class AccelerationLimit(Value):
    """What joints may speed up and brake by; they also keep room to brake before their position limits.

    Attributes:
        limit: (m,) or one for all joints [rad/s^2, length/s^2], above zero, inf where there is none.
    """

    limit: Array = field(converter=own)

    def __init__(self, limit: ArrayLike) -> None:
        """Acceleration limits.

        Args:
            limit: (m,) or one for all joints [rad/s^2, length/s^2], above zero, inf where there is none.

        Raises:
            BadInput: not above zero.
        """
        a = _numbers(limit, "limit")
        self.__attrs_init__(accelerations(a, a.size, "limit").reshape(a.shape))


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
        limit: Pink's.
        collision_model: a `pinocchio.GeometryModel` on the joints of `robot.model`, or None.
        name: the name of its class.
    """

    def __init__(self, limit: ForPink, collision_model: Any = None) -> None:
        """A limit of Pink's.

        Args:
            limit: anything with `compute_qp_inequalities(configuration, dt)`.
            collision_model: a `pinocchio.GeometryModel` on the joints of `robot.model`, for `SelfCollisionBarrier`.

        Raises:
            BadInput: not a limit of Pink's.
        """
        if not _is_pinks(limit):
            raise BadInput("limit", excerpt(limit), "a limit made for Pink: compute_qp_inequalities(...)")
        self.limit = limit
        self.collision_model = collision_model
        self.name = type(limit).__name__

    def for_loop(self, loop: Loop) -> Limit:
        """The limit with a configuration of its own.

        Raises:
            BadInput: a robot without a model; a limit that fails on this arm.
            MissingExtra: without Pink.
        """
        model: Any = getattr(loop.robot, "model", None)
        if model is None:
            raise BadInput("limits", "a robot of joint screws", "one of a URDF: Pink's limits read its model")
        return _InPink(self, model, loop)


class _InPink(Limit):
    """A limit of Pink's in a loop."""

    def __init__(self, given: PinkLimit, model: Any, loop: Loop) -> None:
        self._given, self._dt = given, loop.dt
        self.name = given.name
        from invariantqp.robots.pink import Configuration  # Pink is loaded when a limit of its kind is

        q = middle(loop.robot)
        with_collisions = {} if given.collision_model is None else {"collision_model": given.collision_model}
        self._configuration = Configuration(model, model.createData(), q, **with_collisions)
        try:
            self.rows(q, np.zeros(len(q)))
        except (BadInput, _Unusable) as error:
            if isinstance(error, BadInput) and error.argument == "limits":
                raise
        except Exception as error:  # whatever a class of another library raises
            raise BadInput(
                "limits",
                f"{self.name}, which fails on this arm: {type(error).__name__}: {error}",
                "a limit made from robot.model",
                ""
                if given.collision_model is not None
                else "One that reads collisions is given them by "
                "iq.limits.PinkLimit(limit, collision_model=...); iq.limits.Clearance needs none.",
            ) from error

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        limit, dt = self._given.limit, self._dt
        self._configuration.update(q)
        if hasattr(limit, "set_last_integration"):  # an acceleration limit
            limit.set_last_integration(velocity.copy(), dt)
        with np.errstate(invalid="ignore"):  # NaN is checked for below
            answer = limit.compute_qp_inequalities(self._configuration, dt)
        if answer is None:
            return None
        G, h = answer
        C = np.array(G, dtype=np.float64).reshape(-1, np.shape(G)[-1])
        upper = np.array(h, dtype=np.float64).reshape(-1) / dt
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


class _Function(Limit):
    """A function of q that returns rows."""

    def __init__(self, function: Callable[[Array], LimitRows | None]) -> None:
        self._function = function
        called = getattr(function, "name", getattr(function, "__name__", ""))
        self.name = called if isinstance(called, str) and called != "<lambda>" else ""

    def rows(self, q: Array, velocity: Array) -> LimitRows | None:
        del velocity
        return self._function(q.copy())


Rows: TypeAlias = LimitRows | Callable[[Array], LimitRows | None]
AnyLimit: TypeAlias = Rows | Limit | JointLimits | AccelerationLimit | ToolSpeed | ForPink


class _Unusable(Exception):
    """The rows of this tick cannot be used."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(str(reason))
        self.reason = reason


class Given(NamedTuple):
    """The limits of an argument, sorted by what they come to."""

    joints: tuple[JointLimits, ...]
    accelerations: tuple[Array, ...]  # (m,)
    tool_speed: ToolSpeed | None
    rows: tuple[tuple[str, LimitRows | Limit], ...]  # each with the argument that it was given by

    @classmethod
    def of(cls, limits: Sequence[AnyLimit], m: int, rows: Rows | None = None) -> Given:
        """The limits of `limits=` and `rows=` for m joints, checked as far as they can be by themselves.

        Raises:
            BadInput: something that is not a limit; rows on another number of joints; two tool speeds.
        """
        if not isinstance(limits, (list, tuple)):
            raise BadInput("limits", excerpt(limits), f"a list: {LIMITS}")
        if rows is not None and not isinstance(rows, LimitRows) and (isinstance(rows, type) or not callable(rows)):
            raise BadInput("rows", excerpt(rows), "LimitRows(C, lower, upper), or a function of q that returns it")
        speeds = [limit for limit in limits if isinstance(limit, ToolSpeed)]
        if len(speeds) > 1:
            raise BadInput("limits", "two tool speeds", "one, here or as tool_speed=")
        combined = [] if rows is None else [("rows", _row_limit(rows, "rows", m))]
        others = (x for x in limits if not isinstance(x, (ToolSpeed, JointLimits, AccelerationLimit)))
        return cls(
            tuple(limit for limit in limits if isinstance(limit, JointLimits)),
            tuple(accelerations(x.limit, m, "limits") for x in limits if isinstance(x, AccelerationLimit)),
            speeds[0] if speeds else None,
            (*combined, *(("limits", _row_limit(limit, "limits", m)) for limit in others)),
        )

    def box(self, box: JointBox) -> JointBox:
        """Joint limits beside those of a box.

        Raises:
            BadInput: another number of joints; a range that has nothing in common with the box's.
        """
        if not self.joints:
            return box
        m = len(box.velocity_limit)
        sides = [(x.position_lower, x.position_upper, x.velocity_limit) for x in self.joints]
        wrong = next((side.size for limits in sides for side in limits if side.shape not in ((), (m,))), None)
        if wrong is not None:
            raise BadInput("limits", f"JointLimits on {wrong} joints", f"{m} limits, or one for all")
        low, high, speed = box.position_lower, box.position_upper, box.velocity_limit
        for lower, upper, fastest in sides:
            low, high, speed = np.maximum(low, lower), np.minimum(high, upper), np.minimum(speed, fastest)
        if (low > high).any():
            i = int((low > high).argmax())
            raise BadInput(
                "limits",
                f"JointLimits that leave joint {i} no position: from {low[i]:g} to {high[i]:g}",
                "a range in common with the robot's",
            )
        return JointBox(low, high, speed, box.dt, max(limits.margin for limits in self.joints))


def _row_limit(limit: object, argument: str, m: int) -> LimitRows | Limit:
    """What answers with rows, as a limit."""
    if isinstance(limit, LimitRows):
        return _required(limit, argument, m)
    if isinstance(limit, Limit):
        return limit
    if isinstance(limit, type):
        raise BadInput(argument, excerpt(limit), LIMITS)
    if _is_pinks(limit):
        return PinkLimit(limit)  # type: ignore[arg-type]
    if not callable(limit):
        raise BadInput(argument, excerpt(limit), LIMITS)
    return _Function(limit)


def _required(rows: object, argument: str, m: int) -> LimitRows:
    """Rows on m joints.

    Raises:
        BadInput: something else.
    """
    if not isinstance(rows, LimitRows):
        raise BadInput(argument, type(rows).__name__, "LimitRows(C, lower, upper), or None for no limit")
    if np.shape(rows.C)[1] != m:
        raise BadInput(argument, f"rows on {np.shape(rows.C)[1]} joints", f"rows on {m}, one for each joint")
    return rows


def _is_pinks(limit: object) -> bool:
    return hasattr(limit, "compute_qp_inequalities")


class TickRows(NamedTuple):
    """The rows of one tick, None where there are none; and why they cannot be used, None where they can."""

    rows: LimitRows | None
    trouble: Reason | None = None


class RowLimits:
    """All limits of a loop that answer with rows, in their order."""

    def __init__(self, given: tuple[tuple[str, LimitRows | Limit], ...], loop: Loop) -> None:
        """As they are in a loop; each with the argument that it was given by."""
        self._m = len(loop.velocity_limit)
        self._given, self._loop = given, loop
        self._limits = [
            (argument, limit if isinstance(limit, LimitRows) else limit.for_loop(loop)) for argument, limit in given
        ]
        for argument, limit in self._limits:
            if isinstance(limit, LimitRows):
                _required(limit, argument, self._m)

    def __deepcopy__(self, memo: dict[int, Any]) -> RowLimits:
        """Those of another loop, which shares what it was given, obstacles that move for instance."""
        return RowLimits(self._given, self._loop)

    def at(self, q: Array, before: Array) -> TickRows:
        """The rows at joint positions q (m,), `before` (m,) being the velocity now.

        Raises:
            BadInput: something else than rows on the arm's joints.
        """
        try:
            return TickRows(_stacked(list(self._parts(q, before))))
        except _Unusable as trouble:
            return TickRows(None, trouble.reason)

    @property
    def fixed(self) -> LimitRows | None:
        """The rows where they are the same in every tick."""
        if not all(isinstance(limit, LimitRows) for _, limit in self._limits):
            return None
        return self.at(np.zeros(self._m), np.zeros(self._m)).rows

    def own(self, q: Array) -> LimitRows | None:
        """The rows at joint positions q (m,) but Pink's, None where there are none or they cannot be used."""
        try:
            return _stacked(list(self._parts(q, np.zeros(self._m), pinks=False)))
        except _Unusable:
            return None

    def _parts(self, q: Array, before: Array, *, pinks: bool = True) -> Iterator[LimitRows]:
        for argument, limit in self._limits:
            if isinstance(limit, LimitRows):
                yield limit
            elif pinks or not isinstance(limit, _InPink):
                found = self._asked(argument, limit, q, before)
                if found is not None:
                    yield found

    def _asked(self, argument: str, limit: Limit, q: Array, before: Array) -> LimitRows | None:
        """The rows of a limit, by its name where they have none."""
        try:
            rows = limit.rows(q, before)
        except BadInput as error:
            if isinstance(limit, _InPink):
                raise
            raise _Unusable(Reason(Code.ROWS_REFUSED, rows=(limit.name or "rows",), words=str(error))) from error
        if rows is None:
            return None
        rows = _required(rows, argument, self._m)
        if rows.names or not limit.name:
            return rows
        k = len(rows.C)
        return evolve_rows(rows, [limit.name] if k == 1 else [f"{limit.name} row {i}" for i in range(k)])


def evolve_rows(rows: LimitRows, names: Sequence[str]) -> LimitRows:
    """The same rows by other names."""
    return LimitRows(rows.C, rows.lower, rows.upper, names)


def _stacked(parts: list[LimitRows]) -> LimitRows | None:
    """All rows together, None where there are none."""
    if len(parts) < 2:
        return parts[0] if parts else None
    named = any(part.names for part in parts)
    names = [name for part in parts for name in part.names or ("",) * len(part.C)] if named else ()
    return LimitRows(
        np.concatenate([part.C for part in parts]),
        np.concatenate([part.lower for part in parts]),
        np.concatenate([part.upper for part in parts]),
        names,
    )


class Changes(NamedTuple):
    """What is other in this tick than the controller was made with: slower, and inside more limits.

    v_max(tick) = max(speed min(v_max, velocity_limit), |x_before| - a dt)

    A limit below what the joints have now is approached as fast as their accelerations allow.
    """

    speed: float  # share of the motion's speed, in [0, 1]
    given: Given  # more limits

    def box(self, box: JointBox, braking: BrakingBox | None, before: Array) -> tuple[JointBox, BrakingBox | None]:
        """Joint limits of this tick, coming from the joint velocity `before` (m,)."""
        narrow = self.given.box(box)
        limit = self.speed * narrow.velocity_limit if self.speed > 0.0 else np.zeros(len(before))  # may be infinite
        acceleration = least_of(self.given.accelerations, braking)
        if acceleration is not None:
            slowest = np.abs(before) - acceleration * box.dt
            limit = np.minimum(np.maximum(limit, slowest), box.velocity_limit)
        slower = JointBox(narrow.position_lower, narrow.position_upper, limit, box.dt)
        return slower, None if acceleration is None else BrakingBox(slower, acceleration)

    def cone(
        self, cone: Cone | None, own: Cone, bounds: tuple[Array, Array], before: Array, step: Array
    ) -> Cone | None:
        """The limit of the tool's speed in this tick: lower than the controller's `cone`, for the point of `own`.

        `step` (m,) is by how much joint velocities may change, inf where there is no limit of acceleration.
        """
        told = self.given.tool_speed
        limit = min(inf if cone is None else cone.limit, inf if told is None else told.limit)
        if limit == inf:
            return cone
        limit *= self.speed
        # All joints slower by the same share is a velocity that accelerations allow, along the way the tool goes now.
        over = np.abs(before) - step
        share = float((over[over > 0.0] / np.abs(before[over > 0.0])).max(initial=0.0))
        slower = np.minimum(np.maximum(share * before, bounds[0]), bounds[1])
        return (own if cone is None else cone)._replace(limit=max(limit, own.speed(slower)))


def least_of(limits: tuple[Array, ...], braking: BrakingBox | None) -> Array | None:
    """(m,) the lowest of some acceleration limits and those of a box, None where there are none."""
    all_of_them = limits if braking is None else (*limits, braking.acceleration)
    return np.minimum.reduce(all_of_them) if all_of_them else None


def changes_of(
    speed: float,
    velocity_limit: ArrayLike | None,
    tool_speed: float | None,
    limits: Sequence[AnyLimit],
    m: int,
) -> Changes | None:
    """What a tick of m joints is told to change; None for nothing.

    Raises:
        BadInput: a speed outside [0, 1], a limit below zero, a tool speed that is not above zero, no limit.
    """
    if type(speed) is float and speed == 1.0 and velocity_limit is None and tool_speed is None and limits == ():
        return None
    share = arrays.not_negative(speed, "speed", "a share of the speed, from 0 to 1")
    if share > 1.0:
        raise BadInput("speed", f"{share:g}", "a share of the speed, from 0 to 1")
    given = Given.of(limits, m)
    if velocity_limit is not None:
        given = given._replace(joints=(*given.joints, _slower(velocity_limit, m)))
    if tool_speed is not None:
        if given.tool_speed is not None:
            raise BadInput("limits", "two tool speeds", "one, here or as tool_speed=")
        given = given._replace(tool_speed=ToolSpeed(arrays.number(tool_speed, "tool_speed", "a speed", positive=True)))
    if share == 1.0 and given == Given((), (), None, ()):
        return None
    return Changes(share, given)


def _slower(value: ArrayLike, m: int) -> JointLimits:
    expected = f"{m} speeds, zero or more, or one for all"
    a = arrays.array(value, "velocity_limit", expected)
    if a.shape not in ((), (m,)) or not (a >= 0.0).all():  # NaN is not above zero either
        raise BadInput("velocity_limit", f"{excerpt(value)}" if a.shape in ((), (m,)) else f"shape {a.shape}", expected)
    return JointLimits(velocity_limit=a)


class TickLimits(NamedTuple):
    """The limits of one tick."""

    lower: Array  # (m,) of the joint velocity
    upper: Array  # (m,)
    rows: LimitRows | None  # on combinations of joint velocities, or None
    cone: Cone | None  # the speed limit of a point, or None
    strained: tuple[Reason, ...]  # what gave way at joints whose limits contradict each other
    trouble: Reason | None  # why there is nothing to do but stand still, None for nothing
    placed: tuple[Array, Array]  # (m,) bounds of the joint velocity by position limits alone


class LoopLimits(NamedTuple):
    """The limits of a loop."""

    box: JointBox  # position and velocity limits
    braking: BrakingBox | None  # the same with acceleration limits, or None
    tool_speed: ToolSpeed | None  # the speed limit of a point of the tool, or None
    joint_rows: RowLimits | None  # limits on combinations of joint velocities, or None
    loop: Loop  # what limits are told of it
    believed: tuple[Array, Array] | None  # (m,) bounds of positions that are believed, or None for all

    @classmethod
    def of(
        cls,
        robot: Robot,
        dt: float,
        delay: float,
        *,
        limits: Sequence[AnyLimit],
        rows: Rows | None,
        acceleration_limit: ArrayLike | None,
        position_margin: float,
        tool_speed: ToolSpeed | float | None,
        far_outside: Literal["hold", "return"],
        turning: NDArray[np.bool_],
    ) -> LoopLimits:
        """The limits for the arguments of a controller; `turning` (m,) says which joints turn.

        Raises:
            BadInput: something that is not a limit, two tool speeds.
            MissingExtra: a limit of Pink's without Pink.
        """
        m = len(robot.names)
        given = Given.of(limits, m, rows)
        margin = arrays.not_negative(position_margin, "position_margin", "a distance kept from position limits")
        if margin > 0.0:
            given = given._replace(joints=(*given.joints, JointLimits(margin=margin)))
        box = given.box(JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, dt))
        if acceleration_limit is not None:
            given = given._replace(accelerations=(*given.accelerations, accelerations(acceleration_limit, m)))
        acceleration = least_of(given.accelerations, None)
        braking = None if acceleration is None else BrakingBox(box, acceleration)
        if tool_speed is not None and given.tool_speed is not None:
            raise BadInput("limits", "two tool speeds", "one, here or as tool_speed=")
        speed = given.tool_speed if tool_speed is None else tool_speed
        if speed is not None and not isinstance(speed, ToolSpeed):
            speed = ToolSpeed(arrays.number(speed, "tool_speed", "a speed", positive=True))
        believed = None
        if arrays.choice(far_outside, "far_outside", ("hold", "return")) == "hold":
            room = np.where(turning, FAR_OUTSIDE, inf)
            believed = robot.position_lower - room, robot.position_upper + room
        most = np.full(m, inf) if acceleration is None else acceleration
        loop = Loop(robot, dt, delay, box.position_lower, box.position_upper, box.velocity_limit, most)
        return cls(box, braking, speed, RowLimits(given.rows, loop) if given.rows else None, loop, believed)

    def at(self, sighting: Sighting, target: Any, q: Array, before: Array, now: Changes | None = None) -> TickLimits:
        """The limits at joint positions q (m,), coming from the joint velocity `before` (m,), changed for `now`."""
        strained: tuple[Reason, ...] = ()
        box, braking = self.box, self.braking
        if now is not None:
            box, braking = now.box(box, braking, before)
        if braking is None:
            lower, upper = box.at(q)
            placed = box.placed(q)
        else:
            bounds = braking.at(q, before)
            lower, upper, strained = bounds[:3]
            placed = bounds[3:]
        cone = self._cone(sighting, target, now, (lower, upper), before, braking)
        rows, trouble = self._rows(q, before, now)
        return TickLimits(lower, upper, rows, cone, strained, trouble, placed)

    def _cone(
        self,
        sighting: Sighting,
        target: Any,
        now: Changes | None,
        bounds: tuple[Array, Array],
        before: Array,
        braking: BrakingBox | None,
    ) -> Cone | None:
        """The speed limit of a point of the tool in this tick."""
        speed = self.tool_speed
        if speed is None and now is None:
            return None
        told = None if now is None else now.given.tool_speed
        if speed is None:
            point = ORIGIN if told is None or told.point is None else told.point
        else:
            point = ORIGIN if speed.point is None else speed.point
            if told is not None and told.point is not None and not np.array_equal(told.point, point):
                raise BadInput("limits", "a tool speed of another point", "one of the point that the controller limits")
        here = self.loop.robot.points(sighting, target, point)[0]
        cone = None if speed is None else speed.cone(sighting.J, here)
        if now is None:
            return cone
        step = np.full(len(before), inf) if braking is None else braking.acceleration * self.box.dt
        return now.cone(cone, Cone(velocity_at(sighting.J, here), inf, np.zeros(3)), bounds, before, step)

    def _rows(self, q: Array, before: Array, now: Changes | None) -> TickRows:
        """The rows of this tick: the loop's own, then those for `now`."""
        found = TickRows(None) if self.joint_rows is None else self.joint_rows.at(q, before)
        if now is None or not now.given.rows or found.trouble:
            return found
        more = RowLimits(now.given.rows, self.loop).at(q, before)
        return TickRows(_stacked([r for r in (found.rows, more.rows) if r is not None]), more.trouble)

    def wrong(self, q: Array) -> Reason | None:
        """Why joint positions (m,) cannot be true, None where they may be; of several joints, the worst."""
        if self.believed is None:
            return None
        lower, upper = self.believed
        beyond = np.maximum(q - upper, lower - q)
        i = int(beyond.argmax())
        if not beyond[i] > 0.0:
            return None
        far = float(q[i]), float(beyond[i]) + FAR_OUTSIDE
        return Reason(Code.NOT_BELIEVED, (i,), numbers=far, words=self.loop.robot.names[i])

    def told(self, solution: VelocitySolution, q: ArrayLike, strained: tuple[Reason, ...] = ()) -> VelocitySolution:
        """The solution with what is `strained`, or with joints outside their range that are held by limits."""
        names = self.loop.robot.names
        if strained:
            return with_trouble(solution, with_names(strained, names))
        if not solution.active or self.braking is not None:
            return solution
        far = self.box.outside(q, solution.active)
        return solution._replace(reasons=(*with_names(far, names), *solution.reasons)) if far else solution


def _numbers(value: ArrayLike, argument: str) -> Array:
    """(m,) numbers, or one for all."""
    a = arrays.array(value, argument, "numbers, one a joint or one for all, infinite where there is no limit")
    if a.ndim > 1 or a.size == 0:
        raise BadInput(argument, f"shape {a.shape}", "numbers, one a joint or one for all")
    if np.isnan(a).any():
        raise BadInput(argument, "NaN", "numbers, infinite where there is no limit")
    return a.copy()
