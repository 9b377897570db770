"""The plant of a run: an arm, its force sensor and its contact; and the ideal one, q <- q + dt x.

The ideal plant moves exactly as commanded, against springs at points of the tool: one point, the two ends of an edge,
the four corners of a face or a handle. It has no inertia, lag, friction or noise, and dead time only if given.

    on a plane:  f_i = (k / n) max(-n.(p_i - p0), 0) n,     on a hinge:  f_i = (k / n) (g_i(angle) - p_i)

Wrenches are exerted on the tool, about the origin of the base frame. The tilting stiffness of an edge or a face follows
from its points: k L^2 / 4 for an edge of length L.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import hypot, inf
from typing import NamedTuple, Protocol

import numpy as np

from invariantqp.force.sensor import GRAVITY
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot


class Measurement(NamedTuple):
    """Joint positions (m,), and the wrench (6,) in the sensor's frame, as measured."""

    q: Array
    wrench: Array


class PlantState(NamedTuple):
    """The true joint positions (m,), tool pose (4, 4), and wrench (6,) on the tool, base frame."""

    q: Array
    pose: Array
    wrench: Array


class Plant(Protocol):
    """An arm and its contact."""

    def measure(self) -> Measurement:
        """The measurement now."""

    def command(self, velocity: Array) -> None:
        """Move for one tick at joint velocities (m,)."""

    def state(self) -> PlantState:
        """The true state now, which controllers do not see."""


class Plane(NamedTuple):
    """A plane through a point (3,), with its unit normal (3,) pointing out.

    It ends at straight edges, if any: each is the vector (3,) from the point to the edge, normal to it.
    """

    point: Array
    normal: Array
    edges: tuple[Array, ...] = ()

    def depth(self, p: Array) -> float:
        """The depth of p (3,) below the plane [length], negative above it."""
        return float(self.normal.dot(self.point - p))

    def extent(self, p: Array) -> float:
        """The distance from p (3,) to the nearest edge [length], negative beyond it; inf without edges."""
        return min((float(e.dot(self.point + e - p)) / hypot(*e.tolist()) for e in self.edges), default=inf)


@dataclass(frozen=True, eq=False)
class SurfaceSprings:
    """Points of a tool on a surface that only pushes."""

    points: Array  # (n, 3) in the tool frame [m]: one, the two ends of an edge, or the four corners of a face in order
    surface: Plane
    stiffness: float  # of all points together [N/m]

    def wrench(self, T: Array) -> Array:
        """(6,) of the surface on the tool at pose T."""
        total = np.zeros(6)
        each = self.stiffness / len(self.points)
        for p in self.points.dot(T[:3, :3].T) + T[:3, 3]:
            depth = self.surface.depth(p)
            if depth > 0.0 and self.surface.extent(p) > 0.0:
                total += force_at(each * depth * self.surface.normal, p)
        return total


@dataclass(frozen=True, eq=False)
class HingeSprings:
    """A tool that holds the handle of a door, which turns about an axis."""

    points: Array  # (n, 3) of the tool frame [m], each tied to the point of the door that it is on at angle 0
    home: Array  # (4, 4) tool pose at angle 0
    screw: Array  # (6,) twist of the door, in the base frame
    stiffness: float  # of all points together [N/m]

    def handle(self, angle: float) -> Array:
        """(n, 3) positions of the points of the door at an angle [rad]."""
        T = se3.exp(angle * self.screw).dot(self.home)
        return np.asarray(self.points.dot(T[:3, :3].T) + T[:3, 3])

    def angle(self, T: Array, guess: float) -> float:
        """The angle [rad] at which the springs stretch least, with the tool at pose T: that of a free door."""
        p = self.points.dot(T[:3, :3].T) + T[:3, 3]
        for _ in range(6):  # two are enough from the last tick's angle
            g = self.handle(guess)
            along = np.cross(self.screw[:3], g) + self.screw[3:]
            guess += float(np.vdot(along, p - g) / np.vdot(along, along))
        return guess

    def wrench(self, T: Array, angle: float) -> Array:
        """(6,) of the door on the tool at pose T."""
        p = self.points.dot(T[:3, :3].T) + T[:3, 3]
        forces = self.stiffness / len(p) * (self.handle(angle) - p)
        return np.concatenate((np.cross(p, forces).sum(axis=0), forces.sum(axis=0)))


Springs = SurfaceSprings | HingeSprings


def force_at(force: Array, point: Array) -> Array:
    """(6,) wrench of a force (3,) along the line through a point (3,)."""
    return np.concatenate((se3.cross(point, force), force))


class SimulatedSensor(NamedTuple):
    """A force sensor and the mass of the tool beyond it."""

    mount: Array  # (4, 4) pose of the sensor in the tool frame
    mass: float = 0.0  # of the tool beyond the sensor [kg]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # (3,) centre of that mass in the sensor's frame [m]

    def reading(self, T: Array, contact: Array) -> Array:
        """(6,) the reading, in its frame, at rest at tool pose T: contact wrench and weight."""
        pose = T.dot(self.mount)
        weight = force_at(self.mass * np.array(GRAVITY), pose[:3, :3].dot(self.centre) + pose[:3, 3])
        return np.asarray(se3.adjoint(pose, check=False).T.dot(contact + weight))


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
        """An arm at rest at `start` (m,) that executes commands `delay` seconds late, in whole ticks of dt [s]."""
        self._robot = robot
        self._dt = dt
        self._springs = springs
        self._sensor = SimulatedSensor(np.eye(4)) if sensor is None else sensor
        self._q = start.copy()
        self._pending = deque([np.zeros(len(start))] * round(delay / dt))
        self._angle = 0.0
        self._state: PlantState | None = None  # computed once a tick

    def measure(self) -> Measurement:
        """Joint positions and the sensor's wrench, both exact."""
        if self._springs is None:
            return Measurement(self._q, np.zeros(6))
        now = self.state()
        return Measurement(now.q, self._sensor.reading(now.pose, now.wrench))

    def command(self, velocity: Array) -> None:
        """q <- q + dt x, with the velocity x commanded a dead time ago."""
        self._pending.append(velocity)
        self._q = self._q + self._dt * self._pending.popleft()
        self._state = None

    def state(self) -> PlantState:
        """Joint positions, tool pose and the springs' wrench."""
        if self._state is None:
            T = self._robot.pose(self._q)
            self._state = PlantState(self._q, T, self._wrench(T))
        return self._state

    def _wrench(self, T: Array) -> Array:
        """(6,) wrench of the springs on the tool at a pose (4, 4), base frame; follows the angle of a hinge."""
        if self._springs is None:
            return np.zeros(6)
        if isinstance(self._springs, SurfaceSprings):
            return self._springs.wrench(T)
        self._angle = self._springs.angle(T, self._angle)
        return self._springs.wrench(T, self._angle)
