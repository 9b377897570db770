"""A path whose shape is kept: its joint motion, and the time scaling by which that is driven.

    approach    to the path's start by the law of the loop; meanwhile the joint path is searched (`joint_path`)
    driving     the joint path in least time (`plan`); a time scaling pauses, reverses and overrides it

The time scaling runs backward only after `reverse`, so a path ends. It waits for joints with a tracking error.
"""

from __future__ import annotations

from functools import partial
from math import inf
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.paths.curve import SLOW_SHARE, ParametrisedPath, parametrised_path
from invariantqp.paths.joint_limits import JointLimits, speed_scale
from invariantqp.paths.joint_path import MIN_STEP, PATH_TOLERANCE, JointPath
from invariantqp.paths.plan import ON_TIME, PathPlan, plan_of
from invariantqp.paths.reference import RetimedMotion, TimeScaling
from invariantqp.paths.solution import FollowerSolution
from invariantqp.paths.task_error import TaskError, task_error
from invariantqp.paths.waypoints import POSE_TOLERANCE
from invariantqp.velocity.solution import Status

# Steps of the search for each second of ticks, at least one a tick: a step takes a third of a millisecond or so.
SEARCH_RATE = 1500.0
# The path's start is out of reach where joints rest for this long [s] while the distance falls at less than this share
# of the gain.
STUCK_TIME, STUCK_SHARE = 1.0, 0.1
# Tolerance of the place where a path is blocked, as a share of the path: there an arm moves much for little. Otherwise
# it is the shortest step.
BLOCKED_TOLERANCE = 2.0 * PATH_TOLERANCE
# A tool farther off its path than this share of the measure's length has been pushed.
PUSHED_TOOL = 0.02
# The ruling of a tick where it is not a limit.
OVERRIDE, OFF_PATH, PAUSE, TURN = "the override", "the arm is off its path", "a pause", "the turn"
ON_THE_WAY, ON_THE_WAY_BACK = (
    "on the way to the path's start",
    "off the path, pushed or with more delay than delay=, on the way back",
)
SETTLING, ENDED, START = "settling", "the path's end", "the start"
# Looked up once: an attribute of an enum takes longer than the rest of the report.
MOVING, SLOWED = Status.MOVING, Status.SLOWED


