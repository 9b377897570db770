"""The arms of the tests: by name at a start away from limits, and random ones of every kind as joint twists."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import invariantqp as iq
from support.random_systems import motion

# Joint positions away from limits and singularities, with the tool down where six joints or more allow it [rad].
READY = {
    "panda": (0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8),
    "ur5": (0.0, -1.4, 1.6, -1.8, -1.57, 0.0),
    "so101": (0.0, -0.4, 0.5, 0.6, 0.0),
    "gen3": (0.3, 0.3, 0.1, -1.6, 0.2, -1.0, 3.0),
    "xarm7": (0.0, -0.3, 0.0, 1.0, 0.0, 1.3, 0.0),
}
# Acceleration limits of streams [rad/s^2], and jerk limits as multiples of them [1/s].
LIMITS = {"panda": ([15, 7.5, 10, 12.5, 15, 20, 20], 500.0), "ur5": ([8.0] * 6, 50.0), "so101": ([30.0] * 5, 50.0)}
# What each kind is; `arm` makes one with m joints.
KINDS = ("general", "planar", "scara", "parallel", "concurrent", "nearly concurrent", "gantry", "mixed", "repeated")
Z = np.array((0.0, 0.0, 1.0))


def ready(name):
    """(m,) the start of the arm of this name."""
    return np.array(READY[name])


def numerical_twists(robot, q, step=1e-6):
    """(6, m) joint twists from poses alone: log(T(q + d) T(q - d)^-1) / 2d."""
    steps = step * np.eye(len(q))
    return np.array([iq.log(robot.pose(q + d) @ iq.inverse(robot.pose(q - d))) for d in steps]).T / (2.0 * step)


class Arm(NamedTuple):
    """Joint twists J (6, m) in some frame, which joints slide (m,), and a point (3,) of the tool."""

    J: np.ndarray
    slides: np.ndarray
    point: np.ndarray

    def in_frame(self, T):
        """The same arm in another frame."""
        return Arm(iq.adjoint(T) @ self.J, self.slides, T[:3, :3] @ self.point + T[:3, 3])

    def in_units(self, unit):
        """The same arm with lengths in another unit, `unit` of them in one of the old; slides too."""
        lengths = np.repeat((1.0, unit), 3)
        return Arm(lengths[:, None] * self.J / self.joints_in(unit), self.slides, unit * self.point)

    def joints_in(self, unit):
        """(m,) factors from joint velocities to those in the new unit."""
        return np.where(self.slides, unit, 1.0)


def arm(rng, kind, m):
    """A random arm of the kind with m joints, moved by a random rigid motion."""
    slides = np.zeros(m, dtype=bool)
    axes = rng.normal(size=(m, 3))
    points = rng.uniform(-0.7, 0.7, size=(m, 3))
    if kind in {"planar", "scara", "parallel"}:
        axes = np.tile(Z, (m, 1)) * rng.choice((-1.0, 1.0), size=(m, 1))
    if kind == "planar":
        points[:, 2] = 0.0
    if kind == "scara":
        slides[-1] = True
    if kind in {"concurrent", "nearly concurrent"}:
        points[:] = points[0]
        points += 1e-3 * rng.normal(size=(m, 3)) if kind == "nearly concurrent" else 0.0
    if kind == "gantry":
        slides[:] = True
    if kind == "mixed":
        slides[rng.integers(m)] = True
    if kind == "repeated":
        axes[m // 2 :], points[m // 2 :] = axes[0], points[0]
    columns = [
        iq.se3.prismatic(u) if slide else iq.revolute(u, p) for u, p, slide in zip(axes, points, slides, strict=True)
    ]
    return Arm(np.column_stack(columns), slides, rng.uniform(-1.0, 1.0, size=3)).in_frame(motion(rng, 1.0))
