"""How fast a path may be driven at each of its knots, so that a tool that obeys the limits there can stay on it.

    top speed       |q' v| <= velocity limits, and whatever else limits the joint velocity q' v at a knot
    from behind     the largest speed from which every later one can still be reached, at most a joint's acceleration:
                    x = v^2 is linear between knots, q' v changes at most at the rate a at both ends of each piece:
                    |q'' x_i + q'_i u| <= a,  |q'' x_i+1 + q'_i+1 u| <= a,  u = (x_i+1 - x_i) / 2h

The set of speeds from which the rest can be driven is an interval from zero, known by its upper end.

Reference: Pham & Pham 2018, A new approach to time-optimal path parameterization based on reachability analysis.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invariantqp.geometry.arrays import Array

# Stands for an infinite speed, whose square is still a number.
BOUNDLESS = 1e30


def top_speed(slopes: Array, limits: Array | float) -> tuple[Array, NDArray[np.intp]]:
    """(n,) the largest v with |q'_i v| <= limits_i for (n, m) slopes q', inf at rest; and (n,) the joint that rules.

    Limits are (n, m), or one number, positive or zero.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.where(slopes != 0.0, limits / np.abs(slopes), np.inf)
    which = speed.argmin(axis=1)
    return np.take_along_axis(speed, which[:, None], axis=1)[:, 0], which


def bends(at: Array, positions: Array, slopes: Array) -> tuple[Array, Array]:
    """(n - 1, m) q'' at the beginning and at the end of each piece, of the cubic with these positions and slopes."""
    h = np.diff(at)[:, None]
    mean = np.diff(positions, axis=0) / h
    return (6.0 * mean - 4.0 * slopes[:-1] - 2.0 * slopes[1:]) / h, (
        2.0 * slopes[:-1] + 4.0 * slopes[1:] - 6.0 * mean
    ) / h


def smooth_speed(at: Array, positions: Array, slopes: Array, acceleration: Array, along: float) -> Array:
    """(n,) the largest speed v at each knot at which joints can follow any path acceleration up to `along`.

        |q'' v^2| + |q' along| <= a

    `along` is at most acceleration / |slopes| anywhere; the others are as in `drivable`.
    """
    first, last = np.abs(bends(at, positions, slopes))
    most = np.zeros_like(slopes)
    most[:-1] = first
    most[1:] = np.maximum(most[1:], last)
    speed: Array = np.sqrt(_most(most, acceleration - np.abs(slopes) * along).min(axis=1))
    return speed


def drivable(at: Array, positions: Array, slopes: Array, top: Array, acceleration: Array, final: float = 0.0) -> Array:
    """(n,) the largest v^2 at each knot from which all later ones can be driven, at most `final` at the last.

    Parameters and top speeds (n,), joint positions and slopes q' (n, m), acceleration limits (m,), inf where there is
    none.
    """
    n = len(at)
    h = np.diff(at)
    most = np.minimum(top, BOUNDLESS) ** 2
    squares = np.append(most[:-1], min(float(most[-1]), final * final))
    limited = np.isfinite(acceleration)
    if not limited.any() or n < 2:
        return squares
    a = acceleration[limited]
    q = slopes[:, limited]
    first, last = bends(at, positions[:, limited], q)
    half = 0.5 / h[:, None]
    # Rows |alpha x + beta y| <= gamma on the squares x, y at the two ends of a piece
    alpha = np.hstack((first - q[:-1] * half, -q[1:] * half))
    beta = np.hstack((q[:-1] * half, last + q[1:] * half))
    gamma = np.tile(a, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(beta != 0.0, gamma / np.abs(beta), np.inf)
        slope = np.where(beta != 0.0, alpha / beta, 0.0)
    # |y + slope x| <= room,  0 <= y <= squares of the next knot
    alone = _most(slope[:, None] - slope[:, :, None], room[:, None] + room[:, :, None]).min(axis=(1, 2))
    alone = np.minimum(alone, _most(slope, room).min(axis=1))
    alone = np.minimum(alone, _most(np.where(beta == 0.0, np.abs(alpha), 0.0), gamma).min(axis=1))
    squares[:-1] = np.minimum(squares[:-1], alone)
    room, fall = np.where(slope < 0.0, room, np.inf), np.maximum(-slope, 0.0)
    with np.errstate(divide="ignore", over="ignore"):
        for i in range(n - 2, -1, -1):
            squares[i] = min(squares[i], ((room[i] + squares[i + 1]) / fall[i]).min())
    return squares


def _most(slope: Array, room: Array) -> Array:
    """The largest x with slope x <= room, room >= 0; inf where slope is not positive."""
    with np.errstate(divide="ignore", invalid="ignore"):
        x: Array = np.where(slope > 0.0, room / slope, np.inf)
    return x
