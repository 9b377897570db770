"""What a loop keeps from tick to tick: the velocity commanded last, the turn of the error, and how it converges."""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.convergence import Convergence
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import VelocitySolution, with_trouble


class Memory(NamedTuple):
    """The state between ticks; a tick returns the next one."""

    velocity: Array  # (m,) commanded last [rad/s, length/s]
    turn: Array  # (3,) rotation of the error in the tick before, NaN before the first
    convergence: Convergence  # how the error falls

    @classmethod
    def at_first(cls, joints: int) -> Memory:
        """Before the first tick."""
        return cls(np.zeros(joints), np.full(3, nan), Convergence())

    @classmethod
    def of(cls, numbers: Array) -> Memory:
        """As `numbers` gives it."""
        return cls(numbers[9:].copy(), numbers[6:9].copy(), Convergence(*numbers[:6].tolist()))

    @property
    def numbers(self) -> Array:
        """(9 + m,) all of it as the compiled core takes it."""
        return np.concatenate((self.convergence, self.turn, self.velocity))

    def write(self, numbers: Array) -> None:
        """Into `numbers`, all but the velocity, which every tick writes there."""
        numbers[:6], numbers[6:9] = self.convergence, self.turn

    def now(self, velocity: ArrayLike | None) -> Array:
        """(m,) the joint velocity now: as measured, or else the one commanded last.

        Raises:
            BadInput: NaN or another shape.
        """
        return self.velocity if velocity is None else arrays.vector(velocity, len(self.velocity), "velocity")

    def followed(self, error: Array, change: Array, root: Array, slowness: float) -> Memory:
        """After a tick with an error (6,), its `change` (6,) until the next tick, and the measure's root (6, 6).

        `slowness` is 1 / |change| of a tick at full speed.
        """
        watch = self.convergence.followed(root.dot(error), root.dot(change), slowness)
        return Memory(self.velocity, error[:3], watch)

    def judged(self, solution: VelocitySolution) -> VelocitySolution:
        """The solution of a tick; a loop that does not converge is trouble."""
        trouble = self.convergence.trouble
        return with_trouble(solution, trouble) if trouble else solution
