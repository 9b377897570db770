"""The joint motion that is followed, in stamp time: a source, and what is left of the jump to it.

    r(t) = source(t) + residual(t),     residual: a quintic from the jump in position, velocity, acceleration to zero

A source may be replaced at any time: r is then continuous with its first two derivatives (a C2 splice), and jerk stays
bounded. Sources: joint positions with stamps, smoothed without delay (`Points`), samples of a hand read a little late
(`Window`), a stop (`Stop`). Each comes to rest after its end by itself.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded

from invariantqp.geometry.arrays import Array
from invariantqp.paths.time_law import JointLimits

# Shares of the limits that a splice and a stop are made for: the rest covers what lies between the places checked.
SPLICE_SHARE, STOP_SHARE = 0.9, 0.97
# A splice is checked at so many places, for so many durations, up to the longest [s]; what needs longer is caught up.
PLACES, DURATIONS, LONGEST = 21, 6, 0.6
# Stops looked at: the shortest in ticks, for a jerk that lasts less than three is none; the longest [s].
SHORTEST_STOP, LONGEST_STOP, STOPS = 4.0, 12.0, 64
# The window over a hand's samples reaches this far to each side, times one over the cutoff: 65 ms at 4 Hz.
WINDOW = 0.26
# Samples that a window keeps at most, and the share of its width nearer than which two are one.
MOST_SAMPLES, SAMPLE_SHARE = 64, 1.0 / 48.0
# Samples this far apart, as a share of the window's half, say which way a hand goes; nearer ones hardly do.
SPREAD = 0.1
# How fast the mean transport time follows the measured one, a share of the difference for each sample.
TRANSPORT_SHARE = 0.02
_FACTORIALS = np.array((1.0, 1.0, 2.0, 6.0))


class Source(Protocol):
    """A joint motion in stamp time."""

    @property
    def end(self) -> float:
        """After which it is at rest."""
        ...

    def at(self, times: Array) -> Array:
        """(k, 4, m) position, velocity, acceleration and jerk at times (k,)."""
        ...


class Stop(NamedTuple):
    """From a state to rest: velocity is a cubic of time that ends at zero with its slope."""

    start: float
    duration: float
    coefficients: Array  # (5, m) of powers of the time since the start

    @classmethod
    def of(cls, state: Array, start: float, duration: float) -> Stop:
        """From position, velocity and acceleration (3, m), in a given time."""
        x, v, a = state
        D = duration
        if D <= 0.0:
            return cls(start, 0.0, np.vstack((x, np.zeros((4, len(x))))))
        # v(u) = v + a u + b u^2 + c u^3 with v(D) = v'(D) = 0
        b = -3.0 * v / D**2 - 2.0 * a / D
        c = 2.0 * v / D**3 + a / D**2
        return cls(start, D, np.vstack((x, v, 0.5 * a, b / 3.0, 0.25 * c)))

    @property
    def end(self) -> float:
        """When it is at rest."""
        return self.start + self.duration

    def at(self, times: Array) -> Array:
        """As `Source.at`."""
        u = np.clip(times - self.start, 0.0, self.duration)
        answer = _derivatives(self.coefficients, u)
        answer[(times >= self.end) | (times < self.start), 1:] = 0.0
        return answer


def stopping(state: Array, start: float, limits: JointLimits) -> Stop:
    """The quickest stop from position, velocity and acceleration (3, m) that keeps the limits."""
    x, v, a = state
    if not (v.any() or a.any()):
        return Stop.of(state, start, 0.0)
    D = np.geomspace(SHORTEST_STOP * limits.dt, LONGEST_STOP, STOPS)[:, None, None]
    u = np.linspace(0.0, 1.0, PLACES)[None, :, None] * D
    b, c = -3.0 * v / D**2 - 2.0 * a / D, 2.0 * v / D**3 + a / D**2
    velocity = v + u * (a + u * (b + u * c))
    acceleration = a + u * (2.0 * b + 3.0 * u * c)
    jerk = 2.0 * b + 6.0 * u * c
    position = x + u * (v + u * (0.5 * a + u * (b / 3.0 + 0.25 * u * c)))
    worst = limits.ratio(position, velocity, acceleration, jerk).max(axis=1)
    # Where the state is at a limit already, the stop is not to make it worse.
    allowed = max(STOP_SHARE, 1.0001 * float(worst[:, None].min()))
    fits = np.flatnonzero(worst <= allowed)
    return Stop.of(state, start, float(D[fits[0], 0, 0]))


class Points:
    """A cubic spline through joint positions, with a way in from rest before them and out to rest after them."""

    def __init__(self, stamps: Array, positions: Array, limits: JointLimits, *, moving_in: bool = True) -> None:
        """Through positions (n, m) at increasing stamps (n,)."""
        self.stamps, self.positions = stamps, positions
        n, m = positions.shape
        self._coefficients = np.zeros((4, max(n - 1, 1), m))
        if n == 1:
            self._coefficients[3, 0] = positions[0]
        elif n == 2:
            self._coefficients[2, 0] = (positions[1] - positions[0]) / (stamps[1] - stamps[0])
            self._coefficients[3, 0] = positions[0]
        else:
            self._coefficients = CubicSpline(stamps, positions, bc_type="natural").c
        first, last = self._inside(np.array((stamps[0], stamps[-1])))
        self._out = stopping(last[:3], float(stamps[-1]), limits)
        back = first[:3] * np.array((1.0, -1.0, 1.0))[:, None]
        self._in = stopping(back if moving_in else back * np.array((1.0, 0.0, 0.0))[:, None], 0.0, limits)

    @property
    def start(self) -> float:
        """Where the way in begins."""
        return float(self.stamps[0]) - self._in.duration

    @property
    def end(self) -> float:
        """When it is at rest."""
        return self._out.end

    def at(self, times: Array) -> Array:
        """As `Source.at`."""
        first, last = float(self.stamps[0]), float(self.stamps[-1])
        if len(times) == 1:
            t = float(times[0])
            if first <= t <= last:
                return self._inside(times)
            return self._out.at(times) if t > last else self._before(times)
        answer = self._inside(np.clip(times, first, last))
        after, before = times > last, times < first
        if after.any():
            answer[after] = self._out.at(times[after])
        if before.any():
            answer[before] = self._before(times[before])
        return answer

    def _before(self, times: Array) -> Array:
        """On the way in, which is a stop run backward."""
        back = self._in.at(float(self.stamps[0]) - times)
        back[:, 1::2] *= -1.0
        return back

    def _inside(self, times: Array) -> Array:
        i = np.clip(np.searchsorted(self.stamps, times, side="right") - 1, 0, self._coefficients.shape[1] - 1)
        u = (times - self.stamps[i])[:, None]
        c3, c2, c1, c0 = self._coefficients[:, i]
        return np.stack(
            (c0 + u * (c1 + u * (c2 + u * c3)), c1 + u * (2.0 * c2 + 3.0 * u * c3), 2.0 * c2 + 6.0 * u * c3, 6.0 * c3),
            axis=1,
        )


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


class Steady(NamedTuple):
    """At the velocity of a state."""

    start: float
    state: Array  # (3, m)

    @property
    def end(self) -> float:
        """It has none."""
        return inf

    def at(self, times: Array) -> Array:
        """As `Source.at`."""
        answer = np.zeros((len(times), 4, self.state.shape[1]))
        answer[:, 0] = self.state[0]  # where it leads is not known
        answer[:, 1] = self.state[1]
        return answer


class Slowed(NamedTuple):
    """A source driven at a share of its speed."""

    source: Source
    start: float
    first: float  # the source's time at the start
    rate: float

    @property
    def end(self) -> float:
        """When it is at rest."""
        return self.start + (self.source.end - self.first) / self.rate

    def place(self, time: float) -> float:
        """The source's own time."""
        return self.first + self.rate * (time - self.start)

    def at(self, times: Array) -> Array:
        """As `Source.at`."""
        answer = self.source.at(self.first + self.rate * (times - self.start))
        slowed: Array = answer * (self.rate ** np.arange(4.0))[:, None]
        return slowed


