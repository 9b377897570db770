"""What a tick of the engine asks of Python: limits, exact demands and robots of the user's, and other solvers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from invariantqp.control.demands import Exact, View, rows_of
from invariantqp.control.limits import Changes, LoopLimits, RowLimits, limit_fields, stacked, tool_speed_fields
from invariantqp.errors import BadInput, InvariantQPError, excerpt
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, Sighting
from invariantqp.velocity.backends import Backend, SolverFailure
from invariantqp.velocity.definition import Answer, Rows, Tick, velocity
from invariantqp.velocity.exact import ExactRows, whitened
from invariantqp.velocity.forms import Form
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.limits import JointBox, LimitRows
from invariantqp.velocity.problem import found_by
from invariantqp.velocity.reasons import Code, Reason, told
from invariantqp.velocity.solution import Status, VelocitySolution, both


class LoopOfUser(Protocol):
    """What is read of a controller, whose attributes these are."""

    robot: Robot
    limits: LoopLimits
    box: JointBox
    joint_rows: RowLimits | None
    exact: tuple[Exact, ...]
    form: Form | None
    guard: Guard | None
    backend: Backend | None
    by_chain: bool
    asks_demands: bool


class Callbacks:
    """The functions that the engine calls in a tick, and what they said.

    Attributes:
        functions: as the engine takes them: arm, rows, after, exact, law; None where there is none.
        rows: the limits on combinations of joint velocities in this tick, or None.
        raised: the exception that one of the functions raised, or None.
    """

    def __init__(self, controller: LoopOfUser, now: Changes | None = None) -> None:
        """Of a controller; `now` is what is other in one tick."""
        own, changed = controller.joint_rows, None if now is None else now.joint_rows
        self._loop, self._now, self._target = controller, now, None
        self._fixed = None if own is None else own.fixed
        asked = own if own is not None and own.fixed is None else None
        self._asked: list[RowLimits] = [limits for limits in (asked, changed) if limits]
        self._limits: list[RowLimits] = [limits for limits in (own, changed) if limits]
        self.rows: LimitRows | None = self._fixed
        self._trouble: Reason | None = None
        self._failure = ""
        self.raised: BaseException | None = None
        looks = any(limits.does["after"] for limits in self._limits)
        self._tells = any(limits.does["broken"] for limits in self._limits)
        self.functions: tuple[Callable[..., Any] | None, ...] = (
            None if controller.by_chain else self._kept(self._arm),
            self._kept(self._limit_rows) if self._asked else None,
            self._kept(self._after) if looks else None,
            self._kept(self._exact) if controller.asks_demands else None,
            None if controller.backend is None else self._kept(self._law),
        )

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
        """A tick begins at measured joint positions q (m,), towards a target, None for a twist."""
        self.rows, self._target, self._trouble, self._failure, self.raised = self._fixed, target, None, "", None
        for limits in self._limits:
            limits.begin(q)

    def completed(self, solution: VelocitySolution) -> VelocitySolution:
        """The solution with what limits and solvers said."""
        backend = self._loop.backend
        if backend is not None:
            solution = solution._replace(backend=backend.name if solution.method == "qp" else "")
            if self._failure and solution.status is Status.HELD:
                solution = solution._replace(reasons=(Reason(Code.NO_VELOCITY, words=self._failure),))
        if self._trouble is not None:
            solution = solution._replace(reasons=both((self._trouble,), solution))
        if self._tells and (broken := next((why for limits in self._limits if (why := limits.broken())), "")):
            status = Status.LIMITED if solution.status is Status.OK else solution.status
            solution = solution._replace(status=status, reasons=both(told(broken), solution))
        return solution

    def _kept(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, whose exceptions are kept: they are the user's, and no argument that the engine refuses."""

        def called(*arguments: Any) -> Any:
            try:
                return function(*arguments)
            except BaseException as error:
                self.raised = error
                raise

        return called

    def _sighting(self, q: Array) -> Sighting:
        robot = self._loop.robot
        return robot.sight(q, robot.target(robot.pose(q) if self._target is None else self._target))

    def _arm(self, q: Array) -> tuple[Array, Any]:
        return seen(self._sighting(q))

    def _limit_rows(self, q: Array, before: Array) -> tuple[Array, Array, Array] | bool | None:
        """Rows at joint positions q (m,) beside those that never change; False where none are known to be safe."""
        found: list[LimitRows] = []
        self.rows = self._fixed
        for limits in self._asked:
            rows, self._trouble = limits.at(q, before)
            if self._trouble is not None:
                return False
            found += [] if rows is None else [rows]
        more = stacked(found)
        self._add(more)
        return None if more is None else (more.C, more.lower, more.upper)

    def _after(self, q: Array, x: Array) -> tuple[Array, Array, Array] | None:
        """More rows, where the answer x (m,) does not keep some limit to the tick's end."""
        more = stacked([rows for limits in self._limits if (rows := limits.after(q, x)) is not None])
        self._add(more)
        return None if more is None else (more.C, more.lower, more.upper)

    def _add(self, more: LimitRows | None) -> None:
        if more is not None:
            self.rows = more if self.rows is None else stacked([self.rows, more])

    def _exact(self, q: Array, gain: float, ahead: Array) -> tuple[Array, Array, Array | None]:
        robot = self._loop.robot
        target = robot.target(robot.pose(q) if self._target is None else self._target)
        rows = rows_of(self._loop.exact, View(robot, robot.sight(q, target), target, gain, ahead))
        return rows.A, rows.b, rows.of_twist

    def _law(self, fields: dict[str, Any]) -> tuple[Any, ...] | None:
        """The answer of `velocity.definition` by the loop's own solver, None where it finds none."""
        loop = self._loop
        rows, point, exact = (fields.pop(name) for name in ("rows", "tool_speed", "exact"))
        formed, guard = fields.pop("formed"), loop.guard
        if rows is not None or point is not None:
            m = len(fields["lower"])
            C, low, high = (np.zeros((0, m)), np.zeros(0), np.zeros(0)) if rows is None else rows
            fields["rows"] = Rows(C, low, high) if point is None else Rows(C, low, high, (), *point)
        if exact is not None:
            E, first, error, D = exact
            M = whitened(ExactRows(E, first + error, D if D.any() else None), fields["root"])[0]
            fields["exact"] = M.T.dot(E), first.dot(M), error.dot(M)
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


def seen(sighting: Sighting) -> tuple[Array, Any]:
    """A sighting as the engine takes it.

    Raises:
        BadInput: something else.
    """
    if not isinstance(sighting, Sighting):
        raise BadInput("sighting", excerpt(sighting), "what robot.sight returned")
    return sighting.J, sighting.pose
