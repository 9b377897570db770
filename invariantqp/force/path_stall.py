"""Whether a tool that is driven along a path in contact comes no farther: pressed, it may not have what is planned."""

from __future__ import annotations

from typing import NamedTuple

from invariantqp.control.path_drive import STANDING
from invariantqp.control.path_driver import PATIENCE
from invariantqp.control.path_report import STOPPED


class Stall(NamedTuple):
    """How long a tool has been at a place, give or take STOPPED of the path.

    Attributes:
        place: there; None before the first tick and where it is meant to stand.
        time: since it came there [s].
        driven: how far it has been driven in that time, which it went or not.
        lasts: whether it comes no farther.
    """

    place: float | None = None
    time: float = 0.0
    driven: float = 0.0
    lasts: bool = False

    def after(self, place: float, rate: float, dt: float, end: float, *, waits: bool, asked: bool) -> Stall:
        """After a tick of dt [s] at a rate.

        Args:
            place: where the tool was.
            rate: of the place.
            dt: tick [s].
            end: of the path.
            waits: whether it is meant to stand.
            asked: whether it is as slow as it was asked to be.
        """
        near = STOPPED * end
        if waits or self.place is None or abs(place - self.place) > near:
            return Stall(None if waits else place)
        time, driven = self.time + dt, self.driven + dt * abs(rate)
        stands = abs(rate) * dt <= STANDING * end and not asked
        return Stall(self.place, time, driven, time > PATIENCE and (stands or driven > 2.0 * near))
