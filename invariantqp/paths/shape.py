"""A path whose shape is kept: the joint motion along it, driven by a clock that is slower where it has to be.

    setting out    to the path's start, by the law of the loop, and looking along the path: a joint motion (`ahead`)
    driving        that motion as soon as limits allow (`plan`), by a clock: pauses, turns, overrides change its rate

The clock goes backward only where an override says so, so a path ends. It waits for joints that are not where
they were sent.
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
from invariantqp.paths.ahead import OFF_PATH, SHORTEST, JointPath
from invariantqp.paths.curve import SLOW, GivenPath, given_path
from invariantqp.paths.fit import REACHED
from invariantqp.paths.plan import ON_TIME, PathPlan, plan_of
from invariantqp.paths.reference import Clock, Clocked
from invariantqp.paths.solution import FollowerSolution
from invariantqp.paths.task_error import TaskError, task_error
from invariantqp.paths.time_law import JointLimits, usual
from invariantqp.velocity.solution import Status

# Look-ahead steps for each second of ticks, at least one a tick: a step takes a third of a millisecond or so.
STEPS = 1500.0
# A tool on its way to the path whose joints rest for this long [s], its distance falling at less than this share of
# the gain, does not get there.
PATIENCE, STUCK = 1.0, 0.1
# The end is reached within the shortest step; what blocks it within this share of the path: at the edge of its reach an
# arm moves much for little. In contact the tool is there as it has reached a pose, along S.
STOPPED = 2e-5
# A tool farther off its path than this, relative to the measure's length, has been pushed.
PUSHED = 0.02
# What rules a tick where limits do not.
OVERRIDDEN, ASTRAY, PAUSE, TURN = "the override", "the arm is off its path", "a pause", "the turn"
ON_THE_WAY, ON_THE_WAY_BACK = (
    "on the way to the path's start",
    "off the path, pushed or later than told (delay=), on the way back",
)
SETTLING, ENDED, START = "settling", "the path's end", "the start"
# Looked up once: an attribute of an enum takes longer than the rest of what is told.
MOVING, SLOWED = Status.MOVING, Status.SLOWED


class Shape:
    """A path to be driven, and what is known of it.

    Attributes:
        given: the path.
        plan: the joint motion along it, None before it is found.
        motion: the same by the clock, None before it is driven.
        back: whether it is to be driven backward.
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
        """Fit the path; all but `joint_jerk` (m,), inf for no limit, is as in `PathFollower`."""
        self._loop = loop
        self._rate = None if rate is None else arrays.number(rate, "rate", "a rate in 1/s", positive=True)
        self._along = [
            inf if x is None else arrays.number(x, name, f"a {name}", positive=True)
            for x, name in ((acceleration, "acceleration"), (jerk, "jerk"))
        ]
        self._jerk = joint_jerk
        self._stops = arrays.choice(blocked, "blocked", ("stop", "leave")) == "stop"
        self._length: float = loop.measure.length
        self._tolerance = OFF_PATH * self._length
        if tolerance is not None:
            self._tolerance = arrays.number(tolerance, "tolerance", "a distance", positive=True)
        timed = rate is not None
        self.given: GivenPath = given_path(loop.robot, loop.measure, path, end, times, timed=timed, corners=corners)
        self._goal = self.given.curve.target(loop.robot, 0.0)
        self._search: JointPath | None = None
        self._share = 1.0  # the largest override so far: the plan is for that many times the rate
        self.plan: PathPlan | None = None
        self.motion: Clocked | None = None
        self.back = False
        m = len(joint_jerk)
        none = np.full(m + 1, inf)
        speed = np.append(loop.box.velocity_limit, inf)
        acceleration_of = (
            none if loop.acceleration_limit is None else np.append(loop.acceleration_limit, self._along[0])
        )
        # Of the joints and, last, the place; its own positions are in range.
        self._limits = JointLimits(-none, none, speed, acceleration_of, np.append(joint_jerk, self._along[1]), loop.dt)
        self._few = len(loop.robot.names) < self.given.curve.size and not loop.exact
        self._off = self._stood = 0.0  # on the way to the path: how far off it is, and for how long it gets no nearer
        self._ticks = 0  # since it set out
        self._usual = -inf  # up to which place all that is to be told is told by the core; none where a place is left

    # Setting out

    def prepare(self, q: Array) -> None:
        """Find the joint motion from joint positions (m,) near the path's start."""
        self._search = self.plan = None
        while self.plan is None:
            self.look_on(q)

    def set_out(self, q: Array, before: Array, share: float) -> FollowerSolution:
        """A tick of the way to the path's start at a share of the speed, and of looking along it."""
        loop, dt = self._loop, self._loop.dt
        off = task_error(loop, q, self._goal).off
        if self._search is None and off > OFF_PATH * self._length:
            answer = loop.step(q, self._goal, velocity=before, speed=share)
            still = self._stands(answer.velocity)
            if self._stops or not still:  # a path that may be left may start out of reach
                stuck = still and share > 0.0 and off > (1.0 - STUCK * loop.gain * dt) * self._off
                self._off, self._stood = off, self._stood + dt if stuck else 0.0
                lasts = self._stood >= PATIENCE
                why = f"the arm comes no closer than {off:.3g} to the path" if lasts else ON_THE_WAY
                status = Status.BLOCKED if lasts else Status.WAITING
                return self._waiting(answer.velocity, status, "; ".join(filter(None, (why, answer.reason))), off)
        answer = loop.rest(q, "", before)
        self.look_on(q)
        return self._waiting(answer.velocity, Status.WAITING, "looking along the path", off)

    def look_on(self, q: Array) -> None:
        """Look a little farther along the path, from joint positions (m,) near its start; make the plan at its end."""
        if self._search is None:
            self._search = JointPath(
                self._loop, self.given.curve, q, rate=self._rate, mean=self.given.slow / SLOW, stops=self._stops
            )
        for _ in range(max(round(STEPS * self._loop.dt), 1)):
            if self._search.done:
                self.plan = self._planned(self._search)
                return
            self._search.extend()

    def on_the_way(self, q: Array, command: Array) -> FollowerSolution:
        """The solution on the way to the path's start, at q (m,)."""
        return self._waiting(command, Status.WAITING, ON_THE_WAY, task_error(self._loop, q, self._goal).off)

    def _waiting(self, command: Array, status: Status, reason: str, off: float) -> FollowerSolution:
        return FollowerSolution(command, status, reason, (self.given.place(0.0), 0.0, 0.0), lambda: off, START)

    def _planned(self, search: JointPath) -> PathPlan:
        """The plan of what was found."""
        rate = inf if self._rate is None else self._share * self._rate
        along = (rate, self._along[0], self._along[1])
        plan = plan_of(self._loop, self.given.curve, search.knots, search.blocked, along=along, jerk=self._jerk)
        near = (STOPPED if plan.blocked else SHORTEST) * self.given.curve.end
        self._usual = plan.end - near if (plan.off <= OFF_PATH * self._length).all() else -inf
        return plan

    # Driving

    @property
    def driven(self) -> PathPlan:
        """The plan, which there is."""
        if self.plan is None:
            raise BadInput("path", "a path without a plan", "prepare(q)")
        return self.plan

    def begin(self, time: float) -> Clocked:
        """Drive the plan from a time on, at its start and from rest."""
        self._ticks = 0
        self.motion = Clocked(self.driven.motion, Clock(time, 0.0, 0.0, 0.0, 0.0), len(self._jerk))
        return self.motion

    def order(self, time: float, override: float) -> Clocked:
        """The motion from a time on at a share of its speed: its clock goes over to another rate if that changed."""
        motion = self.motion
        if motion is None:
            motion = self.begin(time)
        now = motion.place(time)
        if not 0.0 <= now <= motion.source.end:  # at rest beyond an end, where no time is to be made up
            clock = Clock(time, min(max(now, 0.0), motion.source.end), 0.0, 0.0, 0.0)
            motion = motion._replace(clock=clock)
        if self._rate is not None and override > self._share and self._search is not None:
            motion = self._faster(motion, time, override, self._search)
        share = min(override, 1.0) if self._rate is None else override / self._share
        final = -share if self.back else share
        clock = motion.clock
        if clock.final != final and clock.rate == 0.0 == clock.final and self._sets_out(motion, clock.first):
            motion = motion._replace(clock=Clock(time, clock.first, final, 0.0, final))
        elif clock.final != final:
            motion = motion.turned(time, final, self._limits)
        self.motion = motion
        return motion

    def _faster(self, motion: Clocked, time: float, override: float, search: JointPath) -> Clocked:
        """The motion by a plan for a larger override, at the same place and speed."""
        at, rate, _ = motion.clock.now(time)
        place, speed = motion.source.at(np.array((at,)))[0, :2, -1]
        self._share = override
        self.plan = plan = self._planned(search)
        there = plan.time(float(place))
        most = float(plan.motion.at(np.array((there,)))[0, 1, -1])
        rate *= float(speed) / most if most > 0.0 else 1.0
        return motion._replace(source=plan.motion, clock=Clock(time, there, rate, 0.0, rate))

    def _sets_out(self, motion: Clocked, at: float) -> bool:
        """Whether the motion at a time of its own is so slow that joints can have it in a tick."""
        _, v, a, _ = motion.source.at(np.array((at,)))[0]
        dt, limits = self._loop.dt, self._limits
        return bool((np.abs(v) <= dt * limits.acceleration).all() and (np.abs(a) <= dt * limits.jerk).all())

    def still(self, time: float) -> Clocked:
        """The motion with its clock at rest where it is now."""
        if self.motion is None:
            return self.begin(time)
        self.motion = self.motion._replace(clock=Clock(time, self.motion.place(time), 0.0, 0.0, 0.0))
        return self.motion

    def delayed(self, by: float) -> Clocked:
        """The motion, which is driven, with its clock later by some time [s]."""
        motion = self.motion or self.begin(0.0)
        self.motion = motion._replace(clock=motion.clock._replace(start=motion.clock.start + by))
        return self.motion

    def rate(self, time: float) -> float:
        """Of the clock at a time."""
        return 0.0 if self.motion is None else self.motion.clock.now(time)[1]

    def place(self, time: float) -> float:
        """Where the motion is, by the caller's parameter."""
        return self.given.place(0.0 if self.motion is None else self.motion.last(time))

    def put(self, time: float, place: float) -> None:
        """Set the clock to where the motion is at a place."""
        if self.motion is not None:
            clock = self.motion.clock
            first = clock.first + self.driven.time(place) - clock.now(time)[0]
            self.motion = self.motion._replace(clock=clock._replace(first=first))

    # What is told

    def told(
        self, q: Array, command: Array, time: float, override: float, *, why: str, pressed: float | None = None
    ) -> FollowerSolution:
        """What is told of a tick that ends at a time, its joints at q (m,) when it began.

        `why` says why the clock is to rest, "" where it is not; `pressed` how far off a tool in contact is, along S.
        """
        plan, motion, dt = self.driven, self.motion or self.begin(time), self._loop.dt
        self._ticks += 1
        now, rate, _ = motion.clock.now(time)
        at, before = motion.last(time), motion.last(time - dt)
        where = self._where(before, at, self._ticks)

        def off() -> float:
            return self.across(q, before) if pressed is None else pressed

        blocked = plan.blocked
        if not blocked and plan.off[-1] > OFF_PATH * self._length:
            blocked = f"it is out of reach, by {plan.off[-1]:.3g} [length]"
        near = (STOPPED if blocked else SHORTEST) * self.given.curve.end
        if why or rate < 0.0 or plan.end - at > near:
            status, reason, ruling = self._on_the_way(before, now, rate, why, override)
        elif not self._stands(command):
            status, reason, ruling = Status.MOVING, "", SETTLING
        elif blocked:
            status, reason, ruling = (
                Status.BLOCKED,
                f"the path cannot be had from {where[0]:.6g} on: {blocked}",
                SETTLING,
            )
        elif not (self._arrived(q, before, command) if pressed is None else pressed <= REACHED * self._length):
            status, reason, ruling = Status.MOVING, "", SETTLING
        elif self._few and (across := off()) > self._tolerance:
            status, ruling = Status.BLOCKED, ENDED
            reason = f'it is out of reach, by {across:.3g} [length] (exact="position" would turn the tool instead)'
        else:
            status, reason, ruling = Status.DONE, "", ENDED
        return FollowerSolution(command, status, reason, where, off, ruling)

    @property
    def until(self) -> float:
        """Until when the clock need not be looked at: till the motion is over."""
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
    def usual(self) -> float:
        """Up to which place `told_by_core` tells all there is, while the clock is as it is."""
        forward = self.motion is not None and self.motion.clock.final > 0.0 <= self.motion.clock.rate
        return self._usual if forward and not self.back else -inf

    def told_by_core(self, command: Array, q: Array, before: float, after: float, override: float) -> FollowerSolution:
        """As `told`, of a tick on the way from a place to another that is below `usual`."""
        plan, status = self.driven, SLOWED
        self._ticks += 1
        ruling = plan.ruling[plan.nearest(before)]
        if ruling == ON_TIME:
            status = MOVING
        elif override < 1.0:
            ruling = OVERRIDDEN
        where, across = partial(self._where, before, after, self._ticks), partial(self.across, q, before)
        return FollowerSolution(command, status, "", where, across, ruling)

    def _where(self, before: float, after: float, ticks: int) -> tuple[float, float, float]:
        """Place, how late it is and its speed, after so many ticks, on the way from a place of the curve to another."""
        place, dt = self.given.place(after), self._loop.dt
        late = 0.0 if self._rate is None else ticks * dt - place / self._rate
        return place, late, (place - self.given.place(before)) / dt

    def _on_the_way(self, at: float, now: float, rate: float, why: str, override: float) -> tuple[Status, str, str]:
        """Status, reason and what rules at a place and a time of the motion, its clock at a rate."""
        plan, knot = self.driven, self.driven.nearest(at)
        ruling = plan.ruling[knot]
        if why or (ruling != ON_TIME and override < 1.0):
            ruling = why or OVERRIDDEN
        elif self.back != (rate < 0.0) and rate != 0.0:
            ruling = TURN
        if why == ASTRAY and rate == 0.0:
            return Status.WAITING, ON_THE_WAY_BACK if at > 0.0 else ON_THE_WAY, ruling
        if why == PAUSE and rate == 0.0:
            return Status.PAUSED, "", ruling
        if rate < 0.0 and now <= 0.0 and self.back:
            return Status.PAUSED, "", START
        off, reachable = float(plan.off[knot]), OFF_PATH * self._length
        if off <= reachable:
            return Status.MOVING if ruling == ON_TIME else Status.SLOWED, "", ruling
        if plan.blocked and plan.off[0] > reachable:
            return Status.WAITING, ON_THE_WAY, ruling
        return Status.LEFT, f"the arm is {off:.3g} off the path, which it cannot reach here", ruling

    def _arrived(self, q: Array, at: float, command: Array) -> bool:
        """Whether the tool at q (m,) is at a place in what is wanted, and will be after a command (m,)."""
        way = self.way(q, at)
        moved = way.rows.dot(way.state.J.dot(command))
        return way.off + self._loop.dt * float(np.linalg.norm(moved)) <= self._tolerance

    def way(self, q: Array, at: float) -> TaskError:
        """The way from joint positions (m,) to the path at a place of its curve."""
        return task_error(self._loop, q, self.given.curve.target(self._loop.robot, at))

    def across(self, q: Array, at: float) -> float:
        """How far the tool at q (m,) is off the path near a place, in what is wanted; of few joints in all."""
        way, curve = self.way(q, at), self.given.curve
        if self._few:
            return float(np.linalg.norm(way.root.dot(way.error)))
        off, ahead = way.rows.dot(way.error), way.rows.dot(curve.tangent(at))
        squares = float(ahead.dot(ahead))
        if squares > 0.0:  # the nearest place
            shift = min(max(-float(ahead.dot(off)) / squares, -at), curve.end - at)
            off = off + shift * ahead
        return float(np.linalg.norm(off))

    def is_off(self, q: Array, time: float) -> bool:
        """Whether the tool at q (m,) has been pushed off the path."""
        return self.motion is not None and self.across(q, self.motion.last(time)) > PUSHED * self._length

    def _stands(self, velocity: Array) -> bool:
        """Whether joints at a velocity (m,) count as at rest."""
        return bool((np.abs(velocity) <= SLOW * usual(self._loop.box.velocity_limit)).all())
