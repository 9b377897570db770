"""Selectively damped least squares: the step along each singular direction is limited separately.

    theta_i = clamp((u_i.s) / sigma_i v_i, gamma_i),   theta = clamp(sum theta_i, gamma_max)
    N_i = sum_l |u_i|_l,   M_i = 1 / sigma_i sum_j |v_ij| |J_v,j|,   gamma_i = min(1, N_i / M_i) gamma_max

theta are changes of the joint angles in one tick. The sums over end effectors l have two terms here, the position of
the tool and its orientation, with one metre for one radian.

Reference: Buss & Kim 2005, Sect. 3.
"""

from __future__ import annotations

from math import pi

import numpy as np

from invariantqp.geometry.arrays import Array

# gamma_max of the paper: the largest change of a joint angle in one tick [rad].
LARGEST_STEP = pi / 4.0
# A singular value below this fraction of the largest counts as zero, as in numpy.linalg.pinv.
SINGULAR = 1e-15


def sdls_step(J: Array, e: Array) -> Array:
    """The change (m,) of the joint angles in one tick for a wanted displacement e (6,) of the tool in that tick."""
    U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
    linear, angular = np.linalg.norm(J[3:], axis=0), np.linalg.norm(J[:3], axis=0)
    step = np.zeros(J.shape[1])
    for u, size, v in zip(U.T, sigma, Vt, strict=True):
        if size <= SINGULAR * sigma[0]:
            continue
        N = np.linalg.norm(u[:3]) + np.linalg.norm(u[3:])
        M = np.abs(v).dot(linear + angular) / size
        step += _clamped(u.dot(e) / size * v, min(1.0, N / M) * LARGEST_STEP)
    return _clamped(step, LARGEST_STEP)


def _clamped(step: Array, largest: float) -> Array:
    """The step scaled down so that no component exceeds `largest`."""
    size = float(np.abs(step).max())
    return step if size <= largest else step * (largest / size)
