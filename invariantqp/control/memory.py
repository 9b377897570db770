"""What a loop keeps from tick to tick: the velocity commanded last, the turn of the error, and how it converges."""

from __future__ import annotations

from math import isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.convergence import Convergence
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import VelocitySolution, with_trouble


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

    @classmethod
    def of(cls, numbers: Array) -> Memory:
        """As `numbers` gives it."""
        promised, achieved, speed, size, ticks = numbers[:5].tolist()
        before = not isnan(numbers[5])
        watch = Convergence(promised, achieved, speed, numbers[5:11].copy() if before else None, size, int(ticks))
        return cls(numbers[14:].copy(), numbers[11:14].copy() if before else None, watch)

    @property
    def numbers(self) -> Array:
        """(14 + m,) all of it as the compiled core takes it, NaN for what there is not before the first tick."""
        found = np.empty(14 + len(self.velocity))
        found[14:] = self.velocity
        self.write(found)
        return found

    def write(self, numbers: Array) -> None:
        """Into `numbers`, all but the velocity, which every tick writes there."""
        promised, achieved, speed, expected, size, ticks = self.convergence
        numbers[:5] = promised, achieved, speed, size, ticks
        numbers[5:11] = nan if expected is None else expected
        numbers[11:14] = nan if self.turn is None else self.turn

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
        measured = root.dot(error)
        watch = self.convergence.seen(measured).commanded(measured, root.dot(change), slowness)
        return self._replace(turn=error[:3].copy(), convergence=watch)

    def judged(self, solution: VelocitySolution) -> VelocitySolution:
        """The solution of a tick; a loop that does not converge is trouble."""
        trouble = self.convergence.trouble
        return with_trouble(solution, trouble) if trouble else solution
