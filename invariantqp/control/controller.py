"""The loop body: measured joint positions and a target in, a joint velocity inside the limits out.

    s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, limits(q))

Of a target that leaves something free (`control/target.py`), only the part that it asks for is measured. The error
twist is taken in the base frame, where it is the same whatever frame the tool has; b slows the approach down where
acceleration limits need room to brake. A tick is computed by the engine (`core/loop.hpp`); this file reads arguments,
and asks functions and limits that are the user's.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy, deepcopy
from numbers import Real
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.callbacks import Callbacks, LoopInEngine, engine_state
from invariantqp.control.demands import (
    Exact,
    ExactPoint,
    ExactTwist,
    Named,
    View,
    demand_fields,
    demands_of,
    require_all_directions,
    require_rows,
    row_rank,
    rows_of,
)
from invariantqp.control.limits import (
    AccelerationLimit,
    AnyLimit,
    Changes,
    JointLimits,
    Limit,
    LoopLimits,
    Rows,
    limit_fields,
    limits_of,
    loop_of,
    refuse,
    require_range,
    row_limit,
    tool_speed_fields,
    tool_speed_of,
)
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.target import TARGETS, checked_target, partial_target
from invariantqp.control.tracking import question_gain, question_times, ticks_late, tracking_gain
from invariantqp.engine import law
from invariantqp.errors import BadInput, InvariantQPError, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import turning
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import (
    Robot,
    RobotState,
    continuous_turns,
    middle,
    require_robot,
)
from invariantqp.velocity.arguments import metric_of
from invariantqp.velocity.backends import Backend, backend_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.guard import Guard, guard_of
from invariantqp.velocity.limits import ToolSpeed, accelerations
from invariantqp.velocity.problem import form_fields, no_projector
from invariantqp.velocity.reasons import Code, told
from invariantqp.velocity.solution import VelocitySolution, both

# The default gain [1/s]: slow beside any tracking gain, fast enough to keep the arm off its limits on long paths.
POSTURE_GAIN = 1.0
# An error of this share of a radian may stay where the arm is next to the least error that it can reach.
SLACK = 2e-3


class Controls(Protocol):
    """Anything with a step: ours, or a law to compare it with."""

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick."""
        ...


