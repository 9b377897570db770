"""The time parameterization of a joint path: least time inside the limits of the joints and of the path (TOPP).

    maximum velocity    |q' v| <= velocity limits, and every other limit of the joint velocity q' v at a knot
    backward pass       the largest speed from which every later one can be reached inside acceleration limits:
                        x = v^2 is linear between knots, and at both ends of each piece
                        |q'' x_i + q'_i u| <= a,  |q'' x_i+1 + q'_i+1 u| <= a,  u = (x_i+1 - x_i) / 2h
    forward pass        the same from the end back: it begins at rest

The path's place is one joint more, of slope one: its rate, acceleration and jerk are limited as those of the others.
With jerk limits the place is averaged over a window of time, and then optimised (`jerk`).

Reference: Pham & Pham 2018, A new approach to time-optimal path parameterization based on reachability analysis.
"""

from __future__ import annotations

from bisect import bisect_left
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from invariantqp.control.controller import Controller
from invariantqp.geometry import sizes
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.paths.curve import Curve
from invariantqp.paths.jerk import least_time
from invariantqp.paths.joint_limits import AT_LIMIT, AT_REST, JointLimits
from invariantqp.paths.joint_path import MIN_STEP, Knot
from invariantqp.paths.reference import Motion
from invariantqp.velocity.limits import braking_speed

# Shares of the velocity and acceleration limits that a plan uses; feedback needs the rest.
VELOCITY_SHARE = 0.998
ACCELERATION_SHARE = 0.98
ACCELERATION, ON_TIME = "acceleration", "the rate asked for"
# With a jerk limit: pieces of the motion between rests. A speed below this share of the largest is a rest, in which the
# motion waits for the average.
PIECES, REST = 600, 1e-2
# Of the search for the time of a place.
BISECTIONS = 24


class PathPlan(NamedTuple):
    """A joint motion along a path, to its end or to where it is blocked.

    Attributes:
        at: (n,) the path's parameter at the knots.
        joints: (m,) joint positions at a place.
        ruling: (n,) what limits the speed at each knot, in words.
        off: (n,) distance of the tool from the path at each knot, in the measure [length].
        blocked: why the path ends at the last knot, in words; "" where it does not.
        motion: of the joints and, last, the place, in time; it begins at 0 and at rest.
        middles: (n - 1,) the parameter half way between knots.
    """

    at: Array
    joints: CubicHermiteSpline
    ruling: list[str]
    off: Array
    blocked: str
    motion: Motion
    middles: list[float]

    @property
    def end(self) -> float:
        """The last place."""
        return float(self.at[-1])

    def nearest(self, at: float) -> int:
        """The index of the knot nearest a place."""
        return bisect_left(self.middles, at)

    def time(self, place: float) -> float:
        """The time at which the motion is at a place."""
        knots, c = self.motion.knots, self.motion.coefficients[:, :, -1]
        i = int(np.clip(np.searchsorted(c[:, 0], place, side="right") - 1, 0, len(c) - 1))
        low, high = float(knots[i]), float(knots[i + 1])
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            u = middle - knots[i]
            here = c[i, 0] + u * (c[i, 1] + u * (c[i, 2] + u * c[i, 3]))
            low, high = (middle, high) if here <= place else (low, middle)
        return low


def plan_of(
    controller: Controller,
    curve: Curve,
    knots: list[Knot],
    blocked: str,
    *,
    along: tuple[float, float, float],
    jerk: Array,
) -> PathPlan:
    """The plan of knots; the tool stops at the first and the last of them.

    Args:
        controller: whose limits hold.
        curve: the path.
        knots: one or more.
        blocked: why the path ends at the last of them, in words; "" where it does not.
        along: the largest rate, acceleration and jerk of the place, inf for no limit.
        jerk: (m,) of the joints, inf for no limit.
    """
    if len(knots) == 1:  # blocked from the start on
        knots = [knots[0], knots[0]._replace(at=knots[0].at + MIN_STEP * curve.end)]
    m = len(controller.robot.names)
    acceleration = (
        np.full(m, inf) if controller.acceleration_limit is None else ACCELERATION_SHARE * controller.acceleration_limit
    )
    at = np.array([k.at for k in knots])
    q, slopes = np.array([k.q for k in knots]), np.array([k.slope for k in knots])
    top, ruling = _max_velocity(controller, q, slopes, acceleration)
    for i in np.flatnonzero(along[0] <= top).tolist():
        top[i], ruling[i] = along[0], ON_TIME
    # The place is one joint more.
    q, slopes = np.column_stack((q, at)), np.column_stack((slopes, np.ones(len(at))))
    limits = np.append(acceleration, along[1])
    joints = CubicHermiteSpline(at, q, slopes)
    speed = _speeds(at, q, slopes, top, limits)
    for i in np.flatnonzero(speed < (1.0 - AT_REST) * top).tolist():
        ruling[i] = ACCELERATION
    motion = _timed(at, joints, speed)
    jerks = np.append(jerk, along[2])
    if np.isfinite(jerks).any():
        fastest = np.append(VELOCITY_SHARE * controller.box.velocity_limit, along[0])
        none = np.full(m + 1, inf)
        with np.errstate(divide="ignore"):
            limits[-1] = min(along[1], float((acceleration / np.abs(slopes[:, :-1])).min(axis=1).max()))
            limits[:-1] /= ACCELERATION_SHARE
        # No more than jerk limits allow on the way to full speed, and on the whole path.
        distance = np.abs(np.diff(q, axis=0)).sum(axis=0)
        most = np.minimum(
            np.sqrt(jerks * fastest), np.where(distance > 0.0, np.cbrt(0.5 * jerks * jerks * distance), inf)
        )
        bounds = JointLimits(-none, none, fastest, np.minimum(limits, most), jerks, controller.dt)
        motion = _with_jerk(at, q, slopes, top, bounds)
    off = np.array([k.off for k in knots])
    joints = CubicHermiteSpline(at, q[:, :-1], slopes[:, :-1])
    return PathPlan(at, joints, ruling, off, blocked, motion, (0.5 * (at[1:] + at[:-1])).tolist())


