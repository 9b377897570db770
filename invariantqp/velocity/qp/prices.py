"""What each active limit costs: the multipliers of minimise 1/2 z'Hz - c'z over lower <= A z <= upper.

    H z - c + A'y = 0,     y > 0 at an upper limit, y < 0 at a lower one, 0 inside

Loosening limit i by e improves the objective by |y_i| e. Found from the optimum, so that every solver gives the same.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits.rows import Polytope

# A limit this close, relative to its value (or 1), is at it: interior-point solvers stop that far inside.
ACTIVE_TOLERANCE = 1e-6


def prices(H: Array, c: Array, z: Array, limits: Polytope) -> Array:
    """(k,) the multipliers at the optimum z (n,)."""
    value = limits.value(z)
    pull = c - H.dot(z)
    margin = ACTIVE_TOLERANCE * np.maximum(1.0, np.abs(value))
    above, below = value >= limits.upper - margin, value <= limits.lower + margin
    if limits.A is None:
        return np.where(above | below, pull, 0.0)
    from scipy.optimize import nnls

    at = np.concatenate((np.flatnonzero(above), np.flatnonzero(below)))
    sign = np.concatenate((np.ones(int(above.sum())), -np.ones(int(below.sum()))))
    y = np.zeros(len(value))
    if len(at) and len(z):
        normals = (limits.A[at] * sign[:, None]).T
        try:
            share, _ = nnls(normals, pull)
        except RuntimeError:  # it may count its iterations out; the sign is then the solver's word alone
            share = np.linalg.lstsq(normals, pull, rcond=None)[0]
        np.add.at(y, at, sign * share)
    return y
