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
# Share of a reading in the mean of the free air, and in the one that follows what little is pressed there.
AVERAGED = 0.05
QUICK = 0.25
# A reading is certainly of free air where it is above that mean by so many standard deviations at most, or by this
# share of the wanted press; one that sticks near the limit is not.
NEAR = 2.0
NEAR_SHARE = 0.02
# What is left out besides, in standard deviations: what the press in free air may be off.
OF_AIR = 1.0


class Rise(NamedTuple):
    """What is remembered since the last reading that is certainly of free air.

    Attributes:
        mean: of the last presses in the air [force]; inf before any, and in touch.
        quick: of the last few presses before a touch is decided [force]; likewise.
        air: the larger of both at the last reading that is certainly of free air; inf before any.
        way: into the surface since then, at most [length].
        sums: number of readings since then, of their presses [force], of the ways at them [length].
        least: what the stiffness is at least, where a good share of the press is left out [force/length].
        stiffest: the largest of these at any touch.
        shows: the largest since then with noise alone left out.
        seen: the largest of these at any touch.
    """

    mean: float = inf
    quick: float = inf
    air: float = inf
    way: float = 0.0
    sums: tuple[int, float, float] = (0, 0.0, 0.0)
    least: float = 0.0
    stiffest: float = 0.0
    shows: float = 0.0
    seen: float = 0.0

    @property
    def aloft(self) -> bool:
        """Whether the last reading was certainly of free air."""
        return self.sums[0] == 0

    @property
    def doubtful(self) -> bool:
        """Whether more than one reading was not: one may be noise, and shows a stiff contact by a tick's whole way."""
        return self.sums[0] > 1

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
        mean, quick = averaged(self.mean, now, AVERAGED), averaged(self.quick, now, QUICK)
        if touch.aloft and (self.air == inf or now <= mean + max(NEAR * noise, NEAR_SHARE * wanted)):
            return Rise(mean, quick, max(mean, quick), late * way, stiffest=self.stiffest, seen=self.seen)
        mean, quick = (inf, inf) if touch.touching else (self.mean, quick)
        way += self.way
        risen = now - self.air
        if risen - ABOVE_NOISE * noise > STIFFEST * way:
            way = inf  # the surface came to the tool: nothing is shown
        n, presses, ways = self.sums[0] + 1, self.sums[1] + now, self.sums[2] + way
        least = max(0.0, risen - max(ABOVE_NOISE * noise, LEFT_OUT * wanted)) / max(way, TINY)
        above = presses / n - self.air - (ABOVE_NOISE / sqrt(n) + OF_AIR) * noise
        shows = max(self.shows, above / max(ways / n, TINY))
        seen = max(self.seen, shows) if touch.touching and not known else self.seen
        return Rise(mean, quick, self.air, way, (n, presses, ways), least, max(self.stiffest, least), shows, seen)


def averaged(mean: float, now: float, share: float) -> float:
    """The mean after one more value, which has a share in it; inf is none yet."""
    return now if mean == inf else mean + share * (now - mean)
