"""Faults of a wrench sensor that readings alone tell, before the controller presses on because of them.

dead     a sensor that has noise reads exactly the same for DEAD_AFTER
pulls    a contact that can only push is read to pull by half of the wanted press: sign, order, weight or bias are wrong
jumps    after a change by more than half of the wanted press within a tick, by the loss limit already
"""

from __future__ import annotations

from typing import NamedTuple

from invariantqp.errors import written
from invariantqp.force.touch import CERTAIN, weighed
from invariantqp.geometry.arrays import Array

# For how long a reading with noise may stay the same to the last bit [s].
DEAD_AFTER = 0.1
# After this time already, the force law waits for the next reading [s].
STALE_AFTER = 0.012
# Share of the wanted press by which a reading may pull, and by which it may change within a tick.
PULL_SHARE = 0.5
# A change within a tick by less than this many standard deviations is noise.
JUMP = 8.0
# For how long after a jump a pull is looked at more closely [s].
JUMP_MEMORY = 0.3


class Health(NamedTuple):
    """What is remembered of the readings.

    Attributes:
        reading: (6,) the last one; None before the first.
        unchanged: for how long it has been the same [s].
        press: the last one [force].
        pull: evidence that the contact is read to pull.
        jumped: how long ago the press jumped [s].
        fault: what is wrong, in words, "" for nothing.
        alive: whether a reading has changed, or need not; before that contact is not looked for.
    """

    reading: Array | None = None
    unchanged: float = 0.0
    press: float = 0.0
    pull: float = -CERTAIN
    jumped: float = JUMP_MEMORY
    fault: str = ""
    alive: bool = False

    @property
    def stale(self) -> bool:
        """Whether the reading is too old to press by."""
        return not self.alive or self.unchanged > STALE_AFTER

    def after(self, reading: Array, press: tuple[float, float] | None, limit: float, noise: float, dt: float) -> Health:
        """What is remembered after one more reading.

        Args:
            reading: (6,) as it came.
            press: felt and wanted [force]; None where the contact can pull.
            limit: between air and contact [force].
            noise: standard deviation of a force component [force].
            dt: tick [s].
        """
        if self.fault:
            return self
        same = self.reading is not None and noise > 0.0 and bool((reading == self.reading).all())
        unchanged = self.unchanged + dt if same else 0.0
        alive = self.alive or noise == 0.0 or press is None or (self.reading is not None and not same)
        dead = f"the reading has not changed for {written(unchanged)} s: a dead sensor (one without noise: noise=0)"
        fault = dead if unchanged > DEAD_AFTER else ""
        if press is None or press[1] == 0.0:
            return Health(reading, unchanged, fault=fault, alive=alive)
        felt, wanted = press
        change = abs(felt - self.press) if self.reading is not None else 0.0
        jumped = 0.0 if change > max(PULL_SHARE * wanted, JUMP * noise) else self.jumped + dt
        close = limit if jumped < JUMP_MEMORY and limit > 0.0 else max(limit, PULL_SHARE * wanted)
        pull = weighed(self.pull, -felt, close, noise)
        if pull == CERTAIN and not fault:
            what = "the reading jumped, or has more noise than told, and" if jumped < JUMP_MEMORY else "the reading"
            fault = f"{what} says that the contact pulls with {written(-felt)} N: sign, order, weight or bias is wrong"
        return Health(reading, unchanged, felt, pull, jumped, fault, alive)
