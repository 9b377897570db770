"""The loop of most tests: an arm that does what its controller commands."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np


class Run(NamedTuple):
    """Joint positions before every tick and after the last (n + 1, m), velocities (n, m) and solutions."""

    q: np.ndarray
    x: np.ndarray
    solutions: list

    @property
    def end(self):
        """Joint positions (m,) after the last tick, and its solution."""
        return self.q[-1], self.solutions[-1]

    @property
    def changes(self):
        """(n, m) changes of the commanded velocity, from rest."""
        return np.diff(self.x, axis=0, prepend=np.zeros((1, self.x.shape[1])))


def drive(loop, q, target, ticks, options=lambda _: {}, *, late=0):
    """A run towards a target, with options(k) of tick k; commands act `late` ticks later."""
    pending, positions, solutions = deque([np.zeros(len(q))] * late), [np.asarray(q)], []
    for k in range(ticks):
        solutions.append(loop.step(positions[-1], target, **options(k)))
        pending.append(solutions[-1].velocity)
        positions.append(positions[-1] + loop.dt * pending.popleft())
    return Run(np.array(positions), np.array([solution.velocity for solution in solutions]), solutions)


class OwnDemand:
    """An exact demand of the user's own class, with the rows of one of the library's."""

    def __init__(self, demand):
        self.rows = demand.rows
