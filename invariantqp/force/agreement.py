"""Whether the readings agree with the motion: the way into a contact raises its press, or is not gone on with.

    owed <- owed + k/6 (way in - slope way across - given) - creep,     disagrees where owed - risen > 0.8 wanted/6

k is the stiffness told, identified, or else what the touch showed at least; risen is by how much more is read than the
least reading since something was owed, less noise. `wanted` is the highest press since the touch until that is more:
what has shown little is trusted no further. A reading that is stuck or saturated is thus pushed against by the wanted
press once more, not by the whole of `approach_distance`, and a stiffness told too large by a factor of five is no
fault. A contact that is suddenly felt no longer is looked for over the same way.

Reference: Page 1954 (cumulative sums).
"""

from __future__ import annotations

from math import exp, hypot, inf, tan
from typing import NamedTuple

from invariantqp.errors import written
from invariantqp.force.touch import Touch
from invariantqp.geometry.arrays import Array

# The least share of the stiffness with which a press has to rise.
SHARE = 1.0 / 6.0
# How much a slope that is not known may add to the way into the surface, as a share of the way across it.
SLOPE = 0.1
# What is pushed in more than explained is told when it would press by this share of the wanted press, or of the highest
# since the touch, where that is less.
MORE = 0.8
# What a surface may give way by, in wanted presses a second.
CREEP = 0.1
# A rise by less than so many standard deviations is noise, and what is owed less than these may be: by a stiffness that
# is told, perhaps five times too large, or by one that was shown.
NOISE = 6.0
LEAST_OWED = 3.0
LEAST_SHOWN = 2.0
# For how long a way out counts for a way back in, while it touches [s].
MEMORY = 0.1
# A contact of which nothing is known is supposed to be no softer [N/m]. That owes little: it is told as soon as noise
# allows, or from this share of the wanted press.
SOFTEST = 100.0
OWED_BY_SOFT = 0.05


class Answer(NamedTuple):
    """A rise with the `least` stiffness [force/length]; of the wanted press or the highest `owed` may be open, and as
    much as `noise` standard deviations. In the `air`, where the last reading was certainly of it, nothing is owed.
    """

    least: float
    owed: float
    noise: float = LEAST_OWED
    air: bool = True


class Agreement(NamedTuple):
    """What is remembered since the press last rose with the way in.

    Attributes:
        owed: by how much the press should have risen at least [force]; -inf before anything is felt.
        low: the least press since then [force].
        touched: whether a touch has been decided.
    """

    owed: float = -inf
    low: float = inf
    touched: bool = False

    def after(
        self,
        press: tuple[float, float],
        way: tuple[float, float],
        answer: Answer,
        noise: float,
        dt: float,
        touch: Touch,
    ) -> Agreement:
        """What is remembered after one more reading.

        Args:
            press: felt and wanted [force].
            way: in, and how much of it may be a slope, of the last motion that has been measured [length].
            answer: what the press owes.
            noise: standard deviation of the press [force].
            dt: tick [s].
            touch: whether there is contact; without it the way out counts, too.
        """
        felt, wanted = press
        low = min(self.low, felt)
        owed = self.owed + answer.least * (way[0] - way[1]) - SHARE * CREEP * wanted * dt
        touched = self.touched or touch.touching
        if answer.air and not touched:
            return Agreement(-inf, felt)
        if self.owed == -inf:
            return Agreement(0.0 if touched else -noise, felt, touched)
        if touch.touching and owed <= max(0.0, felt - low - NOISE * noise):
            return Agreement(min(0.0, owed) * exp(-dt / MEMORY), felt, touched)
        return Agreement(owed, low, touched)

    def trouble(
        self, press: tuple[float, float], noise: float, answer: Answer, yields: float, highest: float | None
    ) -> str:
        """What is wrong, in words, "" for nothing.

        Args:
            press: felt and wanted [force].
            noise: standard deviation of the press [force].
            answer: as in `after`.
            yields: how far the surface may give way [length].
            highest: press since the touch [force], this one before it; None where contact is lost.
        """
        felt, wanted = press
        scale = wanted if highest is None else min(wanted, highest)
        most = max(answer.owed * scale, answer.noise * noise)
        if self.owed - (felt - self.low) <= most + answer.least * yields:
            return ""
        return (
            f"pushed in by {written(self.owed / answer.least, 2)}, {written(felt, 3)} of {written(wanted, 3)} N "
            "are read: a sensor at fault, a step or a slope that is not told, a stiffness told too large, or a surface "
            "that yields (yields=)"
        )


def answer_of(told: float | None, shown: float, *, air: bool = True) -> Answer:
    """What a press owes where a stiffness is told, in any unit of length, or where touches showed one [N/m] or none."""
    if told is not None:
        return Answer(SHARE * told, MORE * SHARE, air=air)
    if SHARE * shown <= SOFTEST:
        return Answer(SOFTEST, OWED_BY_SOFT, air=air)
    return Answer(SHARE * shown, MORE * SHARE, LEAST_SHOWN, air)


def ways_in(way: Array, within: float | None) -> tuple[float, float]:
    """How far in a way leads, and how much of that may be a slope [length].

    Args:
        way: (4,) of the place of contact, along the press and across it (3) [length].
        within: angle by which the normal may be wrong [rad]; None is as much as is usual.
    """
    return float(way[0]), max(SLOPE, tan(within or 0.0)) * hypot(*way[1:].tolist())
