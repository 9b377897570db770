"""The joint motion that is followed, in stamp time: a source, and what is left of the jump to it.

    r(t) = source(t) + residual(t),     residual: a quintic from the jump in position, velocity, acceleration to zero

A source may be replaced at any time: r is then continuous with its first two derivatives (a C2 splice), and jerk stays
bounded. Sources: polynomials of time (`Motion`: points with stamps, smoothed without delay, a path, a stop), samples
of a hand read a little late (`Stream`), either of them by another clock (`Clocked`). Each comes to rest after its end.
"""

from __future__ import annotations

from math import inf, perm
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.linalg import solveh_banded

from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.paths.time_law import JointLimits

# The share of the limits that splices and stops are made for: the rest covers what lies between the places checked.
SHARE = 0.97
# A splice is checked at so many places; what does not keep the limits is caught up.
PLACES = 21
# Gain [1/s] towards where joints were sent, where time is kept; in contact, to the plan where the path frees them.
JOINT_GAIN = 5.0
# Joints farther from where they were sent than this [rad, length] have been pushed: the motion goes on from there.
# Those of a path whose shape is kept are waited for where they are farther than the second, until they are half as far.
DISPLACED, STRAYED = 0.2, 0.02
# Splices take no fewer ticks than the first, and plans are no less calm: a jerk that lasts less than three is none.
# Changes of a clock's rate looked at.
SHORTEST_STOP, TURNS = 4.0, 64
# Points that are planned at once: under a millisecond. A plan's knots are so far apart as a share of how calm it is
# (its least is 1 % above that of all motions), and at most so many.
MOST_POINTS, KNOTS, MOST_PIECES = 96, 0.5, 400
# After the last point velocity and acceleration fade in this time [s], looked at in so many places as far apart. As the
# stop in 0.3 s that it is like: with 0.4 and 0.5 s 3 of 20 runs of chunks were off by more than 1.1 of what those are.
FADE, FADING = 0.075, 8
# Points that a joint cannot be at in time weigh less until so much later at each try, and at most so often: off by at
# most 3 % more than a QP inside the limits was, in five runs.
EASIER, TRIES = 1.3, 12
# Of a piece of a cubic B-spline, powers of the share of it that is over, from its four coefficients.
PIECE: Array = (
    np.array(((1.0, 4.0, 1.0, 0.0), (-3.0, 0.0, 3.0, 0.0), (3.0, -6.0, 3.0, 0.0), (-1.0, 3.0, -3.0, 1.0))) / 6.0
)
# Changes of a clock's rate take at most this [s], are checked at twice as many places, keep this share of limits.
LONGEST_TURN, TURN_SHARE = 4.0, 0.999
# How long such a change may wait for joints that brake [s].
WAITS = (0.0, 0.02, 0.05, 0.1, 0.2)
# A hand is followed this long after its samples come, times one over the cutoff: 67 ms at 3 Hz.
DELAY = 0.2
# A plan along samples that are all noise is as calm as this share of it: more takes longer than what is ahead. What is
# noise is seen in third differences so many delays apart: 0.1 s, in which a hand's tremor has come round.
CALM_OF_DELAY, APART = 0.5, 1.5
# How fast means over samples follow what is measured, a share of the difference for each: of times, of noise. Squares
# that count as none.
TRANSPORT_SHARE, NOISE_SHARE, TINY = 0.02, 0.05, 1e-16
# The d-th derivative of u^n is FACTORS[d, n] u^EXPONENTS[d, n].
FACTORS: Array = np.array([[perm(n, d) for n in range(7)] for d in range(5)], dtype=np.float64)
EXPONENTS = np.array([[max(n - d, 0) for n in range(7)] for d in range(5)])


class Source(Protocol):
    """A joint motion in stamp time."""

    @property
    def end(self) -> float:
        """After which it is at rest."""
        ...

    def at(self, times: Array) -> Array:
        """(k, 4, m) position, velocity, acceleration and jerk at times (k,)."""
        ...


