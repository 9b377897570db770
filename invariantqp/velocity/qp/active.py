"""The shortest e on a set of active limits, N_a e = b_a, and their multipliers: a least-distance problem.

e + N_a'y = 0,   y > 0 at an upper limit, y < 0 at a lower one: loosening limit i by d improves the objective by |y_i| d
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array

Sides = NDArray[np.intp]

# A multiplier of the wrong sign by less than this share of |pull| / |N_i| is rounding.
WRONG_SIGN = 1e-13
# An active row that leaves less than this share of the longest beside the others depends on them.
DEPENDENT = 1e-12


class Face(NamedTuple):
    """The e with N_a e = b_a."""

    at: Sides  # (k,) the active limits
    above: NDArray[np.bool_]  # (k,) whether they are upper ones
    Q: Array  # (n, k) orthonormal
    R: Array  # (k, k) upper triangular (what is below the diagonal means nothing), N_a' = Q R
    e: Array  # (n,) the shortest e

    def shortest(self, b: Array) -> Array:
        """(n,) the shortest e with N_a e = b (k,)."""
        return _shortest(self.Q, self.R, b)

    def along(self, M: Array) -> Array:
        """(..., n) rows of M (..., n) without their parts that would move an active limit."""
        if len(self.at) == len(self.e):
            return np.zeros_like(M)
        free = M
        for _ in range(2 if len(self.at) else 0):  # twice, since the first time leaves rounding of M
            free = free - free.dot(self.Q).dot(self.Q.T)
        return free

    def multipliers(self, pull: Array) -> Array:
        """(k,) y with pull + N_a'y = 0."""
        y: Array = lapack.dtrtrs(self.R, -pull.dot(self.Q))[0] if len(self.at) else np.empty(0)
        return y

    def spread(self, y: Array, count: int) -> Array:
        """(count,) multipliers (k,) of the active limits among all, zero for the others."""
        every = np.zeros(count)
        every[self.at] = y
        return every


def face_of(N: Array, lower: Array, upper: Array, side: Sides) -> Face:
    """The face of limits on N (r, n) that are active: side 1 for those above, -1 for those below, 0 for the others.

    Raises:
        numpy.linalg.LinAlgError: the active rows depend on each other.
    """
    n = N.shape[1]
    at = side.nonzero()[0]
    k = len(at)
    if k == 0:
        return Face(at, np.empty(0, dtype=bool), np.empty((n, 0)), np.empty((0, 0)), np.zeros(n))
    if k > n:
        raise np.linalg.LinAlgError("more active rows than unknowns")
    # The last direction first: it counts least, so its entries of N are the largest. A QR that meets large ones after
    # small ones loses digits of the small ones (Powell & Reid 1969).
    packed, tau, _, _ = lapack.dgeqrf(N[at, ::-1].T)
    R = packed[:k]
    sizes = [abs(size) for size in R.diagonal().tolist()]
    if min(sizes) <= DEPENDENT * max(sizes):
        raise np.linalg.LinAlgError("active rows depend on each other")
    Q = lapack.dorgqr(packed, tau)[0][::-1]
    above = side[at] > 0
    return Face(at, above, Q, R, _shortest(Q, R, np.where(above, upper[at], lower[at])))


def _shortest(Q: Array, R: Array, b: Array) -> Array:
    """(n,) the shortest e with R'Q'e = b (k,)."""
    e: Array = Q.dot(lapack.dtrtrs(R, b, trans=1)[0])
    return e


def weakest(N: Array, face: Face, pull: Array, y: Array, *, late: bool = False) -> int:
    """The active limit whose multiplier, of (k,) y, has the wrong sign by most; -1 for none.

    Late in a search the first one is taken (Bland's rule), so that no active set repeats.
    """
    wrong = [-v if up else v for v, up in zip(y.tolist(), face.above.tolist(), strict=True)]
    if max(wrong, default=0.0) <= 0.0:
        return -1
    rows, size = N[face.at], WRONG_SIGN * sqrt(float(pull.dot(pull)))
    lengths = np.sqrt((rows * rows).sum(axis=1)).tolist()
    found = [i for i, v in enumerate(wrong) if v * lengths[i] > size]
    if not found:
        return -1
    return int(face.at[found[0] if late else max(found, key=wrong.__getitem__)])
