"""How fast a kept shape is driven: as fast as is asked for, where the joints can still stop on it inside all limits.

    q = r(s),  ds/dt = rate >= 0,     a tick is taken only with a stop after it, along r, that keeps the limits

The stop of the tick before, one tick on, is such a stop: there always is one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.paths.reference import Points, Reference, Stop
from invariantqp.paths.time_law import JointLimits

# Changes of the rate that are tried in a tick, as shares of what the joints' jerk allows, the largest first.
CHANGES = (1.0, 0.3, 0.0, -0.3, -1.0)
# Stops of so many durations [s], checked at so many places, to this share of the limits.
STOPS, PLACES, SHARE = (0.02, 0.7, 14), 15, 0.95
# A rate and what is left of the path below which the arm has arrived, as a share of what there was.
ARRIVED = 1e-9
# How soon lateness is to be caught up [s].
SOON = 0.3


class Pace(NamedTuple):
    """A place on a path and how fast it moves."""

    place: float
    rate: float
    change: float  # of the rate
    end: float
    offset: float  # stamps are places plus this
    timed: bool  # whether the path has stamps of its own
    stop: Stop | None = None  # the way to rest along the path, as a function of the time since now

    @property
    def stamp(self) -> float:
        return self.place + self.offset if self.timed else self.place

    @property
    def arrived(self) -> bool:
        return self.rate <= ARRIVED and self.end - self.place <= 1e-6

    def late(self, now: float) -> float:
        return max(now - self.stamp, 0.0) if self.timed and not self.arrived else 0.0

    def stopped(self) -> Pace:
        return self._replace(rate=0.0, change=0.0, stop=None)

    def after(self, reference: Reference, limits: JointLimits, now: float, rate: float, catch_up: float) -> Pace:
        """After a tick."""
        dt = limits.dt
        late = now - self.stamp
        asked = rate
        if self.timed and rate > 0.0:
            asked = float(np.clip(rate * (1.0 + late / SOON), 0.0, max(catch_up * rate, rate)))
        slope = np.abs(reference.at(np.array((self.place,)))[0, 1])
        with np.errstate(divide="ignore"):
            quick = float(np.where(slope > 0.0, limits.jerk / slope, np.inf).min())
            hard = float(np.where(slope > 0.0, limits.acceleration / slope, np.inf).min())
        quick, hard = SHARE * min(quick, 1e6), SHARE * min(hard, 1e4)
        D = np.geomspace(*STOPS[:2], STOPS[2])
        best: Pace | None = None
        for share in CHANGES:
            change = float(np.clip(self.change + share * quick * dt, -hard, hard))
            next_rate = self.rate + dt * change
            if next_rate > asked and share > -1.0 and next_rate > self.rate:
                # no faster than asked: the change has to be over by then
                continue
            if change > 0.0 and next_rate + change * change / (2.0 * quick) > asked and share > -1.0:
                continue
            if next_rate < 0.0:
                continue
            if self.rate <= asked and share < 0.0 and change < 0.0 and self.change >= 0.0 and best is None and share > -1.0:
                pass
            found = self._stoppable(reference, limits, next_rate, change, D)
            if found is not None:
                best = found
                break
        if best is not None:
            return best
        if self.stop is not None:
            state = self.stop.at(np.array((dt,)))[0]
            return self._replace(
                place=float(min(state[0, 0], self.end)), rate=float(state[1, 0]), change=float(state[2, 0]),
                stop=self.stop._replace(start=self.stop.start - dt),
            )
        return self.stopped()

    def _stoppable(self, reference: Reference, limits: JointLimits, rate: float, change: float, D: Array) -> Pace | None:
        """The pace after a tick at a rate, if there is a stop after it."""
        dt = limits.dt
        place = self.place + 0.5 * dt * (self.rate + rate)
        v, a = rate, change
        d = D[:, None]
        b, c = -3.0 * v / d**2 - 2.0 * a / d, 2.0 * v / d**3 + a / d**2
        u = np.linspace(0.0, 1.0, PLACES)[None, :] * d
        s = place + u * (v + u * (0.5 * a + u * (b / 3.0 + 0.25 * u * c)))
        s1 = v + u * (a + u * (b + u * c))
        s2, s3 = a + u * (2.0 * b + 3.0 * u * c), 2.0 * b + 6.0 * u * c
        r = reference.at(np.minimum(s, self.end).ravel()).reshape(*s.shape, 4, -1)
        s1, s2, s3 = s1[..., None], s2[..., None], s3[..., None]
        r1, r2, r3 = r[..., 1, :], r[..., 2, :], r[..., 3, :]
        worst = limits.ratio(
            r[..., 0, :], r1 * s1, r2 * s1**2 + r1 * s2, r3 * s1**3 + 3.0 * r2 * s1 * s2 + r1 * s3
        ).max(axis=1)
        fits = (worst <= 1.0) & (s[:, -1] <= self.end + 1e-12) & (s1[..., 0] >= -1e-9).all(axis=1)
        if not fits.any():
            return None
        i = int(np.flatnonzero(fits)[0])
        stop = Stop.of(np.array([[place], [v], [a]]), 0.0, float(D[i]))
        return self._replace(place=place, rate=rate, change=change, stop=stop)


def paced(
    reference: Reference, pace: Pace | None, place: float, now: float, stamps: Array, joints: Array, limits: JointLimits
) -> Pace:
    """The pace at the beginning of a path, to which the reference goes over."""
    raise NotImplementedError
