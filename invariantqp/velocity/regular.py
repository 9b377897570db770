"""Where the joints can move the tool in all six directions, far from singular: one Cholesky factor is enough.

    x = x_p + A'(AA')^-1 (b - A x_p)          the twist is met, and every form and metric agree on it

The general computation gives the same x where nothing is damped, so two bounds decide that without singular values:

    sigma_min^2 >= 1 / |(AA')^-1|,      sigma_max^2 <= |AA'|
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from scipy.linalg import lapack

from invariantqp.geometry.arrays import Array

# Smallest over largest singular value above which the normal equations keep twelve digits.
ACCURATE_SHARE = 1e-2


def regular_velocity(A: Array, b: Array, posture: Array | None, threshold: float) -> Array | None:
    """The velocity (n,) that meets the twist nearest to the posture; None where damping might act.

    Args:
        A: (6, n) measured joint twists.
        b: (6,) measured twist.
        posture: (n,), or None for zero.
        threshold: the share of the largest singular value above which nothing is damped.
    """
    if A.shape[1] < 6:
        return None
    S = A.dot(A.T)
    factor, info = lapack.dpotrf(S)
    if info != 0:
        return None
    # trace (AA')^-1 = |U^-1|_F^2 bounds its norm. Not dpotri: OpenBLAS gives that to all its threads whatever the size,
    # and six rows then wait milliseconds for a busy core.
    inverse, _ = lapack.dtrtri(factor)
    smallest, largest = 1.0 / float(np.vdot(inverse, inverse)), sqrt(float(np.vdot(S, S)))
    if smallest < max(threshold, ACCURATE_SHARE) ** 2 * largest:  # also for NaN and infinity
        return None
    y, _ = lapack.dpotrs(factor, b if posture is None else b - A.dot(posture))
    x: Array = y.dot(A)
    return x if posture is None else posture + x
