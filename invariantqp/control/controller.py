"""The controller of one arm: measured joint positions and a target in, a joint velocity inside the limits out.

    s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, limits(q))

For a partial target (`control/target.py`) only the constrained part is measured. The error twist is in the base frame,
where it does not depend on the tool frame; b <= 1 slows the approach to what acceleration limits can brake. The
engine computes a tick (`core/loop.hpp`); this file checks arguments.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy, deepcopy
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
    JointLimits,
    Limit,
    RowLimit,
    Rows,
    ToolSpeedLimit,
    require_range,
    tool_speed_fields,
)
from invariantqp.control.loop_limits import AnyLimit, LoopLimits, TickChanges, limit_fields, limits_of, loop_of
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.plausibility import require_plausible
from invariantqp.control.target import TARGETS, checked_target, partial_target
from invariantqp.control.tracking import ticks_of_delay, tracking_gain, warn_of_gain, warn_of_times
from invariantqp.engine import law
from invariantqp.errors import BadInput, InvariantQPError, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.screws import angular_speeds
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import (
    Robot,
    RobotState,
    continuous_turns,
    middle,
    require_robot,
)
from invariantqp.velocity.arguments import damping_of, metric_of
from invariantqp.velocity.backends import Backend, backend_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.guard import Guard, guard_of
from invariantqp.velocity.limits import ToolSpeed, accelerations
from invariantqp.velocity.problem import form_fields, no_projector
from invariantqp.velocity.reasons import Code, text_reasons
from invariantqp.velocity.solution import VelocitySolution, with_reasons_first

# Default posture gain [1/s]: below any tracking gain, large enough to keep the arm off its limits on long paths.
POSTURE_GAIN = 1.0
# Error above the least reachable one at which an arm may stop, as a share of a radian.
SLACK = 2e-3


class Controls(Protocol):
    """The protocol of a controller: anything with such a step."""

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick."""
        ...


