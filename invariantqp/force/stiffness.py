"""How stiff a contact is, from the first moments after touch: how the press grows with the way into the surface.

    press = b + k x + t'u        x way along the press, u (3,) way across it

The ways are integrals of the commanded velocities. The part across is there because a surface whose normal is told
wrong is pressed by sliding along it. Least squares after each touch, until k is several standard errors.
"""

from __future__ import annotations

from math import hypot, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array

# For how long after a touch readings count [s], once the stiffness is known.
WINDOW = 0.5
# Known by then, in windows, a stiffness is soon known.
SOON = 1.5
# Standard errors of k from which on it is known, and the least number of readings.
KNOWN = 8.0
FEWEST = 20
# The least relative spread of the press that counts, a thousandth as a way: smaller ones are rounding.
RESOLVED = 1e-6
# How much a slope that is not known may add to the way into the surface, as a share of the way across it; ways across
# that can add no more than this share are left out: the press alone makes an arm yield across, in step with it.
SLOPE = 0.15
LEFT_OUT = 0.1


class StiffnessEstimate(NamedTuple):
    """Sums over the readings since the last touch.

    Attributes:
        value: k [force/length]; None where it is not known yet.
        fresh: whether it is from the last touch.
        time: since the last touch [s].
        way: (4,) along the press and across it (3), since then [length].
        sums: (6, 6) of products of (1, way, press).
    """

    value: float | None = None
    fresh: bool = False
    time: float = 0.0
    way: Array = np.zeros(4)
    sums: Array = np.zeros((6, 6))

    @property
    def of_touch(self) -> bool:
        """Whether the touch shows it: known soon, or before the tool slid; else friction has a part in it."""
        return self.fresh and (self.time <= SOON * WINDOW or hypot(*self.way[1:].tolist()) <= abs(float(self.way[0])))

    def after(
        self, press: float, moved: Array, noise: float, dt: float, late: float = 0.0, *, touching: bool
    ) -> StiffnessEstimate:
        """The estimate after one more reading.

        Args:
            press: felt [force].
            moved: (4,) way since the last reading, along the press and across it (3), in axes that stay [length].
            noise: standard deviation of the press [force].
            dt: tick [s].
            late: the loop's delay [s]: a lag told as one shows the way in the air before the touch as one into it.
            touching: whether there is contact.
        """
        if not touching:
            return StiffnessEstimate(self.value)
        if self.time < late:
            return self._replace(time=self.time + dt)
        if self.time > WINDOW and self.fresh:
            return self
        way = self.way + moved
        row = np.array([1.0, *way, press])
        sums = self.sums + np.outer(row, row)
        value = _slope(sums, noise)
        if value is None:
            return self._replace(time=self.time + dt, way=way, sums=sums)
        return StiffnessEstimate(value, True, self.time + dt, way, sums)


def _slope(sums: Array, noise: float) -> float | None:
    """k where it is known, else None."""
    n = sums[0, 0]
    if n < FEWEST:
        return None
    mean = sums[0, 1:] / n
    spread = sums[1:, 1:] / n - np.outer(mean, mean)
    # What the way across explains is taken off the way along and the press.
    both, across = [0, 4], slice(1, 4)
    rest = spread[np.ix_(both, both)]
    if SLOPE**2 * spread[across, across].trace() > LEFT_OUT**2 * spread[0, 0]:
        explained = np.linalg.lstsq(spread[across, across], spread[across][:, both], rcond=RESOLVED)[0]
        rest = rest - spread[both][:, across].dot(explained)
    xx, xf, ff = float(rest[0, 0]), float(rest[0, 1]), float(rest[1, 1])
    if xx <= 0.0:
        return None
    k = xf / xx
    least = RESOLVED * float(mean[4]) ** 2
    error = sqrt(max(noise * noise, ff - k * xf, least) / (n * xx))
    return k if k > KNOWN * error else None
