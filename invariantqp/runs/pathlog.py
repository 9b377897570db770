"""What happened along an elastic path in a run: where the tool was, how fast it went, and what slowed it down."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invariantqp.control.path_follower import PathFollower
from invariantqp.control.path_report import ENDED, SETTLING
from invariantqp.control.path_solution import PathSolution
from invariantqp.geometry.arrays import Array

# What rules the speed where nothing slows the tool down.
ON_TIME = "the rate asked for"


@dataclass(frozen=True, eq=False)
class PathTrace:
    """What happened along the path, tick by tick.

    Attributes:
        place: (n,) by the path's own timing [s].
        speed: (n,) over that of its timing.
        lag: (n,) how late the tool is [s].
        ruling: (n,) what rules the speed, in words.
        poses: (n + 1, 4, 4) of the path where the tool is, before the first tick and after each.
        status: in the last tick, as in `PathSolution`.
    """

    place: Array
    speed: Array
    lag: Array
    ruling: list[str]
    poses: Array
    status: str

    @property
    def driven(self) -> Array:
        """The speeds on the way; those at the path's end, where the joints come to rest, are left out."""
        on_the_way = [ruling not in (SETTLING, ENDED) for ruling in self.ruling]
        return self.speed[on_the_way] if any(on_the_way) else self.speed

    @property
    def slowed(self) -> dict[str, float]:
        """What slowed the tool down, with the share of the ticks on the way, most frequent first."""
        counts = Counter(ruling for ruling in self.ruling if ruling not in (ON_TIME, SETTLING, ENDED))
        return {name: count / len(self.driven) for name, count in counts.most_common()}


def path_trace(follower: PathFollower, followed: Sequence[PathSolution]) -> PathTrace:
    """What happened along the path of a follower, from its solutions."""
    place = np.array([s.place for s in followed])
    return PathTrace(
        place=place,
        speed=np.array([s.speed for s in followed]),
        lag=np.array([0.0 if s.lag is None else s.lag for s in followed]),
        ruling=[s.ruling for s in followed],
        poses=np.array([follower.pose(at) for at in (0.0, *place.tolist())]),
        status=followed[-1].status,
    )
