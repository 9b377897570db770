"""Rank and orthogonal complement; arguments are not checked."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array

# The smallest positive normal number, a lower bound of divisors.
TINY = float(np.finfo(float).tiny)


def orthogonal(columns: Array) -> Array:
    """An orthonormal basis (n, n - k) of the orthogonal complement of independent columns (n, k), 0 <= k <= n."""
    Q: Array = np.linalg.qr(columns, mode="complete")[0]
    return Q[:, columns.shape[1] :]


def rank_of(sigma: NDArray[np.floating[Any]], tolerance: float) -> int:
    """The number of singular values (descending) above `tolerance` times the largest."""
    return int(np.count_nonzero(sigma > tolerance * max(float(sigma.max(initial=0.0)), TINY)))
