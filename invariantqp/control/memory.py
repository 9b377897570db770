"""What a loop keeps from tick to tick: the velocity commanded last, the turn of the error, and how it converges."""

from __future__ import annotations

from typing import NamedTuple

from numpy.typing import ArrayLike

from invariantqp.control.convergence import Convergence
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array


class Memory(NamedTuple):
    """The state between ticks; a tick returns the next one.

    Attributes:
        velocity: (m,) commanded last [rad/s, length/s].
        turn: (3,) rotation of the error in the tick before, or None.
        convergence: how the error falls.
    """

    velocity: Array
    turn: Array | None
    convergence: Convergence

    def now(self, velocity: ArrayLike | None) -> Array:
        """(m,) the joint velocity now: as measured, or else the one commanded last.

        Raises:
            BadInput: NaN or another shape.
        """
        return self.velocity if velocity is None else arrays.vector(velocity, len(self.velocity), "velocity")

    def commanded(self, velocity: Array) -> Memory:
        """With the velocity (m,) of a tick."""
        return self._replace(velocity=velocity.copy())

    def followed(self, error: Array, change: Array, root: Array, slowness: float) -> Memory:
        """After a tick towards a target.

        Args:
            error: (6,) twist to the target.
            change: (6,) what the commanded velocity changes of it until the next tick.
            root: (6, 6) of the measure.
            slowness: 1 / |change| of a tick at full speed.
        """
        measured = root.dot(error)
        watch = self.convergence.seen(measured).commanded(measured, root.dot(change), slowness)
        return self._replace(turn=error[:3].copy(), convergence=watch)
