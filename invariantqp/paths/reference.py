"""The joint motion that is followed, in stamp time: a source, and what is left of the jump to it.

    r(t) = source(t) + residual(t),     residual: a quintic from the jump in position, velocity, acceleration to zero

A source may be replaced at any time: r is then continuous with its first two derivatives (a C2 splice), and jerk stays
bounded. Sources are polynomials of time (`Motion`: points with stamps, smoothed without delay, a path, a stop, the
samples of a hand), by a clock of their own or not. Each comes to rest after its end. The engine computes them
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
            late_until: until then it is not where it is wanted to be, as joints cannot.
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

# Gain [1/s] towards where joints were sent, where time is kept; in contact, to the plan where the path frees them.
JOINT_GAIN = 5.0
# Joints farther from where they were sent than this [rad, length] have been pushed: the motion goes on from there.
# Those of a path whose shape is kept are waited for where they are farther than the second, until they are half as far.
PUSHED_JOINT, JOINT_TOLERANCE = 0.2, 0.02
# Splices take no fewer ticks than the first, and plans are no less calm: a jerk that lasts less than three is none.
MIN_SPLICE_TICKS = 4.0
# Points that are planned at once: under a millisecond. A plan's knots are so far apart as a share of how calm it is
# (its least is 1 % above that of all motions), and at most so many.
MAX_POINTS, KNOT_SPACING, MAX_PIECES = 96, 0.5, 400
# After the last point velocity and acceleration fade in this time [s], looked at in so many places as far apart. As the
# stop in 0.3 s that it is like: with 0.4 and 0.5 s 3 of 20 runs of chunks were off by more than 1.1 of what those are.
FADE_TIME, FADE_POINTS = 0.075, 8
# A hand is followed this long after its samples come, times one over the cutoff: 67 ms at 3 Hz.
DELAY_CYCLES = 0.2
# A plan along samples that are all noise is as calm as this share of it: more takes longer than what is ahead. What is
# noise is seen in third differences so many delays apart: 0.1 s, in which a hand's tremor has come round.
NOISE_SMOOTHING, DIFFERENCE_SPACING = 0.5, 1.5
# How fast means over samples follow what is measured, a share of the difference for each: of times, of noise. Squares
# that count as none.
MEAN_SHARE, NOISE_SHARE, TINY = 0.02, 0.05, 1e-16


def constant_motion(position: Array, time: float) -> Motion:
    """At a position (m,), always."""
    return Motion((time, time), position[None, None])


def smoothed_motion(
    state: Array, now: float, stamps: Array, points: Array, limits: JointLimits, smoothing_time: float
) -> Motion:
    """The motion from a state (3, m) now that is near points (n, m) at stamps (n,) with little jerk, joint by joint.

        argmin sum w_i |r(t_i) - p_i|^2 + calm^6 integral |r'''|^2,     w_i: the time between points

    One sentence for a smoothing that delays nothing, the way over from another motion, and the way out to rest: after
    the last point it is wanted that the points go on as they did, fading. What is faster than 1 / (2 pi calm)
    [Hz] is not followed. Where a joint cannot be at the first points in time, inside its limits, they weigh less to it.
    """
    times, wanted = _extrapolated(stamps - now, points)
    n = min(max(int(np.ceil(float(times[-1]) / (KNOT_SPACING * smoothing_time))), 4), MAX_PIECES)
    found: Motion = law.smoothed_motion(limits, state, now, times, wanted, smoothing_time, n)
    return found


def _extrapolated(times: Array, points: Array) -> tuple[Array, Array]:
    """The points (n, m) that are still to come, times (n,) from now, with what is wanted before and after them.

    Before them that is the first; after them, where the parabola along the last of them leads, if velocity and
    acceleration fade.
    """
    last = float(times[-1])
    first = int(times.searchsorted(last - 4.0 * FADE_TIME))
    t, x = (times[first:] - last) / FADE_TIME, points[first:]
    degrees = 1 + min(int(-t[0]), len(t) - 1, 2)  # a derivative takes some time to be seen
    rows, parabola = t[:, None] ** np.arange(degrees), np.zeros((3, points.shape[1]))
    parabola[:degrees] = np.linalg.solve(rows.T @ rows, rows.T @ x)
    v, a = parabola[1], 2.0 * parabola[2]
    over = max(-last, 0.0) + FADE_TIME * np.arange(1, FADE_POINTS + 1)
    u = over[:, None] / FADE_TIME
    left = np.exp(-u)
    goes_on = x[-1] + v * (1.0 - left) + (v + a) * (1.0 - (1.0 + u) * left)
    due, early = (
        int(times.searchsorted(0.0, side="right")),
        FADE_TIME * np.arange(1, int(max(times[0], 0.0) / FADE_TIME) + 1),
    )
    before = points[:1].repeat(len(early), axis=0)
    return np.concatenate((early, times[due:], last + over)), np.concatenate((before, points[due:], goes_on))


class SampleSmoother:
    """Samples of a hand, as joint positions: followed so late that a plan has some ahead of it.

    Attributes:
        period: of the samples, in the mean [s], 0 before there are two.
        transport: how late samples come, in the mean [s].
        stamps: (n,) of the last ones [s].
        positions: (n, m) likewise.
    """

    def __init__(self, cutoff: float, tick: float, stamp: float, position: Array, transport: float) -> None:
        """From one sample on; a sample waits at least a tick [s]."""
        self._least = max(DELAY_CYCLES / cutoff, tick)
        self.period = 0.0
        self._rough = np.zeros(2)  # sums of squared third differences, near ones and far ones
        self.transport = transport
        self.stamps: Array = np.array((stamp,))
        self.positions: Array = position[None]
        most = np.full(len(position), inf)
        self._boundless = JointLimits(-most, most, most, most, most, 0.0)

    @property
    def delay(self) -> float:
        """How long a sample waits when it has come [s]: two are ahead, or noise is carried on beyond the last one."""
        return max(self._least, 2.0 * self.period)

    @property
    def late(self) -> float:
        """How long after its stamp a sample is followed [s]."""
        return self.transport + self.delay

    def add(self, stamp: float, position: Array, transport: float, *, anew: bool) -> None:
        """A sample (m,) with a stamp later than all before it, which count no more if it is the first `anew`."""
        kept = slice(0, 0) if anew else slice(1 - MAX_POINTS, None)
        self.transport += MEAN_SHARE * (transport - self.transport)
        if not anew:
            gap = stamp - float(self.stamps[-1])
            self.period += (MEAN_SHARE if self.period > 0.0 else 1.0) * (gap - self.period)
        self.stamps = np.append(self.stamps[kept], stamp)
        self.positions = np.vstack((self.positions[kept], position))
        apart = DIFFERENCE_SPACING * self.delay
        if stamp - float(self.stamps[0]) >= 3.0 * apart:
            at = stamp - apart * np.append(np.arange(3.0, -1.0, -1.0) / 3.0, np.arange(3.0, -1.0, -1.0))
            i = np.minimum(self.stamps.searchsorted(at, side="right"), len(self.stamps) - 1)
            u = ((at - self.stamps[i - 1]) / (self.stamps[i] - self.stamps[i - 1]))[:, None]
            x = (self.positions[i - 1] + u * (self.positions[i] - self.positions[i - 1])).reshape(2, 4, -1)
            self._rough = (1.0 - NOISE_SHARE) * self._rough + (np.diff(x, 3, axis=1) ** 2).sum(axis=(1, 2))

    @property
    def _smoothing_time(self) -> float:
        """How calm a plan is [s].

        The sixth power of the best is the noise over the hand's squared jerk. Third differences near each other are of
        noise alone, those three times as far apart of both: from 1 where all is noise their ratio falls to 3^-6.
        """
        near, far = self._rough + TINY
        # Stamps on the ticks of a loop scatter in a pattern, in which either of them may cancel.
        return float(NOISE_SMOOTHING * self.delay * np.clip(near / far, 3.0**-6, 1.0) ** (1.0 / 6.0))

    def smoothed_motion(self, before: Motion | None, now: float) -> Motion:
        """The motion along the samples that goes on from one before it; without one, from rest at the first.

        It is the hand's, not the joints': what these cannot do they catch up with.
        """
        first = np.vstack((self.positions[:1], np.zeros((2, self.positions.shape[1]))))
        state = first if before is None else before.at(np.array((now,)))[0, :3]
        return smoothed_motion(
            state, now, self.stamps + self.late, self.positions, self._boundless, self._smoothing_time
        )


class TimeScaling(NamedTuple):
    """How fast the time of a source runs: from one rate to another by a cubic, then on at that."""

    start: float  # when the rate begins to change
    first: float  # the source's time then
    rate: float
    slope: float  # of the rate
    final: float  # the rate in the end
    duration: float = 0.0  # of the change [s]

    def now(self, time: float) -> tuple[float, float, float]:
        """The source's time, rate and slope."""
        found: tuple[float, float, float] = law.clock_at(self, time)
        return found


class RetimedMotion(NamedTuple):
    """A motion by a clock of its own."""

    source: Motion
    clock: TimeScaling
    joints: int | None = None  # so many columns of the motion; None is all

    @property
    def end(self) -> float:
        """When it is at rest."""
        last = self.clock.start + self.clock.duration
        place, rate, _ = self.clock.now(last)
        return float(last + max(self.source.end - place, 0.0) / rate) if rate > 0.0 else last

    def place(self, time: float) -> float:
        """The source's own time."""
        return self.clock.now(time)[0]

    def last(self, time: float) -> float:
        """The position of the motion's last column, a place."""
        return float(self.source.at((self.place(time),))[0, 0, -1])

    def at(self, times: Array) -> Array:
        """As `Motion.at`."""
        found: Array = self.source.at(times, self.clock)[:, :, : self.joints]
        return found

    def turned(self, time: float, final: float, limits: JointLimits) -> RetimedMotion:
        """The same with a clock that goes over to another rate, and has it as soon as limits of all columns allow.

        Joints that brake at their limit already cannot stop sooner: a steady clock then goes on till there is room.
        """
        return self._replace(clock=TimeScaling(*law.rate_change(self.source, self.clock, limits, time, final)))


TimedMotion: TypeAlias = Motion | RetimedMotion


class Reference:
    """What is followed: a source and the residual of the last splice.

    Attributes:
        limits: inside which splices are made.
        source: what is followed.
    """

    def __init__(self, limits: JointLimits, position: Array, time: float) -> None:
        """At rest."""
        self.limits = limits
        self.source: TimedMotion = constant_motion(position, time)
        self._residual: Array = np.zeros((6, len(position)))
        self._start, self._duration = time, 0.0

    @property
    def splice_end(self) -> float:
        """When the last splice is over."""
        return self._start + self._duration

    @property
    def end(self) -> float:
        """When all is at rest."""
        return max(self.splice_end, self.source.end)

    def at(self, time: float) -> Array:
        """(4, m) position, velocity, acceleration and jerk at a time."""
        found: Array = self.tracked(self.limits).at(time)[:, : len(self.limits.lower)]
        return found

    def tracked(self, limits: JointLimits, gain: float = 0.0, *, keeps_shape: bool = False) -> Any:
        """What is followed inside limits, as the engine takes it.

        `gain` [1/s] leads joints back to where they were sent; `keeps_shape` says whether a path's shape is kept.
        """
        motion, clock = _by_clock(self.source)
        pushed = 0.5 * JOINT_TOLERANCE if keeps_shape else PUSHED_JOINT
        return law.TrackedMotion(
            limits, motion, clock, self._residual, self._start, self._duration, gain, keeps_shape, pushed
        )

    def set_splice(self, time: float, residual: Array, duration: float) -> None:
        """The splice from a time on: a residual (6, m), zero after a duration."""
        self._start, self._residual, self._duration = time, residual, duration

    def follow(self, source: TimedMotion, time: float) -> None:
        """Follow a source from a time on without a splice."""
        self.source = source
        self.set_splice(time, self._residual, 0.0)

    def splice(self, source: TimedMotion, time: float, state: Array, duration: float) -> bool:
        """Go over to a source from position, velocity and acceleration (3, m) at a time, in a duration [s].

        Returns:
            Whether that keeps the limits together with the source; if not, the source is followed without a splice,
            which the joints cannot do.
        """
        D = max(duration, MIN_SPLICE_TICKS * self.limits.dt)
        self.source = source
        found = law.splice(*_by_clock(source), self.limits, time, state, D)
        self.set_splice(time, *((self._residual, 0.0) if found is None else (found, D)))
        return found is not None


def _by_clock(source: TimedMotion) -> tuple[Motion, TimeScaling | None]:
    return (source.source, source.clock) if isinstance(source, RetimedMotion) else (source, None)
