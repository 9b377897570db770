"""Saturation in the null space: a joint that would exceed its limit stays at it, and the other joints make up for it.

    x = x_N + (J W)^+ (alpha s - J x_N),   W_jj = 0 and x_N,j = limit for the saturated joints

alpha scales the twist down: it is 1 if the other joints can achieve s, else the largest value found on the way.

Optimal: of the velocities that achieve s, the one nearest to x_N, where the search ends there. A saturated joint whose
multiplier has the wrong sign is let go again,

    x - x_N + J'lambda + mu = 0,   mu = 0 on free joints, mu >= 0 at an upper limit, mu <= 0 at a lower one

Where that goes round in circles or leaves too few joints free, the last velocity that achieved s is the answer; it may
not be the nearest.

Reference: Flacco, De Luca & Khatib 2012, Algorithm 1; 2015, the optimal variant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array

Mask = NDArray[np.bool_]
# A singular value of JW below this fraction of the largest of J counts as zero in the rank.
RANK = 1e-10
# A velocity exceeds a limit if it does so by more than this fraction of the largest limit: less is rounding.
OUTSIDE = 1e-12
# Rounds of the search for each joint: the optimal variant may saturate a joint again.
ROUNDS = 3


class Saturated(NamedTuple):
    """The answer."""

    velocity: Array  # (m,) inside the limits
    scale: float  # alpha, the part of the twist that it achieves


def saturate(
    J: Array, s: Array, lower: Array, upper: Array, rest: Array | None = None, *, optimal: bool = False
) -> Saturated:
    """The velocity inside the limits that achieves alpha s, with alpha as large as the method finds it.

    `rest` (m,) is the joint velocity wanted in the null space, None for zero. Where the bounds exclude zero velocity,
    alpha may be 0; the velocity is then zero clipped to the bounds.
    """
    m = J.shape[1]
    free = np.ones(m, dtype=bool)
    posture: Array = np.zeros(m) if rest is None else rest
    fixed = posture.copy()
    rank = _rank(J, J)
    limits = np.abs(np.concatenate((lower, upper)))
    edge = OUTSIDE * float(limits[np.isfinite(limits)].max(initial=0.0))
    best = Saturated(np.minimum(np.maximum(np.zeros(m), lower), upper), 0.0)
    for _ in range(ROUNDS * (m + 1)):
        inverse = np.asarray(np.linalg.pinv(J * free, rcond=RANK), np.float64)
        along = inverse.dot(s)
        offset = fixed - inverse.dot(J.dot(fixed))
        x = along + offset
        outside = (x < lower - edge) | (x > upper + edge)
        if not outside.any():
            best = Saturated(np.minimum(np.maximum(x, lower), upper), 1.0)
            wrong = _held_too_long(J, inverse, x - posture, free, fixed == upper) if optimal else -1
            if wrong < 0:
                break
            free[wrong], fixed[wrong] = True, posture[wrong]
            continue
        scale, critical = _largest_share(along, offset, lower, upper)
        if scale > best.scale:
            share = np.minimum(np.maximum(scale * along + offset, lower), upper)
            best = Saturated(share, scale)
        if not free[critical]:
            break
        free[critical] = False
        fixed[critical] = upper[critical] if x[critical] > upper[critical] else lower[critical]
        if _rank(J * free, J) < rank:
            break
    return best


def _held_too_long(J: Array, inverse: Array, pull: Array, free: Mask, above: Mask) -> int:
    """The saturated joint whose multiplier has the wrong sign by most; -1 for none."""
    wrong = np.where(above, 1.0, -1.0) * (pull - J.T.dot(inverse.T.dot(pull * free)))
    wrong[free] = 0.0
    worst = int(np.argmax(wrong))
    return worst if wrong[worst] > OUTSIDE * float(np.abs(pull).max()) else -1


def _largest_share(along: Array, offset: Array, lower: Array, upper: Array) -> tuple[float, int]:
    """The largest alpha in [0, 1] with lower <= alpha along + offset <= upper, and the joint that limits it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack(((lower - offset) / along, (upper - offset) / along))
    still = along == 0.0
    ends[0, still], ends[1, still] = -np.inf, np.inf
    low, high = np.minimum(*ends), np.maximum(*ends)
    critical = int(np.argmin(high))
    most, least = min(1.0, float(high[critical])), max(0.0, float(low.max()))
    return (most if least <= most else 0.0), critical


def _rank(A: Array, J: Array) -> int:
    size = float(np.linalg.norm(J, 2))
    return int(np.count_nonzero(np.linalg.svd(A, compute_uv=False) > RANK * size))
