"""The samples of a stream: their clock, which of them is an outlier, whether the arm is far, the motion along them.

A sample is an outlier where joints would exceed their speed limits on the way to it from the sample before. One alone
is dropped, the next one is believed. The arm is far from a stream at its first sample and after a gap, until its joints
are where the samples are; with exact demands also where no short joint motion leads from one sample to the next.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import speed_scale
from invariantqp.paths.reference import JOINT_TOLERANCE, Motion, SampleSmoother
from invariantqp.paths.stamps import FIRST_TIMEOUT, Arrivals, SampleClock
from invariantqp.paths.waypoints import WaypointIK, Waypoints
from invariantqp.robots.kinematics import joint_displacement

# Samples that are taken in a tick at most, the newest: under a millisecond each.
MAX_WAITING = 8


class SampleStream:
    """What a stream has brought.

    Attributes:
        newest: the newest believed sample, the joint positions (m,) for it and its stamp [s]; None before the first.
        source: the joint motion along the samples, None where there is none.
        stream: the samples as joint positions, None before the first.
        far: whether the arm is far from the newest sample.
        twist: (6,) at which the poses of the samples move [rad/s; length/s].
        missed: by how much the newest is out of reach [length].
        arrivals: when they arrived, and how long to wait for the next one.
        dropped: why the last sample was dropped, "" where it was believed.
    """

    def __init__(self, loop: Controller, solver: WaypointIK, *, cutoff: float, timeout: float, drops: bool) -> None:
        """No samples yet; `drops` says whether outliers are dropped, the rest is as in `Follower`."""
        self._loop, self._solver, self._cutoff, self._drops = loop, solver, cutoff, drops
        self._fastest = speed_scale(loop.box.velocity_limit)
        self._waiting: deque[tuple[Waypoints, float | None]] = deque(maxlen=MAX_WAITING)
        self._clock = SampleClock()
        self._doubted = False  # whether the last sample was an outlier
        self.arrivals = Arrivals(timeout, max(timeout, FIRST_TIMEOUT))
        self.clear()

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def clear(self) -> None:
        """Forget the stream, and what waits."""
        self._waiting.clear()
        self.newest: tuple[Waypoints, Array, float] | None = None
        self.source: Motion | None = None
        self.stream: SampleSmoother | None = None
        self.far = False
        self.twist: Array = np.zeros(6)
        self.missed, self.dropped = 0.0, ""

    def add(self, given: Waypoints, stamp: float | None) -> None:
        """One more sample, with its stamp [s], or None for now."""
        self._waiting.append((given, stamp))

    def take(self, now: float, q: Array) -> bool:
        """Take in what waits, with the joints at q (m,); whether the motion along the samples goes on as it was."""
        goes_on, believed = self.source is not None, False
        while self._waiting:
            given, stamp = self._waiting.popleft()
            when, another = self._clock.time(stamp, now)
            before = None if another else self.newest
            if before is not None and when <= before[2]:
                continue
            if before is not None and when - before[2] > self.arrivals.timeout:
                before = None
            given = self._solver.with_poses(given, q if before is None else before[1], leaps=before is None)
            if before is not None and self._is_outlier(given, when, before):
                continue
            self.arrivals.add(now)
            self.dropped, believed = "", True
            goes_on = self._take(given, when, before, now, q) and goes_on
        if believed and self.stream is not None and not self.by_law:
            self.source = self.stream.smoothed_motion(self.source if goes_on else None, now)
        return goes_on

    @property
    def pose(self) -> Array:
        """(4, 4) of the newest sample."""
        pose: Array = np.asarray(None if self.newest is None else self.newest[0].poses)[0]
        return pose

    @property
    def by_law(self) -> bool:
        """Whether the newest sample is approached by the law, which keeps exact demands on the way."""
        return self.far and bool(self._loop.exact) and self.newest is not None and self.newest[0].poses is not None

    def _take(
        self, given: Waypoints, when: float, before: tuple[Waypoints, Array, float] | None, now: float, q: Array
    ) -> bool:
        """A sample that is believed; whether the motion along the samples goes on."""
        exact = bool(self._loop.exact) and given.poses is not None
        near, last = (q, None) if before is None else (q if exact and self.far else before[1], before[2])
        joints, missed = self._solver.points(given, near, np.array((when,)), last)
        there, self.missed = joints[0], float(missed[0])
        if before is None or (exact and self.far):
            self.far = bool(np.abs(there - q).max() > JOINT_TOLERANCE)
        elif exact:
            self.far = bool((np.abs(there - before[1]) > self._fastest * (when - before[2])).any())
        self.twist = np.zeros(6)
        if before is not None and given.poses is not None and before[0].poses is not None:
            self.twist = se3.displacement(before[0].poses[0], given.poses[0]) / (when - before[2])
        self.newest, late = (given, there, when), max(now - when, 0.0)
        if self.by_law:
            self.source = None
        elif self.stream is None:
            self.stream = SampleSmoother(self._cutoff, self._loop.dt, when, there, late)
        else:
            anew = before is None or self.source is None
            self.stream.add(when, there, late, anew=anew)
            return not anew
        return False

    def _is_outlier(self, given: Waypoints, when: float, before: tuple[Waypoints, Array, float]) -> bool:
        """Whether a sample is dropped: it is beyond the joints' speed limits, and the one before it was not."""
        if not self._drops:
            return False
        _, q, stamp = before
        if given.poses is None:
            there = np.clip(np.asarray(given.joints)[0], self._loop.box.position_lower, self._loop.box.position_upper)
            way = joint_displacement(q, there, self._loop.turns)
        else:
            way = self._solver.way(given.poses[0], q)
        time = max(when - stamp, 0.0 if self.stream is None else self.stream.period)
        share = np.abs(way) / (self._fastest * time)
        self._doubted, doubted = bool((share > 1.0).any()), self._doubted
        if not self._doubted or doubted:
            return False
        j = int(share.argmax())
        name = self._loop.robot.names[j]
        self.dropped = f"a sample was dropped: joint {j} ({name}) would need {share[j]:.3g} times its speed limit"
        return True
