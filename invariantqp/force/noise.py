"""How noisy a wrench sensor is, from what its readings in the air change by from one to the next.

    sigma = sqrt(pi)/2 mean |change of a force component|        white noise; a rise that is slow leaves it as it is

A noise above the told one is reckoned with: a sensor told too quiet would read a touch in the air, and a fault.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.geometry.arrays import Array

# Noise above this multiple of what was reckoned with is told: so many readings at least and at most are in the mean, in
# which a change counts as so many standard deviations at most. Of 20 000 sensors told rightly one was doubted.
NOISIER = 1.5
FEWEST = 20
AVERAGED = 200
CLIPPED = 5.0


class Noise(NamedTuple):
    """What is remembered of the readings in the air.

    Attributes:
        readings: how many.
        change: mean of |change| of a force component [force].
        found: standard deviation of a force component where it is larger than told, else 0 [force].
    """

    readings: int = 0
    change: float = 0.0
    found: float = 0.0

    def after(self, reading: Array, last: Array | None, supposed: float) -> Noise:
        """What is remembered after one more reading.

        Args:
            reading: (6,) (m; f) as it came, and the one before; None before the first.
            last: likewise.
            supposed: the standard deviation that is reckoned with [force].
        """
        if last is None or not (change := np.abs(reading - last)[3:]).any():  # none, or the last one repeated
            return self
        count, most = self.readings + 1, CLIPPED * max(supposed, self.change)
        mean = self.change + (float(np.minimum(change, most).mean()) - self.change) / min(count, AVERAGED)
        sigma = sqrt(pi) / 2.0 * mean
        return Noise(count, mean, sigma if count >= FEWEST and sigma > NOISIER * supposed else self.found)

    def trouble(self, told: float) -> str:
        """What is wrong with the noise that was told [force], in words, "" for nothing."""
        if not self.found:
            return ""
        return f"readings have {written(self.found, 2)} N of noise, {written(told, 2)} are told (noise=)"
