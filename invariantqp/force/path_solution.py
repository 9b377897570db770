"""The result of a tick along a path in contact."""

from __future__ import annotations

from typing import NamedTuple

from invariantqp.force.solution import HybridSolution
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import compared
from invariantqp.velocity.solution import Status, VelocitySolution


@compared
class HybridPathSolution(NamedTuple):
    """A tick along a path in contact: the fields of a `PathSolution`, `across` along S alone, and one more.

    Attributes:
        hybrid: the hybrid controller's answer, with the forces.
    """

    velocity: Array
    status: Status
    reason: str
    place: float
    speed: float
    ruling: str
    lag: float | None
    across: float
    velocity_solution: VelocitySolution
    hybrid: HybridSolution
