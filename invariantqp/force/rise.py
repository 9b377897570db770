"""How stiff a contact is at least, from the first readings after those that are certainly of free air.

    k >= (mean press - air - noise) / mean way        way and means since then; the touch itself may have come later

It holds at every tick, whatever the press does then: where a reading sticks, its jump alone shows a stiffness.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

from invariantqp.force.place import TINY
from invariantqp.force.touch import Touch

# So many standard deviations of noise are left out of a rise.
ABOVE_NOISE = 4.0
# For the gain, also this share of the wanted press.
LEFT_OUT = 0.25
# No contact of an arm is stiffer [N/m].
STIFFEST = 1e7
# Share of a reading in the mean of the free air.
AVERAGED = 0.1


class Rise(NamedTuple):
    """What is remembered since the last reading that is certainly of free air.

    Attributes:
        air: the press that is read there [force]; inf before any.
        way: into the surface since then, at most [length].
        sums: number of readings since then, of their presses [force], of the ways at them [length].
        least: what the stiffness is at least, where a good share of the press is left out [force/length].
        stiffest: the largest of these at any touch.
        seen: the largest with noise alone left out, at any touch.
    """

    air: float = inf
    way: float = 0.0
    sums: tuple[int, float, float] = (0, 0.0, 0.0)
    least: float = 0.0
    stiffest: float = 0.0
    seen: float = 0.0

    def after(
        self, press: tuple[float, float], way: float, noise: float, touch: Touch, late: float = 0.0, *, known: bool
    ) -> Rise:
        """What is remembered after one more reading.

        Args:
            press: felt and wanted [force].
            way: into the surface since the last reading, at most [length].
            noise: standard deviation of the press [force].
            touch: whether there is contact.
            late: the loop's delay, in ticks: an arm that lags goes on so far where it is told to slow down.
            known: whether the stiffness is known from an earlier touch.
        """
        now, wanted = press
        if touch.aloft:
            air = now if self.air == inf else self.air + AVERAGED * (now - self.air)
            return Rise(air, late * way, stiffest=self.stiffest, seen=self.seen)
        way += self.way
        risen = now - self.air
        if risen - ABOVE_NOISE * noise > STIFFEST * way:
            way = inf  # the surface came to the tool: nothing is shown
        n, presses, ways = self.sums[0] + 1, self.sums[1] + now, self.sums[2] + way
        least = max(0.0, risen - max(ABOVE_NOISE * noise, LEFT_OUT * wanted)) / max(way, TINY)
        seen = self.seen
        if touch.touching and not known:
            mean = presses / n - self.air - ABOVE_NOISE * noise / sqrt(n)
            seen = max(seen, mean / max(ways / n, TINY))
        return Rise(self.air, way, (n, presses, ways), least, max(self.stiffest, least), seen)
