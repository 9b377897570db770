"""What a loop keeps from tick to tick: last commands, where the joints were, the turn of the error, how it converges.

A command shows in the measured positions one tick and the loop's `delay` later. Those that do not show yet are in
flight: the joints will be at q + dt (sum of the commands in flight) when the next one acts. To an unresponsive joint
(`response.py`) no command is in flight.

Whether the joints follow is judged by what the tool moved, compared with what it was commanded to move:

    told = A (dt x)             the measured motion of the tool that the shown command asked for
    done = A (q - q before)     the one that was seen

Averaged over the last ticks, where much less of what was commanded is done while joints move fast, the loop oscillates,
or the robot does not do what is commanded: a delay, a gain too high for it, a limit that is not modelled.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.response import ROWS, Response
from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.geometry.se3 import norm
from invariantqp.robots.kinematics import joint_displacement
from invariantqp.velocity.reasons import Code, Reason
from invariantqp.velocity.solution import VelocitySolution, with_trouble

# Ticks over which averages are taken.
MEMORY = 50
# Below this share of what was commanded the joints do not follow.
KEPT_SHARE = 0.2
# Below this share of full speed, on average, an arm does not oscillate: a small share is then noise.
FAST_SHARE = 0.005
# A robot that is later than this many ticks is none: a delay in milliseconds, say.
MOST_LATE = 10_000
HEADER = 7


def ticks_late(delay: float, dt: float) -> tuple[int, float]:
    """A delay in ticks: the whole ones, and the share of one more."""
    late = delay / dt
    if late > MOST_LATE:
        raise BadInput("delay", f"{delay:g} s, {late:.0f} ticks", f"seconds, at most {MOST_LATE} ticks")
    whole = int(late + NEGLIGIBLE)  # quotients of decimals are nearly whole
    return whole, max(0.0, late - whole)


def slowness(A: Array, limits: Array) -> float:
    """1 / |v|, v the measured twist of joints A (6, m) at full speed (m,); 0 where one has no limit or none moves."""
    each = np.sqrt((A * A).sum(axis=0))
    moving = each > 0.0
    speed = float(np.linalg.norm(each[moving] * limits[moving]))
    return 1.0 / speed if speed > 0.0 else 0.0


class Memory(NamedTuple):
    """The state between ticks; a tick returns the next one."""

    told: float  # size of the motion commanded in a tick, in the mean of the last ones
    done: float  # likewise of the motion seen, the part along it
    speed: float  # likewise commanded, as a share of the arm's full speed
    ticks: float  # number of ticks but the first
    turn: Array  # (3,) rotation of the error in the tick before, NaN before the first
    positions: Array  # (m,) in the tick before, NaN before the first
    commands: Array  # (k, m) the last ones, the latest first [rad/s, length/s]; k as `late` needs
    response: Response
    late: tuple[int, float]  # the delay in ticks

    @classmethod
    def at_first(cls, joints: int, delay: float, dt: float) -> Memory:
        """Before the first tick."""
        late, first = ticks_late(delay, dt), Response.at_first(joints)
        unknown = np.full(3, nan), np.full(joints, nan)
        return cls(0.0, 0.0, 0.0, 0.0, *unknown, np.zeros((late[0] + 2, joints)), first, late)

    @classmethod
    def of(cls, numbers: Array, joints: int, late: tuple[int, float]) -> Memory:
        """As `numbers` gives it."""
        head, rest = numbers[:HEADER], numbers[HEADER : -ROWS * joints].reshape(-1, joints).copy()
        told, done, speed, ticks = head[:4].tolist()
        response = Response.of(numbers[-ROWS * joints :])
        return cls(told, done, speed, ticks, head[4:].copy(), rest[0], rest[1:], response, late)

    @property
    def numbers(self) -> Array:
        """(HEADER + m + k m + ROWS m,) all of it as the compiled core takes it."""
        return np.concatenate((self[:4], self.turn, self.positions, self.commands.ravel(), self.response.numbers))

    def now(self, velocity: ArrayLike | None) -> Array:
        """(m,) the joint velocity before the next command: as given, or commanded last, 0 if unresponsive."""
        last = self.commands[0]
        if velocity is not None:
            return arrays.vector(velocity, len(last), "velocity")
        return np.where(self.response.unresponsive > 0.0, 0.0, last)

    @property
    def in_flight(self) -> Array:
        """(m,) the sum of the commands that do not show yet."""
        whole, part = self.late
        coming = self.commands[:whole].sum(axis=0) + part * self.commands[whole]
        return np.where(self.response.unresponsive > 0.0, 0.0, coming)

    @property
    def shown(self) -> Array:
        """(m,) the command that the joints have followed since the tick before."""
        whole, part = self.late
        return np.asarray((1.0 - part) * self.commands[whole] + part * self.commands[whole + 1])

    def moved(self, q: Array, turns: Array) -> Array:
        """(m,) the displacement of the joints since the tick before, at q (m,); `turns` as in `joint_displacement`."""
        return joint_displacement(self.positions, q, turns)

    def followed(self, moved: Array, A: Array, dt: float, slowness: float) -> Memory:
        """With what the joints `moved` (m,) since the tick before, by measured joint twists A (6, m).

        `slowness` is 1 / |motion| of a tick at full speed.
        """
        if np.isnan(moved).any():
            return self
        if self.response.unresponsive.any():  # begins anew when all move
            return self._replace(told=0.0, done=0.0, speed=0.0, ticks=0.0)
        told, done = A.dot(dt * self.shown), A.dot(moved)
        size = norm(told)
        new = np.array((size, float(told.dot(done)) / size if size > 0.0 else 0.0, slowness * size))
        means = ((1.0 - 1.0 / MEMORY) * np.array(self[:3]) + 1.0 / MEMORY * new).tolist()
        return self._replace(told=means[0], done=means[1], speed=means[2], ticks=self.ticks + 1.0)

    @property
    def follows(self) -> bool:
        """Whether the joints do what is commanded, as far as it can be said."""
        return self.ticks < MEMORY or self.speed < FAST_SHARE or self.done >= KEPT_SHARE * self.told

    def after(self, q: Array, command: Array, moved: Array, dt: float, units: Array) -> Memory:
        """After a tick of dt [s] at q (m,) that gave a command (m,).

        Args:
            q: as measured.
            command: joint velocity.
            moved: (m,) as `moved` returned it.
            dt: of the tick [s].
            units: (m,) as `response.units` returns them.
        """
        response = Response.at_first(len(q))
        if not np.isnan(moved).any():
            response = self.response.after(dt * self.shown / units, moved / units, dt)
        commands = np.vstack((command[None], self.commands[:-1]))
        return self._replace(positions=q, commands=commands, response=response)

    def judged(self, solution: VelocitySolution, moved: Array, A: Array, dt: float) -> VelocitySolution:
        """The solution of a tick, as in `followed`; a loop whose joints do not follow is trouble.

        Of its joints, the one that is farthest from where its command led in this tick is named.
        """
        if self.follows:
            return solution
        off = np.sqrt((A * A).sum(axis=0)) * np.abs(dt * self.shown - moved)
        return with_trouble(solution, (Reason(Code.NOT_FOLLOWING, (int(off.argmax()),)),))