class PathDrive:
    """A path whose shape is kept.

    Attributes:
        given: the path.
        plan: the joint motion along it, None before it is found.
        motion: the same with its time scaling, None before it is driven.
        back: whether it is driven backward.
    """

    def __init__(
        self,
        loop: Controller,
        path: Any,
        *,
        end: float = 1.0,
        times: ArrayLike | None = None,
        rate: float | None = None,
        acceleration: float | None = None,
        jerk: float | None = None,
        joint_jerk: Array,
        blocked: Literal["stop", "leave"] = "stop",
        tolerance: float | None = None,
        corners: bool = False,
    ) -> None:
        """Fit the path; `joint_jerk` is (m,), inf for no limit, the other options are those of `PathFollower`."""
        self._loop = loop
        self._rate = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        self._along = [
            inf if x is None else arrays.number(x, name, f"a {name}", positive=True)
            for x, name in ((acceleration, "acceleration"), (jerk, "jerk"))
        ]
        self._jerk = joint_jerk
        self._stops = arrays.choice(blocked, "blocked", ("stop", "leave")) == "stop"
        self._length: float = loop.measure.length
        self._tolerance = PATH_TOLERANCE * self._length
        if tolerance is not None:
            self._tolerance = arrays.number(tolerance, "tolerance", "a distance", positive=True)
        timed = rate is not None
        self.given: ParametrisedPath = parametrised_path(
            loop.robot, loop.measure, path, end, times, timed=timed, corners=corners
        )
        self._goal = self.given.curve.target(loop.robot, 0.0)
        self._search: JointPath | None = None
        self._share = 1.0  # the largest override so far: the plan is for that many times the rate
        self.plan: PathPlan | None = None
        self.motion: RetimedMotion | None = None
        self.back = False
        m = len(joint_jerk)
        none = np.full(m + 1, inf)
        speed = np.append(loop.box.velocity_limit, inf)
        acceleration_of = (
            none if loop.acceleration_limit is None else np.append(loop.acceleration_limit, self._along[0])
        )
        # Of the joints and, last, the place; positions are in range.
        self._limits = JointLimits(-none, none, speed, acceleration_of, np.append(joint_jerk, self._along[1]), loop.dt)
        self._few = len(loop.robot.names) < self.given.curve.size and not loop.exact
        self._off = self._stood = 0.0  # distance to the start, and for how long it does not fall
        self._ticks = 0  # since it was begun
        self._plain_until = -inf  # up to which place the engine's fields are the whole report

    @property
    def limits_jerk(self) -> bool:
        """Whether the jerk of the joints is limited."""
        return bool(np.isfinite(self._jerk).all())

    # The approach

    def prepare(self, q: Array) -> None:
        """Find the joint motion from joint positions (m,) near the path's start."""
        self._search = self.plan = None
        while self.plan is None:
            self.extend_search(q)

    def approach_start(self, q: Array, before: Array, share: float) -> FollowerSolution:
        """A tick on the way to the path's start at a share of the speed, then of the search for the joint path."""
        loop, dt = self._loop, self._loop.dt
        off = task_error(loop, q, self._goal).off
        if self._search is None and off > PATH_TOLERANCE * self._length:
            answer = loop.step(q, self._goal, velocity=before, speed=share)
            stopped = self._stands(answer.velocity)
            if self._stops or not stopped:  # a path that may be left may start out of reach
                stuck = stopped and share > 0.0 and off > (1.0 - STUCK_SHARE * loop.gain * dt) * self._off
                self._off, self._stood = off, self._stood + dt if stuck else 0.0
                lasts = self._stood >= STUCK_TIME
                why = f"the arm comes no closer than {off:.3g} to the path" if lasts else ON_THE_WAY
                status = Status.BLOCKED if lasts else Status.WAITING
                return self._waiting(answer.velocity, status, "; ".join(filter(None, (why, answer.reason))), off)
        answer = loop.rest(q, "", before)
        self.extend_search(q)
        return self._waiting(answer.velocity, Status.WAITING, "planning along the path", off)

    def extend_search(self, q: Array) -> None:
        """Search a little farther along the path, from joint positions (m,) near its start; plan at its end."""
        if self._search is None:
            self._search = JointPath(
                self._loop, self.given.curve, q, rate=self._rate, mean=self.given.slow / SLOW_SHARE, stops=self._stops
            )
        for _ in range(max(round(SEARCH_RATE * self._loop.dt), 1)):
            if self._search.done:
                self.plan = self._planned(self._search)
                return
            self._search.extend()

    def approach_solution(self, q: Array, command: Array) -> FollowerSolution:
        """The solution on the way to the path's start, at q (m,)."""
        return self._waiting(command, Status.WAITING, ON_THE_WAY, task_error(self._loop, q, self._goal).off)

    def _waiting(self, command: Array, status: Status, reason: str, off: float) -> FollowerSolution:
        return FollowerSolution(command, status, reason, (self.given.place(0.0), 0.0, 0.0), lambda: off, START)

    def _planned(self, search: JointPath) -> PathPlan:
        """The plan of the joint path."""
        rate = inf if self._rate is None else self._share * self._rate
        along = (rate, self._along[0], self._along[1])
        plan = plan_of(self._loop, self.given.curve, search.knots, search.blocked, along=along, jerk=self._jerk)
        near = (BLOCKED_TOLERANCE if plan.blocked else MIN_STEP) * self.given.curve.end
        self._plain_until = plan.end - near if (plan.off <= PATH_TOLERANCE * self._length).all() else -inf
        return plan

    # Driving

    @property
    def driven(self) -> PathPlan:
        """The plan.

        Raises:
            BadInput: it is not found yet.
        """
        if self.plan is None:
            raise BadInput("path", "a path without a plan", "prepare(q)")
        return self.plan

    def begin(self, time: float) -> RetimedMotion:
        """Drive the plan from a time on, from rest at its start."""
        self._ticks = 0
        self.motion = RetimedMotion(self.driven.motion, TimeScaling(time, 0.0, 0.0, 0.0, 0.0), len(self._jerk))
        return self.motion

    def order(self, time: float, override: float) -> RetimedMotion:
        """The motion from a time on at a share of its speed, to which its time scaling changes."""
        motion = self.motion
        if motion is None:
            motion = self.begin(time)
        now = motion.base_time(time)
        if not 0.0 <= now <= motion.base.end:  # at rest beyond an end: there is no time to make up
            clock = TimeScaling(time, min(max(now, 0.0), motion.base.end), 0.0, 0.0, 0.0)
            motion = motion._replace(clock=clock)
        if self._rate is not None and override > self._share and self._search is not None:
            motion = self._with_override(motion, time, override, self._search)
        share = min(override, 1.0) if self._rate is None else override / self._share
        final = -share if self.back else share
        clock = motion.clock
        if clock.final != final and clock.rate == 0.0 == clock.final and self._sets_out(motion, clock.first):
            motion = motion._replace(clock=TimeScaling(time, clock.first, final, 0.0, final))
        elif clock.final != final:
            motion = motion.with_rate(time, final, self._limits)
        self.motion = motion
        return motion

    def _with_override(self, motion: RetimedMotion, time: float, override: float, search: JointPath) -> RetimedMotion:
        """The motion of a plan for a larger override, at the same place and speed."""
        at, rate, _ = motion.clock.now(time)
        place, speed = motion.base.at(np.array((at,)))[0, :2, -1]
        self._share = override
        self.plan = plan = self._planned(search)
        there = plan.time(float(place))
        most = float(plan.motion.at(np.array((there,)))[0, 1, -1])
        rate *= float(speed) / most if most > 0.0 else 1.0
        return motion._replace(base=plan.motion, clock=TimeScaling(time, there, rate, 0.0, rate))

    def _sets_out(self, motion: RetimedMotion, at: float) -> bool:
        """Whether the motion at a time of its own is so slow that joints reach its speed in a tick."""
        _, v, a, _ = motion.base.at(np.array((at,)))[0]
        dt, limits = self._loop.dt, self._limits
        return bool((np.abs(v) <= dt * limits.acceleration).all() and (np.abs(a) <= dt * limits.jerk).all())

    def stopped(self, time: float) -> RetimedMotion:
        """The motion, stopped where it is."""
        if self.motion is None:
            return self.begin(time)
        self.motion = self.motion._replace(clock=TimeScaling(time, self.motion.base_time(time), 0.0, 0.0, 0.0))
        return self.motion

    def delayed(self, by: float) -> RetimedMotion:
        """The motion, delayed by some time [s]."""
        motion = self.motion or self.begin(0.0)
        self.motion = motion._replace(clock=motion.clock._replace(start=motion.clock.start + by))
        return self.motion

    def rate(self, time: float) -> float:
        """Rate of the time scaling at a time."""
        return 0.0 if self.motion is None else self.motion.clock.now(time)[1]

    def place(self, time: float) -> float:
        """The place of the motion, in the caller's parameter."""
        return self.given.place(0.0 if self.motion is None else self.motion.place(time))

    def set_place(self, time: float, place: float) -> None:
        """Set the time scaling to where the motion is at a place."""
        if self.motion is not None:
            clock = self.motion.clock
            first = clock.first + self.driven.time(place) - clock.now(time)[0]
            self.motion = self.motion._replace(clock=clock._replace(first=first))

    # The report

    def solution(
        self, q: Array, command: Array, time: float, override: float, *, why: str, pressed: float | None = None
    ) -> FollowerSolution:
        """The solution of a tick that ends at a time, with the joints at q (m,) when it began.

        `why` is the reason for which the path waits, or ""; `pressed` the error along S of a tool in contact.
        """
        plan, motion, dt = self.driven, self.motion or self.begin(time), self._loop.dt
        self._ticks += 1
        now, rate, _ = motion.clock.now(time)
        at, before = motion.place(time), motion.place(time - dt)
        where = self._where(before, at, self._ticks)

        def off() -> float:
            return self.across(q, before) if pressed is None else pressed

        blocked = plan.blocked
        if not blocked and plan.off[-1] > PATH_TOLERANCE * self._length:
            blocked = f"it is out of reach, by {plan.off[-1]:.3g} [length]"
        near = (BLOCKED_TOLERANCE if blocked else MIN_STEP) * self.given.curve.end
        if why or rate < 0.0 or plan.end - at > near:
            status, reason, ruling = self._on_the_way(before, now, rate, why, override)
        elif not self._stands(command):
            status, reason, ruling = Status.MOVING, "", SETTLING
        elif blocked:
            status, reason, ruling = (
                Status.BLOCKED,
                f"the path is blocked from {where[0]:.6g} on: {blocked}",
                SETTLING,
            )
        elif not (self._arrived(q, before, command) if pressed is None else pressed <= POSE_TOLERANCE * self._length):
            status, reason, ruling = Status.MOVING, "", SETTLING
        elif self._few and (across := off()) > self._tolerance:
            status, ruling = Status.BLOCKED, ENDED
            reason = f'it is out of reach, by {across:.3g} [length] (exact="position" would turn the tool instead)'
        else:
            status, reason, ruling = Status.DONE, "", ENDED
        return FollowerSolution(command, status, reason, where, off, ruling)

    @property
    def until(self) -> float:
        """When the motion is over [s]."""
        if self.motion is None:
            return -inf
        clock, end = self.motion.clock, self.driven.motion.end
        last = clock.start + clock.duration
        place, rate, _ = clock.now(last)
        if not 0.0 <= place <= end:  # over before the clock is at its rate
            left = end - clock.first if place > end else clock.first
            return float(clock.start + left / max(abs(clock.rate), abs(clock.final)))
        left = end - place if rate > 0.0 else place
        return float(last + left / abs(rate)) if rate else float(last)

    @property
    def plain_until(self) -> float:
        """Up to which place `engine_solution` is the whole report, with this time scaling."""
        forward = self.motion is not None and self.motion.clock.final > 0.0 <= self.motion.clock.rate
        return self._plain_until if forward and not self.back else -inf

    def engine_solution(
        self, command: Array, q: Array, before: float, after: float, override: float
    ) -> FollowerSolution:
        """As `solution`, of a tick from one place to another below `plain_until`."""
        plan, status = self.driven, SLOWED
        self._ticks += 1
        ruling = plan.ruling[plan.nearest(before)]
        if ruling == ON_TIME:
            status = MOVING
        elif override < 1.0:
            ruling = OVERRIDE
        where, across = partial(self._where, before, after, self._ticks), partial(self.across, q, before)
        return FollowerSolution(command, status, "", where, across, ruling)

    def _where(self, before: float, after: float, ticks: int) -> tuple[float, float, float]:
        """Place, how late it is and its speed after so many ticks, the last from one place of the curve to another."""
        place, dt = self.given.place(after), self._loop.dt
        late = 0.0 if self._rate is None else ticks * dt - place / self._rate
        return place, late, (place - self.given.place(before)) / dt

    def _on_the_way(self, at: float, now: float, rate: float, why: str, override: float) -> tuple[Status, str, str]:
        """Status, reason and ruling at a place and a time of the motion, at a rate of the time scaling."""
        plan, knot = self.driven, self.driven.nearest(at)
        ruling = plan.ruling[knot]
        if why or (ruling != ON_TIME and override < 1.0):
            ruling = why or OVERRIDE
        elif self.back != (rate < 0.0) and rate != 0.0:
            ruling = TURN
        if why == OFF_PATH and rate == 0.0:
            return Status.WAITING, ON_THE_WAY_BACK if at > 0.0 else ON_THE_WAY, ruling
        if why == PAUSE and rate == 0.0:
            return Status.PAUSED, "", ruling
        if rate < 0.0 and now <= 0.0 and self.back:
            return Status.PAUSED, "", START
        off, reachable = float(plan.off[knot]), PATH_TOLERANCE * self._length
        if off <= reachable:
            return Status.MOVING if ruling == ON_TIME else Status.SLOWED, "", ruling
        if plan.blocked and plan.off[0] > reachable:
            return Status.WAITING, ON_THE_WAY, ruling
        return Status.LEFT, f"the arm is {off:.3g} off the path, which it cannot reach here", ruling

    def _arrived(self, q: Array, at: float, command: Array) -> bool:
        """Whether the tool at q (m,) is at a place, and will be after a command (m,)."""
        task = self.error(q, at)
        moved = task.rows.dot(task.state.J.dot(command))
        return task.off + self._loop.dt * float(np.linalg.norm(moved)) <= self._tolerance

    def error(self, q: Array, at: float) -> TaskError:
        """The error of joint positions (m,) to the path at a place of its curve."""
        return task_error(self._loop, q, self.given.curve.target(self._loop.robot, at))

    def across(self, q: Array, at: float) -> float:
        """The distance of the tool at q (m,) from the path near a place; of few joints in all directions."""
        task, curve = self.error(q, at), self.given.curve
        if self._few:
            return float(np.linalg.norm(task.root.dot(task.error)))
        off, ahead = task.rows.dot(task.error), task.rows.dot(curve.tangent(at))
        squares = float(ahead.dot(ahead))
        if squares > 0.0:  # the nearest place
            shift = min(max(-float(ahead.dot(off)) / squares, -at), curve.end - at)
            off = off + shift * ahead
        return float(np.linalg.norm(off))

    def is_off(self, q: Array, time: float) -> bool:
        """Whether the tool at q (m,) has been pushed off the path."""
        return self.motion is not None and self.across(q, self.motion.place(time)) > PUSHED_TOOL * self._length

    def _stands(self, velocity: Array) -> bool:
        """Whether joints at a velocity (m,) rest."""
        return bool((np.abs(velocity) <= SLOW_SHARE * speed_scale(self._loop.box.velocity_limit)).all())
