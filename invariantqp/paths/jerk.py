"""The time-optimal motion along a path inside limits of velocity, acceleration and jerk of its joints.

A motion p(t) of them is driven at another rate: dt' = dt / sqrt(b), b a quadratic spline, one number c for each piece.

    time             integral of b^-1/2
    velocity         b <= (top / speed)^2                  at the knot before each piece and in its middle
    acceleration     |a| <= A,  a = p' b' / 2 + p'' b      at knots
    jerk             |a_i+1 - a_i| <= J h b^-1/2           from knot to knot

All constraints are convex in c but the last, which is linearised inside its limit. Each step is one of an interior
point method from b = 1, after which p is the motion at the new rate through the same points: at the end b is one.

The place is a cubic spline with B-spline coefficients that never fall, so that it never goes back; the first three are
equal, and the last three, so that it begins and ends without acceleration.

References: Verscheure et al. 2009, Time-optimal path tracking for robots: a convex optimization approach.
Mehrotra 1992, On the implementation of a primal-dual interior point method.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import BSpline, CubicSpline
from scipy.linalg import cho_solve_banded, cholesky_banded

from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.paths.joint_limits import JointLimits
from invariantqp.paths.reference import Motion

# Steps at most, and the duality gap at which they end, as a share of the time.
STEPS, GAP_SHARE = 60, 1e-2
# The first step's duality gap as a share of the time, and its least slack as a share of the limit.
START_GAP = 0.1


def least_time(
    times: Array,
    places: Array,
    joints: Callable[[Array], Array],
    limits: JointLimits,
    share: float,
    at: Array,
    top: Array,
) -> Motion:
    """The motion from rest to rest inside the limits, of the joints and, last, their place on the path.

    Args:
        times: (n,) of knots at first, which may exceed the limits.
        places: (n,) at these times, not decreasing.
        joints: function of places (k,) that returns positions (k, m), the last of them the place.
        limits: of all m, inf for none; those of positions are ignored.
        share: of the limits of acceleration and jerk that is used.
        at: (k,) places.
        top: (k,) the largest speed there.
    """
    acceleration, jerk = share * limits.acceleration, share * limits.jerk
    has_acceleration, has_jerk = np.isfinite(acceleration), np.isfinite(jerk)
    of_jerk = np.tile(np.arange(has_acceleration.sum() + has_jerk.sum()) >= has_acceleration.sum(), 2)
    slack = z = np.zeros((0, 0))  # slack of each limit, as a share of it, and its multiplier
    highest = np.interp(0.5 * (places[:-1] + places[1:]), at, top)
    motion = _monotone(times, places, joints)
    kept, least, gap = (1.0, times, motion), np.inf, np.inf
    for k in range(STEPS):
        h, v = np.diff(times), motion(times, 1)
        fast, a, _ = derivatives = _derivatives(times, motion, v)
        bounds = limits.velocity, limits.acceleration, limits.jerk
        utilisation = [float((np.abs(x) / y).max()) for x, y in zip(derivatives, bounds, strict=True)]
        slowdown = max(utilisation[0], utilisation[1] ** 0.5, utilisation[2] ** (1.0 / 3.0), 1.0)
        if slowdown * times[-1] < least:  # the motion so much slower is inside the limits
            kept, least = (slowdown, times, motion), slowdown * float(times[-1])
        if gap < GAP_SHARE * times[-1] and slowdown < 1.0 + GAP_SHARE:
            break

        # At a knot b is so much of the c before and of that after it, and b' / 2 so much of their difference.
        both = h[:-1] + h[1:]
        before, after = (np.concatenate(x) for x in (((0.0,), h[1:] / both, (1.0,)), ((1.0,), h[:-1] / both, (0.0,))))
        turn = np.concatenate(((0.0,), 1.0 / both, (0.0,)))[:, None] * v
        left, right = a * before[:, None] - turn, a * after[:, None] + turn
        middle = 0.25 * np.stack((before[:-1], 2.0 + after[:-1] + before[1:], after[1:]), axis=1)
        # Of the c before a piece, its own and that after it, (n - 1, 3, .): accelerations and changes of them
        first = np.stack((left[:-1], right[:-1], 0.0 * left[1:]), axis=1)
        change = np.stack((-left[:-1], left[1:] - right[:-1], right[1:]), axis=1) / h[:, None, None]
        rows = np.concatenate(
            (first[:, :, has_acceleration] / acceleration[has_acceleration], change[:, :, has_jerk] / jerk[has_jerk]),
            axis=2,
        )
        fast_squares = np.maximum((np.abs(fast) / limits.velocity).max(axis=2), fast[:, :, -1] / highest[:, None]) ** 2
        there = np.stack((np.stack((before[:-1], after[:-1], 0.0 * h), axis=1), middle), axis=2)
        need = rows.sum(axis=1)
        free = np.hstack((1.0 - need, 1.0 + need, 1.0 - fast_squares))
        slope = np.concatenate((-rows, rows, -fast_squares[:, None] * there), axis=2)
        slope[:, :, :-2][:, :, of_jerk] -= 0.5 * middle[:, :, None]

        if k == 0:
            slack = np.maximum(np.abs(free), START_GAP)
            z = START_GAP * times[-1] / slack.size / slack
        slack = np.maximum(slack, free)
        gap = float((z * slack).sum())
        step = _Step(slack, z, free, slope, h, middle)
        more, dz = step.to(0.0)[1:]
        then = float(((slack + _share(slack, more) * more) * (z + _share(z, dz) * dz)).sum())
        d, more, dz = step.to((then / gap) ** 3 * gap / slack.size - more * dz)
        far, near = (1.0 - GAP_SHARE) * _share(slack, more), (1.0 - GAP_SHARE) * _share(z, dz)
        slack, z = slack + far * more, z + near * dz
        c = np.where(d > 0.0, 1.0 + far * d, 1.0 / (1.0 - far * np.minimum(d, 0.0)))
        ends = np.concatenate((c[:1], c, c[-1:]))
        b = before * ends[:-1] + after * ends[1:]
        slower = b[:-1] ** -0.5 + 4.0 * (sliding_window_view(ends, 3) * middle).sum(axis=1) ** -0.5 + b[1:] ** -0.5
        times = np.append(0.0, np.cumsum(h * slower / 6.0))
        motion = _monotone(times, places, joints)
    slowdown, times, motion = kept
    return Motion(slowdown * times, np.moveaxis(motion.c[::-1], 0, 1) / slowdown ** np.arange(4.0)[:, None])


def _derivatives(times: Array, motion: CubicSpline, v: Array) -> tuple[Array, Array, Array]:
    """Velocities, accelerations (n, m) and jerk (n - 1, m) of a motion with knots at times (n,).

    Velocities (n - 1, 2, m) are `v` (n, m) at the knot before each piece, and in its middle or at their extremum.
    """
    h, a = np.diff(times), motion(times, 2)
    jerk, turns = np.diff(a, axis=0) / h[:, None], a[:-1] * a[1:] < 0.0
    turned = v[:-1] - 0.5 * a[:-1] ** 2 / np.where(turns, jerk, 1.0)
    return np.stack((v[:-1], np.where(turns, turned, motion(times[:-1] + 0.5 * h, 1))), axis=1), a, jerk


def _monotone(times: Array, places: Array, joints: Callable[[Array], Array]) -> CubicSpline:
    """The motion through the joints at places (n,) at times (n,), moved so that it never goes back."""
    h = np.diff(times, prepend=times[0], append=times[-1])
    place = CubicSpline(times, places, bc_type="clamped")
    c: Array = places + place(times, 1) * (h[1:] - h[:-1]) / 3.0 - place(times, 2) * h[1:] * h[:-1] / 6.0
    c[:2], c[-2:] = places[0], places[-1]
    c = np.clip(c, places[0], places[-1])
    c = 0.5 * (np.maximum.accumulate(c) + np.minimum.accumulate(c[::-1])[::-1])
    place = BSpline(np.pad(times, 3, mode="edge"), np.pad(c, 1, mode="edge"), 3)
    return CubicSpline(times, joints(place(times)), bc_type="clamped")


class _Step:
    """A step of the interior point method: one set of banded equations for the c."""

    def __init__(self, slack: Array, z: Array, free: Array, slope: Array, h: Array, middle: Array) -> None:
        """Slack and multipliers (n, k), the free part of the limits (n, k) and its slopes (n, 3, k)."""
        self._slack, self._z, self._off, self._slope = slack, z, free - slack, slope
        self._weight, self._gain = z / slack, 0.5 * h[:, None] * middle
        H = (slope * self._weight[:, None]) @ slope.transpose(0, 2, 1)
        H += 0.75 * h[:, None, None] * middle[:, :, None] * middle[:, None]
        bands = np.zeros((3, len(h)))  # upper form
        bands[2] = (1.0 + NEGLIGIBLE) * _summed(np.diagonal(H, axis1=1, axis2=2))
        bands[1, 1:] = H[1:, 0, 1] + H[:-1, 1, 2]
        bands[0, 2:] = H[1:-1, 0, 2]
        self._factor = cholesky_banded(bands), False

    def to(self, product: Array | float) -> tuple[Array, Array, Array]:
        """Changes of c, slack and z after which the product of the last two is as given, to first order."""
        away = product / self._slack - self._weight * self._off
        d = cho_solve_banded(self._factor, _summed((self._slope @ away[:, :, None])[:, :, 0] + self._gain))
        more = (sliding_window_view(np.pad(d, 1), 3)[:, None] @ self._slope)[:, 0] + self._off
        return d, more, product / self._slack - self._z - self._weight * more


def _summed(x: Array) -> Array:
    """(n,) the sum for each c of its shares in pieces (n, 3): the one after it, its own and the one before."""
    total: Array = x[:, 1].copy()
    total[:-1] += x[1:, 0]
    total[1:] += x[:-1, 2]
    return total


def _share(x: Array, change: Array) -> float:
    """The largest share of a change, up to one, that keeps x above zero."""
    return 1.0 / max(float((-change / x).max()), 1.0)
