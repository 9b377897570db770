"""Moore-Penrose and its relatives: what scripts write, and what was made of it to respect units or limits.

x = J^+ s  by pinv, by the SVD, by the normal equations J'(JJ')^-1 s
"""

from __future__ import annotations

import numpy as np

from invariantqp.compare.methods import Method, Setting, Solve
from invariantqp.geometry.arrays import Array


def pinv_rule(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
    """J^+ s by numpy.linalg.pinv."""
    return np.asarray(np.linalg.pinv(J).dot(s))


def _pinv(_: Setting) -> Solve:
    return pinv_rule


METHODS = [
    Method(
        name="Moore-Penrose, pinv",
        family="Moore-Penrose",
        limits="clipped",
        why="J^+ s by numpy.linalg.pinv, the line most scripts have (Whitney 1969)",
        make=_pinv,
        problem="least squares",
        limited="least squares box",
        group="Moore-Penrose",
    ),
]
