"""The delay of a robot beyond the declared one, estimated from how well its commands explain its motion.

    moved(t) = share * commanded(t - delay)        the delay that fits best, over all parts of the motion

`share` is what a robot leaves out of all commands, and no delay.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import ROUNDING, Array

# The longest delay beyond the declared one that is looked for [s].
LONGEST = 0.25
# A robot that follows moves by such shares of what it is commanded.
LEAST_SHARE, MOST_SHARE = 0.5, 1.2
# A delay is found where it leaves less than this share of the motion unexplained, and of what the declared one does.
UNEXPLAINED = 0.1
# It has to have passed so often since the first command, and so many ticks more.
PASSED, MORE_TICKS = 2, 10


class DelayEstimate:
    """The last commands and how the motion follows them; `after` is called once in every tick.

    Attributes:
        rows: delays that are compared, in ticks from 0 on.
        kept: (2 + (2 + parts) rows,) what it remembers: ticks since the first command, the square of all motion; by
            delay in ticks the sums of commands times motion, of squares of commands, and the command that can show.
    """

    def __init__(self, dt: float, delay: float, parts: int, kept: float = 1.0) -> None:
        """Nothing yet, for ticks of dt [s], a declared delay [s] and motions (parts,); a tick leaves `kept` of sums."""
        self.rows: int = 2 + round((delay + LONGEST) / dt)
        self._declared, self._dt, self._left = round(delay / dt), dt, kept
        self.kept: Array = np.zeros(2 + (2 + parts) * self.rows)

    @property
    def ticks(self) -> float:
        """Since the first command."""
        return float(self.kept[0])

    def after(self, moved: Array, command: Array) -> float | None:
        """The delay beyond the declared one [s], None while none is seen.

        Args:
            moved: (parts,) the motion until now, as a way or a velocity.
            command: (parts,) likewise, what would have moved by the next tick if nothing were late.
        """
        head, rows, left = self.kept[:2], self.rows, self._left
        sums, commanded = self.kept[2 : 2 + 2 * rows].reshape(2, rows), self.kept[2 + 2 * rows :].reshape(rows, -1)
        head[1] = left * head[1] + float(moved.dot(moved))
        sums *= left
        sums += commanded.dot(moved), np.einsum("ij,ij->i", commanded, commanded)
        head[0] += head[0] > 0.0 or bool(command.any())
        commanded[1:] = commanded[:-1].copy()
        commanded[0] = command
        ticks, whole = head.tolist()
        if whole == 0.0:
            return None
        product, square = sums
        share = np.clip(product / np.maximum(square, ROUNDING * whole), LEAST_SHARE, MOST_SHARE)
        unexplained = whole - share * (2.0 * product - share * square)
        best, declared = int(np.argmin(unexplained)), self._declared
        least = UNEXPLAINED * min(whole, float(unexplained[declared])) - ROUNDING * whole
        if unexplained[best] < least and best > declared and ticks > PASSED * best + MORE_TICKS:
            return (best - declared) * self._dt
        return None
