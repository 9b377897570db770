"""The low-pass and the deadband of a wrench sensor.

smooth     y += (1 - exp(-2 pi f_c dt)) (x - y)
soft       f max(0, 1 - d/|f|)
"""

from __future__ import annotations

from math import exp, pi
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array


class Smoothing(NamedTuple):
    """The state of a low-pass: its owner replaces it by what `after` returns, once in every tick.

    Attributes:
        share: of a step that one tick passes on, 1 - exp(-2 pi f_c dt).
        value: the smoothed wrench; None before the first, which is taken as it is.
    """

    share: float
    value: Array | None = None

    @classmethod
    def of(cls, cutoff: float, dt: float) -> Smoothing:
        """The low-pass with a cut-off in Hz for ticks of dt seconds."""
        return cls(1.0 - exp(-2.0 * pi * cutoff * dt))

    def after(self, wrench: Array) -> tuple[Array, Smoothing]:
        """The smoothed wrench after one more reading, and the state then."""
        smooth = wrench if self.value is None else self.value + self.share * (wrench - self.value)
        return smooth, self._replace(value=smooth)


def soft(vector: Array, width: float) -> Array:
    """The vector shortened by `width`, zero where it is shorter: continuous, and the same for axes of any direction."""
    length = float(np.sqrt(vector.dot(vector)))
    share = 1.0 - width / length if length > width else 0.0
    shortened: Array = vector * share
    return shortened
