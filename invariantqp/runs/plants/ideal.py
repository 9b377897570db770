"""The ideal plant, q <- q + dt x: the arm moves exactly as commanded, against springs where the tool touches.

It has no inertia, no actuator lag, no friction and no noise; a dead time only where one is asked for.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.plants.plant import Measurement, PlantState
from invariantqp.runs.plants.sensor import SimulatedSensor
from invariantqp.runs.plants.springs import Springs, SurfaceSprings

# The wrench on a tool that touches nothing.
NO_WRENCH = np.zeros(6)


class IdealPlant:
    """An arm that moves as commanded, against springs without mass or friction."""

    def __init__(
        self,
        robot: Robot,
        start: Array,
        dt: float,
        springs: Springs | None = None,
        sensor: SimulatedSensor | None = None,
        delay: float = 0.0,
    ) -> None:
        """An arm at rest at `start` (m,) that does what it is told `delay` seconds late, in whole ticks of dt [s]."""
        self._robot = robot
        self._dt = dt
        self._springs = springs
        self._sensor = SimulatedSensor(np.eye(4)) if sensor is None else sensor
        self._q = start.copy()
        self._late = deque([np.zeros(len(start))] * round(delay / dt))
        self._angle = 0.0
        self._state: PlantState | None = None  # asked for twice in a tick

    def measure(self) -> Measurement:
        """Joint positions and the sensor's wrench, both exact."""
        if self._springs is None:
            return Measurement(self._q, None)
        now = self.state()
        return Measurement(now.q, self._sensor.reading(now.pose, now.wrench))

    def command(self, velocity: Array) -> None:
        """q <- q + dt x, x the velocity that was commanded a dead time ago."""
        self._late.append(velocity)
        self._q = self._q + self._dt * self._late.popleft()
        self._state = None

    def state(self) -> PlantState:
        """Joint positions, tool pose and the springs' wrench."""
        if self._state is None:
            T = self._robot.pose(self._q)
            self._state = PlantState(self._q, T, self._wrench(T))
        return self._state

    def _wrench(self, T: Array) -> Array:
        if self._springs is None:
            return NO_WRENCH
        if isinstance(self._springs, SurfaceSprings):
            return self._springs.wrench(T)
        self._angle = self._springs.angle(T, self._angle)
        return self._springs.wrench(T, self._angle)
