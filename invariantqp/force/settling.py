"""Whether the press settles: contact lost again and again, a press that swings or is not reached, are told.

chatters     CHATTER losses within a second, each after a press too high: a surface that is left slowly is no chatter
swings       more than TURNS times within SWUNG it turns by SWING of the wanted press, which stays the same
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
# More turns than these within so long [s] are swings, each by this share of the wanted press and so many standard
# deviations of noise at least.
TURNS = 5
SWUNG = 4.0
SWING = 0.3
ABOVE_NOISE = 10.0
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
        turns: how long ago the press turned [s], the last time first.
        rises: whether it has risen since then.
        extreme: the last it reached that way [force].
        wanted: the press that these are about [force].
        swung: how long ago it swung too often [s].
    """

    losses: tuple[float, ...] = ()
    highest: float | None = None
    press: float | None = None
    missed: float = 0.0
    turns: tuple[float, ...] = ()
    rises: bool = True
    extreme: float = 0.0
    wanted: float = 0.0
    swung: float = SWUNG

    def after(
        self, press: tuple[float, float], dt: float, *, touching: bool, lost: bool, noise: float = 0.0
    ) -> Settling:
        """What is remembered after one more tick.

        Args:
            press: felt and wanted [force].
            dt: tick [s].
            touching: whether there is contact.
            lost: whether that is told as lost; a shorter time in the air is a press that is not reached.
            noise: standard deviation of the press [force].
        """
        felt, wanted = press
        losses, highest = tuple(age + dt for age in self.losses if age + dt < MEMORY), None
        if touching:
            highest = felt if self.highest is None else max(self.highest, felt)
        elif self.highest is not None and self.highest > OVERSHOT * wanted:
            losses = (0.0, *losses)
        now = self._turned(felt, wanted, noise, dt)._replace(losses=losses, highest=highest, press=None, missed=0.0)
        if lost:
            return now._replace(highest=None)
        mean = felt if self.press is None else self.press + min(1.0, dt / AVERAGED) * (felt - self.press)
        off = abs(mean - wanted) > MISSED * wanted > 0.0
        return now._replace(press=mean, missed=self.missed + dt if off else 0.0)

    def _turned(self, felt: float, wanted: float, noise: float, dt: float) -> Settling:
        """The same with a turn of the press, where it is one, from its extreme since the last."""
        now = self._replace(swung=self.swung + dt, wanted=wanted, turns=(), rises=True, extreme=felt)
        if wanted != self.wanted or wanted == 0.0:
            return now
        turns, rises = tuple(age + dt for age in self.turns if age + dt < SWUNG), self.rises
        back = self.extreme - felt if rises else felt - self.extreme
        if back <= max(SWING * wanted, ABOVE_NOISE * noise):
            return now._replace(turns=turns, rises=rises, extreme=felt if back < 0.0 else self.extreme)
        if len(turns) < TURNS:
            return now._replace(turns=(0.0, *turns), rises=not rises)
        return now._replace(swung=0.0, rises=not rises)

    def after_missing(self, missing: float, dt: float) -> Settling:
        """The same where contact cannot be lost: what is missing of force or moment, as a share of an overload."""
        error = missing if self.press is None else self.press + min(1.0, dt / AVERAGED) * (missing - self.press)
        return Settling(press=error, missed=self.missed + dt if error > MISSED else 0.0)

    def unstable(self, *, rests: bool) -> bool:
        """Whether a loss too many has just happened, or a swing of a tool that does not slide on what may be rough."""
        return (len(self.losses) >= CHATTER and self.losses[0] == 0.0) or (rests and self.swung == 0.0)

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
        said = []
        if self.swung < SWUNG:
            said.append(
                f"the press swings about {written(self.wanted, 3)} N: readings or commands are later than "
                f"{written(1e3 * late, 2)} ms of tick, filter and delay, or what the tool slides on is rough"
            )
        if self.missed > PATIENCE and self.press is not None:
            long = f"for {written(self.missed, 2)} s"
            if wanted is None:
                off = f"{written(100.0 * self.press, 2)} % of an overload off {long}"
                said.append(f"force or moment is not reached: {off}")
            else:
                said.append(f"the force is not reached: {written(self.press, 3)} of {written(wanted, 3)} N {long}")
        return "; ".join(said)
