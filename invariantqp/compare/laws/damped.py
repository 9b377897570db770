"""Methods that keep joint speeds bounded near a singularity, clipped to the limits: damped least squares and others.

damped least squares   x = J'(JJ' + lambda^2 I)^-1 s
Nakamura & Hanafusa    lambda^2 = lambda_0^2 (1 - w / w_0)^2 for w < w_0,   w = sqrt(det JJ')
Chiaverini             lambda^2 = lambda_max^2 (1 - (sigma_r / epsilon)^2) for sigma_r < epsilon, along u_r only
Jacobian transpose     x = alpha J's,   alpha = <s, JJ's> / |JJ's|^2
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from invariantqp.compare.laws.sdls import sdls_step
from invariantqp.compare.method import Method, Setting, Solve
from invariantqp.compare.names import DLS, SDLS
from invariantqp.geometry.arrays import Array

# lambda as scripts choose it, in mixed units of J; also lambda_0 and lambda_max of the adaptive methods.
DLS_DAMPING = 0.05
# w_0: Nakamura and Hanafusa's damping starts below this manipulability, a small part of that of arms of about a metre.
MANIPULABILITY = 0.02
# epsilon: Chiaverini's damping starts when the smallest singular value falls below it.
NEARLY_SINGULAR = 0.04
# A small damping of all other directions in Chiaverini's method, for states in which the rank falls by two.
ISOTROPIC = 1e-3


def _damped(J: Array, s: Array, squared: float) -> Array:
    """J'(JJ' + lambda^2 I)^-1 s by Cholesky, or by the pseudoinverse if JJ' + lambda^2 I is singular to rounding."""
    _, y, info = lapack.dposv(J.dot(J.T) + squared * np.eye(6), s)
    if info != 0:
        return np.asarray(np.linalg.pinv(J).dot(s))
    return np.asarray(y.dot(J))


def _dls(_: Setting) -> Solve:
    return lambda J, s, _lower, _upper: _damped(J, s, DLS_DAMPING**2)


def _nakamura_hanafusa(setting: Setting) -> Solve:
    wide = setting.m >= 6

    def velocity(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
        # With fewer than six joints JJ' is always singular, and det J'J is zero at a singularity.
        w = np.sqrt(max(0.0, float(np.linalg.det(J.dot(J.T) if wide else J.T.dot(J)))))
        squared = (DLS_DAMPING * max(0.0, 1.0 - w / MANIPULABILITY)) ** 2
        if wide or squared > 0.0:
            return _damped(J, s, squared)
        return np.asarray(np.linalg.pinv(J).dot(s))

    return velocity


def _chiaverini(_: Setting) -> Solve:
    def velocity(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        divisor = sigma * sigma
        if sigma[-1] < NEARLY_SINGULAR:
            divisor = divisor + ISOTROPIC**2
            divisor[-1] += DLS_DAMPING**2 * (1.0 - (sigma[-1] / NEARLY_SINGULAR) ** 2)
        return np.asarray((U.T.dot(s) * sigma / divisor).dot(Vt))

    return velocity


def _transpose(_: Setting) -> Solve:
    def velocity(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
        x = s.dot(J)
        moved = J.dot(x)
        size = float(moved.dot(moved))
        return np.asarray(x * (float(s.dot(moved)) / size) if size > 0.0 else x)

    return velocity


def _sdls(setting: Setting) -> Solve:
    dt = setting.dt  # SDLS is about joint angles: those of one tick
    return lambda J, s, _lower, _upper: sdls_step(J, dt * s) / dt


METHODS = [
    Method(
        name=DLS,
        family="damped",
        limits="clipped",
        why="damped least squares with lambda = 0.05 (Wampler 1986; Nakamura & Hanafusa 1986)",
        make=_dls,
        problem="damped",
        limited="damped box",
        group="DLS",
    ),
    Method(
        name="DLS, manipulability",
        family="damped",
        limits="clipped",
        why="damped least squares with more damping the further sqrt(det JJ') is below 0.02 (Nakamura & Hanafusa 1986)",
        make=_nakamura_hanafusa,
        limited="damped box",
        group="DLS",
    ),
    Method(
        name="DLS, filtered",
        family="damped",
        limits="clipped",
        why="damping in the direction of the smallest singular value, if it is below 0.04 (Chiaverini 1997)",
        make=_chiaverini,
        limited="damped box",
        group="DLS",
    ),
    Method(
        name="Jacobian transpose",
        family="damped",
        limits="clipped",
        why="alpha J's with the alpha that brings the twist closest to s (Balestrino et al. 1984; Buss 2004)",
        make=_transpose,
    ),
    Method(
        name=SDLS,
        family="damped",
        limits="clipped",
        why="selectively damped least squares (Buss & Kim 2005)",
        make=_sdls,
    ),
]
