"""The samples of a stream: their clock, outliers, whether the arm is far from them, the joint motion along them.

A sample is an outlier where joints would exceed their speed limits on the way to it from the sample before. One alone
is dropped, a second in a row is accepted. The arm is far from a stream at its first sample and after a gap, until its
joints reach the samples; with exact demands also where no short joint motion leads from one sample to the next.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import speed_scale
from invariantqp.paths.reference import JOINT_TOLERANCE, Motion
from invariantqp.paths.smoothing import SampleSmoother
from invariantqp.paths.stamps import FIRST_TIMEOUT, Arrivals, SampleClock
from invariantqp.paths.waypoints import WaypointIK, Waypoints
from invariantqp.robots.kinematics import joint_displacement

# Samples that are taken in a tick at most, the newest: under a millisecond each.
MAX_WAITING = 8


class Sample(NamedTuple):
    """An accepted sample."""

    point: Waypoints  # one pose or one position
    q: Array  # (m,) joint positions for it
    stamp: float  # [s]


class SampleStream:
    """The samples of a stream.

    Attributes:
        newest: the newest accepted sample; None before the first.
        motion: the joint motion along the samples, None where there is none.
        smoother: of the samples as joint positions, None before the first.
        far: whether the arm is far from the newest sample.
        twist: (6,) at which the poses of the samples move [rad/s; length/s].
        missed: by how much the newest is out of reach [length].
        arrivals: when they arrived, and how long to wait for the next one.
        dropped: why the last sample was dropped, "" where it was accepted.
    """

    def __init__(self, loop: Controller, ik: WaypointIK, *, cutoff: float, timeout: float, drop_outliers: bool) -> None:
        """No samples yet; the options are those of `Follower`."""
        self._loop, self._ik, self._cutoff, self._drop_outliers = loop, ik, cutoff, drop_outliers
        self._fastest = speed_scale(loop.box.velocity_limit)
        self._waiting: deque[tuple[Waypoints, float | None]] = deque(maxlen=MAX_WAITING)
        self._clock = SampleClock()
        self._is_outlier = False  # whether the last sample was beyond the speed limits
        self.arrivals = Arrivals(timeout, max(timeout, FIRST_TIMEOUT))
        self.clear()

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def clear(self) -> None:
        """Drop the stream, and the samples that wait."""
        self._waiting.clear()
        self.newest: Sample | None = None
        self.motion: Motion | None = None
        self.smoother: SampleSmoother | None = None
        self.far = False
        self.twist: Array = np.zeros(6)
        self.missed, self.dropped = 0.0, ""

    def add(self, point: Waypoints, stamp: float | None) -> None:
        """One more sample, with its stamp [s], or None for now."""
        self._waiting.append((point, stamp))

    def take(self, now: float, q: Array) -> bool:
        """Take in the samples that wait, with the joints at q (m,); whether the motion along the samples goes on."""
        goes_on, has_new = self.motion is not None, False
        while self._waiting:
            point, given_stamp = self._waiting.popleft()
            stamp, is_other_clock = self._clock.time(given_stamp, now)
            before = None if is_other_clock else self.newest
            if before is not None and stamp <= before.stamp:
                continue
            if before is not None and stamp - before.stamp > self.arrivals.timeout:
                before = None
            point = self._ik.with_poses(point, q if before is None else before.q, leaps=before is None)
            if before is not None and self._drop_outliers and self._drops(point, stamp, before):
                continue
            self.arrivals.add(now)
            self.dropped, has_new = "", True
            goes_on = self._accept(point, stamp, before, now, q) and goes_on
        if has_new and self.smoother is not None and not self.by_law:
            self.motion = self.smoother.motion(self.motion if goes_on else None, now)
        return goes_on

    @property
    def pose(self) -> Array:
        """(4, 4) of the newest sample."""
        pose: Array = np.asarray(None if self.newest is None else self.newest.point.poses)[0]
        return pose

    @property
    def by_law(self) -> bool:
        """Whether the law approaches the newest sample, keeping exact demands."""
        return self.far and bool(self._loop.exact) and self.newest is not None and self.newest.point.poses is not None

    def _accept(self, point: Waypoints, stamp: float, before: Sample | None, now: float, q: Array) -> bool:
        """Accept a sample; whether the motion along the samples goes on."""
        keeps_exact = bool(self._loop.exact) and point.poses is not None
        near = q if before is None or (keeps_exact and self.far) else before.q
        joints, missed = self._ik.points(point, near, np.array((stamp,)), None if before is None else before.stamp)
        there, self.missed = joints[0], float(missed[0])
        if before is None or (keeps_exact and self.far):
            self.far = bool(np.abs(there - q).max() > JOINT_TOLERANCE)
        elif keeps_exact:
            self.far = bool((np.abs(there - before.q) > self._fastest * (stamp - before.stamp)).any())
        self.twist = np.zeros(6)
        if before is not None and point.poses is not None and before.point.poses is not None:
            self.twist = se3.displacement(before.point.poses[0], point.poses[0]) / (stamp - before.stamp)
        self.newest, transport = Sample(point, there, stamp), max(now - stamp, 0.0)
        if self.by_law:
            self.motion = None
        elif self.smoother is None:
            self.smoother = SampleSmoother(self._cutoff, self._loop.dt, stamp, there, transport)
        else:
            restarts = before is None or self.motion is None
            self.smoother.add(stamp, there, transport, restarts=restarts)
            return not restarts
        return False

    def _drops(self, point: Waypoints, stamp: float, before: Sample) -> bool:
        """Whether a sample is dropped: it is an outlier, and the one before it was not."""
        if point.poses is None:
            there = np.clip(np.asarray(point.joints)[0], self._loop.box.position_lower, self._loop.box.position_upper)
            displacement = joint_displacement(before.q, there, self._loop.turns)
        else:
            displacement = self._ik.displacement(point.poses[0], before.q)
        time = max(stamp - before.stamp, 0.0 if self.smoother is None else self.smoother.period)
        share = np.abs(displacement) / (self._fastest * time)
        self._is_outlier, was_outlier = bool((share > 1.0).any()), self._is_outlier
        if not self._is_outlier or was_outlier:
            return False
        j = int(share.argmax())
        name = self._loop.robot.names[j]
        self.dropped = f"a sample was dropped: joint {j} ({name}) would need {share[j]:.3g} times its speed limit"
        return True
