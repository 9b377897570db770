"""Whether the joints respond to their commands. They do not where the robot is stopped, paused or blocked.

    commanded = sum of dt x,   moved = sum of (q - q_before)       over the last 0.05 s, fading

A joint responds if it has moved by at least a fifth of what was commanded, in either direction. It is unresponsive
after an eighth of a second without a response, if more was commanded in that time than friction and the play of gears
may hide; joints beside it that do not respond either are unresponsive, too. It responds again when it has moved by a
fifth of what is commanded and by more than its readings scatter, when the commands explain what it moved better than
rest does, or when it is commanded to rest. When one that was unresponsive by itself responds, all are judged anew.

An unresponsive joint is at rest: its acceleration limit counts from there, and no command to it is in flight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array

# The time over which displacements are compared [s], and after which a joint without a response is unresponsive: longer
# than arms lag behind their commands.
RESPONSE_MEMORY, RESPONSE_TIME = 0.05, 0.125
# The share of the commanded displacement that is a response.
RESPONSE_SHARE = 0.19
# A smaller commanded displacement, in seconds of full speed, may be lost in friction or the play of gears, and one
# smaller than the second is rest; a joint's speed counts up to half a turn, or three lengths, in a second.
LEAST_COMMANDED, COMMANDED_REST, FULL_SPEED = 0.005, 1e-6, 3.1
# A displacement is more than scatter where its square is so many times the mean square of the displacement in a tick
# (independent readings give twice the square of their noise); commands explain displacements where they leave less than
# the second share of that mean square.
SCATTER, EXPLAINED = 30.0, 0.5
# Numbers that are kept of a joint.
ROWS = 7


def units(velocity_limit: Array) -> Array:
    """(m,) the speeds in whose units displacements are compared, for velocity limits (m,)."""
    return np.where(velocity_limit > 0.0, np.minimum(velocity_limit, FULL_SPEED), FULL_SPEED)


class Response(NamedTuple):
    """What is known of each joint's response; displacements are in seconds of its full speed. All are (m,)."""

    silent: Array  # time without a response [s]
    unanswered: Array  # what was commanded in that time
    unresponsive: Array  # 1 where the joint is unresponsive by itself, 0.5 where it is beside another, 0 elsewhere
    scatter: Array  # mean square of the displacement in a tick
    rest: Array  # the same of what commands leave of it
    commanded: Array
    moved: Array

    @classmethod
    def at_first(cls, joints: int) -> Response:
        """Before the first tick."""
        return cls.of(np.zeros(ROWS * joints))

    @classmethod
    def of(cls, numbers: Array) -> Response:
        """As `numbers` gives it."""
        return cls(*numbers.reshape(ROWS, -1).copy())

    @property
    def numbers(self) -> Array:
        """(ROWS m,) all of it as the compiled core takes it."""
        return np.concatenate(self)

    @property
    def unresponsive_joints(self) -> tuple[int, ...]:
        """The indices of unresponsive joints."""
        return tuple(np.flatnonzero(self.unresponsive).tolist())

    @property
    def farthest(self) -> int:
        """The joint that is farthest from where it was commanded to be."""
        return int(np.abs(self.commanded - self.moved).argmax())

    def after(self, commanded: Array, moved: Array, dt: float) -> Response:
        """After a tick of dt [s] in which joints were commanded to move, and moved, by displacements (m,)."""
        left, before = max(1.0 - dt / RESPONSE_MEMORY, 0.0), self.unresponsive > 0.0
        scatter = left * self.scatter + (1.0 - left) * moved**2
        rest = left * self.rest + (1.0 - left) * (moved - commanded) ** 2
        told, done = left * self.commanded + commanded, np.where(before, 1.0, left) * self.moved + moved
        enough = np.abs(done) >= RESPONSE_SHARE * np.abs(told)
        responds = enough & ~before
        silent = np.where(responds, 0.0, self.silent + dt)
        unanswered = np.where(responds, 0.0, self.unanswered + commanded)
        scatters = (~enough | (done * done <= SCATTER * np.minimum(scatter, rest))) & (rest >= EXPLAINED * scatter)
        resumes = bool(((self.unresponsive == 1.0) & ~scatters).any())
        wanted = np.maximum(np.abs(told), np.abs(commanded) * (RESPONSE_MEMORY / dt)) > COMMANDED_REST
        stays = scatters & wanted & (not resumes)
        alone = (silent > RESPONSE_TIME) & (np.abs(unanswered) > LEAST_COMMANDED)
        alone = np.where(before, stays & (alone | (self.unresponsive == 1.0)), alone)
        beside = np.where(before, stays, silent > 0.0) & alone.any()
        now = np.where(alone, 1.0, np.where(beside, 0.5, 0.0))
        begins, ends = (now > 0.0) & ~before, before & (now == 0.0)
        silent, unanswered = np.where(ends, 0.0, silent), np.where(ends, 0.0, unanswered)
        return Response(silent, unanswered, now, scatter, rest, told, np.where(begins, 0.0, done))
