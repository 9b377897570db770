"""Damped least squares, fixed and adaptive, and what else bounds joint speeds near a singularity; all are clipped.

x = J'(JJ' + lambda^2 I)^-1 s
"""

from __future__ import annotations

import numpy as np

from invariantqp.compare.methods import Method, Setting, Solve
from invariantqp.compare.sdls import sdls_step

# The textbook damping of a script, in its own mixed units.
DLS_DAMPING = 0.05


def _dls(_: Setting) -> Solve:
    shift = DLS_DAMPING**2 * np.eye(6)
    return lambda J, s, _lower, _upper: np.asarray(J.T.dot(np.linalg.solve(J.dot(J.T) + shift, s)))


def _sdls(setting: Setting) -> Solve:
    dt = setting.dt  # it thinks in the angles of one tick
    return lambda J, s, _lower, _upper: sdls_step(J, dt * s) / dt


METHODS = [
    Method(
        name="DLS",
        family="damped",
        limits="clipped",
        why="damped least squares with lambda = 0.05 (Wampler 1986; Nakamura & Hanafusa 1986)",
        make=_dls,
        problem="damped",
        limited="damped box",
    ),
    Method(
        name="SDLS",
        family="damped",
        limits="clipped",
        why="selectively damped least squares (Buss & Kim 2005)",
        make=_sdls,
    ),
]