def _speeds(at: Array, q: Array, slopes: Array, top: Array, acceleration: Array) -> Array:
    """(n,) speeds at the knots, from rest to rest where some acceleration is limited."""
    rests = bool(np.isfinite(acceleration).any())
    ends = top.copy()
    if rests:
        ends[[0, -1]] = 0.0
    squares = reachable_squares(at, q, slopes, ends, acceleration)
    back = reachable_squares(at[-1] - at[::-1], q[::-1], -slopes[::-1], np.sqrt(squares)[::-1], acceleration)[::-1]
    return np.sqrt(back)


def _timed(at: Array, joints: CubicHermiteSpline, speed: Array) -> Motion:
    """The motion with speeds at the knots whose squares are linear in between."""
    h = np.diff(at)
    v, w = speed[:-1], speed[1:]
    none = v + w == 0.0
    v = np.where(none, AT_REST * float(speed.max()) or float(at[-1] - at[0]), v)
    w = np.where(none, v, w)
    D = 2.0 * h / (v + w)
    v, b = v[:, None], (0.5 * (w - v) / D)[:, None]  # the place is v u + b u^2
    c3, c2, c1, c0 = joints.c
    quartic = c2 * b**2 + 3.0 * c3 * v**2 * b
    powers = (c0, c1 * v, c1 * b + c2 * v**2, 2.0 * c2 * v * b + c3 * v**3, quartic, 3.0 * c3 * v * b**2, c3 * b**3)
    return Motion(np.append(0.0, np.cumsum(D)), np.stack(powers, axis=1))


def _with_jerk(at: Array, q: Array, slopes: Array, top: Array, limits: JointLimits) -> Motion:
    """The motion inside jerk limits, too.

    The first guess is the motion without them, averaged over the time in which the largest acceleration reverses.
    """
    jerky = np.isfinite(limits.jerk)
    window = float((2.0 * limits.acceleration[jerky] / limits.jerk[jerky]).max())
    speeds = _speeds(at, q, slopes, top, ACCELERATION_SHARE * limits.acceleration)
    motion = _timed(at, CubicHermiteSpline(at, q, slopes), speeds)
    step = motion.end / PIECES
    n = max(round(min(window / step, PIECES)), 1)
    places, speed = motion.at(np.linspace(0.0, motion.end, PIECES + 1))[:, :2, -1].T
    slow = np.flatnonzero(speed <= REST * speed.max())
    rests = [i[speed[i].argmin()] for i in np.split(slow, np.flatnonzero(np.diff(slow) > 1) + 1)]
    waits = np.repeat(rests, n)
    places = np.insert(places, waits, places[waits])
    total = np.append(0.0, np.cumsum(0.5 * (places[1:] + places[:-1])))
    places = (total[n:] - total[:-n]) / n
    places[0], places[-1] = at[0], at[-1]
    times: Array = step * np.arange(len(places), dtype=np.float64)
    top = np.clip(top, AT_REST * float(speeds.max()) or float(at[-1] - at[0]), sizes.LARGEST)
    return least_time(times, places, CubicSpline(at, q), limits, ACCELERATION_SHARE, at, top)


