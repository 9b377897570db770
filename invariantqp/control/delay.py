"""The delay of a robot beyond the declared one, estimated from how well its commands explain its motion.

    moved(t) = share * commanded(t - delay)        the delay that fits best, over all parts of the motion

`share` is what a robot leaves out of all commands, and no delay.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array

# The longest delay beyond the declared one that is looked for [s].
LONGEST = 0.25
# A robot that follows moves by such shares of what it is commanded.
LEAST_SHARE, MOST_SHARE = 0.5, 1.2
# A delay is found where it leaves less than this share of the motion unexplained, and of what the declared one does.
UNEXPLAINED = 0.1
# It has to have passed so often since the first command, and so many ticks more.
PASSED, MORE_TICKS = 2, 10
# Squares below this share of the whole are rounding.
ROUNDING = 1e-12


class DelayEstimate:
    """The last commands and how the motion follows them; `after` is called once in every tick.

    Attributes:
        rows: delays that are compared, in ticks from 0 on.
        ticks: since the first command.
    """

    def __init__(self, dt: float, delay: float, parts: int, kept: float = 1.0) -> None:
        """Nothing yet, for ticks of dt [s], a declared delay [s] and motions (parts,); a tick leaves `kept` of sums."""
        self.rows: int = 2 + round((delay + LONGEST) / dt)
        self.ticks: int = 0
        self._declared, self._dt, self._kept = round(delay / dt), dt, kept
        self._commanded = np.zeros((self.rows, parts))  # by delay in ticks: the command that can show
        self._sums = np.zeros((2, self.rows))
        self._moved = 0.0

    def after(self, moved: Array, command: Array) -> float | None:
        """The delay beyond the declared one [s], None while none is seen.

        Args:
            moved: (parts,) the motion until now, as a way or a velocity.
            command: (parts,) likewise, what would have moved by the next tick if nothing were late.
        """
        commanded = self._commanded
        self._moved = self._kept * self._moved + float(moved.dot(moved))
        self._sums *= self._kept
        self._sums += commanded.dot(moved), np.einsum("ij,ij->i", commanded, commanded)
        self.ticks += self.ticks > 0 or bool(command.any())
        commanded[1:] = commanded[:-1].copy()
        commanded[0] = command
        return self._delay()

    def _delay(self) -> float | None:
        (product, square), whole = self._sums, self._moved
        if whole == 0.0:
            return None
        share = np.clip(product / np.maximum(square, ROUNDING * whole), LEAST_SHARE, MOST_SHARE)
        left = whole - share * (2.0 * product - share * square)
        best, declared = int(np.argmin(left)), self._declared
        least = UNEXPLAINED * min(whole, float(left[declared])) - ROUNDING * whole
        if left[best] < least and best > declared and self.ticks > PASSED * best + MORE_TICKS:
            return (best - declared) * self._dt
        return None
