"""The unit-consistent inverse: the Moore-Penrose inverse of a matrix whose rows and columns are scaled first.

    J^-U = E (D J E)^+ D,     sum_j log|(DJE)_ij| = 0 = sum_i log|(DJE)_ij|  over the entries that are not zero

The diagonal D and E give every row and column the geometric mean 1. Then (A J B)^-U = B^-1 J^-U A^-1 for all positive
diagonal A and B: the answer does not depend on units. It does depend on the frame.

Reference: Uhlmann 2018, A generalized matrix inverse that is consistent with respect to diagonal transformations;
Zhang & Uhlmann 2018, for robots.
"""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array

# An entry below this fraction of the largest of its row or column counts as zero.
ZERO = 1e-12


def scaling(J: Array) -> tuple[Array, Array]:
    """The diagonals (n,) of D and (m,) of E, with which every row and column of |DJE| has the geometric mean 1."""
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
    """(m, n) unit-consistent inverse of J (n, m)."""
    d, e = scaling(J)
    return np.asarray(e[:, None] * np.linalg.pinv(d[:, None] * J * e) * d)
