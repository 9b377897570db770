"""Whether the tool touches, decided from noisy readings of the press by a sequential test.

    E <- min(max(E + (2 l / sigma^2) (press - l), -E0), E0)       touching from E = E0 on, in the air from E = -E0 on

E is the log of how much likelier a press of 2 l is than none, for white noise with standard deviation sigma. With
E0 = log(1e6) a wrong decision is taken once in a million ticks or less often. A press of 5 N with 0.2 N of noise is
decided in one or two ticks, one as small as the noise in about fifty.

Reference: Page 1954 (cumulative sums), Wald 1945.
"""

from __future__ import annotations

from math import inf, log
from typing import NamedTuple

from invariantqp.force.hybrid_task import LOST_SHARE
from invariantqp.force.place import TINY

# Evidence at which a decision is taken: at most one wrong one in a million ticks.
CERTAIN = log(1e6)
# The limit lies at least this far above zero, in standard deviations, but at most at half of the wanted press.
APART = 0.5
HALF = 0.5
# Noise is taken to be at least this share of the limit: one tick then decides without noise.
LEAST_NOISE = 0.25
# The power of the evidence that says how clearly nothing is touched.
SOON = 3


class Touch(NamedTuple):
    """What is known of the contact.

    Attributes:
        evidence: E.
        touching: what was decided last.
        airborne: for how long contact has not been certain [s]; inf before the first touch.
    """

    evidence: float = -CERTAIN
    touching: bool = False
    airborne: float = inf

    @property
    def aloft(self) -> bool:
        """Whether it is certain that nothing is touched."""
        return self.evidence == -CERTAIN

    @property
    def clear(self) -> float:
        """How clearly nothing is touched, from 0 to 1; it falls soon, so that an approach slows down soon."""
        return (min(0.0, self.evidence) / -CERTAIN) ** SOON

    def after(self, press: float, limit: float, noise: float, dt: float) -> Touch:
        """What is known after one more reading.

        Args:
            press: felt [force].
            limit: between air and contact [force]; 0 is contact always.
            noise: standard deviation of the press [force].
            dt: tick [s].
        """
        if limit == 0.0:
            return Touch(CERTAIN, True, 0.0)
        evidence = weighed(self.evidence, press, limit, noise)
        if evidence == CERTAIN:
            return Touch(evidence, True, 0.0)
        return Touch(evidence, self.touching and evidence > -CERTAIN, self.airborne + dt)


def weighed(evidence: float, press: float, limit: float, noise: float) -> float:
    """E after one more reading."""
    sigma = max(noise, LEAST_NOISE * limit, TINY)
    more = evidence + 2.0 * (limit / sigma) * ((press - limit) / sigma)  # the square of a tiny sigma is zero
    return min(max(more, -CERTAIN), CERTAIN)


def loss_limit(lost_below: float | None, wanted: float, noise: float) -> float:
    """The press [force] between air and contact: a tenth of the wanted one, more where noise would hide that."""
    if lost_below is not None:
        return lost_below
    return max(0.0, LOST_SHARE * wanted, min(HALF * wanted, APART * noise))
