"""What a loop keeps from tick to tick: last commands, where the joints were, the turn of the error, how joints respond.

A command shows in the measured positions one tick and the loop's `delay` later. Those that do not show yet are in
flight: the joints will be at q + dt (sum of the commands in flight) when the next one acts. To an unresponsive joint
(`response.py`) no command is in flight. How far joints move for their commands is in `motion_ratio.py`.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.control.tracking import ticks_late
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.motion_ratio import NUMBERS, MotionRatio
from invariantqp.legacy.response import ROWS, Response
from invariantqp.robots.kinematics import joint_displacement
from invariantqp.velocity.reasons import Code, Reason

# The numbers of the error's turn.
HEADER = 3


def states_of(joints: int) -> int:
    """How many numbers tell what is known of the joints: their response and their motion ratio."""
    return (ROWS + 1) * joints + NUMBERS


class JointStates(NamedTuple):
    """What is known of the joints of a loop from the positions that were measured and the commands that these show."""

    response: Response
    ratio: MotionRatio

    @classmethod
    def at_first(cls, joints: int) -> JointStates:
        """Before the first tick."""
        return cls(Response.at_first(joints), MotionRatio.at_first(joints))

    @classmethod
    def of(cls, numbers: Array, joints: int) -> JointStates:
        """As `numbers` gives it."""
        return cls(Response.of(numbers[: ROWS * joints]), MotionRatio.of(numbers[ROWS * joints :]))

    @property
    def numbers(self) -> Array:
        """(states_of(m),) all of it as the compiled core takes it."""
        return np.concatenate((self.response.numbers, self.ratio.numbers))

    def after(self, commanded: Array, moved: Array, dt: float, units: Array) -> JointStates:
        """After a tick of dt [s] in which joints were commanded to move, and moved, by displacements (m,).

        `units` (m,) are as `response.units` returns them.
        """
        response = self.response.after(commanded / units, moved / units, dt)
        responds = not response.unresponsive.any()
        return JointStates(response, self.ratio.after(commanded, moved, dt, responds=responds))

    def trouble(self, dt: float, gain: float, fastest_gain: float, *, chases: bool) -> Reason | None:
        """What is wrong with the joints of a loop, as in `MotionRatio.trouble`."""
        if unresponsive := self.response.unresponsive_joints:
            return Reason(Code.NO_MOTION, unresponsive)
        return self.ratio.trouble(dt, gain, fastest_gain, self.response.farthest, chases=chases)


class Memory(NamedTuple):
    """The state between ticks; a tick returns the next one."""

    turn: Array  # (3,) rotation of the error in the tick before, NaN before the first
    positions: Array  # (m,) in the tick before, NaN before the first
    commands: Array  # (k, m) the last ones, the latest first [rad/s, length/s]; k as `late` needs
    states: JointStates
    late: tuple[int, float]  # the delay in ticks

    @classmethod
    def at_first(cls, joints: int, delay: float, dt: float) -> Memory:
        """Before the first tick."""
        late, unknown = ticks_late(delay, dt), np.full(joints, nan)
        return cls(np.full(HEADER, nan), unknown, np.zeros((late[0] + 2, joints)), JointStates.at_first(joints), late)

    @classmethod
    def of(cls, numbers: Array, joints: int, late: tuple[int, float]) -> Memory:
        """As `numbers` gives it."""
        count = states_of(joints)
        rest = numbers[HEADER:-count].reshape(-1, joints).copy()
        return cls(numbers[:HEADER].copy(), rest[0], rest[1:], JointStates.of(numbers[-count:], joints), late)

    @property
    def numbers(self) -> Array:
        """(HEADER + m + k m + states_of(m),) all of it as the compiled core takes it."""
        return np.concatenate((self.turn, self.positions, self.commands.ravel(), self.states.numbers))

    @property
    def _at_rest(self) -> NDArray[np.bool_]:
        """(m,) which joints are unresponsive."""
        return np.asarray(self.states.response.unresponsive > 0.0)

    def now(self, velocity: ArrayLike | None) -> Array:
        """(m,) the joint velocity before the next command: as given, or commanded last, 0 if unresponsive."""
        last = self.commands[0]
        if velocity is not None:
            return arrays.vector(velocity, len(last), "velocity")
        return np.where(self._at_rest, 0.0, last)

    @property
    def in_flight(self) -> Array:
        """(m,) the sum of the commands that do not show yet."""
        whole, part = self.late
        coming = self.commands[:whole].sum(axis=0) + part * self.commands[whole]
        return np.where(self._at_rest, 0.0, coming)

    @property
    def shown(self) -> Array:
        """(m,) the command that the joints have followed since the tick before."""
        whole, part = self.late
        return np.asarray((1.0 - part) * self.commands[whole] + part * self.commands[whole + 1])

    def observed(self, q: Array, turns: Array, dt: float, units: Array) -> Memory:
        """With what the joints did since the tick before.

        Args:
            q: (m,) as measured.
            turns: (m,) as in `joint_displacement`.
            dt: of the tick [s].
            units: (m,) as `response.units` returns them.
        """
        moved = joint_displacement(self.positions, q, turns)
        if np.isnan(moved).any():
            return self._replace(states=JointStates.at_first(len(q)))
        return self._replace(states=self.states.after(dt * self.shown, moved, dt, units))

    def after(self, q: Array, command: Array) -> Memory:
        """After a tick at measured positions q (m,) that gave a command (m,)."""
        return self._replace(positions=q, commands=np.vstack((command[None], self.commands[:-1])))
