"""The result of a tick along a path in contact."""

from __future__ import annotations

from typing import NamedTuple

from invariantqp.force.solution import HybridSolution
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import same
from invariantqp.velocity.solution import VelocitySolution


class HybridPathSolution(NamedTuple):
    """A tick along a path in contact: the fields of a `PathSolution`, `across` along S alone, and one more.

    Attributes:
        hybrid: the hybrid controller's answer, with the forces.
    """

    velocity: Array
    status: str
    reason: str
    place: float
    speed: float
    ruling: str
    lag: float | None
    across: float
    velocity_solution: VelocitySolution
    hybrid: HybridSolution

    def __eq__(self, other: object) -> bool:
        """Whether all fields are equal, arrays number by number."""
        return type(other) is HybridPathSolution and all(map(same, self, other))

    def __ne__(self, other: object) -> bool:  # else a tuple's own would be used
        return not self == other

    def __hash__(self) -> int:
        return hash((*self.velocity.tolist(), self.status, self.reason))
