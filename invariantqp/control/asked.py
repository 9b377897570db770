"""What of a twist is asked of an arm: its exact rows, or what its joints can do, or all of it.

|R s|     the size, in the measure, of the part of a twist s that the arm is to do
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.demands import View, rows_of
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Sighting
from invariantqp.systems.span import TINY
from invariantqp.velocity.exact import ExactRows

# Rows of the twist that are dependent but for this share are one.
ROW_RATIO = 1e-10


def asked(controller: Controller, sighting: Sighting, root: Array) -> Array:
    """(k, 6) R, orthonormal rows in the measure.

    With exact demands it is their part of the twist; the rest is least squares, and may stray. Fewer than six joints
    are asked for the twists that they can do.

    Args:
        controller: with the demands.
        sighting: the arm now.
        root: (6, 6) of the measure.
    """
    if controller.exact:
        view = View(controller.robot, sighting, sighting.pose, 0.0, np.zeros(6))
        return measured_rows(rows_of(controller.exact, view), root).rows
    if sighting.J.shape[1] >= 6:
        return root
    # All of them, however weak: at the edge of its reach an arm is still asked to go on.
    R: Array = np.linalg.svd(root.dot(sighting.J), full_matrices=False)[0].T.dot(root)
    return R


def asked_part(rows: Array, root: Array) -> Array:
    """(6, 6) the projector on the part of a twist that orthonormal rows (k, 6) ask for; the rest is orthogonal to it.

    Args:
        rows: from `asked`.
        root: (6, 6) of the measure.
    """
    part: Array = np.linalg.solve(root, np.linalg.solve(root.T, rows.T)).dot(rows)
    return part


class MeasuredRows(NamedTuple):
    """The part of a twist that exact rows ask for.

    Attributes:
        rows: (k, 6) R, orthonormal in the measure.
        back: (6, k) with R back = 1, orthogonal to the rest of the twist: back R is the projector on that part.
        weights: (n, k) what demands d of the n rows ask for is d.weights, along R.
    """

    rows: Array
    back: Array
    weights: Array


def measured_rows(rows: ExactRows, root: Array) -> MeasuredRows:
    """What exact rows ask for; joint rows ask for nothing."""
    D, inverse = rows.of_twist, np.linalg.inv(root)
    if D is None:
        return MeasuredRows(np.zeros((0, 6)), np.zeros((6, 0)), np.zeros((len(rows.b), 0)))
    U, sigma, Vt = np.linalg.svd(D.dot(inverse), full_matrices=False)
    k = np.count_nonzero(sigma > ROW_RATIO * max(float(sigma[0]), TINY))
    V = Vt[:k]
    return MeasuredRows(V.dot(root), inverse.dot(V.T), U[:, :k] / sigma[:k])
