"""The rate along a path for which no joint is too fast, nor changes its velocity by more than it may in a tick."""

from __future__ import annotations

from math import inf

from invariantqp.geometry.arrays import Array

# Of what acceleration limits allow in a tick, the share for driving along the path; feedback needs the rest.
TICK_SHARE = 0.985
# Where the tool goes slower than it has to, after a pause for instance, a smaller one is enough.
EASY_SHARE = 0.9
# Between its knots a plan may be a little too fast; the share of the velocity limits that is left then.
FULL_SHARE = 0.9995


def rate_inside(slope: Array, rate: float, possible: float, before: Array, step: Array, limit: Array) -> float:
    """The rate v nearest the wanted one with |q' v - before| <= step and |q' v| <= limit, all (m,), inf for no limit.

    Where no rate keeps all joints' steps, it is the one that breaks them by the least squares. `possible` is the
    largest speed that the path allows; below it a smaller share of the step is enough.
    """
    # Of a handful of joints plain numbers are faster than arrays.
    joints = zip(slope.tolist(), before.tolist(), step.tolist(), limit.tolist(), strict=True)
    moving: list[tuple[float, float, float]] = [(b / s, d / abs(s), x / abs(s)) for s, b, d, x in joints if s]
    if not moving:
        return rate
    middle = [(m, w) for m, w, _ in moving]
    most = FULL_SHARE * min(x for _, _, x in moving)
    rate = min(max(rate, -most), most)
    for share in (EASY_SHARE, TICK_SHARE):
        low, high = max(m - share * w for m, w in middle), min(m + share * w for m, w in middle)
        nearest = min(max(rate, low), high)
        if low <= high and (share == TICK_SHARE or abs(nearest) <= possible > abs(rate)):
            return nearest
    # Least squares in the joints' velocities over what each may change.
    weights = [(1.0 / (w * w), m) for m, w in middle if w < inf]
    return sum(k * m for k, m in weights) / sum(k for k, _ in weights)
