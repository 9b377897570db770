"""One driver for what comes in over time: a whole path, action chunks of a policy, a hand's poses, twists.

    points, samples, twists -> a joint motion in stamp time (`reference`) -> a tick inside all limits (`time_law`)

A change of mind is a splice: a new chunk, a pause, the end of a stream, a leap of a hand and a push of the arm all
replace what is followed, from the motion that the arm has now. No tick is taken from which the joints cannot stop.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from copy import deepcopy
from math import nan
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.path_follower import PathFollower
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.paths.fit import REACHED, Given, Solver, sampled
from invariantqp.paths.reference import Points, Reference, Slowed, Source, Stop, Window, smoothed, stopping
from invariantqp.paths.solution import FollowerSolution
from invariantqp.paths.time_law import JointLimits
from invariantqp.paths.twist import TwistLaw
from invariantqp.velocity.solution import Status

# Without a jerk limit of its own a joint reaches its full acceleration in this time [s].
RISE = 0.02
# A splice takes no less than this [s], where no limit asks for more; one that a single sample makes, no less than that.
EASE, EASE_SAMPLE = 0.3, 0.1
# A clock that differs by more than this from the sum of the ticks [s] has jumped.
SKEW = 0.02
# Joints farther from where they were sent than this [rad, length] have been pushed: the motion goes on from there.
DISPLACED = 0.2
# Gain [1/s] towards where joints were sent.
JOINT_GAIN = 5.0
# A function of time is looked ahead so far [s], at places so far apart [s], and again when half of that is driven.
AHEAD, SAMPLING = 1.0, 0.02
# A hand whose joints would be faster than this many times their limits has leapt.
LEAP = 1.01
# Stamps this far [s] from the follower's clock are of another clock.
ANOTHER_CLOCK = 1.0
# Samples that are taken in a tick at most: the newest. Points that are planned through at once.
MOST_WAITING, MOST_POINTS = 8, 96
# Points so far behind the arm, times 1 / cutoff, are kept for smoothing.
BEHIND = 1.0
# An acceleration that differs from the wanted one by less than this share of what jerk changes in a tick is the same.
ROUNDING = 1e-6
# Joint speeds below this share of their limits are rest.
AT_REST = 1e-6


class Follower:
    """Drives the arm of a controller along what comes in over time; `step` is one tick.

    Attributes:
        controller: whose arm, limits, exact demands and measure hold; nobody else may step it.
        jerk: (m,) of the joints [rad/s^3, length/s^3].
        timeout: after how long without a sample or a twist the arm comes to rest [s].
        paused: whether the arm is told to stand still.
    """

    def __init__(
        self,
        loop: Controller,
        *,
        keep: Literal["time", "shape"] = "time",
        rate: float = 1.0,
        jerk: ArrayLike | None = None,
        cutoff: float = 4.0,
        timeout: float = 0.1,
        blocked: Literal["stop", "leave"] = "stop",
        tolerance: float | None = None,
    ) -> None:
        """A follower of nothing yet: the arm stands still.

        Args:
            loop: a controller with an acceleration limit.
            keep: "time": what is over is skipped, points are met when their stamps say (policies, hands); "shape": the
                tool stays on the path through the points and is late where limits make it so, as a `PathFollower`,
                which drives it then.
            rate: how fast stamps are driven where the shape is kept, 1 as they say.
            jerk: (m,) or one for all joints [rad/s^3, length/s^3]; None lets the acceleration rise to its limit in
                20 ms. Where the shape is kept, joints have no jerk limit.
            cutoff: what is faster than this is smoothed away where time is kept [Hz]; inf follows chunks as they are.
            timeout: after how long without a sample or a twist the arm comes to rest [s].
            blocked: where the shape is kept and the arm cannot reach it: "stop" before it, or "leave" it by the least.
            tolerance: how far off a pose is out of reach [length]; None is 1e-4 of the arm's length. Where the shape is
                kept, as in `PathFollower`.

        Raises:
            BadInput: not a Controller, one without an acceleration limit, a number that is not positive, or a jerk
                limit where the shape is kept.
        """
        if not isinstance(loop, Controller):
            raise BadInput("loop", excerpt(loop), "a Controller")
        if loop.braking is None:
            raise BadInput("loop", "one without an acceleration limit", "Controller(acceleration_limit=...)")
        self.controller = loop
        m = len(loop.robot.names)
        acceleration = loop.braking.acceleration
        self.jerk: Array = acceleration / RISE if jerk is None else _jerks(jerk, m)
        self._keep = arrays.choice(keep, "keep", ("time", "shape"))
        if keep == "shape" and jerk is not None:
            raise BadInput(
                "jerk", 'a limit with keep="shape"', "None: there the joints' accelerations are limited alone"
            )
        self._whole_options: dict[str, Any] = {
            "blocked": arrays.choice(blocked, "blocked", ("stop", "leave")),
            "tolerance": tolerance,
        }
        self._rate = arrays.number(rate, "rate", "a share of the stamps' speed", positive=True)
        self._whole: PathFollower | None = None  # a path whose shape is kept
        self.cutoff: float = arrays.number(cutoff, "cutoff", "a frequency in Hz", positive=True, infinite=True)
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        least = REACHED * loop.measure.length
        self._tolerance = least
        if tolerance is not None:
            self._tolerance = arrays.number(tolerance, "tolerance", "a distance", positive=True)
        box = loop.box
        ahead, behind = box.room(np.zeros(m))
        self._limits = JointLimits(-behind, ahead, loop.robot.velocity_limit, acceleration, self.jerk, loop.dt)
        self._solver = Solver(loop, self._tolerance)
        self._twists = TwistLaw(loop)
        self.paused: bool = False
        self._m = m
        self._time = 0.0  # when the next tick begins, by the stamps' clock
        self._sent: deque[Array] = deque(maxlen=round(loop.delay / loop.dt) + 1)
        self._reference: Reference | None = None
        self._q = self._v = self._a = np.zeros(m)  # of the commanded motion, when the next tick begins
        self._source: Source | None = None  # what is wanted; the reference may be at a stop in its place
        self._given: tuple[Given, Array] | None = None  # the points of the source
        self._missed = np.zeros(0)
        self._next: tuple[Given, Array, float] | None = None
        self._function: Callable[[float], Any] | None = None
        self._looked = 0.0
        self._samples: deque[tuple[Any, float | None]] = deque(maxlen=MOST_WAITING)
        self._newest: tuple[Array, Array, float] | None = None  # a sample's point, joints and stamp
        self._shift = 0.0  # of the samples' clock
        self._heard = 0.0
        self._twist: Array | None = None
        self._driven = False  # whether the path whose shape is kept drives
        self._override = 1.0
        self._closed = False
        self._why = "nothing to follow yet"
        self._late = False  # whether the joints cannot be where they are wanted, and catch up

    def __copy__(self) -> Follower:
        return deepcopy(self)  # with a state of its own

    # What comes in

    def follow(self, points: Any, stamps: ArrayLike | None = None, *, at: float | None = None) -> None:
        """Follow points, or a function of time, in place of all that was followed before.

        The arm goes over from the motion it has, with bounded jerk. Of points whose order is mixed up on their way, the
        newest are followed; those that are over already are not.

        Args:
            points: (n, 4, 4) poses in the base frame, (n, m) joint positions, or a function of time [s] that returns
                one pose or one position. Where the shape is kept: poses, two or more.
            stamps: (n,) when each is wanted [s], increasing, by the clock of `step`'s `now`; of a function, none. Where
                the shape is kept they may be left out: the joints then go as fast as their limits let them.
            at: when to go over [s]; None is now.

        Raises:
            BadInput: neither poses nor joints, NaN, no rigid motion, stamps that do not increase; the follower is as it
                was.
        """
        self._open("points")
        when = self._time if at is None else arrays.number(at, "at", "a time in seconds")
        if self._keep == "shape":
            whole = self._whole_path(points, stamps, at)
            self._forget()
            self._halt()
            self._whole = whole
            if self.paused:
                whole.pause()
            return
        if callable(points):
            if stamps is not None:
                raise BadInput("stamps", "stamps for a function", "none: it is a function of time")
            sampled(points, np.array((when,)), self._m)
            self._forget()
            self._function, self._looked = points, when - AHEAD
            return
        given = Given(points, self._m, "points")
        if stamps is None:
            raise BadInput("stamps", "None", f"({len(given)},) times in seconds, one for each point, increasing")
        times = arrays.vector(stamps, len(given), "stamps").copy()
        if not (np.diff(times) > 0.0).all():
            raise BadInput("stamps", "stamps that do not increase", "one for each point, increasing")
        self._forget()
        self._next = given, times, when

    def add(self, point: Any, stamp: float | None = None) -> None:
        """One more point of a stream, as a hand's tracker sends them.

        Args:
            point: (4, 4) pose in the base frame, a `pinocchio.SE3`, or (m,) joint positions.
            stamp: when it was so [s], by the clock of `step`'s `now`; None is now. A sample older than the newest is
                dropped; a clock that is more than a second off is another clock, and time runs on from its stamps.

        Raises:
            BadInput: neither a pose nor joint positions, NaN; the follower is as it was.
        """
        self._open("point")
        if self._keep == "shape":
            raise BadInput("point", "a stream where the shape is kept", 'keep="time", or a whole path by follow()')
        given = Given([getattr(point, "homogeneous", point)], self._m, "point")
        when = None if stamp is None else arrays.number(stamp, "stamp", "a time in seconds")
        if self._next is not None or self._function is not None or self._twist is not None:
            self._forget()
        self._samples.append((given, when))

    def twist(self, v: ArrayLike) -> None:
        """Move the tool at a twist, until the next one or for `timeout`.

        Args:
            v: (6,) in the base frame, angular part first [rad/s; length/s].

        Raises:
            BadInput: NaN, a wrong shape, or a twist beyond any scale.
        """
        self._open("v")
        wanted = sizes.not_too_fast(arrays.twist(v, "v")).copy()
        self._forget()
        self._twist, self._heard = wanted, self._time

    def prepare(self, q: ArrayLike) -> None:
        """Look along a path whose shape is kept, from joint positions (m,) near its start: as `PathFollower.prepare`.

        Raises:
            BadInput: no such path, NaN, a wrong shape, or positions that cannot be true.
        """
        self._kept_shape("prepare").prepare(q)

    def reverse(self) -> None:
        """Drive a path whose shape is kept in the other direction, after coming to rest.

        Raises:
            BadInput: no such path.
        """
        self._kept_shape("reverse").reverse()

    def close(self) -> None:
        """No more comes: where all of it is driven, the arm is "done"."""
        self._closed = True

    def pause(self) -> None:
        """Come to rest, and stay."""
        self.paused = True
        if self._whole is not None:
            self._whole.pause()

    def resume(self) -> None:
        """Go on after a pause: with what is due then or, where the shape is kept, where it was."""
        self.paused = False
        if self._whole is not None:
            self._whole.resume()

    # A tick

    def step(
        self, q: ArrayLike, velocity: ArrayLike | None = None, *, now: float | None = None, override: float = 1.0
    ) -> FollowerSolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            velocity: (m,) joint velocity now, where the arm moves when it is first stepped, or after a push; None is
                rest. Later the one commanded last counts.
            now: the time [s], by the clock of the stamps; None counts ticks.
            override: share of the speed asked for, 0 to 1.

        Returns:
            FollowerSolution: its velocity, and that of the next ticks to a stop, is inside the limits.

        Raises:
            BadInput: NaN, wrong shapes; the follower is as it was.
        """
        loop, dt = self.controller, self.controller.dt
        measured = arrays.vector(q, self._m, "q")
        moving = None if velocity is None else arrays.vector(velocity, self._m, "velocity")
        clock = None if now is None else arrays.number(now, "now", "a time in seconds")
        share = arrays.not_negative(override, "override", "a share of the speed, 0 to 1")
        if share > 1.0:
            raise BadInput("override", f"{share:g}", "a share of the speed, 0 to 1")
        if self._whole is not None and self._at_rest:
            return self._along(self._whole, measured, moving, clock, share)
        wrong = loop.wrong(measured)
        if wrong:
            self._reference = None
            self._time = self._time + dt if clock is None else clock + dt
            # Wherever the joints may be, at rest as soon as their accelerations allow.
            self._v = np.sign(self._v) * np.maximum(np.abs(self._v) - dt * self._limits.acceleration, 0.0)
            return FollowerSolution(self._v.copy(), Status.HELD, str(wrong), nan, nan, lambda: nan)
        reference = self._begin(measured, moving, clock)
        self._take_in(reference, share)
        if self._late and self._twist is None:
            self._late = not reference.splice(reference.source, self._time, self._state, EASE)
        v = self._wanted(reference)
        a = (v - self._v) / dt
        allowed = self._limits.within(self._q, self._v, self._a, a)
        kept = bool((np.abs(allowed - a) <= ROUNDING * self.jerk * dt).all())
        if not kept:
            v, a = self._v + dt * allowed, allowed
        part = self._share(v)
        if part < 1.0:
            v, kept = part * v, False
            a = (v - self._v) / dt
        correction = JOINT_GAIN * (self._sent[0] - measured)
        self._q, self._v, self._a = self._q + dt * v, v, a
        self._time += dt
        if not kept and self._twist is None:
            self._late = True
        lower, upper = loop.box.at(measured)
        return self._reported(reference, np.clip(v + correction, lower, upper))

    @property
    def _state(self) -> Array:
        """(3, m) position, velocity and acceleration of the motion through the ends of the last three ticks."""
        return np.vstack((self._q, self._v + 0.5 * self.controller.dt * self._a, self._a))

    @property
    def _at_rest(self) -> bool:
        """Whether the joints stand, or a path whose shape is kept has taken over."""
        return self._driven or not self._v.any()

    def _whole_path(self, points: Any, stamps: ArrayLike | None, at: float | None) -> PathFollower:
        """A follower of a path whose shape is kept."""
        if callable(points) or at is not None:
            raise BadInput("points", 'a function, or `at`, with keep="shape"', "poses (n, 4, 4)", "Or PathFollower.")
        rate = None if stamps is None else self._rate
        return PathFollower(self.controller, points, times=stamps, rate=rate, **self._whole_options)

    def _kept_shape(self, name: str) -> PathFollower:
        if self._whole is None:
            raise BadInput(name, "no path whose shape is kept", 'follow(poses) with keep="shape"')
        return self._whole

    def _along(
        self, whole: PathFollower, measured: Array, moving: Array | None, clock: float | None, override: float
    ) -> FollowerSolution:
        """A tick along a path whose shape is kept."""
        dt = self.controller.dt
        self._driven = True
        answer = whole.step(measured, moving, override)
        self._time = (self._time if clock is None else clock) + dt
        self._q, self._a, self._v = measured + dt * answer.velocity, np.zeros(self._m), answer.velocity.copy()
        status, reason = answer.status, answer.reason
        if status is Status.SLOWED:
            status, reason = Status.LATE, reason or answer.ruling
        return FollowerSolution(answer.velocity, status, reason, answer.place, answer.lag or 0.0, lambda: answer.across)

    def _motion(self, reference: Reference) -> Array:
        """(3, m) the same, as exactly as it is known."""
        return self._state if self._late else reference.at(np.array((self._time,)))[0, :3]

    def _open(self, argument: str) -> None:
        if self._closed:
            raise BadInput(argument, "more after close()", "a new Follower")

    def _forget(self) -> None:
        """What was to come is replaced."""
        self._next = self._function = None
        self._samples.clear()
        if self._twist is not None or self._whole is not None:
            self._halt()

    def _halt(self) -> None:
        """What is followed is a stop from the motion that the arm has now."""
        self._twist = self._whole = None
        if self._reference is not None or self._driven:
            self._reference = Reference(self._limits, self._q, self._time)
            self._late = not self._reference.splice(
                stopping(self._state, self._time, self._limits), self._time, self._state, 0.0
            )
        self._source = self._given = self._newest = None
        self._driven = False
        self._sent.clear()

    def _begin(self, measured: Array, moving: Array | None, clock: float | None) -> Reference:
        """The reference at the beginning of a tick, made anew where the arm is not where it was sent."""
        reference = self._reference
        if reference is not None:
            if clock is not None and abs(clock - self._time) > SKEW:
                self._leap_to(clock, reference)
            self._sent.append(self._q)
            if float(np.abs(self._sent[0] - measured).max()) <= DISPLACED:
                return reference
            self._why = "pushed off, on the way back"
        elif clock is not None:
            self._heard += clock - self._time
            self._time = clock
        self._q, self._a = np.clip(measured, self._limits.lower, self._limits.upper), np.zeros(self._m)
        speed = self._limits.velocity
        self._v = np.zeros(self._m) if moving is None else np.clip(moving, -speed, speed)
        self._sent.clear()
        self._sent.append(measured)
        self._reference = new = Reference(self._limits, self._q, self._time)
        new.source = stopping(self._state, self._time, self._limits)
        if self._source is not None:  # a path that was left is gone back to
            self._late = not new.splice(self._source, self._time, new.at(np.array((self._time,)))[0, :3], EASE)
        return new

    def _leap_to(self, clock: float, reference: Reference) -> None:
        """The clock says another time than the ticks."""
        state = self._state
        self._heard += clock - self._time
        self._time = clock
        source = reference.source
        if isinstance(source, Stop):
            source = stopping(state, clock, self._limits)
        self._late = not reference.splice(source, clock, state, EASE)

    def _take_in(self, reference: Reference, override: float) -> None:
        """All that came since the last tick, and what is due."""
        now = self._time
        if self._next is not None and now >= self._next[2]:
            given, stamps, _ = self._next
            self._next = None
            self._take_points(given, stamps, smooth=True)
        elif self._function is not None and now >= self._looked + 0.5 * AHEAD:
            stamps = np.arange(now - 8.0 * SAMPLING, now + AHEAD, SAMPLING)
            self._looked = now
            self._take_points(sampled(self._function, stamps, self._m), stamps, smooth=False)
        if self._samples:
            self._take_samples(reference)
        quiet = now - self._heard
        if quiet > self.timeout and isinstance(self._source, Window):
            self._source, self._why = None, f"no sample for {quiet:.2g} s"
        if self._twist is not None and (self.paused or quiet > self.timeout):
            self._why = "paused" if self.paused else f"no twist for {quiet:.2g} s"
            self._twist = np.zeros(6)
        self._choose(reference, 0.0 if self.paused else override)

    def _choose(self, reference: Reference, override: float) -> None:
        """Go over to what is to be followed now: the source, a slower one, or a stop."""
        now, source = self._time, self._source
        stands = isinstance(reference.source, Stop)
        if source is None or override == 0.0:
            if not stands:
                state = self._motion(reference)
                self._late = not reference.splice(stopping(state, now, self._limits), now, state, 0.0)
        elif override == 1.0:
            if reference.source is not source:
                self._aim(reference, source, EASE)
        elif stands or override != self._override:
            place = reference.source.place(now) if isinstance(reference.source, Slowed) else now
            self._aim(reference, Slowed(source, now, place, override), EASE)
        self._override = override

    def _aim(self, reference: Reference, source: Source, ease: float) -> None:
        """Follow a source from now on."""
        now = self._time
        self._late = not reference.splice(source, now, self._motion(reference), ease)

    def _take_points(self, given: Given, stamps: Array, *, smooth: bool) -> None:
        """Points with stamps, from now on."""
        now = self._time
        if stamps[-1] <= now:
            self._why = "the points were over when they came"
            return
        if self._given is not None and stamps[0] < self._given[1][0] and stamps[-1] <= self._given[1][-1]:
            return  # newer points came before these
        kept = stamps > now - (BEHIND / self.cutoff if smooth else AHEAD)
        kept[-min(3, len(kept)) :] = True
        if kept.sum() > MOST_POINTS:  # the rest when half of these are driven
            first = int(kept.argmax())
            self._next = given, stamps, float(stamps[first + MOST_POINTS // 2])
            kept[first + MOST_POINTS :] = False
        given, stamps = given.chosen(kept), stamps[kept]
        near = self._q if not isinstance(self._source, Points) else self._source.at(stamps[:1])[0, 0]
        joints, missed = self._solver.points(given, near, stamps)
        if smooth:
            joints = smoothed(stamps, joints, self.cutoff)
        self._given, self._missed, self._newest = (given, stamps), missed, None
        self._source = Points(stamps, self._inside(joints), self._limits)

    def _take_samples(self, reference: Reference) -> None:
        """Samples of a stream."""
        now = self._time
        while self._samples:
            given, stamp = self._samples.popleft()
            when = now if stamp is None else stamp + self._shift
            if stamp is not None and abs(when - now) > ANOTHER_CLOCK:
                self._shift = now - stamp
                when, self._newest = now, None
            before = self._newest
            gap = before is None or when - before[2] > self.timeout
            if before is not None and when <= before[2]:
                continue
            near = self._q if before is None or gap else before[1]
            last = None if before is None or gap else before[2]
            joints, missed = self._solver.points(given, near, np.array((when,)), last)
            joint = joints[0]
            self._missed, self._heard = missed, now
            self._given = given, np.array((when,))
            self._newest = given, joint, when
            window = self._source
            leap = before is not None and bool(
                (np.abs(joint - before[1]) > LEAP * self._limits.velocity * (when - before[2])).any()
            )
            if not isinstance(window, Window) or gap or leap:
                late = window.transport if isinstance(window, Window) else max(now - when, 0.0)
                self._source = Window(self.cutoff, self.controller.dt, when, joint, late)
                continue
            if reference.source is not window:
                window.add(when, joint, max(now - when, 0.0))
                continue
            state = self._motion(reference)
            window.add(when, joint, max(now - when, 0.0))
            if not self._late:
                reference.ease(window, now, state, EASE_SAMPLE)

    def _inside(self, joints: Array) -> Array:
        return np.clip(joints, self._limits.lower, self._limits.upper)

    def _wanted(self, reference: Reference) -> Array:
        """(m,) the joint velocity that is wanted in this tick."""
        dt = self.controller.dt
        if self._twist is not None:
            return self._twists.velocity(self._q, self._v, self._twist, self._limits)
        if self._late:
            there = reference.at(np.array((self._time + dt,)))[0]
            return self._v + dt * self._limits.catching_up(self._q + dt * self._v, self._v, there)
        return (reference.position(self._time + dt) - self._q) / dt

    def _share(self, v: Array) -> float:
        """The share of joint velocities v (m,) that the loop's tool speed and rows allow."""
        loop, share = self.controller, 1.0
        if loop.tool_speed is None and loop.joint_rows is None:
            return share
        robot = loop.robot
        if loop.tool_speed is not None:
            sighting = robot.sight(self._q, robot.target(robot.pose(self._q)))
            point = np.zeros(3) if loop.tool_speed.point is None else loop.tool_speed.point
            here = robot.points(sighting, robot.target(sighting.pose), point)[0]
            speed = loop.tool_speed.cone(sighting.J, here).speed(v)
            share = min(share, loop.tool_speed.limit / speed if speed > 0.0 else 1.0)
        if loop.joint_rows is not None:
            rows, trouble = loop.joint_rows.at(self._q, self._v)
            if trouble:
                return 0.0
            if rows is not None:
                value = np.asarray(rows.C).dot(v)
                with np.errstate(divide="ignore", invalid="ignore"):
                    most = np.where(value > 0.0, np.asarray(rows.upper) / value, np.asarray(rows.lower) / value)
                most = most[np.isfinite(most)]
                share = min(share, max(float(most.min()), 0.0)) if len(most) else share
        return share

    # What is told

    def _reported(self, reference: Reference, command: Array) -> FollowerSolution:
        """The solution of a tick."""
        place, late = self._time, 0.0
        if isinstance(reference.source, Slowed):
            place = reference.source.place(self._time)
            late = self._time - place
        elif isinstance(self._source, Window):
            late = self._source.late
            place -= late
        q = self._q
        return FollowerSolution(command, *self._status(place), place, late, lambda: self._across(q, place))

    def _status(self, place: float) -> tuple[Status, str]:
        """What is told of a tick at a place, and why."""
        limit = self._limits.velocity
        still = bool((np.abs(self._v) <= AT_REST * np.where(np.isfinite(limit), limit, 1.0)).all())
        if self.paused:
            return (Status.PAUSED if still else Status.MOVING), "paused"
        if self._twist is None and self._source is not None:
            return self._on_the_way(place, still=still)
        if self._twist is not None and (self._twist.any() or not still):
            return Status.MOVING, "" if self._twist.any() else self._why
        if still and self._closed and not self._samples and self._next is None:
            return Status.DONE, ""
        return Status.WAITING, self._why

    def _on_the_way(self, place: float, *, still: bool) -> tuple[Status, str]:
        """The same while points or samples are followed."""
        missed = self._missed_at(place)
        if self._source is not None and self._time >= self._source.end and still:
            if missed > self._tolerance:
                return Status.BLOCKED, f"the end is out of reach, by {missed:.3g}"
            return Status.DONE, ""
        if missed > self._tolerance:
            return Status.LEFT, f"out of reach, by {missed:.3g}"
        return (Status.LATE, "the joints' limits") if self._late else (Status.MOVING, "")

    def _missed_at(self, place: float) -> float:
        """By how much the points at a place are out of reach."""
        if self._given is None or not len(self._missed):
            return 0.0
        stamps = self._given[1]
        i = int(np.clip(np.searchsorted(stamps, place), 0, len(self._missed) - 1))
        return float(self._missed[max(i - 1, 0) : i + 1].max())

    def _across(self, q: Array, place: float) -> float:
        """How far the tool at q (m,) is off what was asked for at a place."""
        if self._given is None:
            return nan
        given, stamps = self._given
        robot = self.controller.robot
        T = given.pose_at(place, stamps, robot)
        error = se3.displacement(robot.pose(q), T)
        J = robot.jacobian(q)
        v = self.controller.measure.root_for(J, robot.pose(q)).dot(error)
        return float(np.linalg.norm(v))


def _jerks(jerk: ArrayLike, m: int) -> Array:
    """(m,) positive limits."""
    given = arrays.array(jerk, "jerk", "numbers above zero")
    limits = np.full(m, float(given)) if given.ndim == 0 else given.copy()
    if limits.shape != (m,) or not (limits > 0.0).all():
        raise BadInput("jerk", excerpt(jerk), f"{m} limits above zero [rad/s^3, length/s^3], or one for all")
    return limits