class Motion:
    """Joints as polynomials of time, piece by piece; at rest before the first and after the last."""

    def __init__(self, knots: Array, coefficients: Array, eased: float = -inf) -> None:
        """Pieces between knots (n + 1,): powers (n, k, m) of the time since each began, from the constant on.

        Until `eased` it is not where it is wanted to be, as joints cannot.
        """
        self.knots, self.coefficients, self.eased = knots, coefficients, eased
        self.start, self.end = float(knots[0]), float(knots[-1])

    def at(self, times: Array, derivatives: int = 4) -> Array:
        """As `Source.at`, or the first of its rows alone."""
        i = np.minimum(np.maximum(self.knots.searchsorted(times, side="right") - 1, 0), len(self.coefficients) - 1)
        u, c = np.minimum(np.maximum(times, self.start), self.end) - self.knots[i], self.coefficients[i]
        answer: Array = _powers(u, c.shape[1], derivatives) @ c
        answer[(times >= self.end) | (times < self.start), 1:] = 0.0
        return answer


def resting(position: Array, time: float) -> Motion:
    """At a position (m,), always."""
    return Motion(np.array((time, time)), position[None, None])


def planned(state: Array, now: float, stamps: Array, points: Array, limits: JointLimits, calm: float) -> Motion:
    """The motion from a state (3, m) now that is near points (n, m) at stamps (n,) with little jerk, joint by joint.

        argmin sum w_i |r(t_i) - p_i|^2 + calm^6 integral |r'''|^2,     w_i: the time between points

    One sentence for a smoothing that delays nothing, the way over from another motion, and the way out to rest: after
    the last point it is wanted that the points go on as they did, fading. What is faster than 1 / (2 pi calm)
    [Hz] is not followed. Where a joint cannot be at the first points in time, inside its limits, they weigh less to it.
    """
    times, wanted = _going_on(stamps - now, points)
    n = min(max(int(np.ceil(float(times[-1]) / (KNOTS * calm))), 4), MOST_PIECES)
    h = float(times[-1]) / n
    if core is not None and points.shape[1] <= core.MOST_JOINTS:
        pieces, eased = core.planned(limits.rows, state, times, wanted, calm, n)
    else:
        each = [_eased(state, times, wanted, limits, calm, n, j) for j in range(points.shape[1])]
        c, eased = np.stack([c for c, _ in each], axis=1), max(later for _, later in each)
        pieces = PIECE @ np.stack((c[:-3], c[1:-2], c[2:-1], c[3:]), axis=1) / h ** np.arange(4.0)[:, None]
    knots: Array = now + h * np.arange(n + 1.0)
    return Motion(knots, pieces, now + eased)


def _going_on(times: Array, points: Array) -> tuple[Array, Array]:
    """The points (n, m) that are still to come, times (n,) from now, with what is wanted before and after them.

    Before them that is the first; after them, where the parabola along the last of them leads, if velocity and
    acceleration fade.
    """
    last = float(times[-1])
    first = int(times.searchsorted(last - 4.0 * FADE))
    t, x = (times[first:] - last) / FADE, points[first:]
    degrees = 1 + min(int(-t[0]), len(t) - 1, 2)  # a derivative takes some time to be seen
    rows, parabola = t[:, None] ** np.arange(degrees), np.zeros((3, points.shape[1]))
    parabola[:degrees] = np.linalg.solve(rows.T @ rows, rows.T @ x)
    v, a = parabola[1], 2.0 * parabola[2]
    over = max(-last, 0.0) + FADE * np.arange(1, FADING + 1)
    u = over[:, None] / FADE
    left = np.exp(-u)
    goes_on = x[-1] + v * (1.0 - left) + (v + a) * (1.0 - (1.0 + u) * left)
    due, early = int(times.searchsorted(0.0, side="right")), FADE * np.arange(1, int(max(times[0], 0.0) / FADE) + 1)
    before = points[:1].repeat(len(early), axis=0)
    return np.concatenate((early, times[due:], last + over)), np.concatenate((before, points[due:], goes_on))


