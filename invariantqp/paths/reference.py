"""The joint motion that is followed, in stamp time: a source, and what is left of the jump to it.

    r(t) = source(t) + residual(t),     residual: a quintic from the jump in position, velocity, acceleration to zero

A source may be replaced at any time: r is then continuous with its first two derivatives (a C2 splice), and jerk stays
bounded. Sources: polynomials of time (`Motion`: points with stamps, smoothed without delay, a path, a stop), samples
of a hand read a little late (`Window`), either of them by another clock (`Clocked`). Each comes to rest after its end.
"""

from __future__ import annotations

from math import inf, perm
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline
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
# Stops looked at: the shortest in ticks, for a jerk that lasts less than three is none; the longest [s]; how many at
# once. Of changes of a clock's rate.
SHORTEST_STOP, LONGEST_STOP, STOPS, TURNS = 4.0, 12.0, 10, 64
# Changes of a clock's rate take at most this [s], are checked at so many places, and keep this share of the limits.
LONGEST_TURN, PLACES_TURN, TURN_SHARE = 4.0, 41, 0.999
# How long such a change may wait for joints that brake [s].
WAITS = (0.0, 0.02, 0.05, 0.1, 0.2)
# The window over a hand's samples reaches this far to each side, times one over the cutoff: 65 ms at 4 Hz.
WINDOW = 0.26
# Samples that a window keeps at most, and the share of its width nearer than which two are one.
MOST_SAMPLES, SAMPLE_SHARE = 64, 1.0 / 48.0
# Samples this far apart, as a share of the window's half, say which way a hand goes; nearer ones hardly do.
SPREAD = 0.1
# How fast the mean transport time follows the measured one, a share of the difference for each sample.
TRANSPORT_SHARE = 0.02
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

    def __init__(self, knots: Array, coefficients: Array) -> None:
        """Pieces between knots (n + 1,): powers (n, k, m) of the time since each began, from the constant on."""
        self.knots, self.coefficients = knots, coefficients
        self.start, self.end = float(knots[0]), float(knots[-1])

    def at(self, times: Array) -> Array:
        """As `Source.at`."""
        i = np.clip(np.searchsorted(self.knots, times, side="right") - 1, 0, len(self.coefficients) - 1)
        u = np.clip(times, self.start, self.end) - self.knots[i]
        c = self.coefficients[i]
        answer: Array = _powers(u, c.shape[1]) @ c
        answer[(times >= self.end) | (times < self.start), 1:] = 0.0
        return answer


def resting(position: Array, time: float) -> Motion:
    """At a position (m,), always."""
    return Motion(np.array((time, time)), position[None, None])


def stopping(state: Array, start: float, limits: JointLimits, shortest: float = 0.0) -> Motion:
    """The quickest stop from position, velocity and acceleration (3, m) inside the limits, at least so long [s].

    Velocity is a cubic that ends at zero with its slope; a state at rest takes no time.
    """
    x, v, a = state
    if not (v.any() or a.any()):
        return resting(x, start)
    first, last = max(SHORTEST_STOP * limits.dt, shortest), LONGEST_STOP
    for _ in range(2):  # a few over the whole range, then a few between two of them
        times = np.geomspace(first, last, STOPS)[:, None, None]
        u = np.linspace(0.0, 1.0, PLACES)[None, :, None] * times
        b, c = -3.0 * v / times**2 - 2.0 * a / times, 2.0 * v / times**3 + a / times**2
        velocity = v + u * (a + u * (b + u * c))
        acceleration = a + u * (2.0 * b + 3.0 * u * c)
        jerk = 2.0 * b + 6.0 * u * c
        position = x + u * (v + u * (0.5 * a + u * (b / 3.0 + 0.25 * u * c)))
        worst = limits.ratio(position, velocity, acceleration, jerk).max(axis=1)
        # Where the state is at a limit already, the stop is not to make it worse.
        i = int((worst <= max(SHARE, 1.0001 * float(worst.min()))).argmax())
        first, last = float(times[max(i - 1, 0), 0, 0]), float(times[i, 0, 0])
    D = last
    b, c = -3.0 * v / D**2 - 2.0 * a / D, 2.0 * v / D**3 + a / D**2
    return Motion(np.array((start, start + D)), np.stack((x, v, 0.5 * a, b / 3.0, 0.25 * c))[None])


