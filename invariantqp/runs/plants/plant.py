"""What a run controls: an arm and what it touches, simulated or real. A controller only sees its measurements."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from invariantqp.geometry.arrays import Array


class Measurement(NamedTuple):
    """What the sensors say: joint positions (m,), and the wrench (6,) in the sensor's frame, None without a sensor."""

    q: Array
    wrench: Array | None


class PlantState(NamedTuple):
    """How things really are: joint positions (m,), tool pose (4, 4), and the wrench (6,) on the tool, base frame."""

    q: Array
    pose: Array
    wrench: Array


class Plant(Protocol):
    """An arm and what it touches."""

    def measure(self) -> Measurement:
        """What the sensors say now."""
        ...

    def command(self, velocity: Array) -> None:
        """Move for one tick at joint velocities (m,)."""
        ...

    def state(self) -> PlantState:
        """How things really are now; no controller is told."""
        ...
