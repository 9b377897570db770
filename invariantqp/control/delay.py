"""By how much a motion comes later than told after its command, from how well the one explains the other.

    came(t) = share * led(t - late)        the lateness that fits best, over all parts of the motion

`share` is what a robot leaves out of all commands, and no delay.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array

# The longest delay beyond the told one that is looked for [s].
LONGEST = 0.25
# A robot that follows moves by such shares of what it is told.
LEAST_SHARE, MOST_SHARE = 0.5, 1.2
# A delay is found where it leaves less than this share of the motion unexplained, and of what the told one does.
UNEXPLAINED = 0.1
# It has to have passed so often since the first command, and so many ticks more.
PASSED, MORE_TICKS = 2, 10
# Squares below this share of the whole are rounding.
ROUNDING = 1e-12


class DelayEstimate:
    """What is remembered of commands and of what came of them; `after` is called once in every tick.

    Attributes:
        rows: delays that are compared, in ticks from 0 on.
        ticks: since the first command.
    """

    def __init__(self, dt: float, delay: float, parts: int, kept: float = 1.0) -> None:
        """Nothing yet, for ticks of dt [s], a told delay [s] and motions (parts,); `kept` is left of sums each tick."""
        self.rows: int = 2 + round((delay + LONGEST) / dt)
        self.ticks: int = 0
        self._told, self._dt, self._kept = round(delay / dt), dt, kept
        self._led = np.zeros((self.rows, parts))  # by delay in ticks: the command that can show
        self._sums = np.zeros((2, self.rows))
        self._came = 0.0

    def after(self, came: Array, command: Array) -> float | None:
        """The lateness beyond what was told [s], None while none is seen.

        Args:
            came: (parts,) the motion until now, as a way or a velocity.
            command: (parts,) likewise, the one that came would be in the next tick if nothing were late.
        """
        led = self._led
        self._came = self._kept * self._came + float(came.dot(came))
        self._sums *= self._kept
        self._sums += led.dot(came), np.einsum("ij,ij->i", led, led)
        self.ticks += self.ticks > 0 or bool(command.any())
        led[1:] = led[:-1].copy()
        led[0] = command
        return self._found()

    def _found(self) -> float | None:
        (product, square), whole = self._sums, self._came
        if whole == 0.0:
            return None
        share = np.clip(product / np.maximum(square, ROUNDING * whole), LEAST_SHARE, MOST_SHARE)
        left = whole - share * (2.0 * product - share * square)
        best, told = int(np.argmin(left)), self._told
        least = UNEXPLAINED * min(whole, float(left[told])) - ROUNDING * whole
        if left[best] < least and best > told and self.ticks > PASSED * best + MORE_TICKS:
            return (best - told) * self._dt
        return None
