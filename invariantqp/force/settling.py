"""Whether the press settles: contact lost again and again, or a press that is not reached, are told.

chatters     CHATTER losses within a second, each after a press too high: a surface that is left slowly is no chatter
not reached  the press is off by more than MISSED of the wanted one for longer than PATIENCE before it is lost; force or
             moment on a contact that cannot be lost, by more than MISSED of what would be an overload
"""

from __future__ import annotations

from typing import NamedTuple

from invariantqp.errors import written

# Losses within MEMORY [s] that count as chatter.
CHATTER = 4
MEMORY = 1.0
# A press above this multiple of the wanted one, before a loss, makes that chatter.
OVERSHOT = 1.3
# A press this far off, relative to the wanted one, for this long [s] is not reached.
MISSED = 0.2
PATIENCE = 1.0
# Time constant over which the press is averaged for this [s].
AVERAGED = 0.2


class Settling(NamedTuple):
    """What is remembered of the press.

    Attributes:
        losses: how long ago each recent loss was [s].
        highest: the largest press since the touch [force]; None in the air.
        press: averaged [force], or what is missing as a share of an overload; None where contact is lost.
        missed: for how long it has been off [s].
    """

    losses: tuple[float, ...] = ()
    highest: float | None = None
    press: float | None = None
    missed: float = 0.0

    def after(self, press: tuple[float, float], dt: float, *, touching: bool, lost: bool) -> Settling:
        """What is remembered after one more tick.

        Args:
            press: felt and wanted [force].
            dt: tick [s].
            touching: whether there is contact.
            lost: whether that is told as lost; a shorter time in the air is a press that is not reached.
        """
        felt, wanted = press
        losses, highest = tuple(age + dt for age in self.losses if age + dt < MEMORY), None
        if touching:
            highest = felt if self.highest is None else max(self.highest, felt)
        elif self.highest is not None and self.highest > OVERSHOT * wanted:
            losses = (0.0, *losses)
        if lost:
            return Settling(losses)
        mean = felt if self.press is None else self.press + min(1.0, dt / AVERAGED) * (felt - self.press)
        off = abs(mean - wanted) > MISSED * wanted > 0.0
        return Settling(losses, highest, mean, self.missed + dt if off else 0.0)

    def after_missing(self, missing: float, dt: float) -> Settling:
        """The same where contact cannot be lost: what is missing of force or moment, as a share of an overload."""
        error = missing if self.press is None else self.press + min(1.0, dt / AVERAGED) * (missing - self.press)
        return Settling(press=error, missed=self.missed + dt if error > MISSED else 0.0)

    @property
    def chatters(self) -> bool:
        """Whether a loss too many has just happened."""
        return len(self.losses) >= CHATTER and self.losses[0] == 0.0

    def trouble(self, wanted: float | None, late: float) -> str:
        """What is wrong, in words, "" for nothing.

        Args:
            wanted: press [force]; None where contact cannot be lost.
            late: sum of tick, delay and low-pass, as the loop was told [s].
        """
        if len(self.losses) >= CHATTER:
            return (
                f"contact lost {len(self.losses)} times in {written(MEMORY)} s: the force gain is too high for "
                f"{written(1e3 * late, 2)} ms of tick, filter and delay; tell delay= and stiffness=, or less compliance"
            )
        if self.missed > PATIENCE and self.press is not None:
            long = f"for {written(self.missed, 2)} s"
            if wanted is None:
                return f"force or moment is not reached: {written(100.0 * self.press, 2)} % of an overload off {long}"
            return f"the force is not reached: {written(self.press, 3)} of {written(wanted, 3)} N {long}"
        return ""
