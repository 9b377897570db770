"""The result of a tick of a follower."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from invariantqp.force.control import HybridSolution
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import Status

# A reason, or a function that returns it; likewise place, how late it is and its speed.
Reason: TypeAlias = str | Callable[[], str]
Location: TypeAlias = tuple[float, float, float] | Callable[[], tuple[float, float, float]]


class FollowerSolution:
    """The joint velocity of a tick, its status, and where along the input the arm is.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "moving", "late", "slowed", "limited", "scaled", "waiting", "blocked", "left", "paused", "done",
            "degraded" or "held", of a stream in contact also "lost", "overload" or "fault": see `Status`.
        ruling: what limits the speed along a path, in words; "settling" at its end until joints rest.
        hybrid: in contact, the hybrid controller's solution, with the forces; else None.
    """

    __slots__ = ("_across", "_where", "_why", "hybrid", "ruling", "status", "velocity")

    def __init__(
        self,
        velocity: Array,
        status: Status,
        reason: Reason,
        where: Location,
        across: Callable[[], float],
        ruling: str = "",
        hybrid: HybridSolution | None = None,
    ) -> None:
        """The attributes; functions are evaluated when they are read."""
        self.velocity, self.status, self.ruling, self.hybrid = velocity, status, ruling, hybrid
        self._why: Reason = reason
        self._where: Location = where
        self._across: Callable[[], float] | float = across

    def _read(self) -> tuple[float, float, float]:
        if callable(self._where):
            self._where = self._where()
        return self._where

    @property
    def place(self) -> float:
        """Where along the input the joints are at the end of the tick: a stamp [s], or a path's parameter."""
        return self._read()[0]

    @property
    def late(self) -> float:
        """How long after its stamp the place is reached [s]."""
        return self._read()[1]

    @property
    def speed(self) -> float:
        """Rate of the place [1/s], negative backward."""
        return self._read()[2]

    @property
    def reason(self) -> str:
        """Why the status is what it is, in words; "" where there is nothing to report."""
        if callable(self._why):
            self._why = self._why()
        return self._why

    @reason.setter
    def reason(self, why: Reason) -> None:
        self._why = why

    @property
    def across(self) -> float:
        """The distance of the tool from the pose wanted at `place`, in the measure [length]; NaN without an input.

        It includes the errors of smoothing, of a splice that is not over and of joints at their limits; in contact only
        the part along its freedoms counts.
        """
        if callable(self._across):
            self._across = float(self._across())
        return self._across

    def __getstate__(self) -> tuple[None, dict[str, Any]]:
        read = {"_why": self.reason, "_across": self.across, "_where": self._read()}
        return None, {name: read.get(name, getattr(self, name)) for name in self.__slots__}

    def __repr__(self) -> str:
        names = "velocity", "status", "reason", "place", "late"
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in names)})"
