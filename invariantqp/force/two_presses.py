"""How stiff a contact is, from two presses at two forces at rest.

    k = (F2 - F1) / (x2 - x1),      the surface is at x1 - F1 / k

F and x are means of the press and of the way along it, over AVERAGED after SETTLED, with half of the wanted press and
then with all of it. Where the surface was supposed to be does not count, nor does what lags while the press rises.
Means that are taken while the tool slides are not used: on a slope that is a press, too.
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array

# The first press, as a share of the wanted one.
FIRST = 0.5
# How long a press settles, and over how long it is averaged, in time constants of the force law.
SETTLED = 5.0
AVERAGED = 5.0
# The longest way across, in ways along the press, after which the two presses still say how stiff the contact is.
ACROSS = 1.0
# Standard errors from which on they do.
KNOWN = 8.0


class TwoPresses(NamedTuple):
    """What is remembered since the touch.

    Attributes:
        time: since the touch, in time constants of the force law.
        way: (4,) along the press and across it (3), since then [length].
        sums: (2, 6) of (1, way, press) in the first press and in the second.
    """

    time: float = 0.0
    way: Array = np.zeros(4)
    sums: Array = np.zeros((2, 6))

    @property
    def share(self) -> float:
        """How much of the wanted press to exert now."""
        return FIRST if self.time < SETTLED + AVERAGED else 1.0

    @property
    def done(self) -> bool:
        """Whether both have been averaged."""
        return self.time >= 2.0 * (SETTLED + AVERAGED)

    def after(self, press: float, moved: Array, steps: float) -> TwoPresses:
        """What is remembered after one more reading.

        Args:
            press: felt [force].
            moved: (4,) way since the last reading, along the press and across it [length].
            steps: the time since then, in time constants of the force law.
        """
        if self.done:
            return self
        way, sums = self.way + moved, self.sums
        which, within = divmod(self.time, SETTLED + AVERAGED)
        if within >= SETTLED:
            sums = sums.copy()
            sums[int(which)] += (1.0, *way, press)
        return TwoPresses(self.time + steps, way, sums)

    def stiffness(self, noise: float) -> float | None:
        """k where both presses are done and say it, else None; noise is the standard deviation of the press."""
        if not self.done or not self.sums[:, 0].all():
            return None
        n = self.sums[:, 0]
        change = np.diff(self.sums[:, 1:] / n[:, None], axis=0)[0]
        along, across, rise = float(change[0]), hypot(*change[1:4].tolist()), float(change[4])
        error = noise * hypot(*(n**-0.5).tolist())
        return rise / along if along > 0.0 and across <= ACROSS * along and rise > KNOWN * error else None
