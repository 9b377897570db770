"""The rows of a batch that need no QP: the same decisions as in one tick, on (N, ...) arrays.

    m >= 6, far from singular    x = x_p + A'(AA')^-1 (b - A x_p)
    otherwise                    singular values                           (`objective`)

Rows with an active limit, with damping, or whose form matters are not solved here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array
from invariantqp.systems.centre import ROUNDING
from invariantqp.systems.span import LENGTH_LIMIT
from invariantqp.velocity.damping import Adaptive, Fixed
from invariantqp.velocity.law import VelocityLaw
from invariantqp.velocity.measure import length_at, own_point
from invariantqp.velocity.objective import NULL_RATIO
from invariantqp.velocity.report import MET_TOLERANCE, MISSED, PROGRESS_SHARE
from invariantqp.velocity.solution import at_bounds

Mask = NDArray[np.bool_]

# det of |w|^2 I - ww' over its trace cubed (at most 1/27): above this a row's own point is found by one linear solve.
WELL_POSED = 1e-4
# A Cholesky factor is as accurate as singular values where the smallest of them is no less than this share.
ACCURATE_SHARE = 1e-2


def free_rows(
    law: VelocityLaw, A: Array, b: Array, box: tuple[Array, Array], posture: Array | None
) -> tuple[Mask, Array]:
    """Which rows are solved (N,), and their velocities (N, m); zero elsewhere.

    In the measure: joint twists A (N, 6, m), twists b (N, 6); lower and upper bounds and the posture, (N, m) each.
    """
    n, _, m = A.shape
    done, x = np.zeros(n, dtype=bool), np.zeros((n, m))
    if n == 0 or law.metric is not None or not isinstance(law.damping, (Adaptive, Fixed)):
        return done, x
    if m >= 6:
        certain, found = _regular(A, b, posture, law.damping.threshold)
        met = certain & inside(found, box) & _achieved(A, b, found)
        done[met], x[met] = True, found[met]
    rest = ~done
    if law.form is None and rest.any():
        lower, upper = box
        part = posture if posture is None else posture[rest]
        settled, found = _spectral(law.damping, A[rest], b[rest], part)
        settled &= inside(found, (lower[rest], upper[rest])) & ~at_bounds(found, lower[rest], upper[rest]).any(axis=1)
        found[~settled] = 0.0
        done[rest], x[rest] = settled, found
    return done, x


def inside(x: Array, box: tuple[Array, Array]) -> Mask:
    """Whether clipping a row changes no bit."""
    clipped = np.minimum(np.maximum(x, box[0]), box[1])
    return np.asarray((clipped.view(np.int64) == np.ascontiguousarray(x).view(np.int64)).all(axis=1))


def measures(J: Array, s: Array, point: Array | None, length: float | None) -> Array:
    """(N, 6, 6) roots of diag(L^2 I, I) at a point (3,) or (N, 3), or at each row's own point; L is its reach."""
    n = len(J)
    same = point is not None and length is not None and point.strides[0] == 0  # one point, as broadcast to all rows
    p = _own_points(J, s) if point is None else np.broadcast_to(point, (n, 3))[: 1 if same else n]
    L = _reaches(J, s, p) if length is None else np.full(len(p), length)
    roots = np.zeros((len(p), 6, 6))
    for i in range(3):
        roots[:, i, i], roots[:, i + 3, i + 3] = L, 1.0
        j, k = (i + 1) % 3, (i + 2) % 3
        roots[:, j + 3, k], roots[:, k + 3, j] = p[:, i], -p[:, i]
    return np.broadcast_to(roots, (n, 6, 6))


def _own_points(J: Array, s: Array) -> Array:
    """`own_point` for all rows."""
    w, v = J[:, :3], J[:, 3:]
    b = np.cross(w, v, axis=1).sum(axis=2)
    spread = np.matmul(w, w.transpose(0, 2, 1))
    trace = np.trace(spread, axis1=1, axis2=2)
    S = trace[:, None, None] * np.eye(3) - spread
    slow = (v * v).sum(axis=(1, 2)) <= trace * LENGTH_LIMIT**2
    certain: Mask = np.asarray(np.linalg.det(S) > WELL_POSED * (2.0 * trace) ** 3) & slow
    S[~certain] = np.eye(3)
    points: Array = np.linalg.solve(S, b[:, :, None])[:, :, 0]
    for i in np.flatnonzero(~certain).tolist():
        points[i] = own_point(J[i], s[i])
    return points


