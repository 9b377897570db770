"""A plane that pushes back in proportion to how far a tool is in it: all the world that the hybrid tests need."""

from __future__ import annotations

import numpy as np


def exerted(points, height, stiffness):
    """The wrench (m; f), base frame, that a tool exerts with its corners (n, 3) on the plane z = height."""
    wrench = np.zeros(6)
    for p in points:
        f = np.array([0.0, 0.0, -stiffness * max(0.0, height - p[2])])
        wrench += np.concatenate((np.cross(p, f), f))
    return wrench


def corners(pose, half):
    """The four corners of a square face in the xy-plane of the tool frame."""
    return [pose[:3, :3] @ [x, y, 0.0] + pose[:3, 3] for x in (-half, half) for y in (-half, half)]


def circle(start, radius, period):
    """A target that goes round a horizontal circle from `start`, and its twist, as functions of time."""

    def at(t):
        a = 2 * np.pi * t / period
        T = start.copy()
        T[:3, 3] += [radius * (np.cos(a) - 1.0), radius * np.sin(a), 0.0]
        v = 2 * np.pi / period * radius * np.array([-np.sin(a), np.cos(a), 0.0])
        return T, np.concatenate((np.zeros(3), v))

    return at
