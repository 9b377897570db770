"""The joint motion that is followed, in stamp time: a motion and the residual of the splice to it.

    r(t) = motion(t) + residual(t),     residual: a quintic from the jump in position, velocity, acceleration to zero

The motion may be replaced at any time: r is continuous with its first two derivatives (a C2 splice), and its jerk is
bounded. Motions are polynomials of time, at rest after their end. The engine evaluates them
(`core/joint_motion.hpp`).
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.engine import law
from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import JointLimits

if TYPE_CHECKING:

    class Motion:
        """Joints as polynomials of time, piece by piece; at rest before the first and after the last.

        Attributes:
            knots: (n + 1,) times [s].
            coefficients: (n, powers, m) of the time since each piece began, from the constant on.
            start, end: the first and the last of the knots.
            late_until: until then it is off its points, which joints cannot reach in time.
        """

        knots: Array
        coefficients: Array
        start: float
        end: float
        late_until: float

        def __init__(self, knots: ArrayLike, coefficients: Array, late_until: float = -inf) -> None: ...
        def at(self, times: ArrayLike, clock: TimeScaling | None = None) -> Array:
            """(k, 4, m) position, velocity, acceleration and jerk at times (k,)."""
            ...
else:
    Motion = law.Motion

# Gain [1/s] of the joint tracking error where time is kept; in contact, of joints to the plan in the null space.
JOINT_GAIN = 5.0
# Joints with a larger tracking error than this [rad, length] have been pushed: the motion goes on from there. A path
# whose shape is kept waits for joints with a larger one than the second, until it is half of that.
PUSHED_JOINT, JOINT_TOLERANCE = 0.2, 0.02
# A splice takes at least so many ticks, as does the smoothing: jerk that lasts less than three ticks is not limited.
MIN_SPLICE_TICKS = 4.0


def constant_motion(position: Array, time: float) -> Motion:
    """The motion that rests at a position (m,)."""
    return Motion((time, time), position[None, None])


class TimeScaling(NamedTuple):
    """The time of a motion as a function of time: its rate changes to another one by a cubic, and stays there."""

    start: float  # when the rate begins to change
    first: float  # the motion's time then
    rate: float
    slope: float  # of the rate
    final: float  # the rate in the end
    duration: float = 0.0  # of the change [s]

    def now(self, time: float) -> tuple[float, float, float]:
        """The motion's time, its rate and slope."""
        found: tuple[float, float, float] = law.clock_at(self, time)
        return found


class RetimedMotion(NamedTuple):
    """A motion with a time scaling."""

    base: Motion
    clock: TimeScaling
    joints: int | None = None  # so many columns of the motion; None is all

    @property
    def end(self) -> float:
        """When it is at rest."""
        last = self.clock.start + self.clock.duration
        place, rate, _ = self.clock.now(last)
        return float(last + max(self.base.end - place, 0.0) / rate) if rate > 0.0 else last

    def base_time(self, time: float) -> float:
        """The time of the motion without the scaling."""
        return self.clock.now(time)[0]

    def place(self, time: float) -> float:
        """The position of the motion's last column, a place on a path."""
        return float(self.base.at((self.base_time(time),))[0, 0, -1])

    def at(self, times: Array) -> Array:
        """As `Motion.at`."""
        found: Array = self.base.at(times, self.clock)[:, :, : self.joints]
        return found

    def with_rate(self, time: float, final: float, limits: JointLimits) -> RetimedMotion:
        """The same motion whose rate changes to another one in the least time that limits of all columns allow.

        The change waits for joints that brake at their limit, which cannot stop sooner.
        """
        return self._replace(clock=TimeScaling(*law.rate_change(self.base, self.clock, limits, time, final)))


TimedMotion: TypeAlias = Motion | RetimedMotion


class Reference:
    """A motion and the residual of the last splice.

    Attributes:
        limits: inside which splices are made.
        motion: what is followed.
    """

    def __init__(self, limits: JointLimits, position: Array, time: float) -> None:
        """At rest."""
        self.limits = limits
        self.motion: TimedMotion = constant_motion(position, time)
        self._residual: Array = np.zeros((6, len(position)))
        self._start, self._duration = time, 0.0

    @property
    def splice_end(self) -> float:
        """When the last splice is over."""
        return self._start + self._duration

    @property
    def end(self) -> float:
        """When all is at rest."""
        return max(self.splice_end, self.motion.end)

    def at(self, time: float) -> Array:
        """(4, m) position, velocity, acceleration and jerk at a time."""
        found: Array = self.tracked(self.limits).at(time)[:, : len(self.limits.lower)]
        return found

    def tracked(self, limits: JointLimits, gain: float = 0.0, *, keeps_shape: bool = False) -> Any:
        """The reference inside limits as the engine takes it, with the gain of the tracking error [1/s]."""
        pushed = 0.5 * JOINT_TOLERANCE if keeps_shape else PUSHED_JOINT
        splice = self._residual, self._start, self._duration
        return law.TrackedMotion(limits, *_with_clock(self.motion), *splice, gain, keeps_shape, pushed)

    def set_splice(self, time: float, residual: Array, duration: float) -> None:
        """The splice from a time on: a residual (6, m), zero after a duration."""
        self._start, self._residual, self._duration = time, residual, duration

    def switch(self, motion: TimedMotion, time: float) -> None:
        """Follow a motion from a time on without a splice."""
        self.motion = motion
        self.set_splice(time, self._residual, 0.0)

    def splice(self, motion: TimedMotion, time: float, state: Array, duration: float) -> bool:
        """Join a motion from position, velocity and acceleration (3, m) at a time, in a duration [s].

        Returns:
            Whether splice and motion are inside the limits; if not, the motion is followed without a splice, and joints
            have to catch up with it.
        """
        duration = max(duration, MIN_SPLICE_TICKS * self.limits.dt)
        residual = law.splice(*_with_clock(motion), self.limits, time, state, duration)
        self.switch(motion, time)
        if residual is not None:
            self.set_splice(time, residual, duration)
        return residual is not None


def _with_clock(motion: TimedMotion) -> tuple[Motion, TimeScaling | None]:
    return (motion.base, motion.clock) if isinstance(motion, RetimedMotion) else (motion, None)
