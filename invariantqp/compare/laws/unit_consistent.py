"""The unit-consistent inverse: scale rows and columns to geometric mean one, invert as Moore-Penrose does, scale back.

    J^-U = E (D J E)^+ D,     sum_j log|(DJE)_ij| = 0 = sum_i log|(DJE)_ij|  over the entries that are not zero

(D J E)^-U = E^-1 J^-U D^-1 for every positive diagonal D, E: no unit enters. The frame does, because the size of a
single entry is not the same in another.

Reference: Uhlmann 2018, A generalized matrix inverse that is consistent with respect to diagonal transformations;
Zhang & Uhlmann 2018, for robots.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array

# An entry below this fraction of the largest of its row or of its column is a rounded zero.
ZERO = 1e-12


def scaling(J: Array) -> tuple[Array, Array]:
    """The diagonals d (n,) and e (m,) that give every row and column of |J| geometric mean one."""
    n, m = J.shape
    size = np.abs(J)
    there = (size > ZERO * size.max(axis=1, keepdims=True)) & (size > ZERO * size.max(axis=0, keepdims=True))
    logs = np.log(size, where=there, out=np.zeros_like(size))
    # The normal equations of  min sum (log|J_ij| + u_i + w_j)^2: the graph Laplacian of the nonzero entries.
    laplacian = np.block([[np.diag(there.sum(axis=1)), there], [there.T, np.diag(there.sum(axis=0))]]).astype(float)
    sums = np.concatenate((logs.sum(axis=1), logs.sum(axis=0)))
    u = -np.linalg.lstsq(laplacian, sums, rcond=None)[0]
    return np.exp(u[:n]), np.exp(u[n : n + m])


def unit_consistent_inverse(J: Array) -> Array:
    """J^-U (m, n) of (n, m) J."""
    d, e = scaling(J)
    return np.asarray(e[:, None] * np.linalg.pinv(d[:, None] * J * e) * d)