def through(stamps: Array, positions: Array, limits: JointLimits, ease: float, cutoff: float = inf) -> Motion:
    """A cubic spline through positions (n, m) at increasing stamps (n,), with a way in from rest and out to rest.

    These take no less than `ease` [s]: that no point follows is no emergency. What is faster than the cutoff [Hz] is
    smoothed away before.
    """
    if len(stamps) == 1:
        return resting(positions[0], float(stamps[0]))
    if core is not None and positions.shape[1] <= core.MOST_JOINTS:
        strength = (2.0 * np.pi * cutoff) ** -4
        return Motion(*core.through(limits.rows, limits.dt, stamps, positions, strength, ease))
    positions = np.clip(smoothed(stamps, positions, cutoff), limits.lower, limits.upper)
    n, m = positions.shape
    inside = np.zeros((n - 1, 5, m))
    inside[:, 0] = positions[:-1]
    if n == 2:
        inside[0, 1] = (positions[1] - positions[0]) / (stamps[1] - stamps[0])
    else:
        inside[:, :4] = np.moveaxis(CubicSpline(stamps, positions, bc_type="natural").c[::-1], 0, 1)
    first = inside[0, :3] * np.array((1.0, -1.0, 2.0))[:, None]  # run backward
    last = (_powers(np.array((stamps[-1] - stamps[-2],)), 5) @ inside[-1])[0, :3]
    way_in, out = stopping(first, 0.0, limits, ease), stopping(last, float(stamps[-1]), limits, ease)
    pieces, knots = [inside], [stamps]
    if out.end > out.start:
        pieces.append(out.coefficients)
        knots.append(np.array((out.end,)))
    if way_in.end > 0.0:
        D = way_in.end
        back = (_powers(np.array((D,)), 5, 5)[0] / np.diag(FACTORS)[:, None]) @ way_in.coefficients[0]
        pieces.insert(0, (back * np.array((1.0, -1.0, 1.0, -1.0, 1.0))[:, None])[None])
        knots.insert(0, stamps[:1] - D)
    return Motion(np.concatenate(knots), np.concatenate(pieces))


def smoothed(stamps: Array, positions: Array, cutoff: float) -> Array:
    """(n, m) positions at stamps (n,) without what is faster than a frequency [Hz], and without delay.

    argmin sum |y - positions|^2 + lambda sum |y''|^2,     lambda = (2 pi cutoff)^-4
    """
    n = len(stamps)
    if n < 3 or cutoff == inf:
        return positions
    gaps = np.diff(stamps)
    near, far = gaps[:-1], gaps[1:]
    scale = 2.0 / (near + far)
    D = np.array((scale / near, -scale * (1.0 / near + 1.0 / far), scale / far))  # second differences, (3, n - 2)
    strength = (2.0 * np.pi * cutoff) ** -4
    bands = np.zeros((3, n))  # upper form: I + strength D'D
    bands[2] = 1.0
    for i in range(3):
        bands[2, i : i + n - 2] += strength * D[i] ** 2
    bands[1, 1 : n - 1] += strength * D[0] * D[1]
    bands[1, 2:n] += strength * D[1] * D[2]
    bands[0, 2:n] += strength * D[0] * D[2]
    return np.asarray(solveh_banded(bands, positions))


class Window:
    """Samples of a hand, as joint positions: a weighted line through those near the time read, which is a little late.

        r(t) = the line through the samples at t - late, weights (1 - ((t - late - stamp) / half)^2)^4

    `late` is the mean transport time and the window's half: a sample comes in with weight zero, so r is smooth however
    noisy the samples are.
    """

    def __init__(self, cutoff: float, period: float, stamp: float, position: Array, transport: float) -> None:
        """From one sample on; before it the hand was there, too."""
        self.half: float = WINDOW / cutoff
        self.transport = transport
        self._dt = period
        # A hand that was at rest: samples before the first.
        before = stamp - np.array((2.0, 1.5, 1.0, 0.5)) * self.half
        self.stamps: Array = np.append(before, stamp)
        self.positions: Array = np.tile(position, (5, 1))

    @property
    def late(self) -> float:
        """How long after its stamp a sample is followed [s]."""
        return self.transport + self.half

    @property
    def end(self) -> float:
        """No sample says where it ends."""
        return inf

    def add(self, stamp: float, position: Array, transport: float) -> None:
        """A sample (m,) with a stamp later than all before it."""
        if stamp - float(self.stamps[-1]) < SAMPLE_SHARE * self.half:
            return
        self.transport += TRANSPORT_SHARE * (transport - self.transport)
        self.stamps = np.append(self.stamps, stamp)[-MOST_SAMPLES:]
        self.positions = np.vstack((self.positions, position))[-MOST_SAMPLES:]

    def position(self, times: Array) -> Array:
        """(k, m) where the joints are to be at times (k,)."""
        # Beyond the samples, as at the last place that has one in the middle of its window; the line goes on.
        read = times - self.late
        centre = np.clip(read, self.stamps[0], self.stamps[-1])[:, None]
        u = (self.stamps - centre) / self.half
        w = np.maximum(1.0 - u * u, 0.0)
        w *= w
        w *= w
        total = w.sum(axis=1)[:, None]
        mean = w.dot(self.positions) / total
        middle = (w * self.stamps).sum(axis=1)[:, None] / total
        away = (self.stamps - middle) / self.half
        spread = (w * away * away).sum(axis=1)[:, None] / total
        slope = (w * away).dot(self.positions) / total / (spread + SPREAD**2 * SPREAD)
        ahead: Array = mean + slope * ((read[:, None] - middle) / self.half)
        return ahead

    def at(self, times: Array) -> Array:
        """As `Source.at`; derivatives are differences over ticks."""
        h = self._dt
        grid = times[:, None] + h * np.arange(-2, 3)
        p = self.position(grid.ravel()).reshape(len(times), 5, -1)
        v = (p[:, 3] - p[:, 1]) / (2.0 * h)
        a = (p[:, 3] - 2.0 * p[:, 2] + p[:, 1]) / h**2
        j = (p[:, 4] - 2.0 * p[:, 3] + 2.0 * p[:, 1] - p[:, 0]) / (2.0 * h**3)
        return np.stack((p[:, 2], v, a, j), axis=1)


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
        D = np.geomspace(SHORTEST_STOP * limits.dt, LONGEST_TURN, TURNS)[:, None]
        times = clock.start + np.linspace(0.0, 1.0, PLACES_TURN) * D
        place, rate, slope, bend = (x.ravel()[:, None] for x in clock._replace(duration=D).at(times))
        r = self.source.at(place[:, 0])
        v, a, j = r[:, 1], r[:, 2], r[:, 3]
        jerk = rate**3 * j + 3.0 * rate * slope * a + bend * v
        worst = limits.ratio(r[:, 0], rate * v, rate**2 * a + slope * v, jerk).reshape(times.shape).max(axis=1)
        # What it was going to do anyway is not to be made worse.
        i = int((worst <= max(TURN_SHARE, 1.0001 * float(worst.min()))).argmax())
        return float(D[i, 0]), float(worst[i])


