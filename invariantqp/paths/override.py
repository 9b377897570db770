"""The override: the share of the requested speed at which inputs with stamps are followed.

Points and functions are followed by a time scaling that runs slower from where they are due when the override is set;
of samples and twists the speed is scaled. On the way back to what is due no joint exceeds the override's share of the
speed that was requested of it since the arm fell behind.
"""

from __future__ import annotations

from math import inf

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import AT_REST, JointLimits, speed_scale
from invariantqp.paths.joint_tracker import SAMPLE_SPLICE, SPLICE, JointTracker
from invariantqp.paths.reference import TimedMotion, TimeScaling

# The largest speed of a quintic splice over its mean one.
QUINTIC_PEAK = 1.875
# The largest speed of a sampled motion is looked for at so many places.
SPEED_PLACES = 65
# Joints may be so many times as fast as the stream that they catch up with, or they would not reach it.
CATCH_UP_RATIO = 1.2


class Override:
    """The override of a follower, and the speeds that it takes a share of.

    Attributes:
        value: the share of the requested speed.
        scaling: of the time of points and functions below 1; None is the follower's time.
        requested_motion: the motion that was requested last, None where the arm rested.
        input_speeds: (m,) the joint speeds of the input.
    """

    def __init__(self, joints: JointTracker, approach: float) -> None:
        """Full speed; `approach` is the share of the speed limits on the way to a stream."""
        self._joints, self._approach = joints, approach
        self.value, self._changed = 1.0, -inf
        self.scaling: TimeScaling | None = None
        self.requested_motion: TimedMotion | None = None
        self.input_speeds: Array = np.zeros(len(joints.limits.lower))
        self._requested = self.input_speeds  # (m,) the largest since the arm fell behind

    @property
    def place(self) -> float:
        """The stamp that is due now [s]."""
        return self._joints.time if self.scaling is None else self.scaling.now(self._joints.time)[0]

    def time_of(self, stamp: float) -> float:
        """When a stamp is due, or at least not before [s]."""
        scaling = self.scaling
        if scaling is None:
            return stamp
        return scaling.start + (stamp - scaling.first) / scaling.final if scaling.final > 0.0 else inf

    @property
    def is_changing(self) -> bool:
        """Whether the override changed within the time of a splice."""
        return self._joints.time - self._changed < SAMPLE_SPLICE

    def set(self, value: float, *, is_stream: bool) -> tuple[bool, bool]:
        """Set the override; whether that changes it, and whether it had just changed before."""
        now, changes = self._joints.time, value != self.value
        if (changes and self.scaling is not None) or (value < 1.0 and self.scaling is None and not is_stream):
            self.scaling = TimeScaling(now, self.place, value, 0.0, value)
        again = changes and self.is_changing
        self.value, self._changed = value, now if changes else self._changed
        return changes, again

    def bounds(self, motion: TimedMotion, *, is_stream: bool, is_far: bool) -> JointLimits:
        """The joint limits on the way to a motion, with the speeds that override and approach leave."""
        limits = self._joints.limits
        if self.value == 1.0 and not is_far:
            return limits
        full, speeds, place = speed_scale(limits.velocity), self.input_speeds, self.place
        if is_stream:
            there = motion.at(np.linspace(place, max(motion.end, place), SPEED_PLACES))
            speeds = np.abs(there[:, 1]).max(axis=0)
        share = np.clip(CATCH_UP_RATIO * speeds / full, self._approach, 1.0) if is_far else np.ones(len(full))
        if self.value < 1.0:
            self.request(np.maximum(speeds, share * full) if is_far else speeds)
            share = self.value * np.minimum(share, self._requested / full)
        return limits.scaled(share)

    def approach_speeds(self) -> Array:
        """(m,) joint speeds at which the law approaches points."""
        if self.value >= 1.0:
            return self._joints.limits.velocity
        full = speed_scale(self._joints.limits.velocity)
        speeds: Array = self.value * np.clip((self._requested / full).max(), AT_REST, 1.0) * full
        return speeds

    def jump(self, goal: Array) -> None:
        """The request jumps to joint positions (m,) from the requested motion, or from where the arm is."""
        joints, motion = self._joints, self.requested_motion
        here = joints.state.position if motion is None else motion.at(np.array((joints.time,)))[0, 0]
        distance = goal - here
        speeds = np.minimum(QUINTIC_PEAK / SPLICE * np.abs(distance), joints.limits.peak_speed(distance))
        self.input_speeds = np.maximum(self.input_speeds, speeds)

    def request(self, speeds: Array) -> None:
        """Joint speeds (m,) are requested; while the arm is behind the largest of them counts."""
        joints = self._joints
        joins = joints.reference is not None and joints.time < joints.reference.splice_end
        is_behind = joints.state.late or joins or joints.twist is not None
        self._requested = np.maximum(speeds, self._requested) if is_behind else speeds
