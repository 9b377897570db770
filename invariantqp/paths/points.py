"""Points with stamps, and functions of time: what of them is due, and the joint motion through it."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, pi
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_tracker import JointTracker
from invariantqp.paths.override import Override
from invariantqp.paths.reference import (
    JOINT_TOLERANCE,
    MIN_SPLICE_TICKS,
    Motion,
    Reference,
    TimedMotion,
    constant_motion,
)
from invariantqp.paths.smoothing import FADE_TIME, KNOT_SPACING, MAX_PIECES, MAX_POINTS, smoothed_motion
from invariantqp.paths.stamps import ANOTHER_CLOCK, MAX_STAMP_GAP
from invariantqp.paths.task_error import task_error
from invariantqp.paths.waypoints import STALL_TIME, WaypointIK, Waypoints, sampled

# A function of time is looked ahead so far [s], at places so far apart [s], and again when half of that is driven.
FUNCTION_HORIZON, FUNCTION_STEP = 1.0, 0.02
# With exact demands the law approaches points farther than this [rad, length] from the joints; so often [s] it is
# checked whether the joints are there.
FAR, RETRY = 0.1, 0.02


class PendingPoints(NamedTuple):
    """Points that are taken in later."""

    points: Waypoints
    stamps: Array | None  # (n,) [s]; None for the time when they are taken in
    when: float  # [s]
    is_other_motion: bool
    wait: float | None  # how long newer points are waited for [s], of the rest of points; None of new ones


class LastPoint(NamedTuple):
    """The point that the arm goes back to where no newer ones come."""

    q: Array  # (m,) joint positions
    stamp: float
    wait_until: float  # by the stamps


class LawApproach(NamedTuple):
    """Points that the law approaches, keeping exact demands."""

    points: Waypoints
    stamps: Array
    since: float


class PointInput:
    """Points and functions of time.

    Attributes:
        given: the points that are followed, or the last sample, and their stamps (n,).
        missed: (n,) by how much they are out of reach, None where none is [length].
        approach: the points that the law approaches, or None.
        is_complete: whether no newer points come.
    """

    def __init__(
        self, joints: JointTracker, ik: WaypointIK, override: Override, *, cutoff: float, tolerance: float
    ) -> None:
        """No points yet; cutoff [Hz] and tolerance [length] as in `Follower`."""
        self._joints, self._ik, self._override, self._tolerance = joints, ik, override, tolerance
        self._smoothing_time = max(0.5 / pi / cutoff, MIN_SPLICE_TICKS * joints.limits.dt)
        self._next: PendingPoints | None = None
        self._function: Callable[[float], Any] | None = None
        self._sampled_at = 0.0  # the stamp at which the function was sampled
        self._last: LastPoint | None = None
        self.given: tuple[Waypoints, Array] | None = None
        self.missed: Array | None = None
        self.approach: LawApproach | None = None
        self.is_complete = False

    def add(self, points: Waypoints, stamps: Array | None, when: float, *, is_other_motion: bool) -> None:
        """Points to be taken in at a time [s]."""
        self._next = PendingPoints(points, stamps, when, is_other_motion, None)

    def set_function(self, function: Callable[[float], Any], when: float) -> None:
        """A function of time, from a time [s] on."""
        self._function, self._sampled_at = function, when - FUNCTION_HORIZON

    def set_sample(self, point: Waypoints, stamp: float, missed: float) -> None:
        """A sample of a stream takes over."""
        self.given, self._last, self.approach = (point, np.array((stamp,))), None, None
        self.missed = np.array((missed,)) if missed > self._tolerance else None

    def clear_pending(self) -> None:
        """Drop points and functions that are not taken in yet."""
        self._next = self._function = self.approach = None

    def clear(self) -> None:
        """Drop the points that are followed."""
        self.given = self._last = None

    @property
    def is_pending(self) -> bool:
        """Whether points, a function or an approach are still to be followed."""
        return self.has_next or self._function is not None or self.approach is not None

    @property
    def has_next(self) -> bool:
        """Whether points are taken in later."""
        return self._next is not None

    @property
    def _return_stamp(self) -> float:
        """When the arm goes back to the last point, by the stamps."""
        return inf if self._last is None else self._last.stamp if self.is_complete else self._last.wait_until

    def until(self, reference: Reference) -> float:
        """Until when no more of the points is due [s]."""
        joints, time_of, pending = self._joints, self._override.time_of, self._next
        until = time_of(self._sampled_at + 0.5 * FUNCTION_HORIZON) if self._function else inf
        if joints.twist is None and self._last is not None:
            until = min(until, time_of(self._return_stamp))
        elif joints.twist is None and not joints.state.late:
            until = min(until, reference.end)
        if pending is not None:
            until = min(until, pending.when if pending.wait is None else time_of(pending.when))
        return until

    def take_due(self, reference: Reference, motion: TimedMotion | None) -> tuple[TimedMotion | None, str]:
        """The motion that is followed after one with what is due now, and why there is none where points are over."""
        override, pending, now = self._override, self._next, self._joints.time
        place = override.place
        if pending is not None and (now if pending.wait is None else place) >= pending.when:
            self._next = None
            if pending.wait is None:  # new points are due now
                override.scaling, place = None, now
            stamps = np.array((now,)) if pending.stamps is None else pending.stamps
            return self._take(reference, motion, pending._replace(stamps=stamps), stamps, place)
        if self._function is not None and place >= self._sampled_at + 0.5 * FUNCTION_HORIZON:
            stamps = np.arange(place - 8.0 * FUNCTION_STEP, place + FUNCTION_HORIZON, FUNCTION_STEP)
            self._sampled_at = place
            points = sampled(self._function, stamps, len(self._joints.limits.lower))
            return self._take_function(points, stamps, motion, place), ""
        if self._last is not None and place >= self._return_stamp:
            q, self._last = self._last.q, None
            override.jump(q)
            return constant_motion(q, place), ""
        return motion, ""

    def _take_function(self, points: Waypoints, stamps: Array, motion: TimedMotion | None, now: float) -> TimedMotion:
        """The motion through samples of a function."""
        near, before = self._near(motion, stamps) if isinstance(motion, Motion) else (self._joints.state.position, None)
        points = self._ik.with_poses(points, near, leaps=before is None)
        joints = self._joint_positions(points, stamps, near, before, now)
        self.given, self._last, self.approach = (points, stamps), None, None
        return Motion(stamps, np.moveaxis(CubicSpline(stamps, joints).c[::-1], 0, 1))

    def _near(self, motion: Motion, stamps: Array) -> tuple[Array, float]:
        """(m,) the joints of a motion one stamp before the first, and that stamp."""
        before = float(2.0 * stamps[0] - stamps[1])
        return motion.at((before,))[0, 0], before

    def _joint_positions(
        self, points: Waypoints, stamps: Array, near: Array, before: float | None, now: float
    ) -> Array:
        """(n, m) joint positions for points, whose speeds and jump are requested."""
        joints, missed = self._ik.points(points, near, stamps, before)
        speeds = np.abs(np.diff(joints, axis=0) / np.diff(stamps)[:, None]).max(axis=0, initial=0.0)
        self._override.input_speeds = speeds
        self._override.jump(joints[min(int(stamps.searchsorted(now)), len(stamps) - 1)])
        self.missed = missed if (missed > self._tolerance).any() else None
        return joints

    def _take(
        self, reference: Reference, motion: TimedMotion | None, taken: PendingPoints, stamps: Array, now: float
    ) -> tuple[TimedMotion | None, str]:
        """The motion through points with stamps (n,), from `now` on."""
        points, _, _, is_other_motion, wait = taken
        if now - stamps[-1] > ANOTHER_CLOCK and wait is None:
            return motion, "the points were over when they arrived"
        begin, last = float(stamps[0]), float(stamps[-1])
        if begin - now > MAX_STAMP_GAP:
            return motion, f"the points begin in {begin - now:.3g} s: stamps and now= are seconds of one clock"
        older = self.given[1] if not is_other_motion and self._last and self.given else None
        if older is not None and begin < older[0] and last <= older[-1]:
            return motion, ""  # newer points came before these
        # Newer ones may be as late as these and, in a stream, lost for as long as these last: until then the arm does
        # not go back to the last of them.
        wait = max(now, now if self.given is None else last) - begin if wait is None else wait
        taken = taken._replace(wait=wait)
        chosen = self._within_reach(taken, stamps, now)
        points, stamps = points.chosen(chosen), stamps[chosen]
        if not len(stamps):
            return motion, f"the points begin in {begin - now:.3g} s"
        near, before = self._joints.state.position, None
        updated = motion if isinstance(motion, Motion) and len(stamps) > 1 and not is_other_motion else None
        if updated is not None:  # points out of reach, too, go on from there
            near, before = self._near(updated, stamps)
        points = self._ik.with_poses(points, near, leaps=before is None)
        joints = self._joint_positions(points, stamps, near, before, now)
        if updated is not None and older is not None and min(older[-1], last) > now:
            _blend(joints, updated.at(stamps)[:, 0], stamps, older[-1], now, last)
        self.given, self._last = (points, stamps), LastPoint(joints[-1], last, last + wait)
        approach = self.approach
        if self._leaves_exact(points, joints, int(stamps.searchsorted(now))):
            self._override.request(self._override.input_speeds)
            since = self._joints.time if approach is None else approach.since
            self.approach, self._last = LawApproach(points, stamps, since), None
            self._next = taken._replace(when=now + RETRY)
            return None, ""
        self.approach = None
        if approach is not None:
            state = _straight(stamps, joints, now)
        elif isinstance(motion, Motion) and (updated is not None or self._override.value < 1.0):
            state = motion.at((now,))[0, :3]  # though the arm may be behind it
        else:
            state = self._joints.motion(reference)
        unbounded = np.full(len(near), inf)  # the joints keep their position limits where the plan leaves them a little
        limits = self._joints.limits._replace(lower=-unbounded, upper=unbounded)
        return smoothed_motion(state, now, stamps, joints, limits, self._smoothing_time), ""

    def _within_reach(self, taken: PendingPoints, stamps: Array, now: float) -> slice:
        """The points that are planned now; the rest of them is taken in when half of these are driven.

        From the one before now on as far as a plan reaches; of the last some that determine the extrapolation.
        """
        reach = MAX_PIECES * KNOT_SPACING * self._smoothing_time
        first = max(int(stamps.searchsorted(min(now, stamps[-1] - 4.0 * FADE_TIME), side="right")) - 1, 0)
        end = min(first + MAX_POINTS, int(stamps.searchsorted(now + reach, side="right")))
        if end < len(stamps):
            due = float(stamps[(first + end) // 2])
            self._next = taken._replace(when=due if now < due < now + reach else now + 0.25 * reach)
        return slice(first, end)

    def _leaves_exact(self, points: Waypoints, joints: Array, due: int) -> bool:
        """Whether the joint motion to the point that is due leaves exact demands, which the law keeps.

        The law leads there until the joints are near or, stuck with the exact demands met, at rest.
        """
        tracker, approach = self._joints, self.approach
        controller, q = tracker.controller, tracker.state.position
        if not controller.exact or points.poses is None:
            return False
        due = min(due, len(joints) - 1)
        if np.abs(joints[due] - q).max() <= (FAR if approach is None else JOINT_TOLERANCE):
            return False
        is_stuck = approach is not None and tracker.is_at_rest and tracker.time - approach.since > STALL_TIME
        if not is_stuck:
            return True
        return task_error(controller, q, controller.robot.target(points.poses[due])).off <= self._tolerance

    def approached(self, approach: LawApproach) -> tuple[Array, Array]:
        """The twist (6,) and the pose (4, 4) that the law approaches."""
        place, robot, dt = self._override.place, self._joints.controller.robot, self._joints.limits.dt
        now, soon = (approach.points.pose_at(place + t, approach.stamps, robot) for t in (0.0, dt))
        return se3.displacement(now, soon) / dt, now

    @property
    def waits_for_newer(self) -> bool:
        """Whether the last of several points is passed and the arm waits there for newer ones."""
        last = self._last
        return self.has_several and last is not None and last.stamp <= self._override.place < self._return_stamp

    @property
    def has_several(self) -> bool:
        """Whether more than one point is followed."""
        return self.given is not None and len(self.given[1]) > 1

    def missed_at(self, stamp: float) -> float:
        """By how much the points at a stamp are out of reach [length]."""
        if self.given is None or self.missed is None:
            return 0.0
        i = int(np.clip(np.searchsorted(self.given[1], stamp), 0, len(self.missed) - 1))
        missed = float(self.missed[max(i - 1, 0) : i + 1].max())
        return missed if missed > self._tolerance else 0.0


def _blend(joints: Array, before: Array, stamps: Array, older_end: float, now: float, last: float) -> None:
    """Blend new joint positions (n, m) with those of the motion `before` (n, m), of which 0 is left at the last stamp.

    Beyond the end of the older points the difference stays as it is there.
    """
    both = int(stamps.searchsorted(older_end, side="right"))
    if both:
        difference = before - joints
        difference[both:] = difference[both - 1]
        joints += ((last - np.maximum(stamps, now)) / (last - now))[:, None] * difference


def _straight(stamps: Array, joints: Array, now: float) -> Array:
    """(3, m) the motion at a time straight from point to point (n, m), at rest before the first and after the last."""
    times = now - FUNCTION_STEP, now, now + FUNCTION_STEP
    there = np.array([[np.interp(t, stamps, q) for q in joints.T] for t in times])
    return np.vstack((there[1], (there[2] - there[0]) / (2.0 * FUNCTION_STEP), np.zeros(joints.shape[1])))
