"""The protocol of a controller in a loop: `step`. `Controller` meets it, and so does every law it is compared with."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import ArrayLike

from invariantqp.velocity.solution import VelocitySolution


class Controls(Protocol):
    """Anything with a step: ours, or a law to compare it with."""

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick."""
        ...
