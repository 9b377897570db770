"""How far commands have moved joints, the place of contact, and against its constraints, before that is measured."""

from __future__ import annotations

from collections import deque

import numpy as np

from invariantqp.geometry.arrays import Array

# Shares of the told delay that an arm may have in a quick swing.
SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)


class Ways:
    """The last commands' ways, oldest first: the oldest shows in this tick's measurements.

    Attributes:
        joints: (m,) ways of the joints that do not show yet, or () before any.
        place: (3,) ways of the place of contact, base frame [length].
        against: (n,) ways against the constraints, in the unit parts of a `Split`.
    """

    def __init__(self, delay: float, dt: float) -> None:
        """No ways yet, for a told delay and ticks of dt [s]."""
        self._time = delay, dt
        ticks = 1 + round(delay / dt)
        self.joints: deque[Array] = deque(maxlen=ticks - 1)
        self.place: deque[Array] = deque([np.zeros(3)] * ticks, maxlen=ticks)
        self.against: deque[Array] = deque([np.zeros(0)] * ticks, maxlen=ticks)

    def add(self, joints: Array, place: Array, against: Array, later: float) -> None:
        """One more command's ways; the place shows later than was told [s]."""
        delay, dt = self._time
        ticks = 1 + round((delay + later) / dt)
        if ticks > len(self.place):
            self.place = deque([*[np.zeros(3)] * (ticks - len(self.place)), *self.place], maxlen=ticks)
            self.joints = deque(self.joints, maxlen=ticks - 1)
        self.joints.append(joints)
        self.place.append(place)
        self.against.append(against)

    def coming(self, q: Array) -> Array:
        """(m,) where the joints will be when the next command acts, from where they are measured."""
        return np.asarray(sum(self.joints, start=q))

    def shown(self, n: int) -> Array:
        """(s, n) ways against n constraints that show now, if the delay is each of SHARES of what was told.

        A lag that was told as a delay is less of one in a quick swing.
        """
        ticks = len(self.against)
        ways = (self.against[round((1.0 - share) * (ticks - 1))] for share in SHARES)
        return np.array([way if len(way) == n else np.zeros(n) for way in ways])
