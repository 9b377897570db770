"""The result of a tick along a path."""

from __future__ import annotations

from typing import NamedTuple

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.reasons import Explained, Why
from invariantqp.velocity.solution import Status, VelocitySolution


class _Solution(NamedTuple):
    velocity: Array
    status: Status
    reasons: Why
    place: float
    speed: float
    ruling: str
    lag: float | None
    across: float
    velocity_solution: VelocitySolution


class PathSolution(Explained, _Solution):
    """A joint velocity of a tick along a path, and where on the path the tool is. A tuple: one is made in every tick.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "waiting", "moving", "slowed", "paused", "left", "blocked", "done" or "held": see `Status`.
        reasons: why, as data, those of the velocity law among them; () where there is nothing to report.
        reason: the same in words, "" for nothing.
        place: the path's parameter where the tool is.
        speed: of the place [1/s], negative backward.
        ruling: the limit that rules the speed, in words; "settling" where all of the path is driven and the joints come
            to rest.
        lag: how late the tool is [s]; None where no rate is asked for.
        across: how far the tool is off the path, in the measure [length]; with exact demands, in what they ask for; inf
            where joint positions cannot be true.
        velocity_solution: the velocity law's answer.
    """

    __slots__ = ()

    @property
    def row_names(self) -> tuple[str, ...]:  # type: ignore[override]
        """What rows are called that reasons name."""
        return self.velocity_solution.row_names