def _eased(
    state: Array, times: Array, wanted: Array, limits: JointLimits, calm: float, n: int, j: int
) -> tuple[Array, float]:
    """(n + 3,) coefficients of a plan for one joint: a cubic B-spline of n even pieces, the last three the same.

    And until when points weigh less to it.
    """
    h = float(times[-1]) / n
    piece = np.minimum((times / h).astype(np.intp), n - 1)
    # Rows of the least squares, four coefficients each: the points, then the jerks.
    rows = np.vstack((((times / h - piece)[:, None] ** np.arange(4.0)) @ PIECE, np.tile(6.0 * PIECE[3], (n, 1))))
    at = np.minimum(np.append(piece, np.arange(n))[:, None] + np.arange(4), n)
    x, v, a = state[:, j] * (1.0, h, h * h)
    c = np.zeros(n + 3)
    c[:3] = x - v + a / 3.0, x - a / 6.0, x + v + a / 3.0
    away = np.append(wanted[:, j], np.zeros(n)) - (rows * c[at]).sum(axis=1)
    eased = 0.0
    for _ in range(TRIES):
        weights = np.diff(times, prepend=0.0) * np.minimum(times / max(eased, times[0]), 1.0) ** 2
        weights = np.append(weights, np.full(n, h * (calm / h) ** 6))
        bands, right = np.zeros((4, n + 1)), np.zeros(n + 1)  # upper form
        for i in range(4):
            np.add.at(right, at[:, i], weights * rows[:, i] * away)
            for k in range(4):
                upper = at[:, i] <= at[:, k]
                below, column = at[upper, i] - at[upper, k], at[upper, k]
                np.add.at(bands, (3 + below, column), (weights * rows[:, i] * rows[:, k])[upper])
        c[3 : n + 1] = solveh_banded(bands[:, 3:], right[3:])
        c[n + 1 :] = c[n]
        motion = (c[:-2] + 4.0 * c[1:-1] + c[2:]) / 6.0, (c[2:] - c[:-2]) / (2.0 * h), np.diff(c, 2) / h**2
        jerk = np.append(np.diff(c, 3), 0.0) / h**3
        share = float(limits.of(j).ratio(*(x[:, None] for x in (*motion, jerk))).max())
        if share <= SHARE:
            break
        eased = max(eased, 2.0 * calm) * max(share, EASIER)
    return c, eased


class Stream:
    """Samples of a hand, as joint positions: followed so late that a plan has some ahead of it.

    Attributes:
        period: of the samples, in the mean [s], 0 before there are two.
        transport: how late samples come, in the mean [s].
        stamps: (n,) of the last ones [s].
        positions: (n, m) likewise.
    """

    def __init__(self, cutoff: float, stamp: float, position: Array, transport: float) -> None:
        """From one sample on."""
        self._least = DELAY / cutoff
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
        kept = slice(0, 0) if anew else slice(1 - MOST_POINTS, None)
        self.transport += TRANSPORT_SHARE * (transport - self.transport)
        if not anew:
            gap = stamp - float(self.stamps[-1])
            self.period += (TRANSPORT_SHARE if self.period > 0.0 else 1.0) * (gap - self.period)
        self.stamps = np.append(self.stamps[kept], stamp)
        self.positions = np.vstack((self.positions[kept], position))
        apart = APART * self.delay
        if stamp - float(self.stamps[0]) >= 3.0 * apart:
            at = stamp - apart * np.append(np.arange(3.0, -1.0, -1.0) / 3.0, np.arange(3.0, -1.0, -1.0))
            i = np.minimum(self.stamps.searchsorted(at, side="right"), len(self.stamps) - 1)
            u = ((at - self.stamps[i - 1]) / (self.stamps[i] - self.stamps[i - 1]))[:, None]
            x = (self.positions[i - 1] + u * (self.positions[i] - self.positions[i - 1])).reshape(2, 4, -1)
            self._rough = (1.0 - NOISE_SHARE) * self._rough + (np.diff(x, 3, axis=1) ** 2).sum(axis=(1, 2))

    @property
    def _calm(self) -> float:
        """How calm a plan is [s].

        The sixth power of the best is the noise over the hand's squared jerk. Third differences near each other are of
        noise alone, those three times as far apart of both: from 1 where all is noise their ratio falls to 3^-6.
        """
        near, far = self._rough + TINY
        # Stamps on the ticks of a loop scatter in a pattern, in which either of them may cancel.
        return float(CALM_OF_DELAY * self.delay * np.clip(near / far, 3.0**-6, 1.0) ** (1.0 / 6.0))

    def planned(self, before: Motion | None, now: float) -> Motion:
        """The motion along the samples that goes on from one before it; without one, from rest at the first.

        It is the hand's, not the joints': what these cannot do they catch up with.
        """
        first = np.vstack((self.positions[:1], np.zeros((2, self.positions.shape[1]))))
        state = first if before is None else before.at(np.array((now,)))[0, :3]
        return planned(state, now, self.stamps + self.late, self.positions, self._boundless, self._calm)


