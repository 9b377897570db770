"""The rows of a batch that the closed form settles: twist met or guard content, no limit met, nothing damped.

The same decisions as one tick makes (`regular`, `convexify`, `solve`, `tick`), on (N, ...) arrays; a row in doubt is
not settled here.
"""

from __future__ import annotations

from math import isinf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array
from invariantqp.systems.centre import WELL_POSED
from invariantqp.systems.span import LENGTH_LIMIT
from invariantqp.velocity.damping import SINGULAR_RATIO, Damping, PaperLambda, Selective
from invariantqp.velocity.forms import Complement
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.law import ROUNDING, VelocityLaw
from invariantqp.velocity.qp.prices import ACTIVE_TOLERANCE
from invariantqp.velocity.regular import ACCURATE_RATIO
from invariantqp.velocity.solve import FACTORED_RATIO, MET_TOLERANCE

Mask = NDArray[np.bool_]


def free_rows(
    law: VelocityLaw, J: Array, s: Array, box: tuple[Array, Array], posture: Array | None, *, own_form: bool
) -> tuple[Mask, Array]:
    """Which rows are settled (N,), and the velocities (N, m) of those; zero elsewhere.

    Args:
        law: with the form that all rows share.
        J: (N, 6, m).
        s: (N, 6).
        box: lower and upper bounds, (N, m) each.
        posture: (N, m) or None.
        own_form: whether each row has a form of its own instead of the law's.
    """
    n, _, m = J.shape
    done, x = np.zeros(n, dtype=bool), np.zeros((n, m))
    if n == 0 or isinstance(law.damping, (Selective, PaperLambda)) or isinstance(law.form, Complement):
        return done, x
    if m >= 6 and law.metric is None:
        certain, found = _regular(law, J, s, posture, own_form=own_form)
        met = certain & inside(found, box) & _met(J, s, found)
        done[met], x[met] = True, found[met]
    rest = ~done
    if not own_form and rest.any():
        lower, upper = box
        part = _spectral(law, J[rest], s[rest], (lower[rest], upper[rest]), None if posture is None else posture[rest])
        done[rest], x[rest] = part
    return done, x


def inside(x: Array, box: tuple[Array, Array]) -> Mask:
    """Whether clipping a row changes no bit."""
    clipped = np.minimum(np.maximum(x, box[0]), box[1])
    return np.asarray((clipped.view(np.int64) == x.view(np.int64)).all(axis=1))


def _dot(A: Array, x: Array) -> Array:
    return np.asarray(np.matmul(A, x[:, :, None])[:, :, 0])


def _met(J: Array, s: Array, x: Array) -> Mask:
    residual = s - _dot(J, x)
    return np.asarray((residual * residual).sum(axis=1) <= MET_TOLERANCE**2 * (s * s).sum(axis=1))


def _undamped(damping: Damping, smallest: Array, largest: Array) -> Mask:
    pairs = zip(smallest.tolist(), largest.tolist(), strict=True)
    return np.fromiter((damping(a, b) == 0.0 for a, b in pairs), dtype=bool, count=len(smallest))


def _regular(law: VelocityLaw, J: Array, s: Array, posture: Array | None, *, own_form: bool) -> tuple[Mask, Array]:
    """`regular_velocity` for all rows."""
    certain, form, inverse_form = _norms(law, J, own_form=own_form)
    S = np.matmul(J, J.transpose(0, 2, 1))
    try:
        factor = np.linalg.cholesky(S)
    except np.linalg.LinAlgError:  # one is singular: the others still have their factors
        certain &= np.linalg.eigvalsh(S)[:, 0] > 0.0
        S[~certain] = np.eye(6)
        try:
            factor = np.linalg.cholesky(S)
        except np.linalg.LinAlgError:
            return np.zeros(len(J), dtype=bool), np.zeros((len(J), J.shape[2]))
    inverse = np.asarray(np.linalg.inv(factor), dtype=np.float64)
    smallest = 1.0 / ((inverse * inverse).sum(axis=(1, 2)) * inverse_form)
    largest = np.sqrt((S * S).sum(axis=(1, 2))) * form
    certain &= smallest >= ACCURATE_RATIO * largest
    certain[certain] = _undamped(law.damping, smallest[certain], largest[certain])
    wanted = s if posture is None else s - _dot(J, posture)
    y = _dot(inverse.transpose(0, 2, 1), _dot(inverse, wanted))
    x = _dot(J.transpose(0, 2, 1), y)
    return certain, x if posture is None else posture + x


class _Centres(NamedTuple):
    """`centre` for all rows; `certain` where the axes are far from parallel and the length is a proper one."""

    certain: Mask
    point: Array
    length: Array