class Controller:
    """Task-space velocity control of one arm; `step` is one tick. One controller drives one arm, in one thread.

    Its attributes do not change, but `state`: make another one instead. A copy is a loop of its own.

    Attributes:
        robot, dt, gain, delay, backend: as given.
        form: what is attempted of a twist that the joints cannot do, or None.
        measure: the point and length by which twists are measured.
        posture_gain: [1/s], 0 where the null space has no posture.
        exact: what is met exactly.
        guard: the descent guard of the form, or None.
        limits: all limits of the loop.
        box: position and velocity limits.
        acceleration_limit: (m,) [rad/s^2, length/s^2], or None where there is none.
        tool_speed: the speed limit of a point of the tool, or None.
        joint_rows: limits on combinations of joint velocities, or None.
        turns: (m,) whole turns of continuous joints, whose positions are compared modulo these; 0 of other joints.
        in_engine: the loop in the engine, for followers.
        options: the arguments that it was made with, by name.
        state: what the loop remembers between ticks: last commands, measured positions, how joints respond, what the
            last twist missed. A value: it copies, compares and pickles, and may be set to one that was kept.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        dt: float,
        gain: float | None = None,
        form: Form | CarriedMetric | float | None = None,
        damping: float | None = None,
        guard: Guard | bool = True,
        posture: ArrayLike | bool = True,
        posture_gain: float = POSTURE_GAIN,
        joint_metric: ArrayLike | None = None,
        backend: Backend | str | None = None,
        exact: Exact | ExactRows | Sequence[Exact | ExactRows | Named] | Named | None = None,
        point: ArrayLike | Literal["own"] | None = None,
        length: float | None = None,
        acceleration_limit: ArrayLike | None = None,
        delay: float = 0.0,
        position_margin: float = 0.0,
        tool_speed: ToolSpeed | float | None = None,
        rows: Rows | None = None,
        limits: Sequence[AnyLimit] = (),
        far_outside: Literal["hold", "return"] = "hold",
    ) -> None:
        """Make the loop's fixed part.

        Args:
            robot: from `load_robot`, or anything that meets `Robot`; up to 64 joints.
            dt: tick [s].
            gain: tracking gain [1/s], at most 1/dt; None is 0.1/dt, a tenth of the error in a tick, or less where a
                delay is given.
            form: what is attempted of a twist that the joints cannot do; None is least squares at the point.
            damping: lambda of a pitch form, as in `systems.damped_pseudoinverse`; None is 0. Without a form the law
                damps by what the last tick missed.
            guard: the descent guard of a form; True is the default one, False none.
            posture: (m,) joint positions that are kept near where the tool's motion leaves joints free; True is the
                middle of the ranges of hinges, not of slides, for arms with more than six joints, False is none. Where
                the task rests, so do the joints.
            posture_gain: how fast the posture is approached while the tool moves [1/s].
            joint_metric: as in `solve_velocity`.
            backend: None is the engine; "daqp", any solver that qpsolvers has, or a `Backend` of yours solves
                `velocity.definition` in each tick instead, in milliseconds.
            exact: what is met exactly while the rest is least squares: "position" for the tool frame's origin, "twist"
                for the whole twist, which limits then scale instead of bending it, an ExactPoint, ExactAxis,
                ExactPlane, ExactJoints or ExactRows, or several of them.
            point: (3,) in the tool frame, the physical point where accuracy counts; None is the point met exactly
                or, without one, the tool frame's origin; "own" is the arm's own point, which its joints move least.
            length: as in `solve_velocity`, by default the arm's reach to the point.
            acceleration_limit: (m,) or one for all joints [rad/s^2, length/s^2], inf where there is none; a joint then
                also keeps room to brake before its position limits, and the tool before its target. None is no limit.
            delay: dead time between a command and its effect on the next measurement, beyond one tick [s].
            position_margin: distance kept from position limits [rad, length], less than half of any joint's range.
            tool_speed: the largest speed of a point of the tool [length/s], 0.25 m/s beside a person; a number is the
                limit of the tool frame's origin.
            rows: LimitRows on the joint velocity, or a function of q (m,) that returns them (or None) in every tick.
            limits: all limits beside the robot's own, in a list: JointLimits, AccelerationLimit, LimitRows or functions
                as in `rows`, a ToolSpeed, a Clearance that keeps links from each other
                and from obstacles, a `Limit` of your own, and limits and barriers made for Pink from
                `robot.model`, anything with `compute_qp_inequalities(configuration, dt)`. The four arguments above are
                short for some of them. Joint limits never give way; the others do where they contradict these. Reasons
                call rows by their names, those without one by their place in the list. Pink cannot pickle its.
            far_outside: "hold" stands still, "held", where a joint that turns is told to be more than 0.5 rad outside
                its position range, as one in degrees is; "return" moves back from there too.

        Raises:
            BadInput: a dt or gain that is not positive, a gain above 1/dt, something that is not a limit, a posture far
                outside the ranges, exact="twist" of an arm that does not move its tool in all six directions, or an
                argument that `solve_velocity` would refuse.
            UnknownName: no such back end.
            MissingExtra: a limit of Pink's without Pink.

        Warns:
            UserWarning: a gain of at most 1 1/s beside a tick of at most 20 ms, which may be meant as a share of the
                error in a tick; JointLimits more than two turns away from zero, as in degrees; a tool speed of thirty
                times the arm's length in a second, as in millimetres.
        """
        given = {name: value for name, value in locals().items() if name not in {"self", "robot"}}
        self.options: dict[str, Any] = given
        self.robot: Robot = require_robot(robot)
        m = len(robot.names)
        if m > law.MOST_JOINTS:
            raise BadInput("robot", f"{m} joints", f"at most {law.MOST_JOINTS}", "Name those that move: joints=[...].")
        self.dt: float = arrays.number(dt, "dt", "a tick in seconds", positive=True)
        self.delay: float = arrays.not_negative(delay, "delay", "a dead time in seconds")
        question_times(self.dt, self.delay)
        ticks_late(self.delay, self.dt)  # refuses one that is too long
        self.gain: float = tracking_gain(gain, self.dt, self.delay)
        if gain is not None:
            question_gain(self.gain, self.dt)
        self.exact: tuple[Exact, ...] = demands_of(exact)
        mid = middle(robot)
        state = robot.state(mid, robot.target(robot.pose(mid)))  # also loads what the first tick needs
        tip = np.asarray(robot.pose(mid)[:3, 3])
        if self.exact:  # refuses those of another arm
            rows_of(self.exact, View(robot, state, robot.target(robot.pose(mid)), 1.0, np.zeros(6)))
            require_all_directions(self.exact, robot)
        chosen = form_of(form)
        carried = chosen if isinstance(chosen, CarriedMetric) else None
        self.form: Form | None = None if isinstance(chosen, CarriedMetric) else chosen
        anchor = next((d.point for d in self.exact if isinstance(d, ExactPoint)), None) if point is None else point
        self.measure: ToolMeasure = ToolMeasure(robot, anchor, length, carried)
        posture_at, pull = posture_of(posture, posture_gain, robot)
        self.posture_gain: float = float(pull.max())
        self.backend: Backend | None = None if backend is None else backend_of(backend)
        more = limits_by_name(robot, acceleration_limit, position_margin, tool_speed, rows, limits)
        self.limits: LoopLimits = LoopLimits.of(loop_of(robot, self.dt, self.delay), more, far_outside, state.J, tip)
        refuse(self.limits.wrong(posture_at), "posture")
        self.box, self.acceleration_limit, self.tool_speed, self.joint_rows = self.limits[:4]
        self.turns: Array = continuous_turns(self.box.position_lower, self.box.position_upper, state.J)
        descent = guard_of(guard)
        self.guard: Guard | None = None if self.form is None else descent
        self._settings: dict[str, Any] = {
            "joints": m,
            "delay": self.delay,
            "gain": self.gain,
            "slack": SLACK * self.measure.radian,
            "length": self.measure.length,
            **_measure_fields(self.measure),
            **limit_fields(self.limits.loop, self.box.rate),
            "believed_lower": self.limits.believed[0],
            "believed_upper": self.limits.believed[1],
            "range_lower": robot.position_lower,
            "range_upper": robot.position_upper,
            "turns": self.turns,
            "tip": tip,
            "far": self.limits.far,
            "tool_speed": None if self.tool_speed is None else tool_speed_fields(self.tool_speed),
            "metric": metric_of(joint_metric, state.J, tip, self.measure.length),
            **form_fields(self.form),
            "damping": lambda_of(damping),
            "exact_rank": row_rank(self.exact, robot) if self.exact else 0,
            "guard": -1.0 if self.guard is None else self.guard.fraction,
        }
        if pull.any():
            self._settings |= {"posture": posture_at, "pull": pull}
        self.by_chain: bool = type(robot) is Chain  # a class of the user's may be no such chain
        fixed = None if self.joint_rows is None else self.joint_rows.fixed
        demands = demand_fields(self.exact)
        self._settings |= {"rows": fixed and (fixed.C, fixed.lower, fixed.upper), "exact": demands or ()}
        self.asks_demands: bool = demands is None
        asks_limits = self.joint_rows is not None and (fixed is None or any(self.joint_rows.does.values()))
        asks = not self.by_chain or asks_limits or self.asks_demands or self.backend is not None
        start = law.LoopState(m, self.delay, self.dt)
        self.in_engine: LoopInEngine = LoopInEngine(self, self._settings, start, asks=asks)

    def __setattr__(self, name: str, value: Any) -> None:
        if name[0] != "_" and name != "state" and "in_engine" in self.__dict__:  # the engine has its own copy
            raise AttributeError(f"{name} of a controller does not change; make another Controller")
        object.__setattr__(self, name, value)

    def __copy__(self) -> Controller:
        return deepcopy(self)

    def __deepcopy__(self, memo: dict[int, Any]) -> Controller:
        other = object.__new__(type(self))  # what changes is copied: limits and solvers keep state between ticks
        changes = ("limits", "joint_rows", "backend")
        vars(other).update(vars(self), **{name: deepcopy(getattr(self, name), memo) for name in changes})
        vars(other)["in_engine"] = self.in_engine.of(other)
        return other

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "in_engine": (self.in_engine.asks, self.in_engine.state)}

    def __setstate__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields)
        asks, state = fields["in_engine"]
        vars(self)["in_engine"] = LoopInEngine(self, self._settings, state, asks=asks)

    @property
    def state(self) -> Any:
        """What the loop remembers between ticks, a copy."""
        return copy(self.in_engine.state)

    @state.setter
    def state(self, value: Any) -> None:
        if not isinstance(value, law.LoopState) or len(value.numbers) != len(self.in_engine.state.numbers):
            raise BadInput("state", excerpt(value), "the state of a loop with as many joints and as long a delay")
        self.in_engine.state = copy(value)

    def believed(self, q: ArrayLike, argument: str = "q") -> Array:
        """Joint positions (m,) that can be true; errors name the argument.

        Raises:
            BadInput: NaN, a wrong shape, or positions for which a tick is held.
        """
        positions = arrays.joints(q, self.robot.names, argument)
        refuse(self.limits.wrong(positions), argument)
        return positions

    def step(
        self,
        q: ArrayLike,
        target: Any,
        feedforward: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        *,
        speed: float = 1.0,
        velocity_limit: ArrayLike | None = None,
        tool_speed: float | None = None,
        limits: Sequence[AnyLimit] = (),
    ) -> VelocitySolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            target: tool pose to be at, (4, 4) in the base frame, a `pinocchio.SE3`, or what `robot.target` returned; or
                what leaves the rest of the pose free: a point (3,) in the base frame for the tool frame's origin, or a
                `Target` with a point, an axis, or both. Only that part then counts, measured at the target's own point;
                joints that it leaves free follow the posture, or move as little as they can.
            feedforward: (6,) the target's motion, a screw in base coordinates [rad/s; length/s]; None is a target at
                rest. Of a target whose origin p moves at v and which turns at omega, both along the axes of the base
                frame, it is (omega; v + p x omega) = iq.adjoint(iq.transform(translation=p)) @ [*omega, *v].
            velocity: (m,) joint velocity now [rad/s, length/s], for the acceleration limits; None is the one commanded
                last, zero before the first tick.
            speed: an operator's slider, from 0 to 1: the joints go the same way, `speed` times as fast as they would,
                feedforward and approach alike; 0 stands still. A target that moves on has to move so much slower too.
            velocity_limit: (m,) or one for all joints [rad/s, length/s], in this tick; the lower of it and the arm's.
            tool_speed: the largest speed of the controller's limited point, or of the tool frame's origin, in this tick
                [length/s]; the lower of it and the controller's own. The slider scales limits of
                speed too: they are those at speed=1. Joints that are faster than all this allows slow down as fast as
                their `acceleration_limit` lets them, at once without one.
            limits: more limits, in this tick alone, as the controller takes them; the lower of two counts.

        Returns:
            VelocitySolution: q + dt velocity is inside the position limits, or on its way back inside.

        Raises:
            BadInput: NaN, wrong shapes, or a target thirty times as far away as the arm is long, as one in millimetres
                is; the controller is as it was.
            NoPseudoinverse: the form has no projector for the arm as it is now, and there is neither a damping nor a
                guard, which leaves none of the form then.
        """
        if target is None:
            raise BadInput("target", "None", TARGETS, "For a twist, call follow(q, twist).")
        now = self.limits.changed(speed, velocity_limit, tool_speed, limits)
        part = partial_target(target)
        if part is not None:
            if self.form is not None or any(isinstance(demand, ExactTwist) for demand in self.exact):
                expected = 'a (4, 4) pose beside a form or exact="twist"'
                raise BadInput("target", excerpt(target), expected, "These need the whole twist.")
            return self._tick(now, q, target, feedforward, velocity, part=part)
        known = isinstance(target, (np.ndarray, list, tuple)) or hasattr(target, "homogeneous")
        return self._tick(now, q, target if known else self.robot.target(target), feedforward, velocity)

    def follow(
        self,
        q: ArrayLike,
        twist: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        at: Literal["tool", "base"] = "tool",
        rows: ExactRows | None = None,
        robot_state: RobotState | None = None,
        measured_at: ArrayLike | None = None,
        posture: ArrayLike | None = None,
        speed: float = 1.0,
        velocity_limit: ArrayLike | None = None,
        tool_speed: float | None = None,
        limits: Sequence[AnyLimit] = (),
    ) -> VelocitySolution:
        """One tick for a twist of the tool instead of a target; exact demands then follow that twist.

        Args:
            q: (m,) measured joint positions [rad, length].
            twist: (6,) angular velocity, then the velocity of the tool frame's origin, both along the axes of the base
                frame [rad/s; length/s], as MoveIt Servo and UR's `speedL` have it.
            velocity: as in `step`.
            at: "tool" as above; "base": a screw in base coordinates, whose linear part is the velocity of the point of
                the tool's body at the origin of the base frame, as in [DS], `robot.jacobian` and `feedforward`.
            rows: more exact rows, for this tick alone: parts of the screw, A = K'J and b = K'screw for some K.
            robot_state: what `robot.state` returned at q, if it was called in this tick already.
            measured_at: (3,) in the base frame, the point to measure at in this tick; None is the controller's own.
            posture: (m,) joint velocity wanted where the twist leaves joints free; None is the controller's own.
            speed: as in `step`; exact `rows` are `speed` times as fast too.
            velocity_limit: as in `step`.
            tool_speed: as in `step`.
            limits: as in `step`.

        Returns:
            VelocitySolution, as from `step`; its residual is a screw in base coordinates.

        Raises:
            BadInput: NaN, wrong shapes, a twist above 1e12; the controller is as it was.
            NoPseudoinverse: as in `step`.
        """
        now = self.limits.changed(speed, velocity_limit, tool_speed, limits)
        if not isinstance(at, str):
            raise BadInput("at", excerpt(at), "'tool' or 'base'", "A point to measure at is measured_at.")
        more: dict[str, Any] = {"at_base": arrays.choice(at, "at", ("tool", "base")) == "base"}
        if rows is not None:
            require_rows(rows, len(self.robot.names))
            more["exact"] = rows.A, rows.b, rows.of_twist
        if robot_state is not None:
            more["arm"] = engine_state(robot_state)
        if twist is None:
            raise BadInput("twist", "None", "(6,) numbers")
        return self._tick(now, q, None, twist, velocity, measured_at=measured_at, posture=posture, **more)

    def rest(
        self, q: ArrayLike, reason: str, velocity: ArrayLike | None = None, robot_state: RobotState | None = None
    ) -> VelocitySolution:
        """One tick of standing still; outside its limits, an arm moves back inside.

        Args:
            q: (m,) measured joint positions [rad, length].
            reason: why, in words; the solution repeats it.
            velocity: as in `step`.
            robot_state: as in `follow`.

        Raises:
            BadInput: NaN or wrong shapes; the controller is as it was.
        """
        if not isinstance(reason, str):
            raise BadInput("reason", excerpt(reason), "a text")
        arm = {} if robot_state is None else {"arm": engine_state(robot_state)}
        solution = self._tick(None, q, None, None, velocity, stand=True, **arm)
        if not reason or any(one.code is Code.NOT_BELIEVED for one in solution.reasons):
            return solution
        return solution._replace(reasons=both(told(reason), solution))

    def _tick(
        self,
        now: Changes | None,
        q: ArrayLike,
        target: Any,
        ahead: ArrayLike | None,
        velocity: ArrayLike | None,
        **more: Any,
    ) -> VelocitySolution:
        """A tick by the engine, which calls back for what is the user's."""
        inner, pose = self.in_engine, None if "part" in more else target
        calls = inner.calls if now is None else Callbacks(self, now)
        if calls is not None:
            calls.begin(q, pose)
            more |= {"functions": calls.functions, "changes": calls.changes}
        try:
            found = inner.loop.tick(inner.state, q, pose, ahead, velocity, **more)
        except (ValueError, TypeError, AttributeError, ArithmeticError) as refusal:
            if isinstance(refusal, InvariantQPError) or (calls is not None and calls.raised is refusal):
                raise
            raise refused(self, q, target, ahead, velocity, more, refusal) from None
        return inner.solution(found, calls)