class Clock(NamedTuple):
    """How fast the time of a source runs: from one rate to another by a cubic, then on at that."""

    start: float  # when the rate begins to change
    first: float  # the source's time then
    rate: float
    slope: float  # of the rate
    final: float  # the rate in the end
    duration: Any = 0.0  # of the change [s]; an array for several

    def at(self, times: Array) -> tuple[Array, Array, Array, Array]:
        """The source's time, rate, slope and the slope's slope at times that go with the durations."""
        D, d = np.maximum(self.duration, 1e-300), self.final - self.rate
        b, c = (3.0 * d / D - 2.0 * self.slope) / D, (self.slope - 2.0 * d / D) / D / D
        u = np.clip(times - self.start, 0.0, self.duration)
        on = times - self.start < self.duration
        place = (
            self.first
            + self.rate * np.minimum(times - self.start, 0.0)
            + u * (self.rate + u * (0.5 * self.slope + u * (b / 3.0 + u * 0.25 * c)))
        )
        place = place + self.final * np.maximum(times - self.start - self.duration, 0.0)
        rate = np.where(on, self.rate + u * (self.slope + u * (b + u * c)), self.final)
        slope = np.where(on, self.slope + u * (2.0 * b + 3.0 * u * c), 0.0)
        return place, rate, slope, np.where(on, 2.0 * b + 6.0 * u * c, 0.0)

    def now(self, time: float) -> tuple[float, float, float]:
        """The source's time, rate and slope."""
        place, rate, slope, _ = self.at(np.array(time))
        return float(place), float(rate), float(slope)