class Controller:
    """Task-space velocity control of one arm; `step` is one tick. One controller drives one arm, in one thread.

    Only the attribute `state` can be set. A copy is an independent loop.

    Attributes:
        robot, dt, gain, delay, backend: as given.
        form: the form that projects a twist beyond the joints, or None for least squares.
        measure: the point and length by which twists are measured.
        posture_gain: [1/s], 0 without a posture.
        exact: the exact demands.
        guard: the descent guard of the form, or None.
        limits: all limits of the loop.
        box: position and velocity limits.
        acceleration_limit: (m,) [rad/s^2, length/s^2], or None.
        tool_speed: the speed limit of a point of the tool, or None.
        joint_rows: limits on combinations of joint velocities, or None.
        turns: (m,) period of continuous joints, modulo which their positions are compared; 0 for other joints.
        in_engine: the loop in the engine, for followers.
        by_chain: whether the engine computes the arm's kinematics.
        has_own_demands: whether an exact demand is the user's own class.
        options: the arguments of the constructor, by name.
        state: the state between ticks: last commands, measured positions, joint responses, the last residual. A value:
            it can be copied, compared, pickled and set.
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
        """A controller at rest.

        Args:
            robot: from `load_robot`, or anything that implements `Robot`; up to 64 joints.
            dt: tick [s].
            gain: tracking gain [1/s], at most 1/dt; None is 0.1/dt, a tenth of the error in a tick, or less with a
                delay.
            form: how a twist beyond the joints is projected; None is least squares at the point.
            damping: lambda of a pitch form, as in `systems.damped_pseudoinverse`; None is 0. Without a form the damping
                depends on the last tick's residual.
            guard: the descent guard of a form; True is the default one, False none.
            posture: (m,) joint positions to stay near in the null space; True is the middle of the ranges of hinges,
                not of slides, for arms with more than six joints; False is none. Without a task motion the joints rest.
            posture_gain: gain towards the posture while the tool moves [1/s].
            joint_metric: as in `solve_velocity`.
            backend: None is the engine; "daqp", any solver of qpsolvers, or a `Backend` of your own solves
                `velocity.definition` in each tick instead, in milliseconds.
            exact: demands met exactly while the rest is least squares: "position" for the tool frame's origin, "twist"
                for the whole twist, whose speed limits then scale, an ExactPoint, ExactAxis, ExactPlane, ExactJoints or
                ExactRows, or several of them.
            point: (3,) in the tool frame, the physical point where accuracy is measured; None is the exact point or,
                without one, the tool frame's origin; "own" is the arm's own point, which its joints move least.
            length: as in `solve_velocity`, by default the arm's reach to the point.
            acceleration_limit: (m,) or one for all joints [rad/s^2, length/s^2], inf for no limit; a joint then also
                keeps its braking distance before its position limits, and the tool before its target.
            delay: dead time between a command and its effect on the next measurement, beyond one tick [s].
            position_margin: distance kept from position limits [rad, length], less than half of any joint's range.
            tool_speed: the largest speed of a point of the tool [length/s], 0.25 m/s near a person; a number limits the
                tool frame's origin.
            rows: LimitRows on the joint velocity, or a function of q (m,) that returns them (or None) in every tick.
            limits: limits in addition to the robot's own, in a list: JointLimits, AccelerationLimit, LimitRows or
                functions as in `rows`, ToolSpeed, Clearance between links and from obstacles, a `Limit` of your own,
                and limits and barriers made for Pink from `robot.model`, anything with
                `compute_qp_inequalities(configuration, dt)`. The four arguments above are short for some of them. Joint
                limits are never relaxed; others are, where they contradict these. Reasons name rows by their names, or
                by their index in the list. Pink's limits cannot be pickled.
            far_outside: for a turning joint measured more than 0.5 rad outside its position range, as one in degrees:
                "hold" stands still, status "held"; "return" moves back inside.

        Raises:
            BadInput: a dt or gain that is not positive, a gain above 1/dt, something that is not a limit, a posture far
                outside the ranges, exact="twist" for an arm that does not move its tool in all six directions, or an
                argument that `solve_velocity` would refuse.
            UnknownName: no such back end.
            MissingExtra: a limit made for Pink without Pink.

        Warns:
            UserWarning: a gain of at most 1 1/s with a tick of at most 20 ms, which may be meant as a share of the
                error in a tick; JointLimits more than two turns from zero, as in degrees; a tool speed above thirty
                arm lengths a second, as in millimetres.
        """
        self.options: dict[str, Any] = {
            name: value for name, value in locals().items() if name not in {"self", "robot"}
        }
        self.robot: Robot = require_robot(robot)
        m = len(robot.names)
        if m > law.MOST_JOINTS:
            raise BadInput("robot", f"{m} joints", f"at most {law.MOST_JOINTS}", "Name those that move: joints=[...].")
        self.dt: float = arrays.number(dt, "dt", "a tick in seconds", positive=True)
        self.delay: float = arrays.not_negative(delay, "delay", "a dead time in seconds")
        warn_of_times(self.dt, self.delay)
        ticks_of_delay(self.delay, self.dt)  # raises if it is too long
        self.gain: float = tracking_gain(gain, self.dt, self.delay)
        if gain is not None:
            warn_of_gain(self.gain, self.dt)
        self.exact: tuple[Exact, ...] = demands_of(exact)
        mid = middle(robot)
        state = robot.state(mid, robot.target(robot.pose(mid)))  # also loads modules that the first tick needs
        tip = np.asarray(robot.pose(mid)[:3, 3])
        if self.exact:  # raises for demands on another number of joints
            rows_of(self.exact, View(robot, state, robot.target(robot.pose(mid)), 1.0, np.zeros(6)))
            require_all_directions(self.exact, robot)
        chosen = form_of(form)
        carried = chosen if isinstance(chosen, CarriedMetric) else None
        self.form: Form | None = None if isinstance(chosen, CarriedMetric) else chosen
        if point is None:
            point = next((demand.point for demand in self.exact if isinstance(demand, ExactPoint)), None)
        self.measure: ToolMeasure = ToolMeasure(robot, point, length, carried)
        posture_q, posture_gains = posture_of(posture, posture_gain, robot)
        self.posture_gain: float = float(posture_gains.max())
        self.backend: Backend | None = None if backend is None else backend_of(backend)
        all_limits = limits_by_name(robot, acceleration_limit, position_margin, tool_speed, rows, limits)
        own_limits = loop_of(robot, self.dt, self.delay)
        self.limits: LoopLimits = LoopLimits.of(own_limits, all_limits, far_outside, state.J, tip)
        require_plausible(robot, posture_q, self.limits.plausible, "posture")
        self.box, self.acceleration_limit, self.tool_speed, self.joint_rows = self.limits[:4]
        self.turns: Array = continuous_turns(self.box.position_lower, self.box.position_upper, state.J)
        checked_guard = guard_of(guard)
        self.guard: Guard | None = None if self.form is None else checked_guard
        self._settings: dict[str, Any] = {
            "joints": m,
            "delay": self.delay,
            "gain": self.gain,
            "slack": SLACK * self.measure.radian,
            "length": self.measure.length,
            **_measure_fields(self.measure),
            **limit_fields(self.limits.loop, self.box.rate),
            "believed_lower": self.limits.plausible[0],
            "believed_upper": self.limits.plausible[1],
            "range_lower": robot.position_lower,
            "range_upper": robot.position_upper,
            "turns": self.turns,
            "tip": tip,
            "far": self.limits.farthest,
            "tool_speed": None if self.tool_speed is None else tool_speed_fields(self.tool_speed),
            "metric": metric_of(joint_metric, state.J, tip, self.measure.length),
            **form_fields(self.form),
            "damping": damping_of(damping),
            "exact_rank": row_rank(self.exact, robot) if self.exact else 0,
            "guard": -1.0 if self.guard is None else self.guard.fraction,
        }
        if posture_gains.any():
            self._settings |= {"posture": posture_q, "pull": posture_gains}
        self.by_chain: bool = type(robot) is Chain  # a derived class may have other kinematics
        fixed = None if self.joint_rows is None else self.joint_rows.fixed
        demands = demand_fields(self.exact)
        self._settings |= {"rows": fixed and (fixed.C, fixed.lower, fixed.upper), "exact": demands or ()}
        self.has_own_demands: bool = demands is None
        calls_limits = self.joint_rows is not None and fixed is None
        calls = not self.by_chain or calls_limits or self.has_own_demands or self.backend is not None
        start = law.LoopState(m, self.delay, self.dt)
        self.in_engine: LoopInEngine = LoopInEngine(self, self._settings, start, has_callbacks=calls)

    def __setattr__(self, name: str, value: Any) -> None:
        if name[0] != "_" and name != "state" and "in_engine" in self.__dict__:  # the engine has a copy
            raise AttributeError(f"{name} of a controller does not change; make another Controller")
        object.__setattr__(self, name, value)

    def __copy__(self) -> Controller:
        return deepcopy(self)

    def __deepcopy__(self, memo: dict[int, Any]) -> Controller:
        other = object.__new__(type(self))
        stateful = ("limits", "joint_rows", "backend")
        vars(other).update(vars(self), **{name: deepcopy(getattr(self, name), memo) for name in stateful})
        vars(other)["in_engine"] = self.in_engine.of(other)
        return other

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "in_engine": (self.in_engine.has_callbacks, self.in_engine.state)}

    def __setstate__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields)
        has_callbacks, state = fields["in_engine"]
        vars(self)["in_engine"] = LoopInEngine(self, self._settings, state, has_callbacks=has_callbacks)

    @property
    def state(self) -> Any:
        """The state between ticks, a copy."""
        return copy(self.in_engine.state)

    @state.setter
    def state(self, value: Any) -> None:
        if not isinstance(value, law.LoopState) or len(value.numbers) != len(self.in_engine.state.numbers):
            raise BadInput("state", excerpt(value), "the state of a loop with as many joints and as long a delay")
        self.in_engine.state = copy(value)

    def checked_positions(self, q: ArrayLike, argument: str = "q") -> Array:
        """Plausible joint positions (m,); errors name the argument.

        Raises:
            BadInput: NaN, a wrong shape, or positions for which a tick is held.
        """
        positions = arrays.joint_vector(q, self.robot.names, argument)
        require_plausible(self.robot, positions, self.limits.plausible, argument)
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
            target: target pose of the tool frame, (4, 4) in the base frame, a `pinocchio.SE3`, or from `robot.target`;
                or a partial target: a point (3,) in the base frame for the tool frame's origin, or a `Target` with a
                point, an axis, or both. A partial target is measured at its own point; joints that it leaves free
                follow the posture, or move as little as possible.
            feedforward: (6,) twist of the target, a screw in base coordinates [rad/s; length/s]; None is a target at
                rest. If the target's origin p moves at v and the target turns at omega, both along the axes of the base
                frame, it is (omega; v + p x omega) = iq.adjoint(iq.transform(translation=p)) @ [*omega, *v].
            velocity: (m,) measured joint velocity [rad/s, length/s], for the acceleration limits; None is the last
                command, zero before the first tick.
            speed: speed override, from 0 to 1, of feedforward and approach alike; 0 stands still. The motion of the
                target must be slowed down by the same factor.
            velocity_limit: (m,) or one for all joints [rad/s, length/s], in this tick; the lower of it and the arm's.
            tool_speed: the largest speed of the controller's limited point, or of the tool frame's origin, in this tick
                [length/s]; the lower of it and the controller's own. The override scales speed limits too. Joints above
                these limits slow down at their `acceleration_limit`, at once without one.
            limits: more limits in this tick, as the controller takes them; the tighter one counts.

        Returns:
            VelocitySolution: q + dt velocity is inside the position limits, or on its way back inside.

        Raises:
            BadInput: NaN, wrong shapes, or a target thirty arm lengths away, as in millimetres; the controller's state
                does not change.
            NoPseudoinverse: the form has no projector for the arm as it is now, and there is neither a damping nor a
                guard.
        """
        if target is None:
            raise BadInput("target", "None", TARGETS, "For a twist, call follow(q, twist).")
        changes = self.limits.changed(speed, velocity_limit, tool_speed, limits)
        part = partial_target(target)
        if part is not None:
            if self.form is not None or any(isinstance(demand, ExactTwist) for demand in self.exact):
                expected = 'a (4, 4) pose beside a form or exact="twist"'
                raise BadInput("target", excerpt(target), expected, "These need the whole twist.")
            return self._tick(changes, q, target, feedforward, velocity, part=part)
        is_pose = isinstance(target, (np.ndarray, list, tuple)) or hasattr(target, "homogeneous")
        return self._tick(changes, q, target if is_pose else self.robot.target(target), feedforward, velocity)

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
            rows: more exact rows in this tick, parts of the screw: A = K'J and b = K'screw for some K.
            robot_state: what `robot.state` returned at q, if it was called in this tick already.
            measured_at: (3,) in the base frame, the point to measure at in this tick; None is the controller's own.
            posture: (m,) desired joint velocity in the null space; None is towards the controller's posture.
            speed: as in `step`; exact `rows` are scaled too.
            velocity_limit: as in `step`.
            tool_speed: as in `step`.
            limits: as in `step`.

        Returns:
            VelocitySolution, as from `step`; its residual is a screw in base coordinates.

        Raises:
            BadInput: NaN, wrong shapes, a twist above 1e12; the controller's state does not change.
            NoPseudoinverse: as in `step`.
        """
        changes = self.limits.changed(speed, velocity_limit, tool_speed, limits)
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
        return self._tick(changes, q, None, twist, velocity, measured_at=measured_at, posture=posture, **more)

    def rest(
        self, q: ArrayLike, reason: str, velocity: ArrayLike | None = None, robot_state: RobotState | None = None
    ) -> VelocitySolution:
        """One tick at rest; an arm outside its limits moves back inside.

        Args:
            q: (m,) measured joint positions [rad, length].
            reason: why, in words; it becomes the solution's reason.
            velocity: as in `step`.
            robot_state: as in `follow`.

        Raises:
            BadInput: NaN or wrong shapes; the controller's state does not change.
        """
        if not isinstance(reason, str):
            raise BadInput("reason", excerpt(reason), "a text")
        arm = {} if robot_state is None else {"arm": engine_state(robot_state)}
        solution = self._tick(None, q, None, None, velocity, stand=True, **arm)
        if not reason or any(one.code is Code.IMPLAUSIBLE_POSITION for one in solution.reasons):
            return solution
        return solution._replace(reasons=with_reasons_first(text_reasons(reason), solution))

    def _tick(
        self,
        changes: TickChanges | None,
        q: ArrayLike,
        target: Any,
        twist: ArrayLike | None,
        velocity: ArrayLike | None,
        **more: Any,
    ) -> VelocitySolution:
        """A tick of the engine; `twist` is the feedforward, or without a target the commanded twist."""
        inner, pose = self.in_engine, None if "part" in more else target
        calls = inner.calls if changes is None else Callbacks(self, changes)
        if calls is not None:
            calls.begin(q, pose)
            more |= {"functions": calls.functions, "changes": calls.changes}
        try:
            result = inner.loop.tick(inner.state, q, pose, twist, velocity, **more)
        except (ValueError, TypeError, AttributeError, ArithmeticError) as error:
            if isinstance(error, InvariantQPError) or (calls is not None and calls.raised is error):
                raise
            raise bad_input(self, q, target, twist, velocity, more, error) from None
        return inner.solution(result, calls)


def bad_input(
    loop: Controller, q: Any, target: Any, twist: Any, velocity: Any, more: dict[str, Any], error: Exception
) -> Exception:
    """The error of the library for an error of the engine: which argument is wrong, and what was expected."""
    m = len(loop.robot.names)
    positions = arrays.joint_vector(q, loop.robot.names, "q")
    if isinstance(error, ArithmeticError):
        return no_projector(loop.robot.jacobian(positions), loop.form)
    if target is not None:
        if "part" in more:
            point = checked_target(target).point
        else:
            pose = loop.robot.target(target)
            point = loop.robot.points(loop.robot.state(positions, pose), pose, np.zeros(3))[1]
        if point is not None:
            loop.limits.require_near(point, "target")
        if twist is not None:
            sizes.bounded_twists(arrays.vector(twist, 6, "feedforward"), "feedforward")
    elif twist is not None:
        sizes.bounded_twists(arrays.twist(twist))
    for name, value, size in (
        ("velocity", velocity, m),
        ("posture", more.get("posture"), m),
        ("measured_at", more.get("measured_at"), 3),
    ):
        if value is not None:
            arrays.vector(value, size, name)
    return BadInput("the arguments", str(error), "numbers that can be computed with")


def limits_by_name(
    robot: Robot,
    acceleration_limit: ArrayLike | None,
    position_margin: float,
    tool_speed: ToolSpeed | float | None,
    rows: Rows | None,
    limits: Sequence[AnyLimit],
) -> list[Limit]:
    """The limits of a controller in addition to the robot's own, from the arguments of these names."""
    given: list[Limit] = [] if rows is None else [RowLimit(rows)]
    given += [] if tool_speed is None else [ToolSpeedLimit(tool_speed)]
    given += limits_of(limits)
    if acceleration_limit is not None:
        given.append(AccelerationLimit(accelerations(acceleration_limit, len(robot.names))))
    margin = arrays.not_negative(position_margin, "position_margin", "a distance kept from position limits")
    require_range(robot.position_lower, robot.position_upper, margin, "position_margin")
    return [*given, JointLimits(margin=margin)] if margin > 0.0 else given


