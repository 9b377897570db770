"""Stamps: seconds of one clock near the follower's, checked; arrivals of a stream's items and its timeout."""

from __future__ import annotations

import warnings
from math import inf, sqrt

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.paths.joint_limits import speed_scale
from invariantqp.paths.waypoints import Waypoints

# Stamps this far [s] from the follower's clock are of another clock; points as far apart in the mean are suspect.
ANOTHER_CLOCK = 1.0
# No two points are so far apart [s]: the geometric mean of a second and its nanoseconds.
MAX_STAMP_GAP = sqrt(1e9)
# A stream ends after so many of its intervals without an item, at most after the second [s]: four items in a row may be
# lost. Items farther apart are of several streams. The follower waits for the second sample for the third time [s].
INTERVALS, MAX_TIMEOUT, FIRST_TIMEOUT = 5.0, 0.5, 0.4
# The share of a new interval in their mean.
INTERVAL_SHARE = 0.1


def checked_stamps(stamps: ArrayLike, count: int) -> Array:
    """(count,) stamps, checked.

    Raises:
        BadInput: not `count` numbers, not increasing, or in nanoseconds.
    """
    times = arrays.vector(stamps, count, "stamps").copy()
    apart = np.diff(times)
    if not (apart > 0.0).all():
        raise BadInput("stamps", "stamps that do not increase", "one for each point, increasing")
    if (most := float(apart.max(initial=0.0))) > MAX_STAMP_GAP:
        raise BadInput("stamps", f"stamps {most:.3g} s apart", "times in seconds", "Are these nanoseconds?")
    return times


def warn_if_milliseconds(stamps: Array, given: Waypoints, speed: Array, length: float) -> None:
    """Warn of stamps (n,) that look like milliseconds: the arm could pass the points a thousand times as fast.

    Rotations of poses count as `length` [length/rad]; `speed` are the joints' limits (m,) [rad/s, length/s].
    """
    duration = float(stamps[-1] - stamps[0])
    if duration < ANOTHER_CLOCK * max(len(stamps) - 1, 1):
        return
    speed = speed_scale(speed)
    if given.joints is not None:
        distance = float((np.abs(np.diff(given.joints, axis=0)).sum(axis=0) / speed).max())
    elif given.poses is None:
        distance = float(np.linalg.norm(np.diff(given.places, axis=0), axis=1).sum() / speed.max())
    else:
        parts = np.diff(given.poses[:, :3] / (1.0, 1.0, 1.0, length), axis=0)
        distance = float(np.linalg.norm(parts, axis=1).sum(axis=0).max() / speed.max())
    if 0.0 < 1e3 * distance <= duration:
        _warn(f"in the {duration:g} s of these points the arm hardly moves", 2)


class SampleClock:
    """The clock of a stream's samples in the follower's time."""

    def __init__(self) -> None:
        """The follower's clock."""
        self._shift, self._ahead = 0.0, 0  # samples in a row that were ahead

    def time(self, stamp: float | None, now: float) -> tuple[float, bool]:
        """The time of a sample that comes now, by the follower's clock; whether it is the first of another clock."""
        when = now if stamp is None else stamp + self._shift
        self._ahead = self._ahead + 1 if when - now > ANOTHER_CLOCK else 0
        if self._ahead == 2:  # in a row: another unit, not another clock
            _warn(f"these are more than {ANOTHER_CLOCK:g} s later, one after the other", 6)
        if stamp is None or abs(when - now) <= ANOTHER_CLOCK:
            return when, False
        self._shift = now - stamp
        return now, True


class Arrivals:
    """When the items of a stream arrive, and how long to wait for the next one.

    Attributes:
        last: when the newest arrived [s].
    """

    def __init__(self, shortest: float, first: float) -> None:
        """No item yet; `shortest` is the shortest timeout [s], `first` that before the interval is known."""
        self._shortest, self._first = shortest, first
        self._interval = 0.0  # mean [s], 0 before two have arrived
        self.last = -inf

    @property
    def timeout(self) -> float:
        """After how long without an item the stream has ended [s]."""
        known = self._interval > 0.0
        return max(self._shortest, min(INTERVALS * self._interval, MAX_TIMEOUT) if known else self._first)

    def add(self, now: float) -> None:
        """An item arrives."""
        gap, mean = now - self.last, self._interval
        if gap > max(self.timeout, MAX_TIMEOUT):
            self._interval = 0.0
        elif gap > 0.0:
            self._interval = gap if mean == 0.0 else mean + INTERVAL_SHARE * (gap - mean)
        self.last = now


def _warn(why: str, depth: int) -> None:
    """Warn the caller at a depth of stamps in milliseconds."""
    message = f"stamps are seconds here: {why}. Times in milliseconds are 1e-3 * times"
    warnings.warn(message, UserWarning, stacklevel=depth + 2)
