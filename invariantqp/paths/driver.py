"""One driver for what comes in over time: a whole path, action chunks of a policy, a hand's poses, twists.

    points, samples, twists -> a joint motion in stamp time (`reference`) -> a tick inside all limits (`time_law`)

A change of mind is a splice from the motion that the arm has now: to a new chunk, to the last point of one, after a
leap of a hand or a push of the arm. What it cannot do inside the limits is caught up, and an arm that is to stop
follows the twist zero. No tick is taken from which the joints cannot stop.

An override below 1 slows all of it down. Points and functions are followed by a clock that runs slower from where they
are due when it is set; of streams and twists the speed is scaled. On the way back to what is due no joint exceeds the
override's share of the speed that was requested of it since the arm fell behind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import partial
from math import inf, nan
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from invariantqp.control.controller import Controller
from invariantqp.control.target import Target
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.control import HybridController
from invariantqp.force.wrench import Wrench
from invariantqp.geometry import arrays, se3, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.paths.contact import Pressed, PressedStream
from invariantqp.paths.fit import PATIENCE, REACHED, Given, Solver, sampled
from invariantqp.paths.plan import PathPlan
from invariantqp.paths.reference import (
    DISPLACED,
    FADE,
    JOINT_GAIN,
    KNOTS,
    MOST_PIECES,
    MOST_POINTS,
    SHORTEST_STOP,
    STRAYED,
    Clock,
    Clocked,
    Motion,
    Reference,
    Source,
    planned,
    resting,
)
from invariantqp.paths.samples import Samples
from invariantqp.paths.shape import ASTRAY, PAUSE, Shape
from invariantqp.paths.solution import FollowerSolution, Why
from invariantqp.paths.stamps import ANOTHER_CLOCK, LONG, Arrivals, increasing, question
from invariantqp.paths.task_error import STILL, task_error
from invariantqp.paths.time_law import AT_LIMIT, AT_REST, JointLimits, usual
from invariantqp.robots.kinematics import unwrapped
from invariantqp.velocity.reasons import decoded, row_name
from invariantqp.velocity.solution import Status, VelocitySolution

# Without a jerk limit of its own a joint reaches its full acceleration in this time [s], a usual setting of a UR5.
RISE = 0.02
# A splice takes the first [s], one to a hand or of joints that catch up the second: a hand is caught up with 0.06 s
# later with 0.3, and what takes longer goes past it, and back.
EASE, EASE_SAMPLE = 0.3, 0.1
# A clock that differs by more than this from the sum of the ticks [s] has jumped.
SKEW = 0.02
# Where there is no acceleration limit a joint may turn round in a tick, one without a speed limit from this speed
# [rad/s, length/s].
FASTEST = 1e3
# A function of time is looked ahead so far [s], at places so far apart [s], and again when half of that is driven.
AHEAD, SAMPLING = 1.0, 0.02
# The largest override of a path whose shape is kept.
MOST_OVERRIDE = 1.5
# The largest speed of a splice over its mean one; speeds of what is followed are looked at in so many places.
PEAK, SPEEDS = 1.875, 65
# On the way to a stream that is far joints may be so many times as fast as the stream, or they would not reach it.
OVERTAKES = 1.2
# Points farther than this [rad, length] from the joints are approached by the law where there are exact demands; so
# often [s] it is looked whether the joints are there.
LEAP, TRIED = 0.1, 0.02
# Why joints catch up, or are elsewhere.
LATE, SLOWER = "the joints' limits", "the override"
ELSEWHERE = "joints are not where they were sent: they do not follow, or later than told (delay=)"
# Why an arm stands that is not done.
NOT_DUE = "the next points are not due yet"


class Course(NamedTuple):
    """What is followed while nothing new comes."""

    reference: Reference
    followed: Any  # as the engine takes it
    until: float  # by the stamps' clock
    told: float  # up to which place `Shape.told_by_core` tells of a tick


class Follower:
    """Drives the arm of a controller along what comes in over time; `step` is one tick.

    With a hybrid controller the tool presses all the while. What is followed then counts along the freedoms of the
    contact alone: its depth neither presses nor lifts the tool, and force and approach are the hybrid controller's. A
    stream keeps its time and does not wait for the touch; its status is "lost" while there is no contact.

    Attributes:
        controller: whose arm, limits, exact demands and measure hold; nobody else may step it.
        jerk: (m,) of the joints [rad/s^3, length/s^3].
        timeout: as given [s].
        paused: whether the arm is to stand still.
    """

    def __init__(
        self,
        loop: Controller | HybridController,
        *,
        keep: Literal["time", "shape"] = "time",
        rate: float = 1.0,
        jerk: ArrayLike | None = None,
        cutoff: float = 3.0,
        timeout: float = 0.1,
        approach: float = 1.0 / 3.0,
        drop_outliers: bool = True,
        blocked: Literal["stop", "leave"] = "stop",
        tolerance: float | None = None,
    ) -> None:
        """A follower of nothing yet: the arm stands still.

        Args:
            loop: a controller, or for motion in contact a hybrid controller; where time is kept with an acceleration
                limit.
            keep: "time": what is over is skipped, points are met when their stamps say (policies, hands); "shape": the
                tool stays on the path through the points and is late where limits make it so.
            rate: how fast stamps are driven where the shape is kept, 1 as they say.
            jerk: (m,) or one for all joints [rad/s^3, length/s^3]; None lets the acceleration rise to its limit in
                20 ms, and at once where the shape is kept.
            cutoff: what is faster than this is smoothed away where time is kept [Hz]; inf follows chunks as they are.
            timeout: how long after the last sample or twist the arm begins to stop [s]. For a stream that is slow this
                becomes five of its intervals, once these are observed, but at most 0.5 s.
            approach: the share of the joints' speed limits that is used at most on the way to a stream of samples from
                where the arm is: to its first sample, after a gap or a stop; 1 uses all of them.
            drop_outliers: whether one sample is dropped that joints at their speed limits could not reach in the time
                since the sample before; of two in a row the second is believed.
            blocked: where the shape is kept and the arm cannot reach it: "stop" before it, or "leave" it by the least.
            tolerance: how far off a pose is out of reach [length]; None is 1e-4 of the arm's length. Where the shape is
                kept, as in `PathFollower`.

        Raises:
            BadInput: not a Controller, one without an acceleration limit where time is kept or joints have a jerk
                limit, or a number that is not positive.
        """
        self._pressed: Pressed | None = None
        self._stream: PressedStream | None = None
        self._keep = arrays.choice(keep, "keep", ("time", "shape"))
        if isinstance(loop, HybridController) and self._keep == "shape":
            inner = Controller(loop.robot, **loop.loop.options)
            self._pressed = Pressed(loop, inner)
        elif isinstance(loop, HybridController):
            self._stream = PressedStream(loop)
            inner = self._stream.controller
        elif isinstance(loop, Controller):
            inner = Controller(loop.robot, **loop.options)
        else:
            raise BadInput("loop", excerpt(loop), "a Controller, or a HybridController")
        if inner.acceleration_limit is None and (self._keep == "time" or jerk is not None):
            expected = f"{type(loop).__name__}(acceleration_limit=...)"
            raise BadInput("loop", "one without an acceleration limit", expected)
        self.controller = inner
        self._m = m = len(inner.robot.names)
        self._limits = _limits_of(inner, jerk, rise=RISE if keep == "time" else 0.5 * inner.dt)
        self.jerk: Array = self._limits.jerk
        self._options: dict[str, Any] = {
            "joint_jerk": np.full(m, inf) if jerk is None else self.jerk,
            "blocked": arrays.choice(blocked, "blocked", ("stop", "leave")),
            "tolerance": tolerance,
        }
        self._rate = arrays.number(rate, "rate", "a share of the stamps' speed", positive=True)
        self.cutoff: float = arrays.number(cutoff, "cutoff", "a frequency in Hz", positive=True, infinite=True)
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        self._share = arrays.number(approach, "approach", "a share of the speed limits, up to 1", positive=True)
        if self._share > 1.0:
            raise BadInput("approach", f"{self._share:g}", "a share of the speed limits, up to 1")
        self._drops = arrays.flag(drop_outliers, "drop_outliers")
        least = REACHED * inner.measure.length
        self._tolerance = (
            least if tolerance is None else arrays.number(tolerance, "tolerance", "a distance", positive=True)
        )
        self._solver = Solver(inner, self._tolerance)
        self._rise = float((self._limits.acceleration / self.jerk).max())
        self._engine = inner.in_engine.follower(self._rise)
        self.paused: bool = False
        self._reset()

    def _reset(self) -> None:
        """Nothing has come yet, and the arm stands still."""
        loop, m = self.controller, self._m
        self._shape: Shape | None = None  # a path whose shape is kept
        self._start: Array | None = None  # (m,) of its joints
        self._astray = False  # whether it waits for joints that are not where they were sent
        self._off = 0.0  # how far one of them is from there at most
        self._course: Course | None = None
        self._time = 0.0  # when the next tick begins, by the stamps' clock
        self._state = law.FollowerState(m, loop.delay, loop.dt)  # of the joints
        self._trouble: bytes | None = None  # what is wrong with the joints
        self._reference: Reference | None = None
        self._source: Source | None = None  # what is wanted
        self._given: tuple[Given, Array] | None = None  # the points of the source
        self._missed: Array | None = None  # by how much points are out of reach, where one is
        self._last: tuple[Array, float, float] | None = None  # (m,) the last of them, its stamp, when to go back to it
        # With stamps, None for then; when; alone; of the rest of points how long newer ones are waited for.
        self._next: tuple[Given, Array | None, float, bool, float | None] | None = None
        self._function: Callable[[float], Any] | None = None
        self._looked = 0.0
        self._samples = Samples(loop, self._solver, cutoff=self.cutoff, timeout=self.timeout, drops=self._drops)
        self._by_law: tuple[Given, Array, float] | None = None  # points approached by the law, with stamps; since when
        self._twists = Arrivals(self.timeout, self.timeout)
        self._asked: Array = STILL  # the twist
        self._twist_at: Literal["tool", "base"] = "tool"
        self._twist: Array | None = None  # the same, or zero where the arm comes to rest
        self._turns = False  # whether there is a twist to move at
        self._override = 1.0
        self._changed = -inf  # when the override changed
        self._clock: Clock | None = None  # of points and functions where the override is below 1; None is the stamps'
        self._bounds = self._limits  # as far as override and approach leave them
        self._was: Source | None = None  # what was wanted before
        self._speeds: Array = np.zeros(m)  # of joints, which points ask for
        self._requested: Array = np.zeros(m)  # the largest joint speeds requested since the arm fell behind
        self._closed = False
        self._why = "nothing to follow yet"
        self._answer: VelocitySolution | None = None  # what the law made of a twist, or the loop of a command
        self._bound = False  # whether that is a command that the loop's rows or tool speed do not allow

    def __copy__(self) -> Follower:
        return deepcopy(self)  # with a state of its own

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in {"_engine", "_course"}}

    def __setstate__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields, _course=None)
        self._engine = self.controller.in_engine.follower(self._rise)

    # What comes in

    def follow(self, points: Any, stamps: ArrayLike | None = None, *, at: float | None = None) -> None:
        """Follow points, or a function of time, in place of what was followed before.

        The arm goes over from the motion it has, with bounded jerk. Points with stamps are one more sight of the motion
        that those before them were of, as the chunks of a policy are: where both say something, the new take over
        evenly, from nothing now to all at their own end. With `at` they are another motion, and take over at once. Of
        sights whose order is mixed up on their way, the newest is followed. Points that are over already still say
        where the last of them is, for a second.

        Args:
            points: (n, 4, 4) poses in the base frame, (n, m) joint positions, or a function of time [s] that returns
                one pose or one position. Or points (n, 3) for the tool frame's origin, of an arm without three joints,
                or a list of `Target`: what they leave free moves as little as it can. Where the shape is kept: two or
                more, no joint positions, and all with the same left free.
            stamps: (n,) when each is wanted [s], increasing, by the clock of `step`'s `now`; of a function, none. One
                point is a goal: without a stamp it is wanted now. Where the shape is kept they may be left out: the
                joints then go as fast as their limits let them.
            at: when to go over to another motion [s], `now` for at once; None is now, to one more sight of the same.

        Raises:
            BadInput: neither poses nor joints, NaN, no rigid motion, stamps that do not increase; the follower is as it
                was.
        """
        self._open("points")
        when = self._time if at is None else arrays.number(at, "at", "a time in seconds")
        if self._keep == "shape":
            if callable(points) or at is not None:
                what = 'a function, or `at`, with keep="shape"'
                raise BadInput("points", what, "poses (n, 4, 4)", "PathFollower takes functions.")
            given = self._believed(Given(points, self._m, "points"), "points")
            if given.joints is not None or len(given) == 1:
                expected = 'two poses (n, 4, 4) or targets, or more, with keep="shape"'
                raise BadInput("points", excerpt(points), expected)
            times = None if stamps is None else increasing(stamps, len(given))
            rate = None if stamps is None else self._rate
            path = given.targets if given.poses is None else given.poses
            shape = self._shape_of(path, "points", times=times, rate=rate, **self._options)
            self._forget()
            self._halt()
            self._shape, self._start = shape, None
            return
        if callable(points):
            if stamps is not None:
                raise BadInput("stamps", "stamps for a function", "none: it is a function of time")
            self._believed(sampled(points, np.array((when,)), self._m), "points")
            self._forget()
            self._function, self._looked = points, when - AHEAD
            return
        given = self._believed(Given(points, self._m, "points"), "points")
        if stamps is None and len(given) > 1:
            raise BadInput("stamps", "None", f"({len(given)},) times in seconds, one for each point, increasing")
        times = None if stamps is None else increasing(stamps, len(given))
        if times is not None:
            question(times, given, self._limits.velocity, self.controller.measure.length)
        law = self._by_law
        self._forget()
        self._by_law, self._next = law, (given, times, when, at is not None, None)

    def _shape_of(self, path: Any, name: str, **options: Any) -> Shape:
        """A path whose shape is kept."""
        shape, loop = Shape(self.controller, path, **options), self.controller
        whole = self._pressed is not None or loop.form is not None or loop.exact
        if whole and shape.given.curve.part is not None:
            expected = "poses (n, 4, 4) beside a form, exact demands or a contact"
            raise BadInput(name, "targets that leave something free", expected, "These need the whole pose.")
        return shape

    def add(self, point: Any, stamp: float | None = None) -> None:
        """One more point of a stream, as a hand's tracker sends them; one alone is a stream that ended (`timeout`).

        Args:
            point: (4, 4) pose in the base frame, a `pinocchio.SE3`, (m,) joint positions; or what leaves the rest of
                the pose free: a `Target` or, of an arm without three joints, a point (3,) for the tool frame's origin.
            stamp: when it was so [s], by the clock of `step`'s `now`; None is now. A sample older than the newest is
                dropped; a clock that is more than a second off is another clock, and time runs on from its stamps.

        Raises:
            BadInput: neither a pose nor joint positions, NaN; the follower is as it was.
        """
        self._open("point")
        if self._keep == "shape":
            raise BadInput("point", "a stream where the shape is kept", 'keep="time", or a whole path by follow()')
        given = self._believed(Given([arrays.pose_matrix(point)], self._m, "point"), "point")
        when = None if stamp is None else arrays.number(stamp, "stamp", "a time in seconds")
        if self._next is not None or self._function is not None or self._turns or self._by_law is not None:
            self._forget()
        self._samples.add(given, when)

    def twist(self, v: ArrayLike, *, at: Literal["tool", "base"] = "tool") -> None:
        """Move the tool at a twist, until the next one or the end of the stream of twists (`timeout`).

        In contact it moves at the part of the twist that the contact leaves free.

        Args:
            v: (6,) angular velocity, then the velocity of the tool frame's origin, both along the axes of the base
                frame [rad/s; length/s], as MoveIt Servo and UR's `speedL` have it.
            at: "tool" as above; "base": a screw in base coordinates, as in `Controller.follow`.

        Raises:
            BadInput: NaN, a wrong shape, or a twist beyond any scale.
        """
        course, point = self._course, arrays.choice(at, "at", ("tool", "base"))
        self._open("v")
        wanted = sizes.bounded_twists(arrays.twist(v, "v")).copy()
        if self._pressed is not None:
            raise BadInput("v", 'a twist in contact with keep="shape"', 'keep="time", or a path: follow(poses)')
        if not self._turns:
            self._forget()
            self._halt()
        self._twists.add(self._time)
        if self._turns and course is not None:  # the same course, for longer
            self._course = course._replace(until=self._time + self._twists.timeout)
        self._twist_at, self._asked, self._turns = point, wanted, bool(wanted.any())
        self._twist = wanted if self._override > 0.0 else STILL

    def prepare(self, q: ArrayLike) -> None:
        """Find the joint motion along a path whose shape is kept now, from joint positions near its start.

        It takes about a tenth of a second, where exact demands are left several times that. Without it the first ticks
        find it, a little in each, while the arm waits.

        Args:
            q: (m,) joint positions [rad, length]; where the path starts out of reach, those from which to approach it,
                at best the nearest, `solve_pose(robot, pose, form=tool_metric(robot)).q`.

        Raises:
            BadInput: no such path, NaN, a wrong shape, or positions that cannot be true.
        """
        self._kept_shape("prepare").prepare(self.controller.checked_positions(q))

    def reverse(self) -> None:
        """Come to rest on a path whose shape is kept, and drive it in the other direction.

        Raises:
            BadInput: no such path.
        """
        shape = self._kept_shape("reverse")
        self._course = None
        shape.back = not shape.back

    def close(self) -> None:
        """No more comes: where all of it is driven, the arm is "done"."""
        self._course = None
        self._closed = True

    def pause(self) -> None:
        """Come to rest, and stay."""
        self._course = None
        self.paused = True

    def resume(self) -> None:
        """Go on after a pause: with what is due then or, where the shape is kept, where it was."""
        self._course = None
        self.paused = False

    # A tick

    def step(
        self,
        q: ArrayLike,
        velocity: ArrayLike | None = None,
        *,
        now: float | None = None,
        override: float = 1.0,
        wrench: Any = None,
        contact: Contact | None = None,
        wanted: ArrayLike | Wrench | None = None,
    ) -> FollowerSolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            velocity: (m,) joint velocity now, where it is not the one commanded last, which None is: of an arm that
                moves when it is first stepped, after a push or an emergency stop.
            now: the time [s], by the clock of the stamps; None counts ticks.
            override: share of the requested speed, 0 to 1, of all that is followed, which may change in every tick; 0
                stops; along a path up to 1.5, where limits allow it.
            wrench: in contact, as in `HybridController.step`, and so are the next two.
            contact: the contact now; None takes the task's.
            wanted: what to exert in this tick; None takes the task's.

        Returns:
            FollowerSolution: its velocity, and that of the next ticks to a stop, is inside the limits.

        Raises:
            BadInput: NaN, wrong shapes; the follower is as it was.
        """
        clock = None if now is None else arrays.number(now, "now", "a time in seconds")
        if velocity is None and override == self._override and self._runs(clock):
            found = self._going_on(q)
            if found is not None:
                return found
        self._course = None
        share = self._override_of(override)
        if self._stream is not None:
            return self._streamed(self._stream, q, velocity, clock, share, (wrench, contact, wanted))
        if self._pressed is None:
            _none(wrench=wrench, contact=contact, wanted=wanted)
        state = self._state
        measured, before, wrong = self._observed(q, velocity)
        if self._pressed is not None:
            return self._in_contact(self._pressed, measured, before, clock, share, (wrench, contact, wanted))
        shape, another = self._shape, np.abs(before - state.command) > self._limits.dt * self._limits.acceleration
        state.command = before
        if wrong:
            return self._held(wrong, clock)
        anew, leaves = state.unresponsive != (), shape is None and bool(another.any())
        if leaves or anew:  # joints cannot have it by what was commanded
            self._reference, state.change = None if leaves else self._reference, np.zeros(self._m)
        if shape is not None and shape.motion is None and (self._reference is None or not state.velocity.any()):
            if shape.plan is None:
                return self._setting_out(shape, measured, clock, share)
            measured = self._on_path(shape, measured, clock)
        reference = self._begin(measured, clock, anew=anew)
        self._take_in(reference, share)
        return self._driven(reference, measured)

    def _runs(self, clock: float | None) -> bool:
        """Whether the course goes on at the time of a tick, by its clock [s] or the sum of the ticks."""
        course, now = self._course, self._time
        return course is not None and now < course.until and (clock is None or abs(clock - now) <= SKEW)

    def _on_path(self, shape: Shape, q: Array, clock: float | None) -> Array:
        """Follow the path whose start is reached; (m,) joint positions, of continuous joints near that start."""
        self._source = shape.begin(self._time if clock is None else clock)
        self._reference = self._twist = None
        there = shape.driven.joints(0.0)
        self._state.measured = unwrapped(there, q[None], self.controller.turns)[0]
        return np.asarray(self._state.measured)

    def _observed(self, given: ArrayLike, velocity: ArrayLike | None) -> tuple[Array, Array, str]:
        """(m,) joint positions and velocity when a tick begins, and why positions cannot be true, "" if they can.

        Positions of continuous joints are by whole turns near those of the tick before; unresponsive ones are at rest.
        """
        state, q = self._state, arrays.vector(given, self._m, "q")
        before = state.command if velocity is None else arrays.vector(velocity, self._m, "velocity").copy()
        wrong = self.controller.limits.implausible(q)
        measured = self._engine.observe(state, q, velocity is not None)
        self._trouble = self._engine.trouble(state)
        before[list(state.unresponsive)] = 0.0
        return measured, before, str(wrong) if wrong else ""

    def _driven(self, reference: Reference, measured: Array) -> FollowerSolution:
        """A tick along a reference."""
        command = self._moved(reference, measured, self._ease)
        self._time += self.controller.dt
        self._course = self._made_course(reference)
        return self._reported(reference, measured, command)

    @property
    def _ease(self) -> float:
        """How long a splice takes that late joints look for [s], 0 where they do not."""
        looks = self._state.late and self._twist is None and not self._changing
        return max(EASE_SAMPLE, SHORTEST_STOP * self.controller.dt) if looks else 0.0

    def _wish(self, ease: float) -> tuple[Any, ...]:
        """What is wanted in a tick, as the engine takes it."""
        kind, twist, share, target = "course", self._twist, 1.0, None
        if self._chases and self._override > 0.0 and not self.paused:
            kind, (twist, target, speeds) = "target", self._approached()
            self._bounds = self._limits.slowed(speeds / usual(self._limits.velocity))
        elif twist is not None:
            kind, share = "twist", self._override
        twist = None if twist is None or not twist.any() else twist
        at_base = kind == "target" or self._twist_at == "base"
        if kind == "twist" and twist is not None and self._stream is not None:
            twist, at_base = self._stream.along(twist, at_base=at_base), True
        return kind, twist, at_base, share, ease, self._time, target

    def _moved(self, reference: Reference, measured: Array, ease: float = 0.0) -> Array:
        """(m,) the command of a tick along a reference, inside the limits; the joints are sent so far."""
        shape, functions = self._shape, self.controller.in_engine.begin_callbacks(measured)
        wish, course = self._wish(ease), self._course_of(reference)
        found = self._engine.drive(self._state, course, wish, measured, functions, False)
        if found[0] is None and shape is not None:  # the path waits
            reference.source = self._source = shape.delayed((1.0 - found[5]) * self.controller.dt)
            found = self._engine.drive(self._state, self._course_of(reference), wish, measured, functions, True)
        self._keep_told(found, reference, ease)
        return np.asarray(found[0])

    def _keep_told(self, found: tuple[Any, ...], reference: Reference, ease: float) -> None:
        """Keep what a tick found beside its command."""
        _, _, _, residual, self._bound, _, answer = found
        self._answer = None if answer is None else self.controller.in_engine.solution(answer)
        if residual is not None:
            reference.joins(self._time, residual, ease)
        elif ease and self._time < reference.joined:
            reference.joins(self._time, np.zeros((6, self._m)), 0.0)

    def _course_of(self, reference: Reference) -> Any:
        """What is followed, as the engine takes it."""
        shape = self._shape is not None
        return reference.course(self._bounds, self.controller.gain if shape else self._gain, shape=shape)

    def _made_course(self, reference: Reference) -> Course | None:
        """What the next ticks follow, and until when nothing new comes; None where something is to be decided."""
        shape = self._shape
        if self._samples or self._chases or (shape is None and self._source is None and self._twist is None):
            return None
        if shape is not None and (
            self._state.late
            or reference.source is not shape.motion
            or self._time <= reference.joined
            or self._astray
            or self._state.unresponsive
        ):
            return None
        until, told = self._when(self._looked + 0.5 * AHEAD) if self._function else inf, -inf
        if shape is not None:
            until, told = min(until, shape.until), shape.usual
        elif self._twist is None:
            ends = reference.end if self._last is None else self._when(self._due)
            until = min(until, inf if self._state.late and self._last is None else ends)
        if self._next is not None:
            until = min(until, self._next[2] if self._next[4] is None else self._when(self._next[2]))
        if self._turns:
            until = min(until, self._twists.last + self._twists.timeout)
        elif self._twist is None and self._samples.newest is not None:
            arrivals = self._samples.arrivals
            until = min(until, arrivals.last + arrivals.timeout)
        return None if until <= self._time else Course(reference, self._course_of(reference), until, told)

    @property
    def _gain(self) -> float:
        """[1/s] at which joints are led back to where they were sent, where time is kept."""
        return JOINT_GAIN * (0.0 if self.paused else self._override)

    @property
    def _due(self) -> float:
        """When to go back to the last point if no newer ones come, by the stamps."""
        return inf if self._last is None else self._last[1] if self._closed else self._last[2]

    @property
    def _place(self) -> float:
        """What is due now, by the stamps of points."""
        return self._time if self._clock is None else self._clock.now(self._time)[0]

    def _when(self, place: float) -> float:
        """When a place is due, or at least not before."""
        clock = self._clock
        if clock is None:
            return place
        return clock.start + (place - clock.first) / clock.final if clock.final > 0.0 else inf

    def _going_on(self, q: ArrayLike) -> FollowerSolution | None:
        """A tick in which nothing new comes; None where there is something to decide, and nothing has changed."""
        if self._course is None:
            return None
        reference, course, _, told = self._course
        time, shape, ease, state = self._time, self._shape, self._ease, self._state
        functions = self.controller.in_engine.begin_callbacks(q)
        try:
            found = self._engine.step(state, course, self._wish(ease), q, functions)
        except (ValueError, TypeError) as refusal:
            if self.controller.in_engine.raised(refusal):
                raise
            return None  # q is no joint positions
        if found is None:
            return None
        tick, measured, self._off, self._trouble = found
        self._keep_told(tick, reference, ease)
        self._time += self.controller.dt
        if tick[3] is not None or (ease and time < reference.joined):
            self._course = self._made_course(reference)
        if shape is not None and tick[2] < told and self._trouble is None:
            return shape.told_by_core(tick[0], measured, tick[1], tick[2], self._override)
        return self._reported(reference, measured, tick[0])

    def _override_of(self, value: float) -> float:
        most = 1.0 if self._shape is None else MOST_OVERRIDE
        share = arrays.not_negative(value, "override", f"a share of the speed, 0 to {most:g}")
        if share > most:
            raise BadInput("override", f"{share:g}", f"a share of the speed, 0 to {most:g}")
        return share

    def _held(self, reason: str, clock: float | None) -> FollowerSolution:
        """A tick of joint positions that cannot be true: wherever they may be, to rest as soon as they may."""
        dt, shape, state = self.controller.dt, self._shape, self._state
        self._reference = None
        self._time = (self._time if clock is None else clock) + dt
        place = nan
        if shape is not None:
            place = shape.place(self._time - dt)
            self._source = None if shape.motion is None else shape.still(self._time)
        limit, v = self.controller.acceleration_limit, state.command
        step = np.full(self._m, inf) if limit is None else dt * limit
        v = np.sign(v) * np.maximum(np.abs(v) - step, 0.0)
        self._commanded(v)
        state.velocity = v
        return FollowerSolution(v, Status.HELD, reason, (place, 0.0, 0.0), lambda: inf, "joint positions")

    def _commanded(self, command: Array) -> None:
        """A tick that the engine did not make gave a command (m,)."""
        self._state.command, self._state.change = command, np.zeros(self._m)
        self._state.commanded(command)

    def _setting_out(self, shape: Shape, measured: Array, clock: float | None, override: float) -> FollowerSolution:
        """A tick on the way to a path whose shape is kept."""
        before = self._state.command
        share, limited = 0.0 if self.paused else min(override, 1.0), np.isfinite(self._options["joint_jerk"]).all()
        found = self._approaching(shape, measured, before, share) if limited else None
        told = shape.set_out(measured, before, share) if found is None else found
        self._time = (self._time if clock is None else clock) + self.controller.dt
        if found is None:
            self._commanded(told.velocity)
        self._reference = None
        return told

    def _approaching(self, shape: Shape, measured: Array, before: Array, share: float) -> FollowerSolution | None:
        """As `Shape.set_out`, inside limits of jerk, by the joints; None at the path's start, or where that fails."""
        state = self._state
        if self._start is None or state.unresponsive or np.abs(state.sent - measured).max() > DISPLACED:
            goal = self._solver.posed(Given([shape.given.pose(0.0)], self._m, "path"), measured, leaps=True)
            (there,), (missed,) = self._solver.points(goal, measured, np.array((self._time,)))
            if missed > REACHED * self.controller.measure.length:
                return None
            if self._start is not None:  # pushed
                state.acceleration = np.zeros(self._m)
            self._start, state.position, state.velocity = there, measured, before
            state.begin(measured)
        else:
            state.send()
        self._twist, state.late = None, bool(np.abs(self._start - state.position).max() > AT_LIMIT) or not self._still
        if not state.late:
            return None
        self._bounds = self._limits.slowed(np.full(self._m, share))
        if share == 0.0:
            self._twist = STILL
        command = self._moved(Reference(self._limits, self._start, self._time), measured)
        return shape.on_the_way(measured, command)

    def _in_contact(
        self,
        pressed: Pressed,
        measured: Array,
        before: Array,
        clock: float | None,
        override: float,
        given: tuple[Any, Contact | None, ArrayLike | Wrench | None],
    ) -> FollowerSolution:
        """A tick along a path in contact."""
        shape = self._kept_shape("step")
        time = self._time if clock is None else clock
        kept = shape.motion, shape.plan
        try:
            told = pressed.step(shape, measured, before, time, override, given, paused=self.paused)
        except BadInput:  # the follower is as it was
            shape.motion, shape.plan = kept
            raise
        self._time = time + self.controller.dt
        self._commanded(told.velocity)
        return told

    def _streamed(
        self,
        pressed: PressedStream,
        q: ArrayLike,
        velocity: ArrayLike | None,
        clock: float | None,
        override: float,
        given: tuple[Any, Contact | None, ArrayLike | Wrench | None],
    ) -> FollowerSolution:
        """A tick of a stream in contact: the pressed arm follows a reference arm, which goes on along the stream."""
        state, positions = self._state, arrays.vector(q, self._m, "q")
        before = None if velocity is None else arrays.vector(velocity, self._m, "velocity")
        command = pressed.command if before is None else before
        answer = pressed.step(positions, before, state, given)
        at, tracking = state.position, pressed.tracking
        if tracking.begins:
            self._reference, at = None, tracking.measured
            state.command, state.change = command, np.zeros(self._m)
        if wrong := self.controller.limits.implausible(positions):
            told = self._held(str(wrong), clock)
            pressed.sent()
            return pressed.told(told, answer)
        reference = self._begin(at, clock, anew=False)
        self._take_in(reference, override)
        self._moved(reference, at, self._ease)
        self._time += self.controller.dt
        pressed.sent(state.position)
        return pressed.told(self._reported(reference, state.sent - tracking.astray, answer.velocity), answer)

    @property
    def _through_ticks(self) -> Array:
        """(3, m) position, velocity and acceleration of the motion through the ends of the last three ticks."""
        state, dt = self._state, self.controller.dt
        return np.vstack((state.position, state.velocity + 0.5 * dt * state.acceleration, state.acceleration))

    def _kept_shape(self, name: str) -> Shape:
        if self._shape is None:
            raise BadInput(name, "no path whose shape is kept", 'follow(poses) with keep="shape"')
        return self._shape

    def _motion(self, reference: Reference) -> Array:
        """(3, m) the same, as exactly as it is known."""
        exact = not self._state.late and self._twist is None
        return reference.at(self._time)[:3] if exact else self._through_ticks

    def _open(self, argument: str) -> None:
        self._course = None
        if self._closed:
            raise BadInput(argument, "more after close()", "a new Follower")

    def _believed(self, given: Given, argument: str) -> Given:
        """What was given, if it can be true; degrees cannot, nor millimetres."""
        if len(given.places):
            self.controller.limits.require_near(given.places, argument)
        for q in () if given.joints is None else (given.joints.min(axis=0), given.joints.max(axis=0)):
            self.controller.checked_positions(q, argument)
        return given

    def _forget(self) -> None:
        """What was to come is replaced."""
        self._next = self._function = self._by_law = None
        self._samples.clear()
        if self._turns or self._shape is not None:
            self._halt()

    def _halt(self) -> None:
        """Come to rest from the motion that the arm has now."""
        self._twist, self._turns, self._shape, self._state.late = STILL, False, None, False
        self._source = self._given = self._last = self._was = None
        self._bounds = self._limits

    def _begin(self, measured: Array, clock: float | None, *, anew: bool) -> Reference:
        """The reference at the beginning of a tick, made anew where told, or where the arm is not where it was sent."""
        reference = self._reference
        if reference is not None:
            if self._goes_on(reference, measured, clock, anew=anew):
                return reference
        else:
            if clock is not None:
                self._set_clock(clock)
            begun = None if self._shape is None or self._source is None else self._begun(measured, self._source)
            if begun is not None:
                return begun
        if self._shape is not None and self._shape.motion is not None:
            self._source = self._shape.still(self._time)
        state, speed = self._state, self._limits.velocity
        state.position = np.clip(measured, self._limits.lower, self._limits.upper)
        state.command = state.velocity = np.clip(state.command, -speed, speed)
        state.acceleration = state.change
        state.begin(measured)
        self._off = 0.0
        self._reference = new = Reference(self._limits, state.position, self._time)
        if self._shape is not None and self._source is not None:  # a path that was left is gone back to
            self._state.late = not new.splice(self._source, self._time, self._through_ticks, EASE)
        elif not self._turns:  # and so is what is wanted, from rest or the motion that the arm has
            self._twist, self._samples.far, self._was = STILL, self._samples.newest is not None, None
            if self._source is not None:
                self._leaps(self._source.at(np.array((self._place,)))[0, 0])
        return new

    def _goes_on(self, reference: Reference, measured: Array, clock: float | None, *, anew: bool) -> bool:
        """Whether a reference is followed on from where the arm is; if it begins `anew`, along a path from rest."""
        if clock is not None and abs(clock - self._time) > SKEW:
            self._leap_to(clock, reference)
        self._state.send()
        shape = self._shape
        if self._displaced(measured):
            return False
        if anew and shape is not None and shape.motion is not None and not self._state.late:
            reference.source = self._source = shape.still(self._time)
            return True
        return not anew

    def _displaced(self, measured: Array) -> bool:
        """Whether joints are so far from where they were sent that they have been pushed."""
        self._off, shape = float(np.abs(self._state.sent - measured).max()), self._shape
        if shape is not None and self._off > STRAYED and shape.is_off(measured, self._time):
            return True
        return self._off > DISPLACED

    def _begun(self, measured: Array, source: Source) -> Reference | None:
        """What is followed along a path whose shape is kept, where the joints are where that has them."""
        state = self._state
        state.position = there = source.at(np.array((self._time,)))[0, 0]
        state.velocity = state.acceleration = np.zeros(self._m)
        state.begin(there)
        if self._displaced(measured):
            return None
        self._reference = Reference(self._limits, there, self._time)
        self._reference.source = source
        return self._reference

    def _set_clock(self, clock: float) -> None:
        """Count from another time on; what came last came as long ago as by the time before."""
        self._twists.last += clock - self._time
        self._samples.arrivals.last += clock - self._time
        self._time = clock

    def _leap_to(self, clock: float, reference: Reference) -> None:
        """The clock says another time than the ticks."""
        state = self._through_ticks
        before = self._time
        self._set_clock(clock)
        if self._shape is not None and self._shape.motion is not None:
            reference.source = self._source = self._shape.delayed(clock - before)
        elif self._twist is None:
            self._state.late = not reference.splice(reference.source, clock, state, EASE)

    def _take_in(self, reference: Reference, override: float) -> None:
        """All that came since the last tick, and what is due."""
        now, shape = self._time, self._shape
        if shape is not None and shape.motion is not None:
            away = self._state.late or now < reference.joined
            self._astray = away or self._off > (0.5 if self._astray else 1.0) * STRAYED
            share = 0.0 if self.paused or self._astray else override
            self._override = override
            reference.source = self._source = shape.order(now, share)
            return
        if override == 1.0 and not self.paused:
            self._clock = None
        place = self._place
        if self._next is not None and (now if self._next[4] is None else place) >= self._next[2]:
            given, stamps, _, alone, wait = self._next
            self._next = None
            if wait is None:  # what came is due now
                self._clock, place = None, now
            self._take_points(reference, given, np.array((now,)) if stamps is None else stamps, place, alone, wait)
        elif self._function is not None and place >= self._looked + 0.5 * AHEAD:
            stamps = np.arange(place - 8.0 * SAMPLING, place + AHEAD, SAMPLING)
            self._looked = place
            self._take_points(reference, sampled(self._function, stamps, self._m), stamps, place)
        elif self._last is not None and place >= self._due:
            self._leaps(self._last[0])
            self._source, self._last = resting(self._last[0], place), None
        samples = self._samples
        if samples:
            self._take_samples(reference)
        arrivals, twists = samples.arrivals, self._twists
        quiet = now - arrivals.last
        if samples.newest is not None and quiet > arrivals.timeout and (self._source is not None or samples.by_law):
            self._source, samples.far, self._why = None, False, f"no sample for {quiet:.2g} s"
        quiet = now - twists.last
        if self._turns and (self.paused or quiet > twists.timeout):
            self._why = "paused" if self.paused else f"no twist for {quiet:.2g} s"
            self._turns = False
        self._choose(reference, 0.0 if self.paused else override)

    def _choose(self, reference: Reference, override: float) -> None:
        """Go over to what is to be followed now, at the override, or come to rest."""
        now, source, samples, changed = self._time, self._source, self._samples, override != self._override
        stream, place = samples.newest is not None, self._place
        if changed and self._clock is not None:
            self._clock = Clock(now, place, override, 0.0, override)
        elif override < 1.0 and self._clock is None and not stream:
            self._clock = Clock(now, now, override, 0.0, override)
        changing, self._changed = changed and self._changing, now if changed else self._changed
        self._override = override
        if self._turns:
            self._twist = self._asked if override > 0.0 else STILL
            return
        if source is None or override == 0.0 or self._chases:
            self._twist, self._state.late, self._bounds = STILL, False, self._limits
            return
        followed = reference.source
        same = self._twist is None and source is (followed.source if isinstance(followed, Clocked) else followed)
        if samples.far and same and not self._state.late and now >= reference.joined:
            samples.far, changed = False, True
        if not same or changed or override < 1.0:
            self._bounds = reference.limits = self._bounded(source, place)
        if same and not changed:
            return
        self._was = source
        slower = source if self._clock is None or isinstance(source, Clocked) else Clocked(source, self._clock)
        state, ease = self._motion(reference), EASE_SAMPLE if stream else EASE
        self._state.late = True
        if changing and same:  # a splice that begins anew in each tick leads nowhere
            reference.follow(slower, now)
        else:
            self._state.late = not reference.splice(slower, now, state, ease)
        self._twist = None

    def _bounded(self, source: Source, place: float) -> JointLimits:
        """The limits on the way to a source at a place: of its joint speeds the share that override and approach leave.

        At an override below 1 that is a share of the speed that was requested since the arm fell behind: that of the
        source, of a splice to it where it leaps, and of an approach.
        """
        limits, override, samples = self._limits, self._override, self._samples
        if override == 1.0 and not samples.far:
            return limits
        full, asked = usual(limits.velocity), self._speeds
        if samples.stream is not None:
            there = source.at(np.linspace(place, max(source.end, place), SPEEDS))
            asked = np.abs(there[:, 1]).max(axis=0)
        share = np.clip(OVERTAKES * asked / full, self._share, 1.0) if samples.far else np.ones(self._m)
        if override < 1.0:
            self._request(np.maximum(asked, share * full) if samples.far else asked)
            share = override * np.minimum(share, self._requested / full)
        return limits.slowed(share)

    def _leaps(self, there: Array) -> None:
        """What is wanted leaps to joint positions (m,), from where it was or the arm is."""
        here = self._state.position if self._was is None else self._was.at(np.array((self._time,)))[0, 0]
        way = there - here
        speeds = np.minimum(PEAK / EASE * np.abs(way), self._limits.peak(way))
        self._speeds = np.maximum(self._speeds, speeds)

    def _request(self, speeds: Array) -> None:
        """Joint speeds (m,) are requested, while the arm is behind beside those before."""
        joins = self._reference is not None and self._time < self._reference.joined
        behind = self._state.late or joins or self._twist is not None
        self._requested = np.maximum(speeds, self._requested) if behind else speeds

    @property
    def _changing(self) -> bool:
        """Whether the override has changed just now."""
        return self._time - self._changed < EASE_SAMPLE

    @property
    def _chases(self) -> bool:
        """Whether the arm approaches what it follows by the law, which keeps exact demands on the way."""
        return self._samples.by_law or self._by_law is not None

    def _take_points(
        self,
        reference: Reference,
        given: Given,
        stamps: Array,
        now: float,
        alone: bool | None = None,
        wait: float | None = None,
    ) -> None:
        """Points with stamps, from `now` on: one more sight of the motion followed, or `alone`; None is a function."""
        smooth, followed = alone is not None, self._source
        over = now - stamps[-1] > ANOTHER_CLOCK and wait is None
        if over or stamps[0] - now > LONG:
            other = f"the points begin in {stamps[0] - now:.3g} s: stamps and now= are seconds of one clock"
            self._why = "the points were over when they came" if over else other
            return
        older = self._given[1] if alone is False and self._last and self._given else None
        if older is not None and stamps[0] < older[0] and stamps[-1] <= older[-1]:
            return  # newer points came before these
        # Newer ones may be as late as these and, in a stream, lost for as long as these last: until then the arm does
        # not go back to the last of them.
        begin, last = float(stamps[0]), float(stamps[-1])
        wait = max(now, now if self._given is None else last) - begin if wait is None else wait
        # From the one before now on as far as a plan reaches, of the last some that say how it goes on.
        calm = max(0.5 / np.pi / self.cutoff, SHORTEST_STOP * self.controller.dt)
        reach, first, end = MOST_PIECES * KNOTS * calm, 0, len(stamps)
        if smooth:
            first = max(int(stamps.searchsorted(min(now, last - 4.0 * FADE), side="right")) - 1, 0)
            end = min(first + MOST_POINTS, int(stamps.searchsorted(now + reach, side="right")))
        if end < len(stamps):  # the rest when half of these are driven
            due = float(stamps[(first + end) // 2])
            self._next = given, stamps, due if now < due < now + reach else now + 0.25 * reach, bool(alone), wait
        if end == 0:
            self._why = f"the points begin in {stamps[0] - now:.3g} s"
            return
        whole, given, stamps = (given, stamps), given.chosen(slice(first, end)), stamps[first:end]
        near, before, there = self._state.position, None, None
        if isinstance(followed, Motion) and len(stamps) > 1 and not alone:  # out of reach, too, they go on from there
            before = float(2.0 * stamps[0] - stamps[1])
            near, *there = followed.at(np.append(before, stamps))[:, 0]
        given = self._solver.posed(given, near, leaps=before is None)
        joints, missed = self._solver.points(given, near, stamps, before)
        self._speeds = np.abs(np.diff(joints, axis=0) / np.diff(stamps)[:, None]).max(axis=0, initial=0.0)
        self._leaps(joints[min(int(stamps.searchsorted(now)), len(stamps) - 1)])
        both = 0 if older is None or min(older[-1], last) <= now else int(stamps.searchsorted(older[-1], side="right"))
        if there and both:  # beyond the end of those before they differ as at it
            differ = np.array(there) - joints
            differ[both:] = differ[both - 1]
            joints += ((last - np.maximum(stamps, now)) / (last - now))[:, None] * differ
        self._given, self._last = (given, stamps), (joints[-1], last, last + wait) if smooth else None
        self._missed = missed if (missed > self._tolerance).any() else None
        if smooth and self._leaves_exact(given, joints, int(stamps.searchsorted(now))):
            since = self._time if self._by_law is None else self._by_law[2]
            self._request(self._speeds)
            self._by_law, self._last, self._source = (given, stamps, since), None, None
            self._next = *whole, now + TRIED, bool(alone), wait
            return
        begins = _along(stamps, joints, now) if self._by_law is not None else None
        if begins is None and isinstance(followed, Motion) and (there is not None or self._override < 1.0):
            begins = followed.at(np.array((now,)))[0, :3]
        self._by_law = None
        self._source = (
            self._through(reference, stamps, joints, now, calm, begins) if smooth else _spline(stamps, joints)
        )

    def _through(
        self, reference: Reference, stamps: Array, joints: Array, now: float, calm: float, begins: Array | None
    ) -> Motion:
        """The motion through joint positions (n, m) from a state (3, m), None for the arm's.

        Though the arm may be behind it, what is requested goes on as it was, or begins on the points.
        """
        free = np.full(self._m, inf)  # what little a plan is outside a range, joints are not
        limits = self._limits._replace(lower=-free, upper=free)
        return planned(self._motion(reference) if begins is None else begins, now, stamps, joints, limits, calm)

    def _leaves_exact(self, given: Given, joints: Array, due: int) -> bool:
        """Whether the way of the joints to the point that is due leaves exact demands, and the law's does not.

        The law leads there, until the joints are near or, exact demands being met, at rest.
        """
        if not self.controller.exact or given.poses is None:
            return False
        due = min(due, len(joints) - 1)
        if np.abs(joints[due] - self._state.position).max() <= (LEAP if self._by_law is None else STRAYED):
            return False
        target = self.controller.robot.target(given.poses[due])
        trapped = self._by_law is not None and self._still and self._time - self._by_law[2] > PATIENCE
        return not trapped or task_error(self.controller, self._state.position, target).off <= self._tolerance

    def _take_samples(self, reference: Reference) -> None:
        """Samples of a stream."""
        samples = self._samples
        goes_on = samples.take(self._time, self._state.position)
        if samples.newest is None:
            return
        given, _, stamp = samples.newest
        self._given, self._last, self._by_law = (given, np.array((stamp,))), None, None
        self._missed = np.array((samples.missed,)) if samples.missed > self._tolerance else None
        goes_on = goes_on and self._source is not None and reference.source is self._source
        self._source = samples.source
        if goes_on and samples.source is not None:
            reference.source = self._was = samples.source

    def _approached(self) -> tuple[Array, Array, Array]:
        """What the law approaches, points or samples that are far: twist (6,) and pose (4, 4), at joint speeds (m,)."""
        samples, limits, q = self._samples, self._limits, self._state.position
        if self._by_law is not None:
            given, stamps, _ = self._by_law
            target, soon = (given.pose_at(self._place + t, stamps, self.controller.robot) for t in (0.0, limits.dt))
            speeds = limits.velocity
            if self._override < 1.0:
                full = usual(speeds)
                speeds = self._override * np.clip((self._requested / full).max(), AT_REST, 1.0) * full
            return se3.displacement(target, soon) / limits.dt, target, speeds
        target, twist = samples.pose, samples.twist
        speeds = self._share * limits.velocity
        if twist.any():  # or joints would not reach it
            speeds = np.maximum(speeds, OVERTAKES * np.abs(self._solver.way(target, q, twist)))
        return twist, target, self._override * speeds

    # What is told

    def _reported(self, reference: Reference, measured: Array, command: Array) -> FollowerSolution:
        """The solution of a tick."""
        shape = self._shape
        if shape is not None and shape.motion is not None:
            why = ASTRAY if self._astray else PAUSE if self.paused or self._override == 0.0 else ""
            told = shape.told(measured, command.copy(), self._time, self._override, why=why)
            found = self._by_loop(streams=False) if self._state.late else None
            if (found := self._joint_trouble() or found) is not None:
                told.status, told.reason = found
            return told
        place, late = self._time, 0.0
        if self._samples.stream is not None:
            late = self._samples.stream.late
            place -= late
        elif self._twist is None:
            place = self._place
            late = self._time - place
        where = place, late, 1.0
        along = None if self._stream is None else self._stream.tracking.projector
        across = partial(self._across, self._state.position, self._state.sent, measured, place, self._given, along)
        return FollowerSolution(command.copy(), *self._status(reference, place), where, across)

    @property
    def _still(self) -> bool:
        """Whether the commanded motion rests."""
        return bool((np.abs(self._state.velocity) <= AT_REST * usual(self._limits.velocity)).all())

    def _status(self, reference: Reference, place: float) -> tuple[Status, Why]:
        """The status of a tick at a place, and its reason."""
        streams = self._source is not None and not self.paused
        found = self._joint_trouble() or self._by_loop(streams) or self._interrupted()
        if found is not None:
            return found
        samples = self._samples
        if self._turns:
            return Status.MOVING, ""
        if samples.far or self._by_law is not None:
            share = "" if self._by_law is not None else f", at most {self._share:.2g} of the speed limits"
            return Status.LATE, f"on the way to what is followed{share}"
        if self._source is not None:
            end = inf if samples.newest else max(self._when(self._source.end), reference.joined)
            return self._on_the_way(end, place)
        over = self._closed and not samples and self._next is None and self._still
        return (Status.DONE, "") if over else (Status.WAITING, self._why)

    def _interrupted(self) -> tuple[Status, Why] | None:
        """What is said of an arm that does not follow what is there to follow, None where it does."""
        wanted = self._turns or self._source is not None or self._chases
        if self.paused or (self._override == 0.0 and wanted):
            return (Status.PAUSED if self._still else Status.MOVING), "paused" if self.paused else "override is 0"
        if self._off > STRAYED and wanted:
            return Status.LATE, ELSEWHERE
        return (Status.DEGRADED, self._samples.dropped) if self._samples.dropped and wanted else None

    def _joint_trouble(self) -> tuple[Status, Why] | None:
        """What is said of joints that do not do what they are commanded to, None where all do."""
        if self._trouble is None:
            return None
        names, trouble = self.controller.robot.names, decoded(self._trouble)[0]
        return Status.DEGRADED, str(trouble._replace(names=tuple(names[j] for j in trouble.joints)))

    def _by_loop(self, streams: bool) -> tuple[Status, Why] | None:
        """What the loop says of the tick, None where nothing; a stream that its limits hold back is late instead."""
        answer = self._answer
        if answer is not None and answer.status in (Status.DEGRADED, Status.HELD):
            return answer.status, partial(getattr, answer, "reason")
        if streams:
            return None
        if answer is None or not (self._bound or (self._turns and answer.status is not Status.OK)):
            return None
        if self._bound:
            return Status.LIMITED, partial(_held_by, answer)
        status = Status.SCALED if answer.status is Status.SCALED else Status.LIMITED
        return status, partial(getattr, answer, "reason")

    def _on_the_way(self, end: float, place: float) -> tuple[Status, Why]:
        """The same while points or samples are followed, which end at a time."""
        several = self._given is not None and len(self._given[1]) > 1
        if several and self._last is not None and self._last[1] <= self._place < self._due:
            return Status.WAITING, "for newer points"
        missed = self._missed_at(place)
        stands = self._time >= end and self._still and not self._state.late
        if stands and self._next is None:
            far = f"the end is out of reach, by {missed:.3g} [length]"
            return (Status.BLOCKED, far) if missed > self._tolerance else (Status.DONE, "")
        if missed > self._tolerance:
            return Status.LEFT, f"out of reach, by {missed:.3g} [length]"
        if stands:
            return Status.WAITING, NOT_DUE
        if not (self._state.late or (several and isinstance(self._source, Motion) and place < self._source.eased)):
            return Status.MOVING, ""
        held = None if self._answer is None or not self._bound else partial(_held_by, self._answer)
        return Status.LATE, held or (LATE if self._override == 1.0 else SLOWER)

    def _missed_at(self, place: float) -> float:
        """By how much the points at a place are out of reach."""
        if self._given is None or self._missed is None:
            return 0.0
        i = int(np.clip(np.searchsorted(self._given[1], place), 0, len(self._missed) - 1))
        return float(self._missed[max(i - 1, 0) : i + 1].max())

    def _across(
        self,
        q: Array,
        sent: Array,
        measured: Array,
        place: float,
        points: tuple[Given, Array] | None,
        along: Array | None,
    ) -> float:
        """How far the tool is off the points wanted at a place, its joints as far from q (m,) as measured from sent.

        In contact that is along S, by a projector (6, 6).
        """
        if points is None:
            return nan
        q, (given, stamps) = q - (sent - measured), points
        robot = self.controller.robot
        T = given.pose_at(place, stamps, robot)
        error = se3.displacement(robot.pose(q), T)
        error = error if along is None else along.dot(error)
        J = robot.jacobian(q)
        v = self.controller.measure.root_for(J, robot.pose(q)).dot(error)
        return float(np.linalg.norm(v))


class PathFollower(Follower):
    """Drives the tool of a controller along one path, whose shape is kept; `step` is one tick.

    A `Follower(controller, keep="shape")` of one path, which may also be a function.
    """

    def __init__(
        self,
        loop: Controller | HybridController,
        path: Callable[[float], ArrayLike | Target] | ArrayLike | Sequence[ArrayLike | Target],
        *,
        end: float = 1.0,
        times: ArrayLike | None = None,
        rate: float | None = None,
        acceleration: float | None = None,
        jerk: float | None = None,
        joint_jerk: ArrayLike | None = None,
        blocked: Literal["stop", "leave"] = "stop",
        tolerance: float | None = None,
        corners: bool = False,
    ) -> None:
        """Fit the path; the joint motion along it is found by `prepare`, or in the first ticks.

        Args:
            loop: a velocity controller, or for a path in contact a hybrid one.
            path: the tool's pose (4, 4) as a function of a parameter in [0, end], or (n, 4, 4) poses on the way. In
                place of poses points (3,) of the tool frame's origin, or `Target`, all with the same left free: that
                follows the posture or moves as little as it can, and neither times nor lengths count it.
            end: of a function's parameter.
            times: (n,) the parameter of poses; None is their number, from 0. A function takes none.
            rate: how fast the parameter is meant to go [1/s], 1 where it is time; None is as fast as limits allow.
            acceleration: of the speed along the path; its unit is that of the parameter over s^2, or with rate=None
                [length/s^2]; None is as much as the joints allow.
            jerk: likewise, over s^3; None is no limit of jerk.
            joint_jerk: (m,) of the joints, or one for all [rad/s^3, length/s^3]; None is no limit.
            blocked: where the arm cannot reach the path: "stop" before it, or "leave" it by the least and rejoin it.
            tolerance: how near its end a tool is that is "done", in the controller's measure [length]; None is 1e-5 of
                the measure's length, the arm's reach. Noise in q needs more.
            corners: whether poses are joined by straight lines, at whose ends the tool stops to turn; otherwise a
                smooth curve leads through them, which swings out where they turn a corner.

        Raises:
            BadInput: not a path, fewer than two poses, times that do not increase or of a function, a path that
                stands still.
        """
        super().__init__(loop, keep="shape", jerk=joint_jerk, blocked=blocked, tolerance=tolerance)
        along: dict[str, Any] = {"end": end, "times": times, "rate": rate, "acceleration": acceleration, "jerk": jerk}
        along["corners"] = arrays.flag(corners, "corners")
        self._shape = self._shape_of(path, "path", **along, **self._options)

    @property
    def plan(self) -> PathPlan | None:
        """The joint motion along the path, None before it is found."""
        return self._kept_shape("plan").plan

    def pose(self, place: float) -> Array | Target:
        """(4, 4) the path's pose at a place, as solutions tell it; a `Target` where the path leaves something free.

        Raises:
            BadInput: not a number.
        """
        return self._kept_shape("place").given.pose(arrays.number(place, "place", "the path's parameter"))


def _held_by(answer: VelocitySolution) -> str:
    """What of the loop's an answer to a command says does not allow it."""
    price, name = answer.row_multipliers, "the tool's speed"
    if price is not None and price.any():
        name = row_name(int(np.abs(price).argmax()), tuple(answer.row_names))
    return f"held by {name}"


def _spline(stamps: Array, joints: Array) -> Motion:
    """The motion through joint positions (n, m), as smooth as they are."""
    return Motion(stamps, np.moveaxis(CubicSpline(stamps, joints).c[::-1], 0, 1))


def _along(stamps: Array, joints: Array, now: float) -> Array:
    """(3, m) the motion at a time straight from point to point (n, m), at rest before the first and after the last."""
    there = np.array([[np.interp(t, stamps, q) for q in joints.T] for t in (now - SAMPLING, now, now + SAMPLING)])
    return np.vstack((there[1], (there[2] - there[0]) / (2.0 * SAMPLING), np.zeros(joints.shape[1])))


def _none(**given: Any) -> None:
    """Refuse what counts in contact alone."""
    for name, value in given.items():
        if value is not None:
            raise BadInput(name, excerpt(value), "None without contact", "Give a HybridController as the loop.")


def _limits_of(loop: Controller, jerk: ArrayLike | None, rise: float) -> JointLimits:
    """A loop's limits; without a jerk limit the acceleration rises to its own in a time [s].

    Raises:
        BadInput: no jerk limits.
    """
    m, speed = len(loop.robot.names), loop.box.velocity_limit
    acceleration = 2.0 * np.minimum(speed, FASTEST) / loop.dt
    if loop.acceleration_limit is not None:
        acceleration = np.minimum(loop.acceleration_limit, acceleration)
    limits = acceleration / rise
    if jerk is not None:
        given = arrays.array(jerk, "jerk", "numbers above zero")
        limits = np.full(m, float(given)) if given.ndim == 0 else given.copy()
        if limits.shape != (m,) or not (limits > 0.0).all():
            raise BadInput("jerk", excerpt(jerk), f"{m} limits above zero [rad/s^3, length/s^3], or one for all")
    return JointLimits(loop.box.position_lower, loop.box.position_upper, speed, acceleration, limits, loop.dt)
