"""The force law's gain and its integral action.

    twist = (I - P) C factor (e + w / T_i integral of e)(I - P)'      e the wrench error,   w = c k the loop's rate

On a contact of stiffness k the loop is a first-order lag of rate c k, stable with dead time d below c k d = pi / 2. The
rate is at most RATE, and a quarter of 1 / (dt + delay + time constant of the low-pass), from which on no overshoot is
visible. T_i = 4 / (c k) is critical damping: a normal told wrong, which moves the surface at constant speed, leaves no
error. Without k there is no integral, since a too fast one oscillates.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.force.stiffness import StiffnessEstimate
from invariantqp.geometry.arrays import Array

# How fast a force error is corrected where nothing else is asked for [1/s].
RATE = 20.0
# The largest rate times what is late: tick, delay and low-pass.
LATE_SHARE = 0.25
# Critical damping of rate and integral.
CRITICAL = 4.0
# The compliance without a known stiffness is changed by at most this factor either way.
MOST_CHANGE = 100.0
# After the contact was lost again and again the rate is reduced by this factor, each time.
SLOWER = 0.5
LEAST_CAUTION = 1.0 / 64.0


class Regulation(NamedTuple):
    """What the force law remembers, in the contact's frame.

    Attributes:
        estimate: of the contact's stiffness.
        integral: (6,) of the wrench error [force s].
        caution: share of the rate, less than 1 after chatter.
    """

    estimate: StiffnessEstimate = StiffnessEstimate()
    integral: Array = np.zeros(6)
    caution: float = 1.0

    def rate(self, late: float) -> float:
        """c k [1/s] to aim at, `late` [s] being the sum of tick, delay and low-pass."""
        return self.caution * min(RATE, LATE_SHARE / late)

    def factor(self, compliance: float, stiffness: float | None, late: float) -> float:
        """By how much the compliance [length/s/force] is multiplied for that rate; 1 where no stiffness is known."""
        k = self.estimate.value if stiffness is None else stiffness
        if k is None:
            return self.caution
        return min(max(self.rate(late) / (compliance * k), 1.0 / MOST_CHANGE), MOST_CHANGE)

    def after(self, error: Array, rate: float | None, dt: float, most: float) -> Regulation:
        """The integral after a tick.

        Args:
            error: (6,) of the wrench.
            rate: c k [1/s]; None forgets the integral.
            dt: tick [s].
            most: share of the step that is allowed, 0 where limits keep the law from acting.
        """
        if rate is None:
            return self._replace(integral=np.zeros(6))
        return self._replace(integral=self.integral + most * dt * rate / CRITICAL * error)

    def slower(self) -> Regulation:
        """The same, more cautious."""
        return self._replace(caution=max(LEAST_CAUTION, SLOWER * self.caution), integral=np.zeros(6))