class Reference:
    """What is followed: a source and the residual of the last splice."""

    def __init__(self, limits: JointLimits, position: Array, time: float) -> None:
        """At rest."""
        self._limits = limits
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
        if len(times) == 1 and (numbers := self.course()) is not None and core is not None:
            motion: Array = core.motion(numbers, float(times[0]))[None, :, : len(self._limits.lower)]
            return motion
        answer = self.source.at(times)
        if times[0] < self.joined:
            u = times - self._start
            left = _powers(np.clip(u, 0.0, self._duration), 6) @ self._residual
            left[u >= self._duration] = 0.0
            answer = answer + left
        return answer

    def position(self, time: float) -> Array:
        """(m,) where the joints are to be."""
        times = np.array((time,))
        source = self.source
        there: Array = source.position(times)[0] if isinstance(source, Window) else source.at(times)[0, 0]
        if time < self.joined:
            there = there + (time - self._start) ** np.arange(6) @ self._residual
        return there

    def course(self, source: Source | None = None, gain: float | None = None) -> Array | None:
        """What is followed, or would be with a source, as the compiled core takes it; None for what it does not have.

        `gain` is that towards a path whose shape is kept; None keeps time.
        """
        source = self.source if source is None else source
        limits = self._limits
        m = len(limits.lower)
        clock = Clock(0.0, 0.0, 1.0, 0.0, 1.0)
        if isinstance(source, Clocked):
            source, clock, _ = source
        window = (source.half, source.late) if isinstance(source, Window) else (0.0, 0.0)
        if core is None or m > core.MOST_JOINTS:
            return None
        if isinstance(source, Window):
            sizes, values = (m, m, 0, len(source.stamps)), (source.stamps, source.positions.ravel())
        elif isinstance(source, Motion):
            n, k, columns = source.coefficients.shape
            sizes, values = (m, columns, n, k), (source.knots, source.coefficients.ravel())
        else:
            return None
        kept = (JOINT_GAIN, False, DISPLACED) if gain is None else (gain, True, 0.5 * STRAYED)
        head = *sizes, limits.dt, *kept, *clock, self._start, self._duration, *window
        return np.concatenate((head, self._residual.ravel(), *limits[:5], *values))

    def joins(self, time: float, residual: Array, duration: float) -> None:
        """The splice from a time on: a residual (6, m), zero after a duration."""
        self._start, self._residual, self._duration = time, residual, duration

    def splice(self, source: Source, time: float, state: Array, duration: float) -> bool:
        """Go over to a source from position, velocity and acceleration (3, m) at a time, in a duration [s].

        Returns:
            Whether that keeps the limits together with the source; if not, the source is followed without a splice,
            which the joints cannot do.
        """
        numbers = self.course(source)
        D = max(duration, SHORTEST_STOP * self._limits.dt)
        self.source = source
        if core is not None and numbers is not None:
            found = core.splice(numbers, time, state, D)
        else:
            here = source.at(np.array((time,)))[0]
            residual = _residual(state - here[:3], D)
            u = np.linspace(0.0, D, PLACES)
            here[2:] = 0.0  # a hand is taken to go on as it does
            there = here if isinstance(source, Window) else source.at(time + u)
            worst = self._limits.ratio(*np.moveaxis(there + _powers(u, 6) @ residual, 1, 0)).max()
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
