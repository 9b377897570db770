"""The loop of HybridController, by the old law, until the engine has its tick.

The loop body: measured joint positions and a target in, a joint velocity inside the limits out.

    s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, box(q))

The error twist is taken in the base frame, where it is the same whatever frame the tool has; b slows the approach down
where acceleration limits need room to brake (`approach`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import POSTURE_GAIN, limits_by_name, posture_of
from invariantqp.control.demands import Exact, ExactPoint, View, demands_of, require_rows, row_rank, rows_of
from invariantqp.control.limits import (
    AnyLimit,
    Changes,
    LoopLimits,
    Rows,
    loop_of,
    refuse,
)
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import (
    question_gain,
    question_times,
    same_turn,
    ticks_late,
    tracking_gain,
    tracking_twist,
)
from invariantqp.engine import ENGINES, Engine
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.approach import Approach, approach
from invariantqp.legacy.compiled_loop import acts_at, compiled_loop, compiled_tick
from invariantqp.legacy.damping import Damping, PaperLambda, damping_of
from invariantqp.legacy.law import SLACK, SLACK_GAIN, Chase, Demand, VelocityLaw
from invariantqp.legacy.memory import HEADER, Memory
from invariantqp.legacy.response import units
from invariantqp.legacy.solve import solve, standing
from invariantqp.robots.kinematics import (
    Robot,
    Sighting,
    continuous_turns,
    joint_displacement,
    middle,
    require_robot,
    unwrapped,
)
from invariantqp.velocity.arguments import metric_of
from invariantqp.velocity.backends import Backend, backend_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.guard import Guard, guard_of
from invariantqp.velocity.limits import LimitRows, ToolSpeed
from invariantqp.velocity.reasons import Code, Reason, read
from invariantqp.velocity.solution import Status, VelocitySolution, with_trouble

if TYPE_CHECKING:
    from invariantqp.engine import Loop

# Damping over the measure's length, the arm's reach, beside which joint twists count for nothing: for 1e-5, squared.
OF_JOINTS = 1000.0
# So often at most an answer is made again that does not keep a limit to its end. Measured: a UR5 beside a box, ticks of
# 10 ms, comes as near as 19.61 mm of 20 with 1, 19.72 with 2, 19.90 with 4.
AGAIN = 4
# In which a posture may bring joints to full speed [s]. Measured: the largest acceleration on 45 singular paths of
# seven-joint arms at 100 Hz, as a share of five times that of damped least squares and 10 rad/s^2, and how many of 180
# tight tasks a QP dominates: 4.1 and 9 without it, 1.5 and 7 with .1 s, 1.2 and 8 with .2, .8 and 11 with .5.
POSTURE_TIME = 0.2


class Observed(NamedTuple):
    """One tick."""

    positions: Array  # (m,) checked joint positions, as measured
    there: Array  # (m,) where the joints are when the command of this tick acts
    sighting: Sighting  # the robot's state there
    target: Any  # as the robot returned it
    root: Array  # (6, 6) of the measure
    before: Array  # (m,) the joint velocity before
    memory: Memory  # with what the joints did since the tick before


class LegacyLoop:
    """Task-space velocity control of one arm; `step` is one tick. One controller drives one arm, in one thread.

    Its attributes do not change: make another one instead. A copy, shallow or deep, is a loop of its own.

    Attributes:
        robot, dt, gain, delay: as given.
        law: form, damping, guard, joint metric and solver, fixed for the loop.
        measure: the point and length by which twists are measured.
        posture_gain: [1/s], 0 where the null space has no posture.
        exact: what is met exactly.
        row_rank: how many independent rows of it the arm can keep in its best state; None is all.
        box: position and velocity limits.
        braking: the same with acceleration limits, or None.
        tool_speed: the speed limit of a point of the tool, or None.
        joint_rows: limits on combinations of joint velocities, or None.
        turns: (m,) whole turns of continuous joints, whose positions are compared modulo these; 0 of other joints.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        dt: float,
        gain: float | None = None,
        form: Form | CarriedMetric | float | None = None,
        damping: Damping | PaperLambda | float | None = None,
        guard: Guard | bool = True,
        posture: ArrayLike | bool = True,
        posture_gain: float = POSTURE_GAIN,
        joint_metric: ArrayLike | None = None,
        backend: Backend | str | None = None,
        exact: Exact
        | ExactRows
        | Sequence[Exact | ExactRows | Literal["position"]]
        | Literal["position"]
        | None = None,
        point: ArrayLike | Literal["own"] | None = None,
        length: float | None = None,
        acceleration_limit: ArrayLike | None = None,
        delay: float = 0.0,
        position_margin: float = 0.0,
        tool_speed: ToolSpeed | float | None = None,
        rows: Rows | None = None,
        limits: Sequence[AnyLimit] = (),
        far_outside: Literal["hold", "return"] = "hold",
        engine: Engine = "compiled",
    ) -> None:
        """Make the loop's fixed part; arguments, errors and warnings are `Controller`'s, but for two.

        `damping` is lambda, or a policy of `legacy.damping`; None is `Adaptive()`. `engine` is "compiled" for the
        compiled core where it is installed and has this loop, or "python" for the definition in Python alone, which
        answers the same later.
        """
        by = arrays.choice(engine, "engine", ENGINES)
        robot = require_robot(robot)
        self.robot = robot
        m = len(robot.names)
        self.dt: float = arrays.number(dt, "dt", "a tick in seconds", positive=True)
        self.delay: float = arrays.not_negative(delay, "delay", "a dead time in seconds")
        question_times(self.dt, self.delay)
        self.gain: float = tracking_gain(gain, self.dt, self.delay)
        if gain is not None:
            question_gain(self.gain, self.dt)
        self.exact: tuple[Exact, ...] = demands_of(exact)
        self.row_rank: int | None = legacy_rank(self.exact, robot)
        mid = middle(robot)
        self._count = m
        seen = robot.sight(mid, robot.target(robot.pose(mid)))  # also loads what the first tick needs
        tip = np.asarray(robot.pose(mid)[:3, 3])
        chosen = form_of(form)
        carried = chosen if isinstance(chosen, CarriedMetric) else None
        anchor = next((d.point for d in self.exact if isinstance(d, ExactPoint)), None) if point is None else point
        self.measure: ToolMeasure = ToolMeasure(robot, anchor, length, carried)
        self.law: VelocityLaw = VelocityLaw(
            form=None if isinstance(chosen, CarriedMetric) else chosen,
            damping=damping_of(damping, limited=bool(np.isfinite(robot.velocity_limit).all())),
            guard=guard_of(guard),
            metric=metric_of(joint_metric, seen.J, tip, self.measure.length),
            backend=backend_of("daqp" if backend is None else backend),
            dt=self.dt + self.delay,
            engine=by,
        )
        self._posture, self._pull = posture_of(posture, posture_gain, robot)
        self.posture_gain: float = float(self._pull.max())
        self._slack = SLACK * min(self.gain, SLACK_GAIN) * self.measure.radian
        told = limits_by_name(robot, acceleration_limit, position_margin, tool_speed, rows, limits)
        self._limits = LoopLimits.of(loop_of(robot, self.dt, self.delay), told, far_outside, seen.J, tip)
        refuse(self.wrong(self._posture), "posture")
        self.box, self.braking, self.tool_speed, self.joint_rows = self._limits[:4]
        self._brakes, self._late = self._limits.loop.acceleration, ticks_late(self.delay, self.dt)
        fastest = self.box.velocity_limit
        self._fastest = np.where(np.isfinite(fastest) & (fastest > 0.0), fastest, 1.0)
        self._change = self.dt / POSTURE_TIME * self._fastest
        self.turns: Array = continuous_turns(self.box.position_lower, self.box.position_upper, seen.J)
        self.kept: Array = Memory.at_first(m, self.delay, self.dt).numbers  # from tick to tick
        self._brought = self.law.compiled is not None and self.law.compiled.form == "brought"
        self.varies: bool = self._brought or (self.joint_rows is not None and self.joint_rows.fixed is None)
        self._looks = self.joint_rows is not None and bool(self.joint_rows.does["after"])
        self.compiled: Loop | None = self._compiled()  # for the core; None for a loop that it does not have

    def __setattr__(self, name: str, value: Any) -> None:
        if name[0] != "_" and "compiled" in self.__dict__:  # the core has its own copy
            raise AttributeError(f"{name} of a controller does not change; make another one")
        object.__setattr__(self, name, value)

    def __copy__(self) -> LegacyLoop:
        return deepcopy(self)  # solvers and limits keep state between ticks

    def _compiled(self) -> Loop | None:
        return compiled_loop(
            self.robot,
            self.law,
            self.measure,
            self._limits,
            self.exact,
            gain=self.gain,
            posture=self._posture if self._pull.any() else None,
            pull=self._pull,
            change=self._change,
            delay=self.delay,
            slack=self._slack,
            row_rank=-1 if self.row_rank is None else self.row_rank,
            turns=self.turns,
            rise=0.0,
            brakes=self._brakes,
        )

    def by_engine(self, engine: Engine) -> LegacyLoop:
        """A copy of the loop as it is now, computed by another engine, as in `Controller`."""
        law = replace(self.law, engine=arrays.choice(engine, "engine", ENGINES))
        return self._but(law=law)

    def _but(self, **fields: Any) -> LegacyLoop:
        """A loop of its own with other fields."""
        other = deepcopy(self)
        vars(other).update(fields)
        vars(other)["compiled"] = LegacyLoop._compiled(other)
        return other

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
        """One tick: the joint velocity to command until the next, as in `Controller.step`."""
        now = self._limits.changed(speed, velocity_limit, tool_speed, limits)
        core = None if target is None else self.compiled
        if core is None or now is not None or self.varies:
            self._begin(q, now)
            found = None if core is None else self._by_core(core, q, target, feedforward, velocity, now)
        else:
            found = compiled_tick(core, self.kept, q, target, feedforward, velocity)
        if found is not None:
            solution, troubles = found
            return solution if troubles is None else self.said(solution, troubles)
        positions, target = arrays.vector(q, self._count, "q"), self.robot.target(target)
        memory = self._observed(positions)
        before = memory.now(velocity)
        there = positions + self.dt * memory.in_flight
        sighting = self.robot.sight(there, target)
        turn = same_turn(sighting.error, memory.turn)
        ahead = np.zeros(6) if feedforward is None else arrays.vector(feedforward, 6, "feedforward")
        led = ahead if now is None else now.speed * ahead
        error = turn + self.delay * led  # the target, too, is on by then
        s = tracking_twist(error, self.gain, feedforward)
        J, root = sighting.J, self.measure.root_for(sighting.J, sighting.pose)
        share, braked = 1.0, None
        gain = self.gain if now is None else now.speed * self.gain
        if self.braking is not None and gain > 0.0:
            slack = SLACK * self.measure.radian
            braked = approach(self.law, self.braking, gain, slack, J, root, error, led, before)
        if braked is not None:
            share = braked.share
            s -= (1.0 - share) * self.gain * error
        state = Observed(positions, there, sighting, target, root, before, memory)
        if self.wrong(positions):
            return self._tick(state, s, share, ahead)
        self.near(self.robot.points(sighting, target, np.zeros(3))[1], "target")
        state = state._replace(memory=memory._replace(turn=turn[:3]))
        return self._tick(state, s, share, ahead, braked=braked, now=now)

    def follow(
        self,
        q: ArrayLike,
        twist: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        at: Literal["tool", "base"] = "tool",
        rows: ExactRows | None = None,
        sighting: Sighting | None = None,
        measured_at: ArrayLike | None = None,
        posture: ArrayLike | None = None,
        speed: float = 1.0,
        velocity_limit: ArrayLike | None = None,
        tool_speed: float | None = None,
        limits: Sequence[AnyLimit] = (),
    ) -> VelocitySolution:
        """One tick for a twist of the tool instead of a target, as in `Controller.follow`."""
        now = self._limits.changed(speed, velocity_limit, tool_speed, limits)
        if self.varies or now is not None:
            self._begin(q, now)
        own = rows is None and sighting is None and measured_at is None
        core = self.compiled if own else None
        other: dict[str, Any] = {} if posture is None else {"posture": posture}
        if not isinstance(at, str):
            raise BadInput("at", excerpt(at), "'tool' or 'base'", "A point to measure at is measured_at.")
        if arrays.choice(at, "at", ("tool", "base")) == "base":
            other["at_base"] = True
        found = None if core is None else self._by_core(core, q, None, twist, velocity, now, **other)
        if found is not None:
            return self.said(*found)
        positions = arrays.vector(q, self._count, "q")
        s = sizes.not_too_fast(arrays.twist(twist))
        if rows is not None:
            require_rows(rows, self._count)
        where = None if measured_at is None else arrays.vector(measured_at, 3, "measured_at")
        free = None if posture is None else arrays.vector(posture, self._count, "posture")
        state = self._at_rest(positions, sighting, velocity, where)
        if at == "tool":
            tool = self.robot.points(state.sighting, state.target, np.zeros(3))[0]
            s = np.concatenate((s[:3], s[3:] + np.cross(tool, s[:3])))
        return self._tick(state, s, None, s, rows, posture=free, now=now)

    def rest(
        self, q: ArrayLike, reason: str, velocity: ArrayLike | None = None, sighting: Sighting | None = None
    ) -> VelocitySolution:
        """One tick of standing still, as in `Controller.rest`."""
        positions = arrays.vector(q, self._count, "q")
        if not isinstance(reason, str):
            raise BadInput("reason", excerpt(reason), "a text")
        self._begin(positions, None)
        state = self._at_rest(positions, sighting, velocity)
        return self._tick(state, np.zeros(6), None, np.zeros(6), stand=Reason(Code.TOLD, words=reason))

    def _begin(self, q: ArrayLike, now: Changes | None) -> None:
        """A tick of this loop begins at measured joint positions (m,), for its limits and those of this tick."""
        if self.joint_rows is not None:
            self.joint_rows.begin(q)
        if now is not None:
            now.joint_rows.begin(q)

    def _by_core(
        self,
        core: Loop,
        q: ArrayLike,
        target: Any,
        feedforward: ArrayLike | None,
        velocity: ArrayLike | None,
        now: Changes | None,
        **other: Any,
    ) -> tuple[Any, ...] | None:
        """A tick by the core, for `said`, given what Python computes in each; None where Python has to answer."""
        changes = {} if now is None else now.for_core(self._limits.loop)
        if changes is None:
            return None
        other |= changes
        there = rows = None
        if self.varies or (now is not None and now.joint_rows):
            state = acts_at(core, self.kept, q)
            if state is None:
                return None
            there, before = state
            before = before if velocity is None else arrays.vector(velocity, self._count, "velocity")
            rows, trouble = self._limits.rows(there, before, now)
            if trouble is not None:
                return None
            if self.law.form is not None and self._brought:
                root = self._at_rest(arrays.vector(q, self._count, "q"), None, velocity).root
                other["brought"] = np.asarray(self.law.form.matrix(np.asarray(np.linalg.inv(root))), np.float64)
        tick = partial(compiled_tick, core, self.kept, q, target, feedforward, velocity, **other)
        return tick() if there is None else self._by_rows(tick, there, rows, now)

    def _by_rows(
        self, tick: Callable[..., tuple[Any, ...] | None], there: Array, rows: LimitRows | None, now: Changes | None
    ) -> tuple[Any, ...] | None:
        """A tick by the core with rows at joint positions (m,), and more where these do not keep to its end."""
        looks = rows is not None and (self._looks or now is not None)
        kept = self.kept.copy() if looks else None
        found = tick() if rows is None else tick(G=rows.C, least=rows.lower, most=rows.upper, row_names=rows.names)
        for _ in range(0 if kept is None else AGAIN):
            more = None if found is None else self._limits.after(there, found[0].velocity, rows, now)
            if more is None:
                break
            rows, self.kept[:] = more, kept
            found = tick(G=rows.C, least=rows.lower, most=rows.upper, row_names=rows.names)
        return None if found is None else (self._limits.with_broken(found[0], now), found[1])

    def said(self, solution: VelocitySolution, troubles: bytes | None) -> VelocitySolution:
        """The solution of a tick by the core, with what of joints is to be said beside it."""
        return solution if troubles is None else self._limits.with_troubles(solution, read(troubles))

    @property
    def fastest_gain(self) -> float:
        """The larger of the gains at which targets and position limits are approached [1/s]."""
        return max(self.gain, self.box.rate)

    @property
    def memory(self) -> Memory:
        """What the loop keeps from tick to tick, as it is now."""
        return Memory.of(self.kept, self._count, self._late)

    def _observed(self, q: Array) -> Memory:
        """The memory at measured joint positions q (m,), with what the joints did since the tick before."""
        return self.memory.observed(q, self.turns, self.dt, units(self.box.velocity_limit))

    def unwrapped(self, q: ArrayLike) -> Array:
        """(m,) measured joint positions, those of continuous joints by whole turns near those of the tick before.

        Args:
            q: (m,) [rad, length].
        """
        positions, last = arrays.vector(q, self._count, "q"), self.kept[HEADER : HEADER + self._count]
        if np.isnan(last).any():
            return positions
        return np.asarray(unwrapped(last, positions[None], self.turns)[0])

    def _at_rest(
        self, q: Array, sighting: Sighting | None, velocity: ArrayLike | None, at: Array | None = None
    ) -> Observed:
        """The tick of an arm whose target is where its tool is now, measured at a point; `sighting` as in `follow`."""
        memory, robot = self._observed(q), self.robot
        there = q + self.dt * memory.in_flight
        if sighting is None:
            sighting = robot.sight(there, robot.target(robot.pose(there)))
        elif not isinstance(sighting, Sighting):
            raise BadInput("sighting", excerpt(sighting), "what robot.sight returned at q")
        root = self.measure.root_for(sighting.J, sighting.pose, at)
        return Observed(q, there, sighting, sighting.pose, root, memory.now(velocity), memory)

    def wrong(self, q: Array) -> Reason | None:
        """Why joint positions (m,) cannot be true, None where they may be or `far_outside` is "return"."""
        return self._limits.wrong(q)

    def believed(self, q: ArrayLike, argument: str = "q") -> Array:
        """Joint positions (m,) that can be true; errors name the argument.

        Raises:
            BadInput: NaN, a wrong shape, or positions for which a tick is held.
        """
        positions = arrays.vector(q, self._count, argument)
        refuse(self.wrong(positions), argument)
        return positions

    def near(self, places: Array, argument: str) -> None:
        """Refuse places (..., 3) of poses for which a tick is refused, as far away as those in millimetres are.

        Raises:
            BadInput: by the argument's name.
        """
        self._limits.near(places, argument)

    def posture_pull(self, q: Array) -> Array | None:
        """(m,) the joint velocity wanted where a twist leaves joints free; None is zero."""
        return joint_displacement(q, self._posture, self.turns) * self._pull if self.posture_gain else None

    def _exact(
        self, state: Observed, share: float | None, ahead: Array, more: ExactRows | None, now: Changes | None
    ) -> ExactRows | None:
        """What is met exactly, at a share of the gain, and `more`; with no share, for `ahead` alone."""
        if not self.exact:
            return more
        gain = 0.0 if share is None else share * self.gain
        ahead = (1.0 + gain * self.delay * (1.0 if now is None else now.speed)) * ahead
        return rows_of(self.exact, View(self.robot, state.sighting, state.target, gain, ahead), more)

    def _tick(
        self,
        state: Observed,
        s: Array,
        share: float | None,
        ahead: Array,
        more: ExactRows | None = None,
        stand: Reason | None = None,
        posture: Array | None = None,
        *,
        braked: Approach | None = None,
        now: Changes | None = None,
    ) -> VelocitySolution:
        """The velocity for the twist s, or at rest if told to `stand`.

        What of s is not `ahead` chases the target, at a share of the gain and `braked`; None is a twist by itself.
        """
        positions, there, sighting, target, root, before, memory = state
        wrong = self.wrong(positions)
        if wrong:
            return self._halted(state, s, wrong)
        fastest = self._fastest if posture is None else None
        posture = self.posture_pull(there) if posture is None else posture
        limits = self._limits.at(sighting, target, there, before, now)
        stand = limits.trouble or (Reason(Code.STOPPED) if now is not None and now.speed == 0.0 else stand)
        exact, chase = self._exact(state, share, ahead, more, now), None
        if share is not None:
            still = self._exact(state, None, ahead, more, now)
            chase = Chase(
                ahead, None if still is None else still.b, *limits.placed, self._slack, self.measure.carried is None
            )
        demand = Demand(
            sighting.J,
            s,
            root,
            limits.lower,
            limits.upper,
            exact,
            posture,
            limits.rows,
            limits.cone,
            self.row_rank if more is None else None,
            chase,
            fastest,
            memory.commands[0] if fastest is not None else None,
            self._change,
            self._held(before) if share is None or limits.rows is not None else 0.0,
        )
        law = self.law
        if now is not None and now.speed not in (0.0, 1.0):
            law, demand = law.slowed(now.speed), demand.slowed(now.speed)
        within = demand if braked is None else braked.within(demand)
        solution = self._solved(law, within) if stand is None else standing(law, demand, (stand,))
        rows = limits.rows
        for _ in range(AGAIN if stand is None else 0):
            rows = self._limits.after(there, solution.velocity, rows, now)
            if rows is None:
                break
            solution = self._solved(law, demand._replace(rows=rows))
        self._remember(memory, positions, solution.velocity)
        solution = self._limits.told(self._limits.with_broken(solution, now), positions, limits.strained)
        trouble = memory.states.trouble(self.dt, self.gain, self.fastest_gain, chases=share is not None)
        if trouble is not None:
            solution = with_trouble(solution, (trouble,))
        return solution._replace(joint_names=self.robot.names)

    def _solved(self, law: VelocityLaw, demand: Demand) -> VelocitySolution:
        """The joint velocity for the demand of a tick."""
        return solve(law, demand)

    def _remember(self, memory: Memory, positions: Array, command: Array) -> None:
        """A tick at joint positions (m,), NaN where they are not known, gave a command (m,)."""
        self.kept[:] = memory.after(positions, command).numbers

    def _held(self, before: Array) -> float:
        """How long a velocity is held beyond the law's dt [s], until accelerations let joints have another.

        Their rise, and the way of joints that brake over their speed. It counts for a twist by itself and beside rows
        of limits; a chase without these keeps room to brake instead (`approach`).
        """
        return 0.5 * float(np.abs(before / self._brakes).max()) if self.law.dt > 0.0 else 0.0

    def _halted(self, state: Observed, s: Array, reason: Reason) -> VelocitySolution:
        """Standing still wherever the joints may be, or coming to rest as fast as their accelerations allow."""
        x, nowhere = np.zeros(self._count), np.full(self._count, np.nan)
        if self.braking is not None:
            x = np.sign(state.before) * np.maximum(np.abs(state.before) - self.dt * self.braking.acceleration, 0.0)
        self._remember(state.memory, nowhere, x)
        residual = s - state.sighting.J.dot(x)
        return VelocitySolution(x, "hold", Status.HELD, (reason,), (), residual, 0.0, 0.0, 0.0, "")


def legacy_rank(demands: tuple[Exact, ...], robot: Robot) -> int | None:
    """How many independent rows the arm can keep in its best state; None where that is all of them."""
    if not demands:
        return None
    mid = middle(robot)
    target = robot.target(robot.pose(mid))
    rows = rows_of(demands, View(robot, robot.sight(mid, target), target, 1.0, np.zeros(6)))
    best = row_rank(demands, robot)
    return None if best == len(rows.A) else best
