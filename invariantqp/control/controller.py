"""The loop body: measured joint positions and a target in, a joint velocity inside the limits out.

    s = b gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, box(q))

The error twist is taken in the base frame, where it is the same whatever frame the tool has; b slows the approach down
where acceleration limits need room to brake (`approach`).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.approach import same_turn, share_of_gain
from invariantqp.control.changes import STOPPED, Changes, changes_of
from invariantqp.control.compiled import compiled_loop, compiled_tick
from invariantqp.control.convergence import slowness
from invariantqp.control.demands import Exact, ExactPoint, View, demands_of, require_rows, row_rank, rows_of
from invariantqp.control.joint_rows import Rows
from invariantqp.control.loop_limits import Limit, loop_limits
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.memory import HEADER, Memory, ticks_late
from invariantqp.control.observed import Observed, at_rest
from invariantqp.control.posture import POSTURE_GAIN, posture_of
from invariantqp.control.tracking import question_gain, tracking_gain, tracking_twist
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, Sighting, middle, require_robot
from invariantqp.velocity.backends import Backend, backend_of
from invariantqp.velocity.damping import Damping, PaperLambda, damping_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form, form_of
from invariantqp.velocity.law import SLACK, Chase, Demand, Guard, VelocityLaw
from invariantqp.velocity.limits import ToolSpeed
from invariantqp.velocity.problem import guard_of, metric_of
from invariantqp.velocity.solution import Status, VelocitySolution
from invariantqp.velocity.solve import solve, standing


class Controller:
    """Task-space velocity control of one arm; `step` is one tick. One controller drives one arm, in one thread.

    Its attributes do not change: make another one instead. A copy, shallow or deep, is a loop of its own.

    Attributes:
        robot: the arm.
        law: form, damping, guard, joint metric and solver, fixed for the loop.
        measure: the point and length by which twists are measured.
        dt: tick [s].
        gain: [1/s].
        delay: dead time of the robot beyond one tick [s].
        posture_gain: [1/s], 0 where the null space has no posture.
        exact: what is met exactly.
        row_rank: how many independent rows of it the arm can keep in its best state; None is all.
        box: position and velocity limits.
        braking: the same with acceleration limits, or None.
        tool_speed: the speed limit of a point of the tool, or None.
        joint_rows: limits on combinations of joint velocities, or None.
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
        backend: Backend | str = "daqp",
        exact: Exact | ExactRows | Sequence[Exact | ExactRows] | Literal["position"] | None = None,
        point: ArrayLike | Literal["own"] | None = None,
        length: float | None = None,
        acceleration_limit: ArrayLike | None = None,
        delay: float = 0.0,
        position_margin: float = 0.0,
        tool_speed: ToolSpeed | float | None = None,
        rows: Rows | None = None,
        limits: Sequence[Limit] = (),
        far_outside: Literal["hold", "return"] = "hold",
    ) -> None:
        """Make the loop's fixed part.

        Args:
            robot: from `load_robot`, or anything that meets `Robot`.
            dt: tick [s].
            gain: tracking gain [1/s], at most 1/dt; None is 0.1/dt, a tenth of the error in a tick, or less where a
                delay is given.
            form: as in `solve_velocity`; None is least squares at the point.
            damping: as in `solve_velocity`.
            guard: as in `solve_velocity`.
            posture: (m,) joint positions that are kept near where the tool's motion leaves joints free; True is the
                middle of the joint ranges, for arms with more than six joints, False is none. Where the task rests, so
                do the joints.
            posture_gain: how fast the posture is approached while the tool moves [1/s].
            joint_metric: as in `solve_velocity`.
            backend: as in `solve_velocity`.
            exact: what is met exactly while the rest is least squares: "position" for the tool frame's origin, an
                ExactPoint, ExactAxis, ExactPlane, ExactJoints or ExactRows, or several of them.
            point: (3,) in the tool frame, the physical point where accuracy is asked for; None is the point met exactly
                or, without one, the tool frame's origin; "own" is the arm's own point, which its joints move least.
            length: as in `solve_velocity`, by default the arm's reach to the point.
            acceleration_limit: (m,) or one for all joints [rad/s^2, length/s^2], inf where there is none; a joint then
                also keeps room to brake before its position limits, and the tool before its target. None is no limit.
            delay: dead time between a command and its effect on the next measurement, beyond one tick [s].
            position_margin: distance kept from position limits [rad, length].
            tool_speed: the largest speed of a point of the tool [length/s], 0.25 m/s beside a person; a number is the
                limit of the tool frame's origin.
            rows: LimitRows on the joint velocity, or a function of q (m,) that returns them (or None) in every tick.
            limits: more limits, in a list: LimitRows or functions as in `rows`, a ToolSpeed in place of `tool_speed`, a
                Clearance that keeps links from each other and from obstacles, limits and barriers made for Pink from
                `robot.model`, anything with `compute_qp_inequalities(configuration, dt)`. They add to the robot's own
                limits and give way where they contradict these. Reasons number their rows after `rows`, in their
                order, and name a Clearance's bodies. Pink cannot pickle its.
            far_outside: "hold" stands still, "held", where a joint that turns is told to be more than 0.5 rad outside
                its position range, as one in degrees is; "return" moves back from there too.

        Raises:
            BadInput: a dt or gain that is not positive, a gain above 1/dt, something that is not a limit, or an
                argument that `solve_velocity` would refuse.
            UnknownName: no such back end.
            MissingExtra: a limit of Pink's without Pink.

        Warns:
            UserWarning: a gain of at most 1 1/s beside a tick of at most 20 ms, which may be meant as a share of the
                error in a tick.
        """
        self.robot = require_robot(robot)
        m = len(robot.names)
        self.dt: float = arrays.number(dt, "dt", "a tick in seconds", positive=True)
        self.delay: float = arrays.not_negative(delay, "delay", "a dead time in seconds")
        self.gain: float = tracking_gain(gain, self.dt, self.delay)
        if gain is not None:
            question_gain(self.gain, self.dt)
        self.exact: tuple[Exact, ...] = demands_of(exact)
        self.row_rank: int | None = row_rank(self.exact, robot) if self.exact else None
        mid = middle(robot)
        self._count = m
        seen = robot.sight(mid, robot.target(robot.pose(mid)))  # also loads what the first tick needs
        chosen = form_of(form)
        carried = chosen if isinstance(chosen, CarriedMetric) else None
        anchor = next((d.point for d in self.exact if isinstance(d, ExactPoint)), None) if point is None else point
        self.measure: ToolMeasure = ToolMeasure(robot, anchor, length, carried)
        self.law: VelocityLaw = VelocityLaw(
            form=None if isinstance(chosen, CarriedMetric) else chosen,
            damping=damping_of(damping, limited=bool(np.isfinite(robot.velocity_limit).all())),
            guard=guard_of(guard),
            metric=metric_of(joint_metric, seen.J, self.measure.length),
            backend=backend_of(backend),
            dt=self.dt + self.delay,
        )
        self._posture, self._pull = posture_of(posture, posture_gain, robot)
        self.posture_gain: float = float(self._pull.max())
        self._fastest = np.where(np.isfinite(robot.velocity_limit), robot.velocity_limit, 1.0)
        self._slack = SLACK * self.gain * self.measure.radian
        turning = np.array(seen.J[:3].any(axis=0))
        self._limits = loop_limits(
            robot,
            self.dt,
            self.delay,
            acceleration_limit,
            position_margin,
            tool_speed,
            rows,
            limits,
            far_outside,
            turning,
        )
        self.box, self.braking, self.tool_speed, self.joint_rows = self._limits[:4]
        self._slowness = slow = slowness(self.measure.root_for(seen.J, seen.pose).dot(seen.J), robot.velocity_limit)
        self._late = ticks_late(self.delay, self.dt)
        self.kept: Array = Memory.at_first(m, self.delay, self.dt).numbers  # from tick to tick
        self.compiled: Array | None = compiled_loop(  # for the core; None for a loop that it does not have
            robot,
            self.law,
            self.measure,
            self._limits,
            self.gain,
            self._posture,
            self._pull,
            self.delay,
            self._slack,
            slow,
            self.exact,
            self.row_rank,
        )

    def __setattr__(self, name: str, value: Any) -> None:
        if name[0] != "_" and "compiled" in self.__dict__:  # the core has its own copy
            raise AttributeError(f"{name} of a controller does not change; make another Controller")
        object.__setattr__(self, name, value)

    def __copy__(self) -> Controller:
        return deepcopy(self)  # solvers and limits keep state between ticks

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
    ) -> VelocitySolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            target: tool pose to be at, (4, 4) in the base frame, a `pinocchio.SE3`, or what `robot.target` returned.
            feedforward: (6,) twist of the target in the base frame [rad/s; length/s]; None is a target at rest.
            velocity: (m,) joint velocity now [rad/s, length/s], for the acceleration limits; None is the one commanded
                last, zero before the first tick.
            speed: an operator's slider, from 0 to 1: the joints go the same way, `speed` times as fast as they would,
                feedforward and approach alike; 0 stands still. A target that moves on has to move so much slower too.
            velocity_limit: (m,) or one for all joints [rad/s, length/s], in this tick; the lower of it and the arm's.
            tool_speed: the largest speed of the controller's limited point, or of the tool frame's origin, in this tick
                [length/s]; the lower of it and the controller's own. The slider scales limits of
                speed too: they are those at speed=1. Joints that are faster than all this allows slow down as fast as
                their `acceleration_limit` lets them, at once without one.

        Returns:
            VelocitySolution: q + dt velocity is inside the position limits, or on its way back inside.

        Raises:
            BadInput: NaN or wrong shapes; the controller is as it was.
        """
        now = changes_of(speed, velocity_limit, tool_speed, self._count)
        core = None if target is None or now is not None else self.compiled
        found = None if core is None else compiled_tick(core, self.kept, q, target, feedforward, velocity)
        if found is not None:
            answer, more = found
            return self.memory.judged(self.told(answer, q)) if more else answer
        memory = self.memory
        before = memory.now(velocity)
        positions, target = arrays.vector(q, self._count, "q"), self.robot.target(target)
        there = positions + self.dt * memory.in_flight
        sighting = self.robot.sight(there, target)
        turn = same_turn(sighting.error, memory.turn)
        ahead = np.zeros(6) if feedforward is None else arrays.vector(feedforward, 6, "feedforward")
        led = ahead if now is None else now.speed * ahead
        error = turn + self.delay * led  # the target, too, is on by then
        s = tracking_twist(error, self.gain, feedforward)
        root = self.measure.root_for(sighting.J, sighting.pose)
        A = root.dot(sighting.J)
        share = 1.0
        gain = self.gain if now is None else now.speed * self.gain
        if self.braking is not None and gain > 0.0:
            share = share_of_gain(self.law, self.braking, gain, A, root.dot(error))
            s -= (1.0 - share) * self.gain * error
        state = Observed(positions, there, sighting, target, root, before)
        if self.wrong(positions):
            return self._tick(state, s, share, ahead)
        memory = memory.followed(positions, A, self.dt, self._slowness / self.dt)._replace(turn=turn[:3])
        self.kept[:HEADER] = memory.numbers[:HEADER]
        return memory.judged(self._tick(state, s, share, ahead, now=now))

    def follow(
        self,
        q: ArrayLike,
        twist: ArrayLike,
        velocity: ArrayLike | None = None,
        rows: ExactRows | None = None,
        sighting: Sighting | None = None,
        at: ArrayLike | None = None,
        posture: ArrayLike | None = None,
        *,
        calm: bool = True,
        speed: float = 1.0,
        velocity_limit: ArrayLike | None = None,
        tool_speed: float | None = None,
    ) -> VelocitySolution:
        """One tick for a twist of the tool instead of a target; exact demands then follow that twist.

        Args:
            q: (m,) measured joint positions [rad, length].
            twist: (6,) wanted, base frame [rad/s; length/s].
            velocity: as in `step`.
            rows: more exact rows, for this tick alone: parts of the twist, A = K'J and b = K'twist for some K.
            sighting: what `robot.sight` returned at q, if it was called in this tick already.
            at: (3,) in the base frame, the point to measure at in this tick; None is the controller's own.
            posture: (m,) joint velocity wanted where the twist leaves joints free; None is the controller's own.
            calm: False where the joint motion is planned: what damps the chase of a target out of reach is left out.
            speed: as in `step`; exact `rows` are `speed` times as fast too.
            velocity_limit: as in `step`.
            tool_speed: as in `step`.

        Returns:
            VelocitySolution, as from `step`.

        Raises:
            BadInput: NaN, wrong shapes, a twist above 1e12; the controller is as it was.
        """
        now = changes_of(speed, velocity_limit, tool_speed, self._count)
        own = now is None and rows is None and sighting is None and at is None and posture is None and calm is True
        core = self.compiled if own else None
        found = None if core is None else compiled_tick(core, self.kept, q, None, twist, velocity)
        if found is not None:
            answer, more = found
            return self.told(answer, q) if more else answer
        positions = arrays.vector(q, self._count, "q")
        s = sizes.not_too_fast(arrays.twist(twist))
        if rows is not None:
            require_rows(rows, self._count)
        where = None if at is None else arrays.vector(at, 3, "at")
        free = None if posture is None else arrays.vector(posture, self._count, "posture")
        state = self._at_rest(positions, sighting, velocity, where)
        return self._tick(state, s, None, s, rows, posture=free, calm=arrays.flag(calm, "calm"), now=now)

    def rest(
        self, q: ArrayLike, reason: str, velocity: ArrayLike | None = None, sighting: Sighting | None = None
    ) -> VelocitySolution:
        """One tick of standing still; outside its limits, an arm moves back inside.

        Args:
            q: (m,) measured joint positions [rad, length].
            reason: why, in words; the solution repeats it.
            velocity: as in `step`.
            sighting: as in `follow`.

        Raises:
            BadInput: NaN or wrong shapes; the controller is as it was.
        """
        positions = arrays.vector(q, self._count, "q")
        if not isinstance(reason, str):
            raise BadInput("reason", excerpt(reason), "a text")
        state = self._at_rest(positions, sighting, velocity)
        return self._tick(state, np.zeros(6), None, np.zeros(6), stand=reason)

    @property
    def memory(self) -> Memory:
        """What the loop keeps from tick to tick, as it is now."""
        return Memory.of(self.kept, self._count, self._late)

    def _at_rest(
        self, q: Array, sighting: Sighting | None, velocity: ArrayLike | None, at: Array | None = None
    ) -> Observed:
        memory = self.memory
        there = q + self.dt * memory.in_flight
        return at_rest(self.robot, self.measure, q, there, sighting, memory.now(velocity), at)

    def told(self, solution: VelocitySolution, q: ArrayLike) -> VelocitySolution:
        """The solution of a tick that the core answered, its reason with the words that Python has for limits."""
        return self._limits.told(solution, q, self.robot.names)

    def wrong(self, q: Array) -> str:
        """Why joint positions (m,) cannot be true, "" where they may be or `far_outside` is "return"."""
        return self._limits.wrong(q, self.robot.names)

    def believed(self, q: ArrayLike, argument: str = "q") -> Array:
        """Joint positions (m,) that can be true; errors name the argument.

        Raises:
            BadInput: NaN, a wrong shape, or positions for which a tick is held.
        """
        positions = arrays.vector(q, self._count, argument)
        wrong = self.wrong(positions)
        if wrong:
            raise BadInput(
                argument, wrong.partition(" Give")[0], "joint positions in radians, near the position ranges"
            )
        return positions

    def posture_pull(self, q: Array) -> Array | None:
        """(m,) the joint velocity wanted where a twist leaves joints free; None is zero."""
        return (self._posture - q) * self._pull if self.posture_gain else None

    def _rows(
        self, sighting: Sighting, target: Any, gain: float, ahead: Array, more: ExactRows | None
    ) -> ExactRows | None:
        return rows_of(self.exact, View(self.robot, sighting, target, gain, ahead), more) if self.exact else more

    def _tick(
        self,
        state: Observed,
        s: Array,
        share: float | None,
        ahead: Array,
        more: ExactRows | None = None,
        stand: str | None = None,
        posture: Array | None = None,
        *,
        calm: bool = True,
        now: Changes | None = None,
    ) -> VelocitySolution:
        """The velocity for the twist s, or at rest if told to `stand`.

        What of s is not `ahead` chases the target, at a share of the gain; None is a twist by itself.
        """
        positions, there, sighting, target, root, before = state
        wrong = self.wrong(positions)
        if wrong:
            return self._halted(state, s, wrong)
        fastest = self._fastest if posture is None else None
        posture = self.posture_pull(there) if posture is None else posture
        limits = self._limits.at(self.robot, sighting, target, there, before, now)
        stand = limits.trouble or (STOPPED if now is not None and now.speed == 0.0 else stand)
        chase = None
        if share is None:
            exact = self._rows(sighting, target, 0.0, ahead, more)
        else:
            gain = share * self.gain
            exact = self._rows(
                sighting, target, gain, (1.0 + gain * self.delay * (1.0 if now is None else now.speed)) * ahead, more
            )
            rows_ahead = self._rows(sighting, target, 0.0, ahead, more)
            still = None if rows_ahead is None else rows_ahead.b
            chase = Chase(ahead, still, *limits.placed, self._slack, self.measure.carried is None)
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
        )
        law = self.law if calm else self.law.planned
        if now is not None and now.speed not in (0.0, 1.0):
            law, demand = law.slowed(now.speed), demand.slowed(now.speed)
        solution = solve(law, demand) if stand is None else standing(law, demand, stand)
        self.memory.after(positions, solution.velocity).write(self.kept)
        return self._limits.told(solution, positions, self.robot.names, limits.strained)

    def _halted(self, state: Observed, s: Array, reason: str) -> VelocitySolution:
        """Standing still wherever the joints may be, or coming to rest as fast as their accelerations allow."""
        x, nowhere = np.zeros(self._count), np.full(self._count, np.nan)
        if self.braking is not None:
            x = np.sign(state.before) * np.maximum(np.abs(state.before) - self.dt * self.braking.acceleration, 0.0)
        self.memory.after(nowhere, x).write(self.kept)
        residual = s - state.sighting.J.dot(x)
        return VelocitySolution(x, "hold", Status.HELD, reason, (), residual, 0.0, 0.0, 0.0, "")
