"""What a tool touches, as springs at points of the tool: a point is one, an edge two, a face four, a grip four.

    on a surface:  f_i = (k / n) max(depth_i, 0) normal_i,     on a hinge:  f_i = (k / n) (g_i(angle) - p_i)

Wrenches are what the surroundings exert on the tool, about the base's origin. What turns an edge or a face against its
surface follows from where its points are: k L^2 / 4 for an edge of length L.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from invariantqp.force.wrench import GRAVITY
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Surface

# Gauss-Newton steps for a hinge's angle: from a tick ago two reach rounding.
ANGLE_STEPS = 3


@dataclass(frozen=True, eq=False)
class Touch:
    """Points of a tool on a surface that pushes and does not pull.

    Attributes:
        shape: what the tool has there.
        points: (n, 3) in the tool frame [m]: one, the two ends of an edge, or the four corners of a face in turn.
        surface: what they touch.
        stiffness: of all points together [N/m].
    """

    shape: Literal["point", "edge", "face"]
    points: Array
    surface: Surface
    stiffness: float

    def wrench(self, T: Array) -> Array:
        """(6,) of the surface on the tool at pose T."""
        total = np.zeros(6)
        each = self.stiffness / len(self.points)
        for p in self.points.dot(T[:3, :3].T) + T[:3, 3]:
            depth, normal = self.surface.depth(p)
            if depth > 0.0:
                total += force_at(each * depth * normal, p)
        return total


@dataclass(frozen=True, eq=False)
class Grip:
    """A tool that holds what turns about an axis.

    Attributes:
        shape: "hinge".
        points: (n, 3) of the tool frame [m], each tied to the point of the door that it is on at angle 0.
        home: (4, 4) tool pose at angle 0.
        screw: (6,) twist of the door, in the base frame.
        stiffness: of all points together [N/m].
    """

    points: Array
    home: Array
    screw: Array
    stiffness: float
    shape: Literal["hinge"] = "hinge"

    def held(self, angle: float) -> Array:
        """(n, 3) where the points of the door are at an angle."""
        G = se3.exp(angle * self.screw, check=False).dot(self.home)
        held: Array = self.points.dot(G[:3, :3].T) + G[:3, 3]
        return held

    def angle(self, T: Array, guess: float) -> float:
        """The angle of a door that nothing else holds, for a tool at pose T: the one of least strain."""
        p = self.points.dot(T[:3, :3].T) + T[:3, 3]
        for _ in range(ANGLE_STEPS):
            g = self.held(guess)
            along = np.cross(self.screw[:3], g) + self.screw[3:]
            guess += float(np.vdot(along, p - g) / np.vdot(along, along))
        return guess

    def wrench(self, T: Array, angle: float) -> Array:
        """(6,) of the door on the tool at pose T."""
        p = self.points.dot(T[:3, :3].T) + T[:3, 3]
        forces = self.stiffness / len(p) * (self.held(angle) - p)
        return np.concatenate((np.cross(p, forces).sum(axis=0), forces.sum(axis=0)))


class Wrist(NamedTuple):
    """A force sensor and what hangs on it.

    Attributes:
        pose: (4, 4) of the sensor in the tool frame.
        mass: beyond the sensor [kg].
        centre: (3,) of that mass, in the sensor frame [m].
    """

    pose: Array
    mass: float = 0.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def reading(self, T: Array, contact: Array) -> Array:
        """(6,) what the sensor of a tool at rest at pose T reports, in its own frame: contact and weight."""
        sensor = T.dot(self.pose)
        weight = force_at(self.mass * np.array(GRAVITY), sensor[:3, :3].dot(self.centre) + sensor[:3, 3])
        felt: Array = se3.coadjoint(se3.inverse(sensor, check=False)).dot(contact + weight)
        return felt


class Physics(NamedTuple):
    """What a real cell adds to geometry.

    Attributes:
        friction: Coulomb's coefficient between tool and surface.
        hinge_friction: torque that a hinge resists with [N m].
        lag: time constant of the arm's velocity loops [s].
        force_noise: standard deviation of each measured force [N].
        moment_noise: of each measured moment [N m].
        seed: of the noise.
    """

    friction: float = 0.3
    hinge_friction: float = 0.3
    lag: float = 0.01
    force_noise: float = 1.0
    moment_noise: float = 0.03
    seed: int = 0


class Sensed(NamedTuple):
    """What a controller is told: joint positions (m,), and the wrench (6,) in the sensor's frame where there is one."""

    q: Array
    wrench: Array | None


class Truth(NamedTuple):
    """What is so: joint positions (m,), tool pose (4, 4), and the wrench (6,) on the tool in the base frame."""

    q: Array
    pose: Array
    wrench: Array


def force_at(force: Array, point: Array) -> Array:
    """(6,) wrench of a force (3,) along the line through a point (3,)."""
    return np.concatenate((se3.cross(point, force), force))
