"""A quadratic program in units of its own limits: solvers' tolerances are absolute, and mean something at O(1).

minimise 1/2 d'Hd   over   lower <= C d <= upper,   d the step from the optimum without limits
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array

# Stand-in for infinity in the scaled problem.
UNBOUNDED = 1e30


class BoxQP(NamedTuple):
    """Minimise 1/2 z'Hz - c'z over lower <= Cz <= upper; C = None is the identity. All O(1).

    Attributes:
        H: (n, n) positive definite.
        c: (n,).
        lower: (k,) at least -1e30, which stands for no limit.
        upper: (k,) at most 1e30.
        C: (k, n) rows, or None.
    """

    H: Array
    c: Array
    lower: Array
    upper: Array
    C: Array | None


class Scaled(NamedTuple):
    """A problem in its own units: d = size z for its answer z."""

    qp: BoxQP
    size: float


def scaled(K: Array, A: Array | None, length: Array, lower: Array, upper: Array) -> Scaled:
    """1/2 |K d|^2 inside lower <= A d <= upper, where d = 0 is outside, in units of how far outside it is.

    K (n, n) is a root, A (r, n) rows or None for the identity, `length` (r,) that of the rows, none zero.
    """
    low, high = lower / length, upper / length
    size = float(np.maximum(low, -high).max(initial=0.0)) or 1.0
    H = K.T.dot(K)
    C = None if A is None else A / length[:, None]
    low, high = np.maximum(low / size, -UNBOUNDED), np.minimum(high / size, UNBOUNDED)
    return Scaled(BoxQP(H / H.diagonal().max(), np.zeros(K.shape[1]), low, high, C), size)
