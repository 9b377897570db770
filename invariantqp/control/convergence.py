"""Whether a loop does what its commands promise: the error that should have been left, beside the one that is.

    promised = |e| - |e - dt (J x - feedforward)|      what a tick should have taken off the error
    achieved = |e| - |e next|                          what it did

Both are averaged over the last ticks. Where little of the promise is kept while joints move fast, the loop oscillates,
or its robot does not do what it is told: a delay, a gain too high for it, a limit nobody mentioned.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from invariantqp.geometry.arrays import Array

# Ticks over which is averaged.
MEMORY = 50
# Less of the promise kept than this is no convergence.
KEPT_SHARE = 0.2
# An arm that moves at less than this share of what it can do, on average, does not rattle: that is noise, or the lag of
# a path.
FAST_SHARE = 0.02


class Convergence(NamedTuple):
    """Running averages of a loop.

    Attributes:
        promised: what a tick should take off the error, a tick.
        achieved: what it did.
        speed: of the error under the commands, as a share of what the arm can do at full speed.
        expected: (6,) measured error that the last tick should have left, or None before the first.
        size: its error.
        ticks: how many were seen.
    """

    promised: float = 0.0
    achieved: float = 0.0
    speed: float = 0.0
    expected: Array | None = None
    size: float = 0.0
    ticks: int = 0

    def seen(self, error: Array) -> Convergence:
        """After another tick's measured error (6,) was read."""
        if self.expected is None:
            return self
        share = 1.0 / MEMORY
        promised = self.size - _norm(self.expected)
        achieved = self.size - _norm(error)
        return self._replace(
            promised=(1.0 - share) * self.promised + share * promised,
            achieved=(1.0 - share) * self.achieved + share * achieved,
            ticks=self.ticks + 1,
        )

    def commanded(self, error: Array, change: Array, slowness: float) -> Convergence:
        """After a velocity was commanded.

        Args:
            error: (6,) measured error.
            change: (6,) what the velocity does to it until the next tick.
            slowness: 1 / |change| of a tick at full speed.
        """
        share = 1.0 / MEMORY
        speed = (1.0 - share) * self.speed + share * slowness * _norm(change)
        return self._replace(expected=error + change, size=_norm(error), speed=speed)

    @property
    def trouble(self) -> str:
        """What is wrong, "" for nothing."""
        if self.ticks < MEMORY or self.speed < FAST_SHARE or self.promised <= 0.0:
            return ""
        if self.achieved >= KEPT_SHARE * self.promised:
            return ""
        return (
            "not converging: the joints move, but the error does not fall as their motion predicts; the cause may be a "
            "delay (give it as delay=), a gain too high for the robot, or a robot that does not follow its commands"
        )


def _norm(v: Array) -> float:
    return sqrt(float(v.dot(v)))
