"""Inputs that keep their time: points, functions, samples and twists, of which the newest is followed."""

from __future__ import annotations

from functools import partial
from math import inf, nan
from typing import Any, Literal

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.paths.contact import StreamInContact
from invariantqp.paths.joint_limits import speed_scale
from invariantqp.paths.joint_tracker import SAMPLE_SPLICE, SPLICE, JointTracker
from invariantqp.paths.override import CATCH_UP_RATIO, Override
from invariantqp.paths.points import PointInput
from invariantqp.paths.reference import JOINT_GAIN, JOINT_TOLERANCE, Motion, Reference, RetimedMotion, TimedMotion
from invariantqp.paths.samples import SampleStream
from invariantqp.paths.solution import FollowerSolution, Reason
from invariantqp.paths.stamps import Arrivals
from invariantqp.paths.task_error import STILL
from invariantqp.paths.waypoints import WaypointIK, Waypoints
from invariantqp.velocity.solution import Status

# Why joints catch up, or are off what they follow.
JOINT_LIMITS, OVERRIDE = "the joints' limits", "the override"
OFF_COMMAND = "joint tracking error: joints do not follow, or with more delay than delay="
# Why an arm stands that is not done.
NOT_DUE = "the next points are not due yet"


class TimedInputs:
    """Points, functions, samples and twists; where there is none the arm comes to rest.

    Attributes:
        points, samples: the inputs that give a joint motion.
        override: how fast they are followed.
        has_twist: whether a twist is followed.
        reason: why there is nothing to follow.
    """

    def __init__(
        self,
        joints: JointTracker,
        ik: WaypointIK,
        *,
        cutoff: float,
        timeout: float,
        approach: float,
        drop_outliers: bool,
        tolerance: float,
        contact: StreamInContact | None,
    ) -> None:
        """Nothing to follow; the options are those of `Follower`, `contact` is where the tool presses."""
        self._joints, self._ik, self._approach = joints, ik, approach
        self._tolerance, self._contact = tolerance, contact
        self.override = Override(joints, approach)
        self.points = PointInput(joints, ik, self.override, cutoff=cutoff, tolerance=tolerance)
        self.samples = SampleStream(joints.controller, ik, cutoff=cutoff, timeout=timeout, drop_outliers=drop_outliers)
        self.motion: TimedMotion | None = None  # of points or samples
        self.reason = "nothing to follow yet"
        self._arrivals = Arrivals(timeout, timeout)  # of twists
        self._twist: Array = STILL
        self._twist_at: Literal["tool", "base"] = "tool"
        self.has_twist = False

    # Inputs

    def replace(self) -> None:
        """Another input takes over from those that are pending."""
        self.points.clear_pending()
        self.samples.clear()
        if self.has_twist:
            self.halt()

    def halt(self) -> None:
        """Come to rest from the motion that the arm has now."""
        joints = self._joints
        joints.twist, joints.bounds, joints.state.late = STILL, joints.limits, False
        self.has_twist, self.motion, self.override.requested_motion = False, None, None
        self.points.clear()

    def add_sample(self, point: Waypoints, stamp: float | None) -> None:
        """One more sample of a stream."""
        if self.points.is_pending or self.has_twist:
            self.replace()
        self.samples.add(point, stamp)

    def set_twist(self, twist: Array, at: Literal["tool", "base"]) -> float:
        """Move at a twist (6,); until when [s], -inf where it is the first."""
        goes_on = self.has_twist
        self._arrivals.add(self._joints.time)
        self._twist, self._twist_at, self.has_twist = twist, at, bool(twist.any())
        self._joints.twist = twist if self.override.value > 0.0 else STILL
        return self._joints.time + self._arrivals.timeout if goes_on else -inf

    def shift_clock(self, by: float) -> None:
        """Count from another time on; the last items came as long ago as by the time before."""
        self._arrivals.last += by
        self.samples.arrivals.last += by

    # A tick

    def clock_jumped(self, reference: Reference, by: float) -> None:  # noqa: ARG002 (of all inputs)
        """The clock of `now` differs from the ticks: the same motion is joined at its new time."""
        joints = self._joints
        if joints.twist is None:
            joints.state.late = not reference.splice(reference.motion, joints.time, joints.through_ticks, SPLICE)

    def is_pushed(self, measured: Array) -> bool:
        """Whether joints at measured positions (m,) have been pushed."""
        return self._joints.is_pushed(measured)

    def goes_on(self, reference: Reference, *, restarts: bool) -> bool:  # noqa: ARG002
        """Whether a reference is followed on."""
        return not restarts

    def restarted(self, reference: Reference) -> None:  # noqa: ARG002
        """The reference begins at the arm: the inputs are joined anew."""
        if self.has_twist:
            return
        self._joints.twist, self.override.requested_motion = STILL, None
        self.samples.far = self.samples.newest is not None
        if self.motion is not None:
            self.override.jump(self.motion.at(np.array((self.override.place,)))[0, 0])

    def update(self, reference: Reference, override: float, is_paused: bool) -> None:
        """Take in what came since the last tick and what is due, and select what is tracked."""
        now, samples = self._joints.time, self.samples
        if override == 1.0 and not is_paused:
            self.override.scaling = None
        self.motion, reason = self.points.take_due(reference, self.motion)
        if samples:
            self._take_samples(reference)
        silence = now - samples.arrivals.last
        has_samples = samples.newest is not None and (self.motion is not None or samples.by_law)
        if has_samples and silence > samples.arrivals.timeout:
            self.motion, samples.far, reason = None, False, f"no sample for {silence:.2g} s"
        silence = now - self._arrivals.last
        if self.has_twist and (is_paused or silence > self._arrivals.timeout):
            self.has_twist, reason = False, "paused" if is_paused else f"no twist for {silence:.2g} s"
        self.reason = reason or self.reason
        self._select(reference, 0.0 if is_paused else override)

    def _take_samples(self, reference: Reference) -> None:
        """Take in the samples that wait."""
        samples, motion = self.samples, self.motion
        goes_on = samples.take(self._joints.time, self._joints.state.position)
        if samples.newest is None:
            return
        point, _, stamp = samples.newest
        self.points.set_sample(point, stamp, samples.missed)
        self.motion = samples.motion
        if goes_on and motion is not None and reference.motion is motion and samples.motion is not None:
            reference.motion = self.override.requested_motion = samples.motion

    def _select(self, reference: Reference, value: float) -> None:
        """Track the input that is followed now, at an override, or come to rest."""
        joints, override, motion, samples = self._joints, self.override, self.motion, self.samples
        is_stream = samples.newest is not None
        changes, again = override.set(value, is_stream=is_stream)
        if self.has_twist:
            joints.twist = self._twist if value > 0.0 else STILL
            return
        if motion is None or value == 0.0 or self._approaches_by_law:
            joints.twist, joints.state.late, joints.bounds = STILL, False, joints.limits
            return
        tracked = reference.motion
        same = joints.twist is None and motion is (tracked.base if isinstance(tracked, RetimedMotion) else tracked)
        if samples.far and same and not joints.state.late and joints.time >= reference.splice_end:
            samples.far, changes = False, True
        if not same or changes or value < 1.0:
            is_sampled = samples.smoother is not None
            joints.bounds = reference.limits = override.bounds(motion, is_stream=is_sampled, is_far=samples.far)
        if same and not changes:
            return
        override.requested_motion, scaling = motion, override.scaling
        slower = motion if scaling is None or isinstance(motion, RetimedMotion) else RetimedMotion(motion, scaling)
        if again and same:  # a splice that begins anew in each tick leads nowhere
            reference.switch(slower, joints.time)
            joints.state.late = True
        else:
            state = joints.motion(reference)
            joints.state.late = not reference.splice(slower, joints.time, state, SAMPLE_SPLICE if is_stream else SPLICE)
        joints.twist = None

    @property
    def _approaches_by_law(self) -> bool:
        """Whether the law approaches points or samples, keeping exact demands."""
        return self.samples.by_law or self.points.approach is not None

    def goal(self, is_paused: bool) -> tuple[Any, ...]:
        """The goal of a tick, as the engine takes it."""
        joints = self._joints
        kind, twist, speed, target = "motion", joints.twist, 1.0, None
        if self._approaches_by_law and self.override.value > 0.0 and not is_paused:
            kind, (twist, target, speeds) = "target", self._approached()
            joints.bounds = joints.limits.scaled(speeds / speed_scale(joints.limits.velocity))
        elif twist is not None:
            kind, speed = "twist", self.override.value
        twist = None if twist is None or not twist.any() else twist
        at_base = kind == "target" or self._twist_at == "base"
        if kind == "twist" and twist is not None and self._contact is not None:
            twist, at_base = self._contact.along(twist, at_base=at_base), True
        splice = joints.splice_time
        if splice and self.override.is_changing:
            splice = 0.0
        return kind, twist, at_base, speed, splice, joints.time, target

    def _approached(self) -> tuple[Array, Array, Array]:
        """The twist (6,) and the pose (4, 4) that the law approaches, and the joint speeds (m,)."""
        samples, limits = self.samples, self._joints.limits
        if self.points.approach is not None:
            return *self.points.approached(self.points.approach), self.override.approach_speeds()
        target, twist = samples.pose, samples.twist
        speeds = self._approach * limits.velocity
        if twist.any():  # or joints would not reach it
            needed = self._ik.displacement(target, self._joints.state.position, twist)
            speeds = np.maximum(speeds, CATCH_UP_RATIO * np.abs(needed))
        return twist, target, self.override.value * speeds

    def gain(self, is_paused: bool) -> float:
        """[1/s] at which joints are led back to where they were sent."""
        return JOINT_GAIN * (0.0 if is_paused else self.override.value)

    def repeats_until(self, reference: Reference) -> float:
        """Until when nothing is due [s]; -inf where each tick decides."""
        samples, joints = self.samples, self._joints
        if samples or self._approaches_by_law or (self.motion is None and joints.twist is None):
            return -inf
        until = self.points.until(reference)
        if self.has_twist:
            return min(until, self._arrivals.last + self._arrivals.timeout)
        if joints.twist is None and samples.newest is not None:
            until = min(until, samples.arrivals.last + samples.arrivals.timeout)
        return until

    # The report

    def solution(self, reference: Reference, measured: Array, command: Array, is_paused: bool) -> FollowerSolution:
        """The solution of a tick that began at measured positions (m,)."""
        joints, stream = self._joints, self.samples.smoother
        late = 0.0
        if stream is not None:
            late = stream.late
        elif joints.twist is None:
            late = joints.time - self.override.place
        place = joints.time - late if stream is not None or joints.twist is not None else self.override.place
        along, state = None if self._contact is None else self._contact.tracking.projector, joints.state
        q = state.position - (state.sent - measured)
        error = partial(_tool_error, joints.controller, q, self.points.given, place, along)
        status, reason = self._status(reference, place, is_paused)
        return FollowerSolution(command.copy(), status, reason, (place, late, 1.0), error)

    def _status(self, reference: Reference, place: float, is_paused: bool) -> tuple[Status, Reason]:
        """The status of a tick at a stamp, and its reason."""
        joints, samples = self._joints, self.samples
        is_motion = self.motion is not None and not is_paused
        found = joints.fault_status() or joints.loop_status(is_motion, self.has_twist) or self._interruption(is_paused)
        if found is not None:
            return found
        if self.has_twist:
            return Status.MOVING, ""
        if samples.far or self.points.approach is not None:
            share = "" if self.points.approach else f", at most {self._approach:.2g} of the speed limits"
            return Status.LATE, f"on the way to the input{share}"
        if self.motion is not None:
            end = inf if samples.newest else max(self.override.time_of(self.motion.end), reference.splice_end)
            return self._motion_status(end, place)
        is_done = self.points.is_complete and not samples and not self.points.has_next and joints.is_at_rest
        return (Status.DONE, "") if is_done else (Status.WAITING, self.reason)

    def _interruption(self, is_paused: bool) -> tuple[Status, Reason] | None:
        """The status of an arm that does not follow an input that it has, None where it does."""
        joints, value = self._joints, self.override.value
        has_input = self.has_twist or self.motion is not None or self._approaches_by_law
        if is_paused or (value == 0.0 and has_input):
            status = Status.PAUSED if joints.is_at_rest else Status.MOVING
            return status, "paused" if is_paused else "override is 0"
        if joints.error > JOINT_TOLERANCE and has_input:
            return Status.LATE, OFF_COMMAND
        return (Status.DEGRADED, self.samples.dropped) if self.samples.dropped and has_input else None

    def _motion_status(self, end: float, place: float) -> tuple[Status, Reason]:
        """The status while points or samples are followed, which end at a time [s]."""
        joints, points = self._joints, self.points
        if points.waits_for_newer:
            return Status.WAITING, "for newer points"
        missed = points.missed_at(place)
        stands = joints.time >= end and joints.is_at_rest and not joints.state.late
        if stands and not points.has_next:
            return (
                (Status.BLOCKED, f"the end is out of reach, by {missed:.3g} [length]") if missed else (Status.DONE, "")
            )
        if missed:
            return Status.LEFT, f"out of reach, by {missed:.3g} [length]"
        if stands:
            return Status.WAITING, NOT_DUE
        is_before = points.has_several and isinstance(self.motion, Motion) and place < self.motion.late_until
        if not (joints.state.late or is_before):
            return Status.MOVING, ""
        return Status.LATE, joints.limiting_row or (JOINT_LIMITS if self.override.value == 1.0 else OVERRIDE)


def _tool_error(
    controller: Controller, q: Array, points: tuple[Waypoints, Array] | None, place: float, along: Array | None
) -> float:
    """How far the tool of q (m,) is off the points at a stamp, in contact along S by a projector (6, 6) [length]."""
    if points is None:
        return nan
    robot = controller.robot
    T = points[0].pose_at(place, points[1], robot)
    error = se3.displacement(robot.pose(q), T)
    error = error if along is None else along.dot(error)
    return float(np.linalg.norm(controller.measure.root_for(robot.jacobian(q), robot.pose(q)).dot(error)))
