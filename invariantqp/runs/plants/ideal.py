"""A plant: what a controller senses and commands. The ideal one is q <- q + dt x, and springs where the tool touches.

Nothing else is in it: no inertia, no actuator, no delay, no friction, no noise.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.plants.touch import Grip, Sensed, Touch, Truth, Wrist

# The wrench of a tool that touches nothing.
NOTHING = np.zeros(6)


class Plant(Protocol):
    """An arm and what it touches, real or simulated."""

    def sense(self) -> Sensed:
        """What the controller is told now."""
        ...

    def command(self, velocity: Array) -> None:
        """Joint velocities (m,), held for one tick."""
        ...

    def truth(self) -> Truth:
        """What nobody tells the controller; for the trace."""
        ...


class IdealPlant:
    """An arm that moves as it is told, against springs without mass or friction."""

    def __init__(
        self, robot: Robot, start: Array, dt: float, touch: Touch | Grip | None = None, wrist: Wrist | None = None
    ) -> None:
        self._robot = robot
        self._dt = dt
        self._touch = touch
        self._wrist = Wrist(np.eye(4)) if wrist is None else wrist
        self._q = start.copy()
        self._angle = 0.0
        self._now: Truth | None = None  # looked at twice in a tick

    def sense(self) -> Sensed:
        """Joint positions and the sensor's wrench, both exact."""
        if self._touch is None:
            return Sensed(self._q, None)
        now = self.truth()
        return Sensed(now.q, self._wrist.reading(now.pose, now.wrench))

    def command(self, velocity: Array) -> None:
        """q <- q + dt x."""
        self._q = self._q + self._dt * velocity
        self._now = None

    def truth(self) -> Truth:
        """The state, and the springs' wrench."""
        if self._now is None:
            self._now = self._truth()
        return self._now

    def _truth(self) -> Truth:
        T = self._robot.pose(self._q)
        if self._touch is None:
            return Truth(self._q, T, NOTHING)
        if isinstance(self._touch, Touch):
            return Truth(self._q, T, self._touch.wrench(T))
        self._angle = self._touch.angle(T, self._angle)
        return Truth(self._q, T, self._touch.wrench(T, self._angle))