class Reference:
    """What is followed: a source and the residual of the last splice."""

    def __init__(self, limits: JointLimits, position: Array, time: float) -> None:
        """At rest."""
        self._limits = limits
        m = len(position)
        self.source: Source = Stop.of(np.vstack((position, np.zeros((2, m)))), time, 0.0)
        self._residual = np.zeros((6, m))
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
            left = _derivatives(self._residual, np.clip(u, 0.0, self._duration))
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

    def ease(self, source: Source, time: float, state: Array, shortest: float) -> None:
        """Go over to a source that differs little: as `splice`, but no earlier than the splice before is over."""
        e = state - source.at(np.array((time,)))[0, :3]
        D = max(shortest, self.joined - time)
        self.source, self._residual, self._start, self._duration = source, _residuals(e, np.array((D,)))[0], time, D

    def splice(self, source: Source, time: float, state: Array, shortest: float) -> bool:
        """Go over to a source from position, velocity and acceleration (3, m) at a time.

        The splice is the shortest, not shorter than `shortest` [s], that keeps the limits together with the source.

        Returns:
            Whether there is one; if not, the source is followed without one, which the joints cannot do.
        """
        here = source.at(np.array((time,)))[0, :3]
        e = state - here
        least = max(shortest, SHORTEST_STOP * self._limits.dt)
        D = np.geomspace(least, max(LONGEST, least), DURATIONS)
        C = _residuals(e, D)  # (k, 6, m)
        u = np.linspace(0.0, 1.0, PLACES)[None, :] * D[:, None]
        # A hand is taken to go on as it does.
        ahead = Steady(time, here) if isinstance(source, Window) else source
        there = ahead.at((time + u).ravel()).reshape(*u.shape, 4, -1)
        total = there + _powers(u) @ C[:, None]
        fits = np.flatnonzero(self._limits.ratio(*np.moveaxis(total, 2, 0)).max(axis=1) <= SPLICE_SHARE)
        self.source, self._start = source, time
        if len(fits):
            i = int(fits[0])
            self._residual, self._duration = C[i], float(D[i])
        else:
            self._duration = 0.0
        return bool(len(fits))


