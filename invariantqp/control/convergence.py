"""Whether the joints follow their commands, as the tool sees it: what it moved, compared with what it was told to move.

    told = A (dt x)             the measured motion of the tool that the shown command asked for
    done = A (q - q before)     the one that was seen

Averaged over the last ticks, where much less of what was told is done while joints move fast, the loop oscillates, or
the robot does not do what it is told: a delay, a gain too high for it, a limit that is not modelled.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import norm

# Ticks over which averages are taken.
MEMORY = 50
# Below this share of what was told the joints do not follow.
KEPT_SHARE = 0.2
# Below this share of full speed, on average, an arm does not oscillate: a small share is then noise.
FAST_SHARE = 0.02


class Convergence(NamedTuple):
    """Running averages of a loop."""

    told: float = 0.0  # size of the motion told in a tick
    done: float = 0.0  # of the motion seen, the part along it
    speed: float = 0.0  # told, as a share of the arm's full speed
    ticks: float = 0.0  # number of ticks but the first

    def followed(self, told: Array, done: Array, slowness: float) -> Convergence:
        """After a tick in which a motion (6,) was told and another one seen, both in the measure.

        `slowness` is 1 / |motion| of a tick at full speed.
        """
        share, size = 1.0 / MEMORY, norm(told)
        along = float(told.dot(done)) / size if size > 0.0 else 0.0
        return Convergence(
            (1.0 - share) * self.told + share * size,
            (1.0 - share) * self.done + share * along,
            (1.0 - share) * self.speed + share * slowness * size,
            self.ticks + 1.0,
        )

    @property
    def trouble(self) -> str:
        """Why the loop does not converge, in words; "" where it does."""
        if self.ticks < MEMORY or self.speed < FAST_SHARE or self.done >= KEPT_SHARE * self.told:
            return ""
        return (
            "not converging: the joints do not follow their commands; the cause may be a delay (give it as delay=), a "
            "gain too high for the robot, or a robot that does not do what it is told"
        )


def slowness(A: Array, limits: Array) -> float:
    """1 / |v|, v the measured twist of joints A (6, m) at full speed (m,); 0 where one has no limit or none moves."""
    each = np.sqrt((A * A).sum(axis=0))
    moving = each > 0.0
    speed = float(np.linalg.norm(each[moving] * limits[moving]))
    return 1.0 / speed if speed > 0.0 else 0.0
