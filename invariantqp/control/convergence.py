"""Whether a loop converges: how much the error falls, compared with what the commanded velocities predict.

    promised = |e| - |e - dt (J x - feedforward)|      the predicted decrease of the error in a tick
    achieved = |e| - |e next|                          the measured decrease

Both are averaged over the last ticks. Where much less is achieved than promised while joints move fast, the loop
oscillates, or the robot does not follow its commands: a delay, a gain too high for it, a limit that is not modelled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm

# Ticks over which averages are taken.
MEMORY = 50
# Below this ratio of achieved to promised decrease the loop does not converge.
KEPT_SHARE = 0.2
# Below this share of full speed, on average, an arm does not oscillate: a small ratio is then noise, or lag on a path.
FAST_SHARE = 0.02


class Convergence(NamedTuple):
    """Running averages of a loop.

    Attributes:
        promised: predicted decrease of the error in a tick.
        achieved: measured decrease.
        speed: of the error under the commands, as a share of the arm's full speed.
        expected: (6,) predicted error after the last tick, in the measure; None before the first.
        size: of the error in the last tick.
        ticks: number of ticks.
    """

    promised: float = 0.0
    achieved: float = 0.0
    speed: float = 0.0
    expected: Array | None = None
    size: float = 0.0
    ticks: int = 0

    def seen(self, error: Array) -> Convergence:
        """With the error (6,) of another tick."""
        if self.expected is None:
            return self
        share = 1.0 / MEMORY
        promised = self.size - norm(self.expected)
        achieved = self.size - norm(error)
        return self._replace(
            promised=(1.0 - share) * self.promised + share * promised,
            achieved=(1.0 - share) * self.achieved + share * achieved,
            ticks=self.ticks + 1,
        )

    def commanded(self, error: Array, change: Array, slowness: float) -> Convergence:
        """With this tick's velocity, which changes the measured error (6,) by `change` (6,); `slowness` as below."""
        share = 1.0 / MEMORY
        speed = (1.0 - share) * self.speed + share * slowness * norm(change)
        return self._replace(expected=error + change, size=norm(error), speed=speed)

    @property
    def trouble(self) -> str:
        """Why the loop does not converge, in words; "" where it does."""
        if self.ticks < MEMORY or self.speed < FAST_SHARE or self.promised <= 0.0:
            return ""
        if self.achieved >= KEPT_SHARE * self.promised:
            return ""
        return (
            "not converging: the joints move, but the error does not fall as their motion predicts; the cause may be a "
            "delay (give it as delay=), a gain too high for the robot, or a robot that does not follow its commands"
        )


def slowness(A: Array, limits: Array) -> float:
    """1 / |v|, v the measured twist of joints A (6, m) at full speed (m,); 0 where one has no limit or none moves."""
    each = np.sqrt((A * A).sum(axis=0))
    moving = each > 0.0
    speed = float(np.linalg.norm(each[moving] * limits[moving]))
    return 1.0 / speed if speed > 0.0 else 0.0
