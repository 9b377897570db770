"""Follow inputs over time: points and functions, samples of a stream, twists, paths whose shape is kept.

    input -> a joint motion in stamp time (`reference`) -> a tick inside all limits (`joint_limits`)

A new input is joined by a splice from the motion that the arm has. What joints cannot do inside their limits is caught
up, and a stop is the twist zero. No tick is taken from which the joints cannot stop.
"""

from __future__ import annotations

from copy import deepcopy
from math import nan
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.control import HybridController
from invariantqp.force.wrench import Wrench
from invariantqp.geometry import arrays, sizes
from invariantqp.geometry.arrays import Array
from invariantqp.paths.contact import ContactInput, PathInContact, StreamInContact
from invariantqp.paths.joint_tracker import JointTracker, RepeatedTick, limits_of
from invariantqp.paths.path_drive import PathDrive
from invariantqp.paths.path_input import PathInput
from invariantqp.paths.reference import Reference
from invariantqp.paths.solution import FollowerSolution
from invariantqp.paths.stamps import checked_stamps, warn_if_milliseconds
from invariantqp.paths.timed_inputs import TimedInputs
from invariantqp.paths.waypoints import POSE_TOLERANCE, WaypointIK, Waypoints, sampled
from invariantqp.velocity.solution import Status

# Without a jerk limit of its own a joint reaches its full acceleration in this time [s], a usual setting of a UR5.
JERK_RISE = 0.02
# A clock that differs by more than this from the sum of the ticks [s] has jumped.
CLOCK_TOLERANCE = 0.02
# The largest override of a path whose shape is kept.
MAX_PATH_OVERRIDE = 1.5


