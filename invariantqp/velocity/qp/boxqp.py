"""A quadratic program in units of its own limits: solvers' tolerances are absolute, and mean something at O(1).

minimise 1/2 z'Hz - c'z   over   lower <= Cz <= upper
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array

# DAQP's stand-in for infinity.
UNBOUNDED = 1e30
# The least unit of a row, beside the median of all: units further apart make the problem ill-conditioned for nothing.
SMALLEST_UNIT = 1e-2


class BoxQP(NamedTuple):
    """Minimise 1/2 z'Hz - c'z over lower <= Cz <= upper; C = None is the identity. All O(1), all bounds finite or None.

    Attributes:
        H: (n, n) positive definite.
        c: (n,).
        lower: (k,) at least -UNBOUNDED.
        upper: (k,) at most UNBOUNDED.
        C: (k, n) rows, or None.
    """

    H: Array
    c: Array
    lower: Array
    upper: Array
    C: Array | None


def scaled(H: Array, c: Array, lower: Array, upper: Array, rows: Array | None) -> tuple[BoxQP, Array]:
    """The same problem in units of its own limits, and the factors (n,) that take its answer back."""
    reach = np.maximum(-lower, upper)
    if rows is not None or reach.max() >= UNBOUNDED or reach.min() <= 0.0:
        # Where a side is open, the other one tells the size; a joint without limits, or held at zero, keeps its unit.
        sides = np.abs(np.stack((lower, upper)))
        reach = np.where(sides < UNBOUNDED, sides, 0.0).max(axis=0)
        reach[reach == 0.0] = 1.0
        if rows is not None:  # a side that is all but zero says nothing of how fast the joints are
            length = np.linalg.norm(rows, axis=1)
            length[length == 0.0] = 1.0
            reach = np.maximum(reach, SMALLEST_UNIT * float(np.median(reach / length)) * length)
        lower, upper = np.maximum(lower, -UNBOUNDED * reach), np.minimum(upper, UNBOUNDED * reach)
    if rows is None:
        unit, C = reach, None
    else:
        C = rows / reach[:, None]
        steepest = np.abs(C).max(axis=0)
        unit = 1.0 / np.where(steepest > 0.0, steepest, 1.0)
        C = C * unit
    H = (H * unit).T * unit
    size = H.max()  # of a positive-definite matrix: on its diagonal
    return BoxQP(H / size, c * unit / size, lower / reach, upper / reach, C), unit
