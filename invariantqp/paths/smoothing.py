"""Smoothing without delay: the joint motion near points with little jerk, and that along the samples of a stream."""

from __future__ import annotations

from math import inf

import numpy as np

from invariantqp.engine import law
from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import JointLimits
from invariantqp.paths.reference import Motion

# Points that are planned at once: under a millisecond. The spacing of a plan's knots as a share of its smoothing time
# (the cost is 1 % above that of all motions), and how many there are at most.
MAX_POINTS, KNOT_SPACING, MAX_PIECES = 96, 0.5, 400
# After the last point velocity and acceleration fade in this time [s], sampled at so many places as far apart: with 0.4
# and 0.5 s in place of the 0.3 s that this takes, 3 of 20 runs of chunks had 1.1 times the error and more.
FADE_TIME, FADE_POINTS = 0.075, 8
# A hand is followed this long after its samples come, times one over the cutoff: 67 ms at 3 Hz.
DELAY_CYCLES = 0.2
# The smoothing time of a plan along noise, as a share of the delay: more exceeds the samples that are ahead.
# Noise is estimated from third differences so many delays apart: 0.1 s, a period of a hand's tremor.
NOISE_SMOOTHING, DIFFERENCE_SPACING = 0.5, 1.5
# Shares of a new value in the means over samples: of times, of noise. A square that counts as zero.
MEAN_SHARE, NOISE_SHARE, TINY = 0.02, 0.05, 1e-16


def smoothed_motion(
    state: Array, now: float, stamps: Array, points: Array, limits: JointLimits, smoothing_time: float
) -> Motion:
    """The motion from a state (3, m) near points (n, m) at stamps (n,) with little jerk, joint by joint.

        argmin sum w_i |r(t_i) - p_i|^2 + smoothing_time^6 integral |r'''|^2,     w_i: the time between points

    It smooths without delay, joins the points from another motion, and comes to rest: after the last point it follows
    their fading extrapolation. Frequencies above 1 / (2 pi smoothing_time) [Hz] are removed. The first points have less
    weight for a joint that cannot reach them in time inside its limits.
    """
    times, wanted = _extrapolated(stamps - now, points)
    pieces = min(max(int(np.ceil(float(times[-1]) / (KNOT_SPACING * smoothing_time))), 4), MAX_PIECES)
    found: Motion = law.smoothed_motion(limits, state, now, times, wanted, smoothing_time, pieces)
    return found


def _extrapolated(times: Array, points: Array) -> tuple[Array, Array]:
    """The points (n, m) that are still to come, times (n,) from now, extended to both sides.

    Before them is the first; after them the parabola along the last, whose velocity and acceleration fade.
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
    after = x[-1] + v * (1.0 - left) + (v + a) * (1.0 - (1.0 + u) * left)
    due = int(times.searchsorted(0.0, side="right"))
    early = FADE_TIME * np.arange(1, int(max(times[0], 0.0) / FADE_TIME) + 1)
    before = points[:1].repeat(len(early), axis=0)
    return np.concatenate((early, times[due:], last + over)), np.concatenate((before, points[due:], after))


class SampleSmoother:
    """Samples of a stream as joint positions, followed so late that a plan has some ahead of it.

    Attributes:
        period: of the samples, in the mean [s], 0 before there are two.
    """

    def __init__(self, cutoff: float, tick: float, stamp: float, position: Array, transport: float) -> None:
        """From one sample (m,) on, which came `transport` [s] after its stamp; a sample waits at least a tick [s]."""
        self._least = max(DELAY_CYCLES / cutoff, tick)
        self.period = 0.0
        self._squares = np.zeros(2)  # sums of squared third differences, near ones and far ones
        self._transport = transport
        self._stamps: Array = np.array((stamp,))
        self._positions: Array = position[None]
        most = np.full(len(position), inf)
        self._boundless = JointLimits(-most, most, most, most, most, 0.0)

    @property
    def delay(self) -> float:
        """How long a sample waits when it has come [s]: two are ahead, or noise is extrapolated beyond the last one."""
        return max(self._least, 2.0 * self.period)

    @property
    def late(self) -> float:
        """How long after its stamp a sample is followed [s]."""
        return self._transport + self.delay

    def add(self, stamp: float, position: Array, transport: float, *, restarts: bool) -> None:
        """A sample (m,) with a stamp later than all before it, which are dropped where the stream `restarts`."""
        kept = slice(0, 0) if restarts else slice(1 - MAX_POINTS, None)
        self._transport += MEAN_SHARE * (transport - self._transport)
        if not restarts:
            gap = stamp - float(self._stamps[-1])
            self.period += (MEAN_SHARE if self.period > 0.0 else 1.0) * (gap - self.period)
        self._stamps = stamps = np.append(self._stamps[kept], stamp)
        self._positions = positions = np.vstack((self._positions[kept], position))
        apart = DIFFERENCE_SPACING * self.delay
        if stamp - float(stamps[0]) >= 3.0 * apart:
            at = stamp - apart * np.append(np.arange(3.0, -1.0, -1.0) / 3.0, np.arange(3.0, -1.0, -1.0))
            i = np.minimum(stamps.searchsorted(at, side="right"), len(stamps) - 1)
            u = ((at - stamps[i - 1]) / (stamps[i] - stamps[i - 1]))[:, None]
            x = (positions[i - 1] + u * (positions[i] - positions[i - 1])).reshape(2, 4, -1)
            self._squares = (1.0 - NOISE_SHARE) * self._squares + (np.diff(x, 3, axis=1) ** 2).sum(axis=(1, 2))

    @property
    def _smoothing_time(self) -> float:
        """The smoothing time of a plan [s].

        The sixth power of the best is the noise over the hand's squared jerk. Third differences of near samples are of
        noise alone, those three times as far apart of both: their ratio falls from 1 where all is noise to 3^-6.
        """
        near, far = self._squares + TINY
        # Stamps on the ticks of a loop scatter in a pattern, in which either of them may cancel.
        return float(NOISE_SMOOTHING * self.delay * np.clip(near / far, 3.0**-6, 1.0) ** (1.0 / 6.0))

    def motion(self, before: Motion | None, now: float) -> Motion:
        """The motion along the samples that continues one before it; without one, from rest at the first.

        It is the hand's, and ignores the limits of joints, which catch up with it.
        """
        first = np.vstack((self._positions[:1], np.zeros((2, self._positions.shape[1]))))
        state = first if before is None else before.at(np.array((now,)))[0, :3]
        stamps = self._stamps + self.late
        return smoothed_motion(state, now, stamps, self._positions, self._boundless, self._smoothing_time)