def _reaches(J: Array, s: Array, points: Array) -> Array:
    """`length_at` for all rows: the broken line from the point to its foot on each turning axis, the last one first."""
    n, _, m = J.shape
    here, length, size = points.copy(), np.zeros(n), np.sqrt((points * points).sum(axis=1))
    for column in range(m - 1, -1, -1):
        turn, moment = J[:, :3, column], J[:, 3:, column]
        rate, far = np.sqrt((turn * turn).sum(axis=1)), np.sqrt((moment * moment).sum(axis=1))
        turns = rate * LENGTH_LIMIT > far
        rate = np.where(turns, rate, 1.0)[:, None]
        leg = np.where(turns[:, None], np.cross(turn, moment / rate + np.cross(turn / rate, here)) / rate, 0.0)
        here = here + leg
        length += np.sqrt((leg * leg).sum(axis=1))
        size = np.where(turns, np.maximum(size, far / rate[:, 0]), size)
    for i in np.flatnonzero(length <= ROUNDING * size).tolist():
        length[i] = length_at(J[i], points[i], s[i])
    return length


def _dot(A: Array, x: Array) -> Array:
    return np.asarray(np.matmul(A, x[:, :, None])[:, :, 0])


def _achieved(A: Array, b: Array, x: Array) -> Mask:
    left = b - _dot(A, x)
    return np.asarray((left * left).sum(axis=1) <= MET_TOLERANCE**2 * (b * b).sum(axis=1))


def _regular(A: Array, b: Array, posture: Array | None, threshold: float) -> tuple[Mask, Array]:
    """Which rows are far from singular, and their velocities."""
    n, _, m = A.shape
    S = np.matmul(A, A.transpose(0, 2, 1))
    certain = np.isfinite(S).all(axis=(1, 2))
    S[~certain] = np.eye(6)
    try:
        factor = np.linalg.cholesky(S)
    except np.linalg.LinAlgError:  # one is singular: the others still have their factors
        certain &= np.linalg.eigvalsh(S)[:, 0] > 0.0
        S[~certain] = np.eye(6)
        try:
            factor = np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            return np.zeros(n, dtype=bool), np.zeros((n, m))
    inverse = np.asarray(np.linalg.inv(factor), dtype=np.float64)
    smallest, largest = 1.0 / (inverse * inverse).sum(axis=(1, 2)), np.sqrt((S * S).sum(axis=(1, 2)))
    certain &= smallest >= max(threshold, ACCURATE_SHARE) ** 2 * largest
    wanted = b if posture is None else b - _dot(A, posture)
    x = _dot(A.transpose(0, 2, 1), _dot(inverse.transpose(0, 2, 1), _dot(inverse, wanted)))
    return certain, x if posture is None else posture + x


def _spectral(damping: Adaptive | Fixed, A: Array, b: Array, posture: Array | None) -> tuple[Mask, Array]:
    """`least_squares` for all rows, and which of them are not damped and "ok"."""
    n, _, m = A.shape
    good: Mask = np.asarray(np.isfinite(A).all(axis=(1, 2)) & np.isfinite(b).all(axis=1))
    U, singular, Vt = np.linalg.svd(np.where(good[:, None, None], A, 0.0))
    k = singular.shape[1]
    largest = singular[:, :1]
    wanted = _dot(U.transpose(0, 2, 1), b)[:, :k]
    null = singular <= NULL_RATIO * largest
    threshold = damping.threshold
    good &= largest[:, 0] > 0.0
    good &= (null | (singular >= threshold * largest)).all(axis=1)
    seen = np.zeros((n, m))
    seen[:, :k] = np.where(null, 0.0, wanted) / np.where(null, 1.0, singular)
    if posture is not None:
        towards = _dot(Vt, posture)
        towards[:, :k] *= null
        seen += towards
    x = _dot(Vt.transpose(0, 2, 1), seen)
    achieved = (np.where(null, 0.0, wanted) ** 2).sum(axis=1)
    # What fewer than six joints cannot do, none of them misses; but they are not to rest short of it.
    least = PROGRESS_SHARE if m < 6 else 1.0 - MISSED**2
    good &= achieved >= least * (b * b).sum(axis=1)
    return good, x
