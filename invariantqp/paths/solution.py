"""The result of a tick of a follower."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from invariantqp.force.control import HybridSolution
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import Status

# A reason, or what finds it when it is read; the same of a place, how late it is and its speed.
Reason: TypeAlias = str | Callable[[], str]
Location: TypeAlias = tuple[float, float, float] | Callable[[], tuple[float, float, float]]


class FollowerSolution:
    """A joint velocity of a tick, and where in what is followed the arm is.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "moving", "late", "slowed", "limited", "scaled", "waiting", "blocked", "left", "paused", "done",
            "degraded" or "held", of a stream in contact also "lost", "overload" or "fault": see `Status`.
        ruling: what rules the speed along a path, in words; "settling" at its end until joints rest.
        hybrid: in contact, the hybrid controller's answer, with the forces; else None.
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
        """As the attributes say; what is given as a function is computed when it is read."""
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
        """Where in what is followed the joints are when the tick is over: a stamp [s], or a path's parameter."""
        return self._read()[0]

    @property
    def late(self) -> float:
        """How long after its stamp that is [s]."""
        return self._read()[1]

    @property
    def speed(self) -> float:
        """Of the place [1/s], negative backward."""
        return self._read()[2]

    @property
    def reason(self) -> str:
        """Why, in words, "" where there is nothing to report."""
        if callable(self._why):
            self._why = self._why()
        return self._why

    @reason.setter
    def reason(self, why: Reason) -> None:
        self._why = why

    @property
    def across(self) -> float:
        """How far the tool is off what is wanted at `place`, all six parts of it counted in the measure [length].

        Smoothing, a splice that is not over and what the joints cannot do are all in it; in contact only what the
        contact leaves free is. NaN where nothing is followed.
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