class Clocked(NamedTuple):
    """A source by a clock of its own."""

    source: Source
    clock: Clock
    joints: int | None = None  # so many columns of the source; None is all

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
        """The position of the source's last column, a place."""
        return float(self.source.at(np.array((self.place(time),)))[0, 0, -1])

    def at(self, times: Array) -> Array:
        """As `Source.at`."""
        place, rate, slope, bend = (x[:, None] for x in self.clock.at(times))
        r = self.source.at(place[:, 0])[:, :, : self.joints]
        v, a, j = r[:, 1], r[:, 2], r[:, 3]
        return np.stack(
            (
                r[:, 0],
                rate * v,
                rate**2 * a + slope * v,
                rate**3 * j + 3.0 * rate * slope * a + bend * v,
            ),
            axis=1,
        )

    def turned(self, time: float, final: float, limits: JointLimits) -> Clocked:
        """The same with a clock that goes over to another rate, and has it as soon as limits of all columns allow.

        Joints that brake at their limit already cannot stop sooner: a steady clock then goes on till there is room.
        """
        place, rate, slope = self.clock.now(time)
        best, soonest = None, inf
        for wait in WAITS if slope == 0.0 else WAITS[:1]:
            if wait >= soonest:
                break
            clock = Clock(time + wait, place + rate * wait, rate, slope, final)
            D, worst = self._turn(clock, limits)
            if best is None or (worst <= TURN_SHARE and wait + D < soonest):
                best = clock._replace(duration=D)
                soonest = wait + D if worst <= TURN_SHARE else inf
        return self._replace(clock=best or self.clock)

    def _turn(self, clock: Clock, limits: JointLimits) -> tuple[float, float]:
        """The shortest change of rate that keeps the limits, or else that with the least excess; its share of them."""
        D, worst = np.geomspace(SHORTEST_STOP * limits.dt, LONGEST_TURN, TURNS), np.zeros(0)
        for some in np.split(D[:, None], TURNS // 8):  # the shortest first
            times = clock.start + np.linspace(0.0, 1.0, 2 * PLACES - 1) * some
            place, rate, slope, bend = (x.ravel()[:, None] for x in clock._replace(duration=some).at(times))
            r = self.source.at(place[:, 0])
            v, a, j = r[:, 1], r[:, 2], r[:, 3]
            jerk = rate**3 * j + 3.0 * rate * slope * a + bend * v
            ratio = limits.ratio(r[:, 0], rate * v, rate**2 * a + slope * v, jerk).reshape(times.shape)
            worst = np.append(worst, ratio.max(axis=1))
            if worst.min() <= TURN_SHARE:
                break
        # What it was going to do anyway is not to be made worse.
        i = int((worst <= max(TURN_SHARE, 1.0001 * float(worst.min()))).argmax())
        return float(D[i]), float(worst[i])


class Reference:
    """What is followed: a source and the residual of the last splice.

    Attributes:
        limits: inside which splices are made.
        source: what is followed.
    """

    def __init__(self, limits: JointLimits, position: Array, time: float) -> None:
        """At rest."""
        self.limits = limits
        self.source: Source = resting(position, time)
        self._residual = np.zeros((6, len(position)))
        self._start, self._duration = time, 0.0

    @property
    def joined(self) -> float:
        """When the last splice is over."""
        return self._start + self._duration

    @property
    def end(self) -> float:
        """When all is at rest."""
        return max(self.joined, self.source.end)

    def at(self, times: Array) -> Array:
        """(k, 4, m) position, velocity, acceleration and jerk at times (k,)."""
        answer = self.source.at(times)
        if times[0] < self.joined:
            u = times - self._start
            left = _powers(np.clip(u, 0.0, self._duration), 6) @ self._residual
            left[u >= self._duration] = 0.0
            answer = answer + left
        return answer

    def course(self, source: Source | None = None, gain: float = JOINT_GAIN, *, shape: bool = False) -> Array | None:
        """What is followed, or would be with a source, as the compiled core takes it; None for what it does not have.

        `gain` [1/s] leads joints back to where they were sent; `shape` says whether a path's shape is kept.
        """
        source = self.source if source is None else source
        limits = self.limits
        m = len(limits.lower)
        clock = Clock(0.0, 0.0, 1.0, 0.0, 1.0)
        if isinstance(source, Clocked):
            source, clock, _ = source
        if core is None or m > core.MOST_JOINTS:
            return None
        if not isinstance(source, Motion):
            return None
        n, k, columns = source.coefficients.shape
        kept = gain, shape, 0.5 * STRAYED if shape else DISPLACED
        head = m, columns, n, k, limits.dt, *kept, *clock, self._start, self._duration
        return np.concatenate((head, self._residual.ravel(), *limits[:5], source.knots, source.coefficients.ravel()))

    def joins(self, time: float, residual: Array, duration: float) -> None:
        """The splice from a time on: a residual (6, m), zero after a duration."""
        self._start, self._residual, self._duration = time, residual, duration

    def follow(self, source: Source, time: float) -> None:
        """Follow a source from a time on without a splice."""
        self.source = source
        self.joins(time, self._residual, 0.0)

    def splice(self, source: Source, time: float, state: Array, duration: float) -> bool:
        """Go over to a source from position, velocity and acceleration (3, m) at a time, in a duration [s].

        Returns:
            Whether that keeps the limits together with the source; if not, the source is followed without a splice,
            which the joints cannot do.
        """
        numbers = self.course(source)
        D = max(duration, SHORTEST_STOP * self.limits.dt)
        self.source = source
        if core is not None and numbers is not None:
            found = core.splice(numbers, time, state, D)
        else:
            here = source.at(np.array((time,)))[0]
            residual = _residual(state - here[:3], D)
            u = np.linspace(0.0, D, PLACES)
            worst = self.limits.ratio(*np.moveaxis(source.at(time + u) + _powers(u, 6) @ residual, 1, 0)).max()
            found = residual if worst <= SHARE else None
        self.joins(time, *((self._residual, 0.0) if found is None else (found, D)))
        return found is not None


def _residual(e: Array, D: float) -> Array:
    """(6, m) the quintic from (3, m) position, velocity and acceleration to zero in a duration."""
    x, v, a = e
    c3 = -(20.0 * x + 12.0 * v * D + 3.0 * a * D**2) / (2.0 * D**3)
    c4 = (30.0 * x + 16.0 * v * D + 3.0 * a * D**2) / (2.0 * D**4)
    c5 = -(12.0 * x + 6.0 * v * D + a * D**2) / (2.0 * D**5)
    return np.stack((x, v, 0.5 * a, c3, c4, c5))


def _powers(u: Array, count: int, derivatives: int = 4) -> Array:
    """(..., derivatives, count) powers of u (...), and what they become by differentiating once, twice, ..."""
    answer: Array = FACTORS[:derivatives, :count] * u[..., None, None] ** EXPONENTS[:derivatives, :count]
    return answer