def _residuals(e: Array, D: Array) -> Array:
    """(k, 6, m) quintics from (3, m) position, velocity and acceleration to zero in D (k,)."""
    x, v, a = e
    D = D[:, None]
    c3 = -(20.0 * x + 12.0 * v * D + 3.0 * a * D**2) / (2.0 * D**3)
    c4 = (30.0 * x + 16.0 * v * D + 3.0 * a * D**2) / (2.0 * D**4)
    c5 = -(12.0 * x + 6.0 * v * D + a * D**2) / (2.0 * D**5)
    one = np.ones_like(D)
    return np.stack((one * x, one * v, one * 0.5 * a, c3, c4, c5), axis=1)


def _powers(u: Array) -> Array:
    """(..., 4, 6) powers of u (...) and their first three derivatives."""
    answer = np.zeros((*u.shape, 4, 6))
    for d in range(4):
        for n in range(d, 6):
            factor = float(np.prod(np.arange(n, n - d, -1))) if d else 1.0
            answer[..., d, n] = factor * u ** (n - d)
    return answer


def _derivatives(coefficients: Array, u: Array) -> Array:
    """(k, 4, m) a polynomial (n, m), by powers, and three derivatives at u (k,)."""
    answer: Array = _powers(u)[..., : len(coefficients)] @ coefficients
    return answer
