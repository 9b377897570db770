"""What a tick of the engine asks of Python: limits, exact demands and robots of the user's, and other solvers."""

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
from invariantqp.control.limits import (
    Changes,
    Limit,
    LimitInEngine,
    LoopLimits,
    RowLimits,
    limit_fields,
    overrides,
    tool_speed_fields,
)
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
from invariantqp.velocity.problem import found_by, names_of, solution_of
from invariantqp.velocity.reasons import Code, Reason, told
from invariantqp.velocity.solution import Status, VelocitySolution, both


class LoopOfUser(Protocol):
    """What is read of a controller, whose attributes these are."""

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
    asks_demands: bool


class RowNames:
    """What the rows of a tick are called, made when they are read; none where no row has a name."""

    __slots__ = ("_fixed", "_limits", "_rows", "_user_rows")

    def __init__(
        self, fixed: LimitRows | None, limits: Sequence[Limit | LimitRows], rows: bytes, user_rows: Sequence[LimitRows]
    ) -> None:
        """Of rows that never change, and of those of limits: their origins as the engine says them."""
        self._fixed, self._limits, self._rows, self._user_rows = fixed, limits, rows, user_rows

    def __iter__(self) -> Iterator[str]:
        names = [] if self._fixed is None else list(_names(self._fixed))
        of_users = chain.from_iterable(map(_names, self._user_rows))
        numbers = iter(array("d", self._rows))
        for i, pair, distance in zip(numbers, numbers, numbers, strict=True):
            limit = self._limits[int(i)]
            if isinstance(limit, LimitInEngine):
                names.append(limit.clearance.row_name(int(pair), distance))
            else:
                names.append(next(of_users))
        return iter(names if any(names) else ())

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (tuple(self),)


def _names(rows: LimitRows) -> Sequence[str]:
    return rows.names or ("",) * len(rows.C)


