"""Whether a loop converges: how much the error falls, compared with what the commanded velocities predict.

    promised = |e| - |e - dt (J x - feedforward)|      the predicted decrease of the error in a tick
    achieved = |e| - |e next|                          the measured decrease

Both are averaged over the last ticks. Where much less is achieved than promised while joints move fast, the loop
oscillates, or the robot does not follow its commands: a delay, a gain too high for it, a limit that is not modelled.
"""

from __future__ import annotations

from math import isnan, nan
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
    """Running averages of a loop."""

    promised: float = 0.0  # predicted decrease of the error in a tick
    achieved: float = 0.0  # measured decrease
    speed: float = 0.0  # of the error under the commands, as a share of the arm's full speed
    size: float = 0.0  # of the error in the last tick, in the measure
    ticks: float = 0.0  # number of ticks but the first
    expected: float = nan  # predicted size of the error after the last tick; NaN before the first

    def followed(self, error: Array, change: Array, slowness: float) -> Convergence:
        """After a tick with an error (6,) in the measure, and its change (6,) predicted by the velocity commanded.

        `slowness` is 1 / |change| of a tick at full speed.
        """
        share, size = 1.0 / MEMORY, norm(error)
        promised, achieved, speed, before, ticks, expected = self
        if not isnan(expected):
            promised = (1.0 - share) * promised + share * (before - expected)
            achieved = (1.0 - share) * achieved + share * (before - size)
            ticks += 1.0
        speed = (1.0 - share) * speed + share * slowness * norm(change)
        return Convergence(promised, achieved, speed, size, ticks, norm(error + change))

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
