"""How much later than told commands act, from how the joints answer the first of them.

    q(t) - q(0) = share * (way commanded until t - late)        the lateness that fits best, over all joints

What is late in the readings cannot be seen so.
"""

from __future__ import annotations

from math import pi

import numpy as np

from invariantqp.control.delay import PASSED, DelayEstimate
from invariantqp.control.tracking import DELAY_SHARE
from invariantqp.errors import written
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.measure import root_at

# It is looked for until the place of contact was told to go this way, in sizes of the contact.
ENOUGH = 2.0
# A delay counts for the force where it is this multiple of what is late by what was told: from then on one swings.
LATE = 2.0
# It counts for the motion where its gain times the delay is this much: from then on the tool goes to and fro.
RINGS = 1.0


class Lag:
    """What is remembered of commands and of the joints' answers; `after` is called once in every tick.

    Attributes:
        told: sum of tick, delay and low-pass [s].
        delay: that was told [s].
        late: by how much later commands act [s]; None before that is known.
    """

    def __init__(self, dt: float, delay: float, cutoff: float) -> None:
        """Nothing yet, for ticks of dt [s], a told delay [s] and the cut-off of the sensor [Hz]."""
        self.told: float = dt + delay + 1.0 / (2.0 * pi * cutoff)
        self.delay, self._dt = delay, dt
        self.late: float | None = None
        self._first: Array | None = None
        self._way = 0.0

    def after(self, q: Array, way: Array, J: Array, place: Array, size: float) -> None:
        """After a tick with joint positions q (m,) at its beginning and a commanded way (m,).

        Args:
            q: [rad, length].
            way: likewise.
            J: (6, m) joint twists.
            place: (3,) of contact, base frame [length].
            size: of the contact [length]: a turn by an angle counts as so much times the angle.
        """
        if self.late is not None:
            return
        if self._first is None:
            moved = root_at(place, size).dot(J)
            self._first, self._weights = q.copy(), np.sqrt((moved * moved).sum(axis=0))
            self._led, self._echo = np.zeros(len(q)), DelayEstimate(self._dt, self.delay, len(q))
        step = self._weights * way
        self._led += step
        self._way += float(np.sqrt(step.dot(step)))
        self.late = self._echo.after(self._weights * (q - self._first), self._led)
        if self.late is None and self._way > ENOUGH * size and self._echo.ticks > PASSED * self._echo.rows:
            self.late = 0.0

    @property
    def beyond(self) -> float:
        """The delay that counts for the force beside what was told [s]; 0 where none does."""
        return self.late if self.late is not None and self.late > LATE * self.told else 0.0

    @property
    def sums(self) -> tuple[float, float, float]:
        """What was told in all, the delay told, and what counts beside it [s]."""
        return self.told, self.delay, self.beyond

    def gain(self, asked: float) -> float:
        """The motion's gain [1/s]: the one asked for, or less where with the delay found the tool goes to and fro."""
        late = self.late or 0.0
        return min(asked, DELAY_SHARE / (self.delay + late)) if asked * late > RINGS else asked

    def trouble(self, asked: float) -> str:
        """What is wrong, in words, "" for nothing; with the motion's gain that was asked for [1/s]."""
        gain = self.gain(asked)
        if not self.late or (gain == asked and not self.beyond):
            return ""
        slower = f", the motion's gain is {written(gain, 3)} instead of {written(asked, 3)} 1/s" if gain < asked else ""
        return f"commands act {written(1e3 * self.late, 3)} ms later than told: tell delay={slower}"
