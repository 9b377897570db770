"""Least squares inside the limits, and the invariant law's own convex QP by each solver, with no second one behind it.

minimise 1/2 |s - Jx|^2 + mu/2 |x|^2      and      minimise 1/2 x'Hx - c'x,    lower <= x <= upper
"""

from __future__ import annotations

import numpy as np

from invariantqp.compare.methods import Method, Setting, Solve
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.backends import Daqp, minimise
from invariantqp.velocity.rows import Polytope

# What keeps J'J positive definite in a least-squares QP, as scripts and Pink's users choose it.
QP_DAMPING = 1e-6


def _least_squares(setting: Setting) -> Solve:
    ridge, daqp = QP_DAMPING * np.eye(setting.m), Daqp()

    def velocity(J: Array, s: Array, lower: Array, upper: Array) -> Array:
        return minimise(daqp, J.T.dot(J) + ridge, J.T.dot(s), Polytope(None, lower, upper)).z

    return velocity


METHODS = [
    Method(
        name="least-squares QP",
        family="QP",
        limits="inside",
        why="least squares inside the limits with mu = 1e-6, by DAQP: what Pink and scripts solve",
        make=_least_squares,
        problem="least squares",
        limited="least squares box",
    ),
]
