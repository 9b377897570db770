"""What a drive along a path keeps from tick to tick."""

from __future__ import annotations

from math import isnan, nan
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array


class PathState(NamedTuple):
    """A drive between two ticks."""

    place: float  # where the tool will be, by the curve's own parameter
    speed: float  # along the path, not negative
    acceleration: float  # of that
    back: bool  # whether the path is driven backward
    along: Array  # (m,) the joint velocity along the path in the tick before
    velocity: Array  # (m,) and all of it
    tangent: Array | None  # (6,) of the path in the middle of that tick; None before the first
    ticks: int  # since the tool set out

    @classmethod
    def of(cls, numbers: Array) -> PathState:
        """As `numbers` gives it."""
        place, speed, acceleration, back, ticks, first = numbers[:6].tolist()
        along, velocity = numbers[11:].reshape(2, -1).copy()
        tangent = None if isnan(first) else numbers[5:11].copy()
        return cls(place, speed, acceleration, bool(back), along, velocity, tangent, int(ticks))

    @property
    def numbers(self) -> Array:
        """(11 + 2 m,) all of it as the compiled core takes and writes it, NaN for no tangent."""
        tangent = [nan] * 6 if self.tangent is None else self.tangent
        head = self.place, self.speed, self.acceleration, self.back, self.ticks
        return np.concatenate((head, tangent, self.along, self.velocity))

    def after(
        self, place: float, rate: float, dt: float, standing: float, *, back: bool, along: Array, velocity: Array
    ) -> PathState:
        """After a tick of dt [s] from a place on, at a rate that is negative backward.

        Joint velocities (m,) are `along` the path and in all. A tick that drives no farther is at rest where `standing`
        says so: there the drive may turn, to go `back`.
        """
        v = abs(rate)
        turned = back != self.back and v * dt <= standing
        return self._replace(
            place=place + dt * rate,
            speed=0.0 if turned else v,
            acceleration=0.0 if turned else (v - self.speed) / dt,
            back=back if turned else self.back,
            along=along,
            velocity=velocity,
            ticks=self.ticks + 1,
        )


def at_rest(place: float, velocity: Array, ticks: int = 0, *, back: bool = False) -> PathState:
    """A tool that is about to set out from a place, its joints at `velocity` (m,)."""
    return PathState(place, 0.0, 0.0, back, np.zeros(len(velocity)), velocity, None, ticks)