def posture_of(posture: ArrayLike | bool, gain: float, robot: Robot) -> tuple[Array, Array]:
    """The posture (m,) and the gain of each joint (m,) [1/s], 0 without a posture.

    True is the middle of the ranges of the hinges of an arm with more than six joints.
    """
    m = len(robot.names)
    k = arrays.not_negative(gain, "posture_gain", "a gain in 1/s")
    if isinstance(posture, (bool, np.bool_)):
        mid = middle(robot)
        bounded = np.isfinite(robot.position_lower) & np.isfinite(robot.position_upper)
        hinge = angular_speeds(robot.jacobian(mid)) > 0.0
        return mid, np.where(bounded & hinge & (m > 6) & bool(posture), k, 0.0)
    if np.ndim(arrays.array(posture, "posture", "joint positions, True or False")) == 0:
        raise BadInput("posture", f"{posture}", f"({m},) joint positions, True or False", "The gain is posture_gain.")
    return arrays.vector(posture, m, "posture"), np.full(m, k)


def _measure_fields(measure: ToolMeasure) -> dict[str, Any]:
    """The measure as the engine takes it."""
    if measure.carried is not None:
        by = "tool" if measure.carried.follows_tool else "base"
        return {"measured": by, "root": measure.carried.root(np.eye(4))}  # in the body's frame
    return {"measured": "own"} if measure.point is None else {"measured": "point", "point": measure.point}