class Follower:
    """Drives the arm of a controller along inputs that come over time; `step` is one tick.

    With a hybrid controller the tool presses all the while. An input then counts along the freedoms of the contact
    alone: its depth neither presses nor lifts the tool, and force and approach are the hybrid controller's. A stream
    keeps its time and does not wait for the touch; its status is "lost" while there is no contact.

    Attributes:
        controller: whose arm, limits, exact demands and measure hold; nobody else may step it.
        jerk: (m,) of the joints [rad/s^3, length/s^3].
        cutoff: as given [Hz].
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
        """A follower without an input: the arm stands still.

        Args:
            loop: a controller, or for motion in contact a hybrid controller; where time is kept with an acceleration
                limit.
            keep: "time": the tool meets points at their stamps, and points in the past are skipped (policies, hands);
                "shape": the tool stays on the path through the points, and is late if limits require it.
            rate: playback speed of the stamps if the shape is kept; 1 keeps them.
            jerk: (m,) or one for all joints [rad/s^3, length/s^3]; None lets the acceleration rise to its limit in
                20 ms, and at once where the shape is kept.
            cutoff: the frequency above which motion is smoothed away where time is kept [Hz]; inf smooths nothing.
            timeout: how long after the last sample or twist the arm begins to stop [s]. For a stream that is slow this
                becomes five of its intervals, once these are observed, but at most 0.5 s.
            approach: the share of the joints' speed limits that is used at most on the way to a stream of samples from
                where the arm is: to its first sample, after a gap or a stop; 1 uses all of them.
            drop_outliers: whether one sample is dropped that joints at their speed limits could not reach in the time
                since the sample before; of two in a row the second is followed.
            blocked: if the shape is kept and the arm cannot reach it: "stop" before it, or "leave" it by
                the least deviation.
            tolerance: how far off a pose is out of reach [length]; None is 1e-4 of the arm's length. Where the shape is
                kept, as in `PathFollower`.

        Raises:
            BadInput: not a Controller, one without an acceleration limit where time is kept or joints have a jerk
                limit, or a number that is not positive.
        """
        self._keeps_shape = arrays.choice(keep, "keep", ("time", "shape")) == "shape"
        self._path_contact: PathInContact | None = None
        self._stream_contact: StreamInContact | None = None
        if isinstance(loop, HybridController) and not self._keeps_shape:
            self._stream_contact = StreamInContact(loop)
            inner = self._stream_contact.controller
        elif isinstance(loop, HybridController):
            inner = Controller(loop.robot, **loop.loop.options)
            self._path_contact = PathInContact(loop, inner)
        elif isinstance(loop, Controller):
            inner = Controller(loop.robot, **loop.options)
        else:
            raise BadInput("loop", excerpt(loop), "a Controller, or a HybridController")
        if inner.acceleration_limit is None and (not self._keeps_shape or jerk is not None):
            expected = f"{type(loop).__name__}(acceleration_limit=...)"
            raise BadInput("loop", "one without an acceleration limit", expected)
        self.controller = inner
        self._m = m = len(inner.robot.names)
        limits = limits_of(inner, jerk, rise=0.5 * inner.dt if self._keeps_shape else JERK_RISE)
        self.jerk: Array = limits.jerk
        self._path_options: dict[str, Any] = {
            "joint_jerk": np.full(m, np.inf) if jerk is None else self.jerk,
            "blocked": arrays.choice(blocked, "blocked", ("stop", "leave")),
            "tolerance": tolerance,
        }
        self._rate = arrays.number(rate, "rate", "a share of the stamps' speed", positive=True)
        self.cutoff: float = arrays.number(cutoff, "cutoff", "a frequency in Hz", positive=True, infinite=True)
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        share = arrays.number(approach, "approach", "a share of the speed limits, up to 1", positive=True)
        if share > 1.0:
            raise BadInput("approach", f"{share:g}", "a share of the speed limits, up to 1")
        drops = arrays.flag(drop_outliers, "drop_outliers")
        reached = POSE_TOLERANCE * inner.measure.length
        if tolerance is not None:
            reached = arrays.number(tolerance, "tolerance", "a distance", positive=True)
        self.paused: bool = False
        self._joints = JointTracker(inner, limits)
        self._ik = WaypointIK(inner, reached)
        self._timed = TimedInputs(
            self._joints, self._ik, cutoff=self.cutoff, timeout=self.timeout, approach=share, drop_outliers=drops,
            tolerance=reached, contact=self._stream_contact,
        )  # fmt: skip
        self._path: PathInput | None = None
        self._repeated: RepeatedTick | None = None

    def __copy__(self) -> Follower:
        return deepcopy(self)  # with a state of its own

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_repeated": None}

    # Inputs

    def follow(self, points: Any, stamps: ArrayLike | None = None, *, at: float | None = None) -> None:
        """Follow points, or a function of time, in place of the input before.

        The arm joins them from the motion it has, with bounded jerk. Points with stamps update the motion of those
        before them, as the chunks of a policy do: where the two overlap the new ones are blended in, from no share now
        to all at their end. With `at` they are another motion, and take over at once. Of updates that arrive in the
        wrong order the newest is followed. For a second, points that are over still give the last of them as a goal.

        Args:
            points: (n, 4, 4) poses in the base frame, (n, m) joint positions, or a function of time [s] that returns
                one pose or one position. Or points (n, 3) for the tool frame's origin, of an arm without three joints,
                or a list of `Target`; motion that they leave free is as little as possible. Where the shape is kept:
                two or more, no joint positions, and all with the same left free.
            stamps: (n,) when each is wanted [s], increasing, by the clock of `step`'s `now`; of a function, none. One
                point is a goal: without a stamp it is wanted now. Where the shape is kept they may be left out: the
                joints then go as fast as their limits let them.
            at: when to go over to another motion [s], `now` for at once; None is now, as an update of the same.

        Raises:
            BadInput: neither poses nor joints, NaN, no rigid motion, stamps that do not increase; the follower is as it
                was.
        """
        self._open("points")
        when = self._joints.time if at is None else arrays.number(at, "at", "a time in seconds")
        if self._keeps_shape:
            self._follow_path(points, stamps, at)
            return
        inputs = self._timed.points
        if callable(points):
            if stamps is not None:
                raise BadInput("stamps", "stamps for a function", "none: it is a function of time")
            self._plausible(sampled(points, np.array((when,)), self._m), "points")
            self._replace()
            inputs.set_function(points, when)
            return
        given = self._plausible(Waypoints(points, self._m, "points"), "points")
        if stamps is None and len(given) > 1:
            raise BadInput("stamps", "None", f"({len(given)},) times in seconds, one for each point, increasing")
        times = None if stamps is None else checked_stamps(stamps, len(given))
        if times is not None:
            warn_if_milliseconds(times, given, self._joints.limits.velocity, self.controller.measure.length)
        approach = inputs.approach
        self._replace()
        inputs.add(given, times, when, is_other_motion=at is not None)
        inputs.approach = approach

    def _follow_path(self, points: Any, stamps: ArrayLike | None, at: float | None) -> None:
        """Follow points along the path through them."""
        if callable(points) or at is not None:
            what = 'a function, or `at`, with keep="shape"'
            raise BadInput("points", what, "poses (n, 4, 4)", "PathFollower takes functions.")
        given = self._plausible(Waypoints(points, self._m, "points"), "points")
        if given.joints is not None or len(given) == 1:
            expected = 'two poses (n, 4, 4) or targets, or more, with keep="shape"'
            raise BadInput("points", excerpt(points), expected)
        times = None if stamps is None else checked_stamps(stamps, len(given))
        rate = None if stamps is None else self._rate
        path = self._path_input(given.targets if given.poses is None else given.poses, "points", times=times, rate=rate)
        self._replace()
        self._timed.halt()
        self._path = path

    def _path_input(self, path: Any, name: str, **options: Any) -> PathInput:
        """A path whose shape is kept."""
        loop = self.controller
        drive = PathDrive(loop, path, **options, **self._path_options)
        needs_pose = self._path_contact is not None or loop.form is not None or loop.exact
        if needs_pose and drive.given.curve.part is not None:
            expected = "poses (n, 4, 4) beside a form, exact demands or a contact"
            raise BadInput(name, "targets that leave something free", expected, "These need the whole pose.")
        return PathInput(drive, self._joints, self._ik, self._timed.override)

    def add(self, point: Any, stamp: float | None = None) -> None:
        """One more point of a stream, as a hand's tracker sends them; one alone is a stream that ended (`timeout`).

        Args:
            point: (4, 4) pose in the base frame, a `pinocchio.SE3`, (m,) joint positions; or what leaves the rest of
                the pose free: a `Target` or, of an arm without three joints, a point (3,) for the tool frame's origin.
            stamp: when it was so [s], by the clock of `step`'s `now`; None is now. A sample older than the newest is
                dropped; stamps more than a second off are of another clock, and time runs on from them.

        Raises:
            BadInput: neither a pose nor joint positions, NaN; the follower is as it was.
        """
        self._open("point")
        if self._keeps_shape:
            raise BadInput("point", "a stream where the shape is kept", 'keep="time", or a whole path by follow()')
        given = self._plausible(Waypoints([arrays.pose_matrix(point)], self._m, "point"), "point")
        self._timed.add_sample(given, None if stamp is None else arrays.number(stamp, "stamp", "a time in seconds"))

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
        repeated, frame = self._repeated, arrays.choice(at, "at", ("tool", "base"))
        self._open("v")
        wanted = sizes.bounded_twists(arrays.twist(v, "v")).copy()
        if self._path_contact is not None:
            raise BadInput("v", 'a twist in contact with keep="shape"', 'keep="time", or a path: follow(poses)')
        if not self._timed.has_twist:
            self._replace()
            self._timed.halt()
        until = self._timed.set_twist(wanted, frame)
        if repeated is not None and until > -np.inf:  # the same tick, for longer
            self._repeated = repeated._replace(until=until)

    def prepare(self, q: ArrayLike) -> None:
        """Find the joint motion along a path whose shape is kept now, from joint positions near its start.

        It takes about a tenth of a second, several times that where exact demands cannot be met. Without it the first
        ticks find it, a little in each, while the arm waits.

        Args:
            q: (m,) joint positions [rad, length]; where the path starts out of reach, those from which to approach it,
                at best the nearest, `solve_pose(robot, pose, form=tool_metric(robot)).q`.

        Raises:
            BadInput: no such path, NaN, a wrong shape, or positions that cannot be true.
        """
        self._driven_path("prepare").prepare(self.controller.checked_positions(q))

    def reverse(self) -> None:
        """Come to rest on a path whose shape is kept, and drive it in the other direction.

        Raises:
            BadInput: no such path.
        """
        drive = self._driven_path("reverse")
        self._repeated = None
        drive.back = not drive.back

    def close(self) -> None:
        """No more input comes: where all of it is driven, the arm is "done"."""
        self._repeated = None
        self._timed.points.is_complete = True

    def pause(self) -> None:
        """Come to rest, and stay."""
        self._repeated = None
        self.paused = True

    def resume(self) -> None:
        """Go on after a pause: with the input that is due then or, where the shape is kept, from where it was."""
        self._repeated = None
        self.paused = False

    def _driven_path(self, argument: str) -> PathDrive:
        if self._path is None:
            raise BadInput(argument, "no path whose shape is kept", 'follow(poses) with keep="shape"')
        return self._path.drive

    def _open(self, argument: str) -> None:
        self._repeated = None
        if self._timed.points.is_complete:
            raise BadInput(argument, "more after close()", "a new Follower")

    def _plausible(self, given: Waypoints, argument: str) -> Waypoints:
        """Waypoints that the arm can reach or nearly; those in degrees or millimetres are refused."""
        if len(given.places):
            self.controller.limits.require_near(given.places, argument)
        for q in () if given.joints is None else (given.joints.min(axis=0), given.joints.max(axis=0)):
            self.controller.checked_positions(q, argument)
        return given

    def _replace(self) -> None:
        """Another input takes over."""
        self._timed.replace()
        if self._path is not None:
            self._path = None
            self._timed.halt()

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
            velocity: (m,) joint velocity now, where it differs from the last command: of an arm that moves when it is
                first stepped, after a push or an emergency stop. None is the last command.
            now: the time [s], by the clock of the stamps; None counts ticks.
            override: share of the requested speed, 0 to 1, which may change in every tick; 0 stops; along a path up to
                1.5, where limits allow it.
            wrench: in contact, as in `HybridController.step`, and so are the next two.
            contact: the contact now; None takes the task's.
            wanted: the wrench to exert in this tick; None takes the task's.

        Returns:
            FollowerSolution: its velocity, and that of the next ticks to a stop, is inside the limits.

        Raises:
            BadInput: NaN, wrong shapes; the follower is as it was.
        """
        clock = None if now is None else arrays.number(now, "now", "a time in seconds")
        repeated, time = self._repeated, self._joints.time
        if (
            repeated is not None
            and velocity is None
            and override == self._timed.override.value
            and time < repeated.until
            and (clock is None or abs(clock - time) <= CLOCK_TOLERANCE)
        ):
            solution = self._repeat(repeated, q)
            if solution is not None:
                return solution
        self._repeated = None
        share = self._checked_override(override)
        in_contact = (wrench, contact, wanted)
        if self._stream_contact is not None:
            return self._step_stream_in_contact(self._stream_contact, q, velocity, clock, share, in_contact)
        if self._path_contact is None:
            _refuse_contact(wrench=wrench, contact=contact, wanted=wanted)
        joints, path = self._joints, self._path
        state, limits = joints.state, joints.limits
        measured, before, wrong = joints.observe(q, velocity)
        if self._path_contact is not None:
            return self._step_path_in_contact(self._path_contact, measured, before, clock, share, in_contact)
        jumps = path is None and bool((np.abs(before - state.command) > limits.dt * limits.acceleration).any())
        state.command = before
        if wrong:
            return self._hold(wrong, clock)
        restarts = state.unresponsive != ()
        if jumps or restarts:  # the velocity is not that of the commands
            joints.reference, state.change = None if jumps else joints.reference, np.zeros(self._m)
        if path is not None and not path.is_driving and (joints.reference is None or not state.velocity.any()):
            if path.drive.plan is None:
                return path.approach(measured, clock, share, self.paused)
            measured = path.begin(measured, clock)
        reference = self._begin(measured, clock, restarts=restarts)
        command = self._move(reference, measured, share)
        self._repeated = self._repeatable(reference)
        return self._input.solution(reference, measured, command, self.paused)

    @property
    def _input(self) -> TimedInputs | PathInput:
        """The inputs that decide on the tick; those with stamps also stop the arm before it goes to a path."""
        return self._path if self._path is not None and self._path.is_driving else self._timed

    def _checked_override(self, value: float) -> float:
        most = 1.0 if self._path is None else MAX_PATH_OVERRIDE
        share = arrays.not_negative(value, "override", f"a share of the speed, 0 to {most:g}")
        if share > most:
            raise BadInput("override", f"{share:g}", f"a share of the speed, 0 to {most:g}")
        return share

    def _repeat(self, repeated: RepeatedTick, q: ArrayLike) -> FollowerSolution | None:
        """A tick without a new input; None, and nothing has changed, where Python has to decide."""
        joints, inputs = self._joints, repeated.inputs
        goal, before = inputs.goal(self.paused), joints.time
        found = joints.repeat(repeated, goal, q)
        if found is None:
            return None
        fields, measured = found
        joints.time = before + joints.limits.dt
        if fields[3] is not None or (goal[4] and before < repeated.reference.splice_end):
            self._repeated = self._repeatable(repeated.reference)
        solution: FollowerSolution
        if fields[2] < repeated.plain_until and joints.fault is None:
            solution = inputs.plain_solution(fields, measured)
        else:
            solution = inputs.solution(repeated.reference, measured, fields[0], self.paused)
        return solution

    def _repeatable(self, reference: Reference) -> RepeatedTick | None:
        """What the next ticks repeat; None where each of them decides."""
        path, inputs = self._path, self._input
        until = inputs.repeats_until(reference) if path is None or inputs is path else -np.inf
        if until <= self._joints.time:
            return None
        plain_until = -np.inf if path is None else path.drive.plain_until
        return RepeatedTick(reference, self._tracked(reference), until, inputs, plain_until)

    def _begin(self, measured: Array, clock: float | None, *, restarts: bool) -> Reference:
        """The reference of a tick: a new one at first, where it restarts, or where the arm was pushed."""
        joints, inputs = self._joints, self._input
        reference = joints.reference
        if reference is None:
            if clock is not None:
                self._set_clock(clock)
            if isinstance(inputs, PathInput) and inputs.resume(measured) and joints.reference is not None:
                return joints.reference
        else:
            if clock is not None and abs(clock - joints.time) > CLOCK_TOLERANCE:
                by = clock - joints.time
                self._set_clock(clock)
                inputs.clock_jumped(reference, by)
            joints.state.send()
            if not inputs.is_pushed(measured) and inputs.goes_on(reference, restarts=restarts):
                return reference
        reference = joints.restart(measured)
        inputs.restarted(reference)
        return reference

    def _set_clock(self, clock: float) -> None:
        """Count from another time [s] on."""
        self._timed.shift_clock(clock - self._joints.time)
        self._joints.time = clock

    def _move(self, reference: Reference, measured: Array, override: float) -> Array:
        """(m,) the command of a tick along a reference, inside the limits."""
        joints, inputs = self._joints, self._input
        inputs.update(reference, override, self.paused)
        goal = inputs.goal(self.paused)
        fields = joints.tick(self._tracked(reference), goal, measured)
        if fields[0] is None and isinstance(inputs, PathInput):
            inputs.wait(reference, 1.0 - fields[5])
            fields = joints.tick(self._tracked(reference), goal, measured, has_waited=True)
        joints.finish(fields, reference, goal[4])
        joints.time += joints.limits.dt
        return np.asarray(fields[0])

    def _tracked(self, reference: Reference) -> Any:
        """The reference as the engine takes it."""
        keeps_shape = self._path is not None
        gain = self.controller.gain if keeps_shape else self._timed.gain(self.paused)
        return reference.tracked(self._joints.bounds, gain, keeps_shape=keeps_shape)

    def _hold(self, reason: str, clock: float | None) -> FollowerSolution:
        """A tick of implausible joint positions: wherever they may be, to rest as soon as they may."""
        joints, dt, place = self._joints, self._joints.limits.dt, nan
        joints.reference = None
        joints.time = (joints.time if clock is None else clock) + dt
        if self._path is not None:
            drive = self._path.drive
            place = drive.place(joints.time - dt)
            if drive.motion is not None:
                drive.stopped(joints.time)
        command = joints.stop()
        return FollowerSolution(command, Status.HELD, reason, (place, 0.0, 0.0), lambda: np.inf, "joint positions")

    def _step_path_in_contact(
        self,
        contact: PathInContact,
        measured: Array,
        before: Array,
        clock: float | None,
        override: float,
        given: ContactInput,
    ) -> FollowerSolution:
        """A tick along a path in contact."""
        joints, drive = self._joints, self._driven_path("step")
        time = joints.time if clock is None else clock
        kept = drive.motion, drive.plan
        try:
            solution = contact.step(drive, measured, before, time, override, given, paused=self.paused)
        except BadInput:  # the follower is as it was
            drive.motion, drive.plan = kept
            raise
        joints.time = time + joints.limits.dt
        joints.set_command(solution.velocity)
        return solution

    def _step_stream_in_contact(
        self,
        contact: StreamInContact,
        q: ArrayLike,
        velocity: ArrayLike | None,
        clock: float | None,
        override: float,
        given: ContactInput,
    ) -> FollowerSolution:
        """A tick of a stream in contact: the pressed arm follows a reference arm, which goes on along the stream."""
        joints, positions = self._joints, arrays.vector(q, self._m, "q")
        state = joints.state
        before = None if velocity is None else arrays.vector(velocity, self._m, "velocity")
        command = contact.command if before is None else before
        answer = contact.step(positions, before, state, given)
        at, tracking = state.position, contact.tracking
        if tracking.restarts:
            joints.reference, at = None, tracking.measured
            state.command, state.change = command, np.zeros(self._m)
        if wrong := self.controller.limits.implausible(positions):
            held = self._hold(str(wrong), clock)
            contact.sent()
            return contact.solution(held, answer)
        reference = self._begin(at, clock, restarts=False)
        self._move(reference, at, override)
        contact.sent(state.position)
        measured = state.sent - tracking.joint_error
        solution = self._timed.solution(reference, measured, answer.velocity, self.paused)
        return contact.solution(solution, answer)


def _refuse_contact(**given: Any) -> None:
    """Refuse arguments that count in contact alone."""
    for name, value in given.items():
        if value is not None:
            raise BadInput(name, excerpt(value), "None without contact", "Give a HybridController as the loop.")