def refused(
    loop: Controller, q: Any, target: Any, ahead: Any, velocity: Any, more: dict[str, Any], refusal: Exception
) -> Exception:
    """Why the engine refused a tick: which argument, what was found and what was expected."""
    m = len(loop.robot.names)
    positions = arrays.joints(q, loop.robot.names, "q")
    if isinstance(refusal, ArithmeticError):
        return no_projector(loop.robot.jacobian(positions), loop.form)
    if target is not None:
        if "part" in more:
            place = checked_target(target).point
        else:
            wanted = loop.robot.target(target)
            place = loop.robot.points(loop.robot.state(positions, wanted), wanted, np.zeros(3))[1]
        if place is not None:
            loop.limits.near(place, "target")
        if ahead is not None:
            sizes.not_too_fast(arrays.vector(ahead, 6, "feedforward"), "feedforward")
    elif ahead is not None:
        sizes.not_too_fast(arrays.twist(ahead))
    for name, value, size in (
        ("velocity", velocity, m),
        ("posture", more.get("posture"), m),
        ("measured_at", more.get("measured_at"), 3),
    ):
        if value is not None:
            arrays.vector(value, size, name)
    return BadInput("the arguments", str(refusal), "numbers that can be computed with")


def limits_by_name(
    robot: Robot,
    acceleration_limit: ArrayLike | None,
    position_margin: float,
    tool_speed: ToolSpeed | float | None,
    rows: Rows | None,
    limits: Sequence[AnyLimit],
) -> list[Limit]:
    """The limits of a controller beside the robot's own, from the arguments of these names."""
    more: list[Limit] = [] if rows is None else [row_limit(rows)]
    more += [] if tool_speed is None else [tool_speed_of(tool_speed)]
    more += limits_of(limits)
    if acceleration_limit is not None:
        more.append(AccelerationLimit(accelerations(acceleration_limit, len(robot.names))))
    margin = arrays.not_negative(position_margin, "position_margin", "a distance kept from position limits")
    require_range(robot.position_lower, robot.position_upper, margin, "position_margin")
    return [*more, JointLimits(margin=margin)] if margin > 0.0 else more


