"""Callbacks from a tick of the engine to Python: the user's limits, demands, robots and solvers."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any, Protocol

import numpy as np

from invariantqp.control.demands import Exact, View, rows_of
from invariantqp.control.limits import EngineLimit, Limit, tool_speed_fields
from invariantqp.control.loop_limits import LoopLimits, RowLimits, TickChanges, limit_fields, overrides
from invariantqp.engine import law
from invariantqp.errors import BadInput, InvariantQPError, excerpt
from invariantqp.geometry.arrays import Array, vector
from invariantqp.robots.kinematics import Robot, RobotState, joint_displacement
from invariantqp.velocity.backends import Backend, SolverFailure
from invariantqp.velocity.definition import Answer, Rows, Tick, velocity
from invariantqp.velocity.exact import ExactRows, whitened
from invariantqp.velocity.forms import Form
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.limits import JointBox, LimitRows, ToolSpeed
from invariantqp.velocity.problem import answer_fields, row_names_of, solution_of
from invariantqp.velocity.reasons import Code, Reason, text_reasons
from invariantqp.velocity.solution import Status, VelocitySolution, with_reasons_first


class ControllerFields(Protocol):
    """The attributes of a controller that callbacks read."""

    robot: Robot
    limits: LoopLimits
    box: JointBox
    joint_rows: RowLimits | None
    tool_speed: ToolSpeed | None
    exact: tuple[Exact, ...]
    form: Form | None
    guard: Guard | None
    backend: Backend | None
    by_chain: bool
    has_own_demands: bool


class RowNames:
    """The names of the rows of a tick, made when they are read; empty if no row has a name."""

    __slots__ = ("_constant", "_limits", "_origins", "_user_rows")

    def __init__(
        self,
        constant: LimitRows | None,
        limits: Sequence[Limit | LimitRows],
        origins: bytes,
        user_rows: Sequence[LimitRows],
    ) -> None:
        """For constant rows, and rows of limits with the origins that the engine returns: limit, pair, distance."""
        self._constant, self._limits, self._origins, self._user_rows = constant, limits, origins, user_rows

    def __iter__(self) -> Iterator[str]:
        names = [] if self._constant is None else list(_names(self._constant))
        user_names = chain.from_iterable(map(_names, self._user_rows))
        numbers = iter(array("d", self._origins))
        for i, pair, distance in zip(numbers, numbers, numbers, strict=True):
            limit = self._limits[int(i)]
            if isinstance(limit, EngineLimit):
                names.append(limit.clearance.row_name(int(pair), distance))
            else:
                names.append(next(user_names))
        return iter(names if any(names) else ())

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (tuple(self),)


def _names(rows: LimitRows) -> Sequence[str]:
    return rows.names or ("",) * len(rows.C)


class Callbacks:
    """The functions that the engine calls in a tick, and the reasons and rows that they returned.

    Attributes:
        functions: as the engine takes them: arm, limits, exact, law; None for those not needed. Each limit is an object
            of the engine or a pair of functions (rows, after).
        raised: the exception that one of the functions raised, or None.
    """

    def __init__(self, controller: ControllerFields, changes: TickChanges | None = None) -> None:
        """For a controller, and for the changes of one tick."""
        own, changed = controller.joint_rows, None if changes is None else changes.joint_rows
        self._loop, self._changes, self._target = controller, changes, None
        self._constant = None if own is None else own.fixed
        groups = [limits for limits in (own if self._constant is None else None, changed) if limits]
        self._limits: list[Limit | LimitRows] = [limit for limits in groups for limit in limits]
        self._clearances = [limit.clearance for limit in self._limits if isinstance(limit, EngineLimit)]
        users = [limit for limit in self._limits if isinstance(limit, Limit) and not isinstance(limit, EngineLimit)]
        self._first = next((x for x in self._limits if not isinstance(x, EngineLimit)), None)
        self._begin = [limit.begin for limit in users if overrides(limit, "begin")]
        self._has_violations = any(overrides(limit, "violation") for limit in users)
        self._user_rows: list[LimitRows] = []
        self._unusable: Reason | None = None
        self._solver_failure = ""
        self.raised: BaseException | None = None
        self.functions: tuple[Any, ...] = (
            None if controller.by_chain else self._recorded(self._arm),
            tuple(self._limit(limit, limits) for limits in groups for limit in limits),
            self._recorded(self._exact) if controller.has_own_demands else None,
            None if controller.backend is None else self._recorded(self._law),
        )

    def _limit(self, limit: Limit | LimitRows, limits: RowLimits) -> Any:
        """A limit as the engine takes it."""
        if isinstance(limit, EngineLimit):
            return limit.engine
        after = self._recorded(partial(self._after, limit, limits)) if overrides(limit, "after") else None
        return self._recorded(partial(self._limit_rows, limit, limits)), after

    @property
    def changes(self) -> tuple[float, dict[str, Any] | None, tuple[float, Array] | None] | None:
        """The changes of this tick as the engine takes them: speed, joint limits, tool speed."""
        changes, usual = self._changes, self._loop.limits.loop
        if changes is None:
            return None
        speed = changes.loop.tool_speed
        return (
            changes.speed,
            None if changes.loop is usual else limit_fields(changes.loop, self._loop.box.rate),
            None if speed is None or speed is usual.tool_speed else tool_speed_fields(speed),
        )

    def begin(self, q: Any, target: Any) -> None:
        """Begin a tick at measured joint positions q (m,), with a target pose or None."""
        self._user_rows, self._target, self._unusable, self._solver_failure, self.raised = [], target, None, "", None
        for clearance in self._clearances:
            clearance.update()
        for begin in self._begin:
            begin(vector(q, len(self._loop.robot.names), "q"))

    def row_names(self, origins: bytes | None) -> Iterable[str]:
        """The names of the rows of this tick, from the origins that the engine returns."""
        if origins is not None:
            return RowNames(self._constant, self._limits, origins, self._user_rows)
        return () if self._constant is None else self._constant.names

    def completed(self, solution: VelocitySolution, too_near: tuple[int, int, float] | None) -> VelocitySolution:
        """The solution with the reasons of limits and solvers; `too_near`: limit, pair and distance of a clearance."""
        backend = self._loop.backend
        if backend is not None:
            solution = solution._replace(backend=backend.name if solution.method == "qp" else "")
            if self._solver_failure and solution.status is Status.HELD:
                solution = solution._replace(reasons=(Reason(Code.NO_SOLUTION, words=self._solver_failure),))
        if self._unusable is not None:
            solution = solution._replace(reasons=with_reasons_first((self._unusable,), solution))
        if (too_near is not None or self._has_violations) and (violation := self._violation(too_near)):
            status = Status.LIMITED if solution.status is Status.OK else solution.status
            solution = solution._replace(status=status, reasons=with_reasons_first(text_reasons(violation), solution))
        return solution

    def _violation(self, too_near: tuple[int, int, float] | None) -> str:
        """How the first violated limit is violated, "" if none is."""
        for i, limit in enumerate(self._limits):
            if isinstance(limit, EngineLimit):
                if too_near is not None and too_near[0] == i:
                    return str(limit.clearance.too_near(*too_near[1:]))
            elif isinstance(limit, Limit) and (why := limit.violation()):
                return why
        return ""

    def _recorded(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, with its exceptions recorded to tell them from those of the engine."""

        def recorded(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except BaseException as error:
                self.raised = error
                raise

        return recorded

    def _state_at(self, q: Array) -> RobotState:
        robot = self._loop.robot
        return robot.state(q, robot.target(robot.pose(q) if self._target is None else self._target))

    def _arm(self, q: Array) -> tuple[Array, Any]:
        return engine_state(self._state_at(q))

    def _limit_rows(self, limit: Limit | LimitRows, limits: RowLimits, q: Array, before: Array) -> Any:
        """The rows of a limit at joint positions q (m,) or None; False if they cannot be used."""
        if limit is self._first:  # a follower calls for the rows twice in a tick
            self._user_rows = []
        rows, self._unusable = limits.rows_from("rows", [limit], q, before)
        return False if self._unusable is not None else self._added(rows)

    def _after(self, limit: Limit | LimitRows, limits: RowLimits, q: Array, x: Array) -> Any:
        """More rows of a limit if the solution x (m,) violates it at the end of the tick, or None."""
        return self._added(limits.rows_from("after", [limit], q, x)[0])

    def _added(self, rows: LimitRows | None) -> tuple[Array, Array, Array] | None:
        if rows is None:
            return None
        self._user_rows.append(rows)
        return rows.C, rows.lower, rows.upper

    def _exact(
        self, q: Array, gain: float, feedforward: Array, nearest: Array | None
    ) -> tuple[Array, Array, Array | None]:
        robot = self._loop.robot
        pose = self._target if nearest is None else nearest
        target = robot.target(robot.pose(q) if pose is None else pose)
        rows = rows_of(self._loop.exact, View(robot, robot.state(q, target), target, gain, feedforward))
        return rows.A, rows.b, rows.of_twist

    def _law(self, fields: dict[str, Any]) -> tuple[Any, ...] | None:
        """The solution of `velocity.definition` by the controller's back end, None if it fails."""
        loop = self._loop
        rows, point, exact = (fields.pop(name) for name in ("rows", "tool_speed", "exact"))
        has_form, guard, measure = fields.pop("has_form"), loop.guard, fields.pop("measure")
        whole = fields["root"] if measure is None else measure
        if rows is not None or point is not None:
            m = len(fields["lower"])
            C, low, high = (np.zeros((0, m)), np.zeros(0), np.zeros(0)) if rows is None else rows
            fields["rows"] = Rows(C, low, high) if point is None else Rows(C, low, high, (), *point)
        if exact is not None:
            E, first, error, D = exact
            M = whitened(ExactRows(E, first + error, D if D.any() else None), whole)[0]
            fields["exact"], fields["twist_rows"] = (M.T.dot(E), first.dot(M), error.dot(M)), M.T.dot(D)
        tick = Tick(**fields, form=loop.form if has_form else None, guard=None if guard is None else guard.fraction)
        try:
            answer = self._velocity(tick)
        except (SolverFailure, np.linalg.LinAlgError) as failure:
            self._solver_failure = str(failure) or excerpt(failure)
            return None
        return answer_fields(answer, tick)

    def _velocity(self, tick: Tick) -> Answer:
        """The solution by the controller's back end; a guarded form without a projector becomes least squares."""
        try:
            return velocity(tick, self._loop.backend)
        except InvariantQPError as error:
            if isinstance(error, SolverFailure) or tick.guard is None:
                raise
            return velocity(replace(tick, form=None), self._loop.backend)._replace(form_share=0.0)


class LoopInEngine:
    """The loop of a controller in the engine, with its callbacks.

    Attributes:
        settings: the constant arguments, as the engine takes them.
        loop: the engine's loop.
        state: the loop's state between ticks.
        has_callbacks: whether a tick calls Python.
        calls: the callbacks, or None.
    """

    def __init__(
        self, controller: ControllerFields, settings: dict[str, Any], state: Any, *, has_callbacks: bool
    ) -> None:
        """For a controller.

        Raises:
            BadInput: too large or too small numbers.
        """
        self._controller, self.settings, self.state, self.has_callbacks = controller, settings, state, has_callbacks
        self.calls: Callbacks | None = Callbacks(controller) if has_callbacks else None
        rows = controller.joint_rows
        self._row_names = row_names_of(None if rows is None else rows.fixed)
        robot: Any = controller.robot
        try:
            self.loop: Any = law.Loop({**settings, "chain": robot.in_engine} if controller.by_chain else settings)
        except ValueError as refusal:
            raise BadInput("the arguments", str(refusal), "numbers that can be computed with") from None

    def of(self, controller: ControllerFields) -> LoopInEngine:
        """A copy for a copy of the controller."""
        return LoopInEngine(controller, self.settings, copy(self.state), has_callbacks=self.has_callbacks)

    @property
    def law(self) -> dict[str, Any]:
        """Form, damping, guard and joint metric, as the engine takes them."""
        guard = self._controller.guard
        fields = {name: self.settings[name] for name in ("form", "root", "damping", "metric") if name in self.settings}
        return fields | {"guard": None if guard is None else guard.fraction}

    def posture_pull(self, q: Array) -> Array | None:
        """(m,) the joint velocity from q (m,) towards the posture; None without a posture."""
        if "pull" not in self.settings:
            return None
        displacement = joint_displacement(q, self.settings["posture"], self.settings["turns"])
        return np.asarray(self.settings["pull"] * displacement)

    def follower(self, rise: float) -> Any:
        """The engine's follower, whose accelerations rise to their limits in a time [s]."""
        limited = self._controller.tool_speed is not None or self._controller.joint_rows is not None
        return law.Follower(self.loop, rise, limited)

    def begin_callbacks(self, q: Any, target: Any = None) -> tuple[Any, ...] | None:
        """The callbacks of a tick that begins at measured joint positions q (m,), with a target pose or None."""
        if self.calls is None:
            return None
        self.calls.begin(q, target)
        return self.calls.functions

    def raised(self, error: BaseException) -> bool:
        """Whether a callback raised the error."""
        return self.calls is not None and self.calls.raised is error

    def solution(self, result: tuple[Any, ...], calls: Callbacks | None = None) -> VelocitySolution:
        """The solution of a tick from the engine's result; `calls` replaces the loop's own callbacks."""
        calls, names = self.calls if calls is None else calls, self._controller.robot.names
        if calls is None:
            return solution_of(result, self._row_names, names)
        fields, origins, too_near = result
        return calls.completed(solution_of(fields, calls.row_names(origins), names), too_near)


def engine_state(state: RobotState) -> tuple[Array, Any]:
    """A state as the engine takes it.

    Raises:
        BadInput: something else.
    """
    if not isinstance(state, RobotState):
        raise BadInput("robot_state", excerpt(state), "what robot.state(q, target) returned")
    return state.J, state.pose
