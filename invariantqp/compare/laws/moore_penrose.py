"""The Moore-Penrose inverse and its variants for joint ranges, units and limits.

Moore-Penrose   J^+ s  by pinv, by the SVD, or by the normal equations J'(JJ')^-1 s or (J'J)^-1 J's
weighted        W^-1 J'(J W^-1 J')^-1 s,   W = diag(1 / reach^2)
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from invariantqp.compare.laws.saturation import saturate
from invariantqp.compare.laws.unit_consistent import unit_consistent_inverse
from invariantqp.compare.method import Method, Setting, Solve
from invariantqp.compare.names import LU, PINV, SNS, SVD
from invariantqp.geometry.arrays import Array

# A singular value below this fraction of the largest counts as zero, as in numpy.linalg.pinv.
SINGULAR = 1e-15


def _pinv(_: Setting) -> Solve:
    return lambda J, s, _lower, _upper: np.asarray(np.linalg.pinv(J).dot(s))


def _svd(_: Setting) -> Solve:
    def velocity(J: Array, s: Array, _lower: Array, _upper: Array) -> Array:
        U, sigma, Vt = np.linalg.svd(J, full_matrices=False)
        kept = sigma > SINGULAR * sigma[0]
        return np.asarray((U.T.dot(s)[kept] / sigma[kept]).dot(Vt[kept]))

    return velocity


def _lu(A: Array, b: Array) -> Array:
    """A^-1 b; raises LinAlgError if a pivot is exactly zero."""
    _, _, x, info = lapack.dgesv(A, b)
    if info != 0:
        raise np.linalg.LinAlgError("singular normal equations")
    return np.asarray(x)


def _normal_equations(setting: Setting) -> Solve:
    if setting.m >= 6:
        return lambda J, s, _lower, _upper: _lu(J.dot(J.T), s).dot(J)
    return lambda J, s, _lower, _upper: _lu(J.T.dot(J), s.dot(J))


def reach_of(lower: Array, upper: Array) -> Array:
    """(m,) half the width of each joint's velocity bounds, the unit of its velocity; 1 without such bounds."""
    half: Array = 0.5 * (upper - lower)
    return np.where(np.isfinite(half) & (half > 0.0), half, 1.0)


def _weighted(setting: Setting) -> Solve:
    plain = _normal_equations(setting)

    def velocity(J: Array, s: Array, lower: Array, upper: Array) -> Array:
        reach = reach_of(lower, upper)
        return reach * plain(J * reach, s, lower, upper)

    return velocity


def _unit_consistent(_: Setting) -> Solve:
    return lambda J, s, _lower, _upper: unit_consistent_inverse(J).dot(s)


def _saturation(_: Setting) -> Solve:
    return lambda J, s, lower, upper: saturate(J, s, lower, upper).velocity


METHODS = [
    Method(
        name=PINV,
        family="Moore-Penrose",
        limits="clipped",
        why="J^+ s by numpy.linalg.pinv, as most scripts write it (Whitney 1969)",
        make=_pinv,
        problem="least squares",
        limited="least squares box",
        group="Moore-Penrose",
    ),
    Method(
        name=SVD,
        family="Moore-Penrose",
        limits="clipped",
        why="J^+ s by the SVD without forming J^+; singular values below 1e-15 of the largest count as zero",
        make=_svd,
        problem="least squares",
        limited="least squares box",
        group="Moore-Penrose",
    ),
    Method(
        name=LU,
        family="Moore-Penrose",
        limits="clipped",
        why="J^+ s by the normal equations and LU, the fastest if J has full rank; it squares cond(J)",
        make=_normal_equations,
        problem="least squares",
        limited="least squares box",
        group="Moore-Penrose",
    ),
    Method(
        name="weighted Moore-Penrose",
        family="Moore-Penrose",
        limits="clipped",
        why="the shortest velocity, with each joint's bound as its unit (Whitney 1969; Chan & Dubey 1995)",
        make=_weighted,
        problem="weighted",
        limited="least squares box",
    ),
    Method(
        name="unit-consistent inverse",
        family="Moore-Penrose",
        limits="clipped",
        why="the inverse that does not depend on the unit of any row or joint (Zhang & Uhlmann 2018)",
        make=_unit_consistent,
    ),
    Method(
        name=SNS,
        family="Moore-Penrose",
        limits="inside",
        why="saturation in the null space: joints stay at their limits and the others make up for them, if they can "
        "(Flacco, De Luca & Khatib 2012)",
        make=_saturation,
        problem="least squares",
        limited="least squares box",
    ),
]