def _max_velocity(controller: Controller, q: Array, slopes: Array, acceleration: Array) -> tuple[Array, list[str]]:
    """(n,) the maximum velocity at each knot without acceleration limits, and what limits it, in words."""
    names = controller.robot.names
    limit = np.broadcast_to(VELOCITY_SHARE * controller.box.velocity_limit, slopes.shape)
    words = [f"velocity of joint {i} ({name})" for i, name in enumerate(names)]
    top, which = top_speed(slopes, limit)
    ruling = [words[i] for i in which.tolist()]

    def slower(speed: Array, cause: list[str]) -> None:
        for i in np.flatnonzero(speed < top).tolist():
            top[i], ruling[i] = speed[i], cause[i]

    if controller.acceleration_limit is not None:
        margin = np.maximum(np.where(slopes > 0.0, *controller.box.distances(q)), 0.0) + AT_LIMIT
        speed, which = top_speed(slopes, braking_speed(margin, acceleration, controller.dt))
        slower(speed, [f"position of joint {i} ({names[i]})" for i in which.tolist()])
    if controller.tool_speed is not None:
        point = np.append(np.zeros(3) if controller.tool_speed.point is None else controller.tool_speed.point, 1.0)
        robot = controller.robot
        fast = [
            velocity_at(robot.jacobian(x).dot(s), robot.pose(x).dot(point)[:3]) for x, s in zip(q, slopes, strict=True)
        ]
        speed, _ = top_speed(np.linalg.norm(fast, axis=1)[:, None], VELOCITY_SHARE * controller.tool_speed.limit)
        slower(speed, ["the tool's speed"] * len(top))
    if controller.joint_rows is not None:
        rows = [controller.joint_rows.without_pink(x) for x in q]
        shares = [
            inf if r is None else VELOCITY_SHARE * _rows_allow(np.asarray(r.C).dot(s), r.lower, r.upper)
            for r, s in zip(rows, slopes, strict=True)
        ]
        slower(np.array(shares), ["rows"] * len(top))
    return top, ruling


def _rows_allow(y: Array, lower: Array, upper: Array) -> float:
    """The largest v with lower <= v y <= upper; rows that standing still violates are ignored."""
    above, below = np.where(upper >= 0.0, upper, inf), np.where(lower <= 0.0, -lower, inf)
    return float(np.minimum(_largest(y, above), _largest(-y, below)).min(initial=inf))


def top_speed(slopes: Array, limits: Array | float) -> tuple[Array, NDArray[np.intp]]:
    """(n,) the largest v with |q'_i v| <= limits_i for (n, m) slopes q', inf at rest; and (n,) the limiting joint.

    Limits are (n, m), or one number, positive or zero.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.where(slopes != 0.0, limits / np.abs(slopes), np.inf)
    which = speed.argmin(axis=1)
    return np.take_along_axis(speed, which[:, None], axis=1)[:, 0], which


def reachable_squares(at: Array, positions: Array, slopes: Array, top: Array, acceleration: Array) -> Array:
    """(n,) the largest v^2 at each knot from which all later ones can be reached.

    Parameters and top speeds (n,), joint positions and slopes q' (n, m), acceleration limits (m,), inf where there is
    none.
    """
    n = len(at)
    h = np.diff(at)
    squares = np.minimum(top, sizes.LARGEST) ** 2
    limited = np.isfinite(acceleration)
    if not limited.any() or n < 2:
        return squares
    a = acceleration[limited]
    q = slopes[:, limited]
    half, mean = 0.5 / h[:, None], np.diff(positions[:, limited], axis=0) / h[:, None]
    # q'' at the beginning and at the end of each piece, of the cubic with these positions and slopes
    first = (6.0 * mean - 4.0 * q[:-1] - 2.0 * q[1:]) / h[:, None]
    last = (2.0 * q[:-1] + 4.0 * q[1:] - 6.0 * mean) / h[:, None]
    # Rows |alpha x + beta y| <= gamma on the squares x, y at the two ends of a piece
    alpha = np.hstack((first - q[:-1] * half, -q[1:] * half))
    beta = np.hstack((q[:-1] * half, last + q[1:] * half))
    gamma = np.tile(a, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        margin = np.where(beta != 0.0, gamma / np.abs(beta), np.inf)
        slope = np.where(beta != 0.0, alpha / beta, 0.0)
    # |y + slope x| <= margin,  0 <= y <= squares of the next knot
    alone = _largest(slope[:, None] - slope[:, :, None], margin[:, None] + margin[:, :, None]).min(axis=(1, 2))
    alone = np.minimum(alone, _largest(slope, margin).min(axis=1))
    alone = np.minimum(alone, _largest(np.where(beta == 0.0, np.abs(alpha), 0.0), gamma).min(axis=1))
    squares[:-1] = np.minimum(squares[:-1], alone)
    margin, fall = np.where(slope < 0.0, margin, np.inf), np.maximum(-slope, 0.0)
    with np.errstate(divide="ignore", over="ignore"):
        for i in range(n - 2, -1, -1):
            squares[i] = min(squares[i], ((margin[i] + squares[i + 1]) / fall[i]).min())
    return squares


def _largest(slope: Array, margin: Array) -> Array:
    """The largest x with slope x <= margin, margin >= 0; inf where slope is not positive."""
    with np.errstate(divide="ignore", invalid="ignore"):
        x: Array = np.where(slope > 0.0, margin / slope, np.inf)
    return x
