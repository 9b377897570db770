"""The rate along a path for which no joint changes its velocity by more than it may in a tick."""

from __future__ import annotations

import numpy as np

from invariantqp.geometry.arrays import Array

# Of what acceleration limits allow in a tick, the share for driving along the path; feedback needs the rest.
TICK_SHARE = 0.985
# Where the tool goes slower than it has to, after a pause for instance, a smaller one is enough.
EASY_SHARE = 0.9


def rate_inside(slope: Array, rate: float, possible: float, before: Array, step: Array) -> float:
    """The rate v nearest the wanted one with |q' v - before| <= step.

    Where no rate keeps all joints, it is the one that breaks the limits by the least squares.

    Args:
        slope: (m,) q'.
        rate: wanted.
        possible: the largest speed that the path allows; below it a smaller share of the step is enough.
        before: (m,) joint velocity along the path in the tick before.
        step: (m,) positive, inf where there is no limit.
    """
    moving = slope != 0.0
    if not moving.any():
        return rate
    b, s, d = before[moving], slope[moving], step[moving]
    middle, width = b / s, d / np.abs(s)
    for share in (EASY_SHARE, TICK_SHARE):
        low, high = float((middle - share * width).max()), float((middle + share * width).min())
        nearest = min(max(rate, low), high)
        if low <= high and (share == TICK_SHARE or abs(nearest) <= possible > abs(rate)):
            return nearest
    weights = np.where(np.isfinite(d), 1.0 / (d * d), 0.0)
    return float((weights * s * b).sum() / (weights * s * s).sum())