def posture_of(posture: ArrayLike | bool, gain: float, robot: Robot) -> tuple[Array, Array]:
    """The joint positions (m,) and the gain (m,) [1/s] of each joint, 0 where there is no posture.

    True is the middle of the ranges of an arm with more than six joints; a joint without a range has none, nor has a
    slide: where an arm stands on its rail says nothing about where it should stand.
    """
    m = len(robot.names)
    strength = arrays.not_negative(gain, "posture_gain", "a gain in 1/s")
    if isinstance(posture, (bool, np.bool_)):
        mid = middle(robot)
        bounded = np.isfinite(robot.position_lower) & np.isfinite(robot.position_upper)
        hinge = turning(robot.jacobian(mid)) > 0.0
        return mid, np.where(bounded & hinge & (m > 6) & bool(posture), strength, 0.0)
    if np.ndim(arrays.array(posture, "posture", "joint positions, True or False")) == 0:
        raise BadInput(
            "posture", f"{posture}", f"({m},) joint positions, True or False", "How strong it is, is posture_gain."
        )
    return arrays.vector(posture, m, "posture"), np.full(m, strength)


def lambda_of(damping: float | None) -> float:
    """The damping of a pitch form.

    Raises:
        BadInput: not a number, or below zero.
    """
    if damping is None:
        return 0.0
    if isinstance(damping, bool) or not isinstance(damping, Real):
        remedy = "Without a form the law damps by itself, by what the last tick missed."
        raise BadInput("damping", excerpt(damping), "a number lambda >= 0, or None", remedy)
    return arrays.not_negative(damping, "damping", "lambda")


def _measure_fields(measure: ToolMeasure) -> dict[str, Any]:
    """The measure as the engine takes it."""
    if measure.carried is not None:
        by = "tool" if measure.carried.follows_tool else "base"
        return {"measured": by, "root": measure.carried.root(np.eye(4))}  # in the frame of its body
    return {"measured": "own"} if measure.point is None else {"measured": "point", "point": measure.point}
