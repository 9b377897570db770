"""The least |K d| on a set of active limits, by orthogonal factors of the root K, and its multipliers.

K'K d + A'y = 0,   y > 0 at an upper limit, y < 0 at a lower one: loosening limit i by e improves the objective by
|y_i| e
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array
from invariantqp.velocity.qp.scaling import ROW_TOLERANCE

Sides = NDArray[np.intp]

# A multiplier of the wrong sign by less than this share of the largest is rounding.
WRONG_SIGN = 1e-9


def least(K: Array, wanted: Array) -> Array:
    """The z of least |K z - wanted|, K (k, n) of full column rank."""
    if K.shape[1] == 0:
        return np.empty(0)
    _, z, info = lapack.dgels(K, wanted)
    if info != 0:
        raise np.linalg.LinAlgError(f"dgels returned {info}")
    found: Array = z[: K.shape[1]]
    return found


def factored(A: Array) -> tuple[Array, Array]:
    """Q (n, n) orthonormal and R (k, k) upper triangular with A = Q[:, :k] R, A (n, k), k <= n.

    Only the upper triangle of R is R; LAPACK's own calls, since NumPy's take three times as long at this size.
    """
    n, k = A.shape
    packed, tau, _, _ = lapack.dgeqrf(A)
    whole = np.zeros((n, n), order="F")
    whole[:, :k] = packed
    Q, _, _ = lapack.dorgqr(whole, tau)
    return Q, packed[:k]


def on_active(K: Array, A: Array | None, lower: Array, upper: Array, side: Sides) -> tuple[Array, Array]:
    """The d of least |K d| on the active limits, and the multipliers (r,).

    Args:
        K: (k, n) root.
        A: (r, n) rows, or None for the identity.
        lower: (r,).
        upper: (r,).
        side: (r,) 1 for limits active above, -1 for those below, 0 for the others.

    Raises:
        numpy.linalg.LinAlgError: the active rows depend on each other.
    """
    at = np.flatnonzero(side)
    bound = np.where(side[at] > 0, upper[at], lower[at])
    d, y = _boxed(K, at, bound) if A is None else _rowed(K, A[at], bound)
    multipliers = np.zeros(len(side))
    multipliers[at] = y
    return d, multipliers


def _boxed(K: Array, at: Sides, bound: Array) -> tuple[Array, Array]:
    n = K.shape[1]
    d = np.zeros(n)
    if not len(at):
        return d, bound
    d[at] = bound
    free = np.ones(n, dtype=bool)
    free[at] = False
    d[free] = least(K[:, free], -K[:, at].dot(bound))
    return d, -K.dot(d).dot(K[:, at])


def _rowed(K: Array, A: Array, bound: Array) -> tuple[Array, Array]:
    k, n = A.shape
    if k > n:
        raise np.linalg.LinAlgError("more active rows than unknowns")
    if k == 0:
        return np.zeros(n), bound
    Q, R = factored(A.T)
    size = np.abs(R.diagonal())
    if size.min() <= ROW_TOLERANCE * size.max():
        raise np.linalg.LinAlgError("active rows depend on each other")
    w, _ = lapack.dtrtrs(R, bound, trans=1)
    fixed = Q[:, :k].dot(w)
    d = fixed + Q[:, k:].dot(least(K.dot(Q[:, k:]), -K.dot(fixed)))
    y, _ = lapack.dtrtrs(R, -K.dot(d).dot(K).dot(Q[:, :k]))
    return d, y
