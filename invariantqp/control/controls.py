"""What a loop needs of a controller: a step. Ours has it, and so has every law it is compared with."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import ArrayLike

from invariantqp.velocity.solution import VelocitySolution


class Controls(Protocol):
    """Anything with a step: ours, or a law to compare it with."""

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick."""
        ...
