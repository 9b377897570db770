"""Motion that was passed on to a late robot and is still to be done, and the energy that it may take.

    energy = sum over the ways d still to be done of max(0, d . (w + k (r - d / 2))),    r the way to the end of d

w is met now, k the stiffness of the hardest thing that the tool may meet: it may stand right before the tool, and what
is on its way to a late robot cannot be called back. So in free motion, too, no more is passed on than may strike.
"""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from invariantqp.control.echo import LONGEST, Echo
from invariantqp.geometry.arrays import Array

# Time over which the robot's answer is remembered [s]: a few swings of a hand.
REMEMBERED = 2.0
# A delay that was told counts as that many ticks, but for rounding.
ROUNDING = 1e-9


class Pipe:
    """What was passed on in the last ticks.

    Attributes:
        late: by how much later than told the robot was seen to follow [s].
        stiffness: of the hardest thing that the tool may meet, told or met [N/length].
    """

    def __init__(self, dt: float, delay: float, stiffness: float) -> None:
        """Nothing on its way, for ticks of dt [s], a told delay [s] and a stiffness [N/length]."""
        self.late: float = 0.0
        self._dt, self._told = dt, ceil(delay / dt - ROUNDING)
        self.stiffness: float = stiffness
        self._passed = np.zeros((1 + self._told + round(LONGEST / dt), 6))  # the latest last
        self._echo = Echo(dt, self._told * dt, 3, 1.0 - dt / REMEMBERED)

    @property
    def done(self) -> Array:
        """(6,) the twist that the robot has in this tick by what was told of its delay."""
        now: Array = self._passed[-1 - self._told]
        return now

    def push(self, twist: Array, seen: Array | None) -> None:
        """After a tick in which a twist (6,) was passed on; `seen` is the tool's in the tick before, if measured."""
        if seen is not None:
            self.late = max(self.late, self._echo.after(seen[3:], twist[3:]) or 0.0)
        self._passed[:-1] = self._passed[1:].copy()
        self._passed[-1] = twist

    def share(self, twist: Array, met: tuple[Array, Array], left: float) -> float:
        """How much of a twist (6,) can be paid with the energy left [N length], from 0 to 1.

        Now, after all that is on its way; and for as long as the robot is late, so that a tool is slow and does not
        stop and go. `met` are wrenches (6,), now and when something was done last: the one that takes more counts.
        """
        ticks = self._told + round(self.late / self._dt)
        owed, further = self._owed(met[0], ticks) if ticks else (0.0, np.zeros(3))
        line = twist[3:]
        hard, power = self.stiffness * float(line.dot(line)), max(float(twist.dot(met[0])), float(twist.dot(met[1])))
        once = _payable(self._dt * (power + float(line.dot(further))), self._dt**2 * hard, left - owed)
        time = (1 + ticks) * self._dt
        return min(1.0, once, _payable(time * power, time**2 * hard, left))

    def _owed(self, met: Array, ticks: int) -> tuple[float, Array]:
        """The energy that the last so many ticks will take, and the force (3,) that they will add."""
        ways = self._dt * self._passed[-ticks:]
        pressed = np.tile(met, (ticks, 1))
        sums = ways[:, 3:].cumsum(axis=0)
        pressed[:, 3:] += self.stiffness * (sums - 0.5 * ways[:, 3:])
        energies = (ways * pressed).sum(axis=1)
        return float(energies[energies > 0.0].sum()), self.stiffness * sums[-1]


def _payable(push: float, hard: float, left: float) -> float:
    """The largest share with push share + hard share^2 / 2 <= left; one or more where all can be had."""
    left = max(0.0, left)
    if push + 0.5 * hard <= left:
        return 1.0
    root = sqrt(push * push + 2.0 * hard * left)
    return 2.0 * left / (push + root) if push > 0.0 else (root - push) / hard