def _norms(law: VelocityLaw, J: Array, *, own_form: bool) -> tuple[Mask, Array, Array]:
    """Upper bounds (N,) on |Q| and on |Q^-1|, and where they are known."""
    if own_form:
        certain, _, length = _centres(J)
        size = 1.0 + 2.0 * length
        return certain, size, size
    norms, ones = law.form.norms, np.ones(len(J))
    if norms is None:
        return np.zeros(len(J), dtype=bool), ones, ones
    return np.ones(len(J), dtype=bool), norms.form * ones, norms.inverse * ones


def _centres(J: Array) -> _Centres:
    w, v = J[:, :3], J[:, 3:]
    b = np.cross(w, v, axis=1).sum(axis=2)
    spread = np.matmul(w, w.transpose(0, 2, 1))
    trace = np.trace(spread, axis1=1, axis2=2)
    A = trace[:, None, None] * np.eye(3) - spread
    speed = (v * v).sum(axis=(1, 2))
    certain = (np.linalg.det(A) > WELL_POSED * (2.0 * trace) ** 3) & (speed <= trace * LENGTH_LIMIT**2)
    A[~certain] = np.eye(3)
    point = np.linalg.solve(A, b[:, :, None])[:, :, 0]
    moving = v + np.cross(w, point[:, :, None], axis=1)
    moved = (moving * moving).sum(axis=(1, 2))
    certain &= moved * LENGTH_LIMIT**2 > np.maximum(speed, trace)
    return _Centres(certain, point, np.sqrt(np.where(certain, moved / np.where(trace > 0.0, trace, 1.0), 1.0)))


def _spectral(
    law: VelocityLaw, J: Array, s: Array, box: tuple[Array, Array], posture: Array | None
) -> tuple[Mask, Array]:
    """The undamped stationary point of every row, and whether it is the law's answer."""
    n, _, m = J.shape
    B = np.eye(m) if law.metric is None else np.linalg.inv(np.linalg.cholesky(law.metric)).T
    twists = J if law.metric is None else np.matmul(J, B)
    Q, size = _matrix(law)
    QJ = np.matmul(Q, twists)
    mu, V = np.linalg.eigh(np.matmul(twists.transpose(0, 2, 1), QJ))
    seen = _dot(V.transpose(0, 2, 1), _dot(QJ.transpose(0, 2, 1), s))
    order = np.argsort(np.abs(mu), axis=1)
    rank = min(m, 6)
    magnitude = np.take_along_axis(np.abs(mu), order, axis=1)
    smallest, largest = magnitude[:, m - rank], magnitude[:, -1]
    good = largest > ROUNDING * size * (J * J).sum(axis=(1, 2))
    good &= smallest > max(SINGULAR_RATIO, FACTORED_RATIO) * largest
    good[good] = _undamped(law.damping, smallest[good], largest[good])
    null = np.zeros((n, m), dtype=bool)
    np.put_along_axis(null, order[:, : m - rank], True, axis=1)
    left = np.zeros((n, m))
    if posture is not None:
        left = _dot(V.transpose(0, 2, 1), posture if law.metric is None else posture.dot(law.metric).dot(B))
    mu[null | ~good[:, None]] = 1.0  # nothing to divide by
    z = _dot(V, np.where(null, left, seen / mu))
    x = z if law.metric is None else z.dot(B.T)
    met = _met(J, s, x)
    margin = ACTIVE_TOLERANCE * np.maximum(1.0, np.abs(x))
    away = ((x > box[0] + margin) & (x < box[1] - margin)).all(axis=1)
    good &= inside(x, box) & (met | away)
    if law.guard is not None:
        doubtful = good & ~met
        good[doubtful] = _content(law.guard, J[doubtful], s[doubtful], x[doubtful])
    return good, x


def _matrix(law: VelocityLaw) -> tuple[Array, float]:
    """The form's matrix in the frame of J, and the norm that rounding in G is relative to."""
    form = law.form
    data = form.gram_data(np.eye(6), np.zeros(6))
    return data.G, data.size / 6.0


def _content(guard: Guard, J: Array, s: Array, x: Array) -> Mask:
    """Whether no velocity could make the guard ask for more."""
    certain = np.ones(len(J), dtype=bool)
    point = np.zeros((len(J), 3)) if guard.point is None else np.broadcast_to(np.asarray(guard.point), (len(J), 3))
    length = np.full(len(J), 0.0 if guard.length is None or isinf(guard.length) else guard.length)
    if guard.point is None or guard.length is None:
        certain, own_point, own_length = _centres(J)
        point = own_point if guard.point is None else point
        length = own_length if guard.length is None else length
    JW = np.concatenate((length[:, None, None] * J[:, :3], J[:, 3:] + np.cross(J[:, :3], point[:, :, None], axis=1)), 1)
    sW = np.concatenate((length[:, None] * s[:, :3], s[:, 3:] + np.cross(s[:, :3], point)), axis=1)
    r = sW - _dot(JW, x)
    wanted = (sW * sW).sum(axis=1)
    return np.asarray(certain & (wanted - (r * r).sum(axis=1) >= guard.fraction * wanted))