class Callbacks:
    """The functions that the engine calls in a tick, and what they said.

    Attributes:
        functions: as the engine takes them: arm, limits, exact, law; None where there is none. Each of the limits is
            the engine's own, or its functions (rows, after).
        raised: the exception that one of the functions raised, or None.
    """

    def __init__(self, controller: LoopOfUser, now: Changes | None = None) -> None:
        """Of a controller; `now` is what is other in one tick."""
        own, changed = controller.joint_rows, None if now is None else now.joint_rows
        self._loop, self._now, self._target = controller, now, None
        self._fixed = None if own is None else own.fixed
        groups = [limits for limits in (own if self._fixed is None else None, changed) if limits]
        self._limits: list[Limit | LimitRows] = [limit for limits in groups for limit in limits]
        self._clearances = [limit.clearance for limit in self._limits if isinstance(limit, LimitInEngine)]
        users = [limit for limit in self._limits if isinstance(limit, Limit) and not isinstance(limit, LimitInEngine)]
        self._first = next((x for x in self._limits if not isinstance(x, LimitInEngine)), None)
        self._begin = [limit.begin for limit in users if overrides(limit, "begin")]
        self._tells = any(overrides(limit, "broken") for limit in users)
        self._user_rows: list[LimitRows] = []
        self._trouble: Reason | None = None
        self._failure = ""
        self.raised: BaseException | None = None
        self.functions: tuple[Any, ...] = (
            None if controller.by_chain else self._kept(self._arm),
            tuple(self._limit(limit, limits) for limits in groups for limit in limits),
            self._kept(self._exact) if controller.asks_demands else None,
            None if controller.backend is None else self._kept(self._law),
        )

    def _limit(self, limit: Limit | LimitRows, limits: RowLimits) -> Any:
        """One of some limits as the engine takes it."""
        if isinstance(limit, LimitInEngine):
            return limit.engine
        after = self._kept(partial(self._after, limit, limits)) if overrides(limit, "after") else None
        return self._kept(partial(self._limit_rows, limit, limits)), after

    @property
    def changes(self) -> tuple[float, dict[str, Any] | None, tuple[float, Array] | None] | None:
        """What is other in this tick, as the engine takes it."""
        now, usual = self._now, self._loop.limits.loop
        if now is None:
            return None
        speed = now.loop.tool_speed
        return (
            now.speed,
            None if now.loop is usual else limit_fields(now.loop, self._loop.box.rate),
            None if speed is None or speed is usual.tool_speed else tool_speed_fields(speed),
        )

    def begin(self, q: Any, target: Any) -> None:
        """A tick begins at measured joint positions q (m,), towards a target pose, None for no pose."""
        self._user_rows, self._target, self._trouble, self._failure, self.raised = [], target, None, "", None
        for clearance in self._clearances:
            clearance.update()
        for begin in self._begin:
            begin(vector(q, len(self._loop.robot.names), "q"))

    def row_names(self, rows: bytes | None) -> Iterable[str]:
        """What the rows of this tick are called; `rows` are their origins as the engine says them."""
        if rows is not None:
            return RowNames(self._fixed, self._limits, rows, self._user_rows)
        return () if self._fixed is None else self._fixed.names

    def completed(self, solution: VelocitySolution, too_near: tuple[int, int, float] | None) -> VelocitySolution:
        """The solution with what limits and solvers said; and a clearance that is not kept, as the engine says it."""
        backend = self._loop.backend
        if backend is not None:
            solution = solution._replace(backend=backend.name if solution.method == "qp" else "")
            if self._failure and solution.status is Status.HELD:
                solution = solution._replace(reasons=(Reason(Code.NO_VELOCITY, words=self._failure),))
        if self._trouble is not None:
            solution = solution._replace(reasons=both((self._trouble,), solution))
        if (too_near is not None or self._tells) and (broken := self._broken(too_near)):
            status = Status.LIMITED if solution.status is Status.OK else solution.status
            solution = solution._replace(status=status, reasons=both(told(broken), solution))
        return solution

    def _broken(self, too_near: tuple[int, int, float] | None) -> str:
        """What of the first limit does not hold that is broken, "" where all hold."""
        for i, limit in enumerate(self._limits):
            if isinstance(limit, LimitInEngine):
                if too_near is not None and too_near[0] == i:
                    return str(limit.clearance.too_near(*too_near[1:]))
            elif isinstance(limit, Limit) and (why := limit.broken()):
                return why
        return ""

    def _kept(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, whose exceptions are kept: they are the user's, and no argument that the engine refuses."""

        def called(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except BaseException as error:
                self.raised = error
                raise

        return called

    def _state_at(self, q: Array) -> RobotState:
        robot = self._loop.robot
        return robot.state(q, robot.target(robot.pose(q) if self._target is None else self._target))

    def _arm(self, q: Array) -> tuple[Array, Any]:
        return engine_state(self._state_at(q))

    def _limit_rows(self, limit: Limit | LimitRows, limits: RowLimits, q: Array, before: Array) -> Any:
        """Rows of one of some limits at joint positions q (m,), or None; False where none are known to be safe."""
        if limit is self._first:  # a follower asks for them twice
            self._user_rows = []
        rows, self._trouble = limits.answers("rows", [limit], q, before)
        return False if self._trouble is not None else self._added(rows)

    def _after(self, limit: Limit | LimitRows, limits: RowLimits, q: Array, x: Array) -> Any:
        """More rows of one of some limits, where the answer x (m,) does not keep it to the tick's end, or None."""
        return self._added(limits.answers("after", [limit], q, x).rows)

    def _added(self, rows: LimitRows | None) -> tuple[Array, Array, Array] | None:
        if rows is None:
            return None
        self._user_rows.append(rows)
        return rows.C, rows.lower, rows.upper

    def _exact(self, q: Array, gain: float, ahead: Array, nearest: Array | None) -> tuple[Array, Array, Array | None]:
        robot = self._loop.robot
        wanted = self._target if nearest is None else nearest
        target = robot.target(robot.pose(q) if wanted is None else wanted)
        rows = rows_of(self._loop.exact, View(robot, robot.state(q, target), target, gain, ahead))
        return rows.A, rows.b, rows.of_twist

    def _law(self, fields: dict[str, Any]) -> tuple[Any, ...] | None:
        """The answer of `velocity.definition` by the loop's own solver, None where it finds none."""
        loop = self._loop
        rows, point, exact = (fields.pop(name) for name in ("rows", "tool_speed", "exact"))
        formed, guard, measure = fields.pop("formed"), loop.guard, fields.pop("measure")
        whole = fields["root"] if measure is None else measure
        if rows is not None or point is not None:
            m = len(fields["lower"])
            C, low, high = (np.zeros((0, m)), np.zeros(0), np.zeros(0)) if rows is None else rows
            fields["rows"] = Rows(C, low, high) if point is None else Rows(C, low, high, (), *point)
        if exact is not None:
            E, first, error, D = exact
            M = whitened(ExactRows(E, first + error, D if D.any() else None), whole)[0]
            fields["exact"], fields["parts"] = (M.T.dot(E), first.dot(M), error.dot(M)), M.T.dot(D)
        tick = Tick(**fields, form=loop.form if formed else None, guard=None if guard is None else guard.fraction)
        try:
            answer = self._velocity(tick)
        except (SolverFailure, np.linalg.LinAlgError) as failure:
            self._failure = str(failure) or excerpt(failure)
            return None
        x, pace, share, guarded, limited, relaxed, faster = found_by(answer, tick)
        return x, pace, share, answer.missed, guarded, limited, relaxed, faster

    def _velocity(self, tick: Tick) -> Answer:
        """By the loop's own solver; where a form has no projector, its guard leaves none of it."""
        try:
            return velocity(tick, self._loop.backend)
        except InvariantQPError as none:
            if isinstance(none, SolverFailure) or tick.guard is None:
                raise
            return velocity(replace(tick, form=None), self._loop.backend)._replace(guarded=0.0)


class LoopInEngine:
    """The loop of a controller in the engine, with what it asks of Python.

    Attributes:
        settings: what never changes, as the engine takes it.
        loop: the engine's.
        state: what the loop remembers between ticks.
        asks: whether a tick asks anything of Python.
        calls: what it asks, None for nothing.
    """

    def __init__(self, controller: LoopOfUser, settings: dict[str, Any], state: Any, *, asks: bool) -> None:
        """Of a controller.

        Raises:
            BadInput: absurdly large or small numbers.
        """
        self._controller, self.settings, self.state, self.asks = controller, settings, state, asks
        self.calls: Callbacks | None = Callbacks(controller) if asks else None
        rows = controller.joint_rows
        self._row_names = names_of(None if rows is None else rows.fixed)
        robot: Any = controller.robot
        try:
            self.loop: Any = law.Loop({**settings, "chain": robot.in_engine} if controller.by_chain else settings)
        except ValueError as refusal:
            raise BadInput("the arguments", str(refusal), "numbers that can be computed with") from None

    def of(self, controller: LoopOfUser) -> LoopInEngine:
        """A copy, of a copy of the controller."""
        return LoopInEngine(controller, self.settings, copy(self.state), asks=self.asks)

    @property
    def law(self) -> dict[str, Any]:
        """What of the law is the same in every tick, as the engine takes it: form, damping, guard, joint metric."""
        guard = self._controller.guard
        fields = {name: self.settings[name] for name in ("form", "root", "damping", "metric") if name in self.settings}
        return fields | {"guard": None if guard is None else guard.fraction}

    def posture_pull(self, q: Array) -> Array | None:
        """(m,) the joint velocity from q (m,) towards the posture; None where the null space has none."""
        if "pull" not in self.settings:
            return None
        way = joint_displacement(q, self.settings["posture"], self.settings["turns"])
        return np.asarray(self.settings["pull"] * way)

    def follower(self, rise: float) -> Any:
        """The ticks of a follower, whose accelerations rise to their limits in a time [s]."""
        limited = self._controller.tool_speed is not None or self._controller.joint_rows is not None
        return law.Follower(self.loop, rise, limited)

    def asked(self, q: Any, target: Any = None) -> tuple[Any, ...] | None:
        """The functions that are asked in a tick that begins at measured joint positions q (m,), towards a target."""
        if self.calls is None:
            return None
        self.calls.begin(q, target)
        return self.calls.functions

    def raised(self, error: BaseException) -> bool:
        """Whether one of these functions raised the error."""
        return self.calls is not None and self.calls.raised is error

    def solution(self, found: tuple[Any, ...], calls: Callbacks | None = None) -> VelocitySolution:
        """The solution of a tick from what the engine found; `calls` are other functions that it asked."""
        calls, names = self.calls if calls is None else calls, self._controller.robot.names
        if calls is None:
            return solution_of(found, self._row_names, names)
        fields, rows, too_near = found
        return calls.completed(solution_of(fields, calls.row_names(rows), names), too_near)


def engine_state(state: RobotState) -> tuple[Array, Any]:
    """A state as the engine takes it.

    Raises:
        BadInput: something else.
    """
    if not isinstance(state, RobotState):
        raise BadInput("robot_state", excerpt(state), "what robot.state(q, target) returned")
    return state.J, state.pose
