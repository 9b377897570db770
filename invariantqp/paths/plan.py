"""A joint motion along a path, and when: as soon as the joints' limits, and those along the path, let them.

    top speed       |q' v| <= velocity limits, and whatever else limits the joint velocity q' v at a knot
    from behind     the largest speed from which every later one can still be reached, at most a joint's acceleration:
                    x = v^2 is linear between knots, q' v changes at most at the rate a at both ends of each piece:
                    |q'' x_i + q'_i u| <= a,  |q'' x_i+1 + q'_i+1 u| <= a,  u = (x_i+1 - x_i) / 2h
    from the front  the same from the end back: it begins at rest

The path's place is one joint more, of slope one: its rate, acceleration and jerk are limits as those of the others.
A jerk limit: the place is averaged over a window of time, which leaves the tool on its path; what then exceeds a limit
is slowed down there, and in the end all of it.

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
from invariantqp.paths.ahead import AT_LIMIT, SHORTEST, Knot
from invariantqp.paths.curve import Curve
from invariantqp.paths.reference import Motion
from invariantqp.paths.time_law import AT_REST, HALVINGS, JointLimits
from invariantqp.velocity.limits import braking_speed

# Shares of the velocity and acceleration limits that a path is driven at; feedback needs the rest.
VELOCITY_SHARE = 0.998
ACCELERATION_SHARE = 0.98
ACCELERATION, ON_TIME = "acceleration", "the rate asked for"
# With a jerk limit: times looked at on the way, and how often places that exceed a limit are slowed down. A speed below
# this share of the largest is a rest, over which nothing is averaged.
TIMES, ROUNDS, REST = 1500, 3, 1e-2
# Windows tried, as shares of that in which the largest acceleration turns round.
WINDOWS = (1.0, 0.6, 0.35)


class PathPlan(NamedTuple):
    """A joint motion along a path, from its start to where it ends or is blocked.

    Attributes:
        at: (n,) the path's parameter at the knots.
        joints: (m,) joint positions at a place.
        ruling: (n,) what limits the speed at each knot, in words.
        off: (n,) how far the tool is off the path at each knot, in the measure.
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
        """Where it ends."""
        return float(self.at[-1])

    def nearest(self, at: float) -> int:
        """The number of the knot nearest a place."""
        return bisect_left(self.middles, at)

    def time(self, place: float) -> float:
        """When it is at a place."""
        knots, c = self.motion.knots, self.motion.coefficients[:, :, -1]
        i = int(np.clip(np.searchsorted(c[:, 0], place, side="right") - 1, 0, len(c) - 1))
        low, high = float(knots[i]), float(knots[i + 1])
        for _ in range(HALVINGS):
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
        knots = [knots[0], knots[0]._replace(at=knots[0].at + SHORTEST * curve.end)]
    m = len(controller.robot.names)
    acceleration = (
        np.full(m, inf) if controller.braking is None else ACCELERATION_SHARE * controller.braking.acceleration
    )
    at = np.array([k.at for k in knots])
    q, slopes = np.array([k.q for k in knots]), np.array([k.slope for k in knots])
    top, ruling = _top(controller, curve, at, q, slopes, acceleration)
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
        # No more than the jerk can make of it on the way to full speed, and on the way at all.
        way = np.abs(np.diff(q, axis=0)).sum(axis=0)
        limits = np.minimum(limits, np.minimum(np.sqrt(jerks * fastest), np.cbrt(0.5 * jerks * jerks * way)))
        bounds = JointLimits(-none, none, fastest, limits / ACCELERATION_SHARE, jerks, controller.dt)
        motion = _eased(at, q, slopes, top, bounds)
    off = np.array([k.off for k in knots])
    joints = CubicHermiteSpline(at, q[:, :-1], slopes[:, :-1])
    return PathPlan(at, joints, ruling, off, blocked, motion, (0.5 * (at[1:] + at[:-1])).tolist())


def _speeds(at: Array, q: Array, slopes: Array, top: Array, acceleration: Array) -> Array:
    """(n,) speeds at the knots, from rest to rest where some acceleration is limited."""
    rests = bool(np.isfinite(acceleration).any())
    ends = top.copy()
    if rests:
        ends[[0, -1]] = 0.0
    squares = drivable(at, q, slopes, ends, acceleration)
    back = drivable(at[-1] - at[::-1], q[::-1], -slopes[::-1], np.sqrt(squares)[::-1], acceleration)[::-1]
    return np.sqrt(back)


def _timed(at: Array, joints: CubicHermiteSpline, speed: Array) -> Motion:
    """The motion with these speeds at the knots; their squares are linear in between."""
    h = np.diff(at)
    v, w = speed[:-1], speed[1:]
    none = v + w == 0.0
    v = np.where(none, AT_REST * float(speed.max()) or float(at[-1] - at[0]), v)
    w = np.where(none, v, w)
    D = 2.0 * h / (v + w)
    v, b = v[:, None], (0.5 * (w - v) / D)[:, None]  # the place is v u + b u^2
    c3, c2, c1, c0 = joints.c
    powers = np.stack(
        (
            c0,
            c1 * v,
            c1 * b + c2 * v**2,
            2.0 * c2 * v * b + c3 * v**3,
            c2 * b**2 + 3.0 * c3 * v**2 * b,
            3.0 * c3 * v * b**2,
            c3 * b**3,
        ),
        axis=1,
    )
    return Motion(np.append(0.0, np.cumsum(D)), powers)


def _eased(at: Array, q: Array, slopes: Array, top: Array, limits: JointLimits) -> Motion:
    """The motion whose joints keep jerk limits, too: averaged over a window of time, slowed down where it must be."""
    joints, smooth = CubicHermiteSpline(at, q, slopes), CubicSpline(at, q)
    jerky = np.isfinite(limits.jerk)
    longest = float((2.0 * limits.acceleration[jerky] / limits.jerk[jerky]).max())
    best, least, first = None, inf, top
    for k in range(len(WINDOWS) * ROUNDS):
        if k % ROUNDS == 0:
            top, window = first.copy(), WINDOWS[k // ROUNDS] * longest
        speeds = _speeds(at, q, slopes, top, ACCELERATION_SHARE * limits.acceleration)
        times, places = _averaged(_timed(at, joints, speeds), window)
        motion = CubicSpline(times, smooth(places))
        need = np.array([np.abs(motion(times, k)) for k in (1, 2, 3)])
        over = [(x / limit).max(axis=1) for x, limit in zip(need, limits[2:5], strict=True)]
        slower = np.maximum(np.maximum(over[0], np.sqrt(over[1])), np.cbrt(over[2]))
        slow = max(float(slower.max()), 1.0)
        if slow * times[-1] < least:  # all of it so much slower keeps the limits
            least = slow * times[-1]
            best = Motion(slow * times, np.moveaxis(motion.c[::-1], 0, 1) / slow ** np.arange(4.0)[:, None])
        # What is over a limit is slowed down there.
        share = np.ones(len(at))
        for i in np.flatnonzero(slower > 1.0).tolist():
            near = (times > times[i] - 0.5 * window) & (times < times[i] + 0.5 * window)
            inside = (at >= places[near].min()) & (at <= places[near].max())
            share[inside] = np.minimum(share[inside], ACCELERATION_SHARE / slower[i])
        top = share * np.minimum(top, speeds)
    return best if best is not None else _timed(at, joints, speeds)


def _averaged(plan: Motion, window: float) -> tuple[Array, Array]:
    """Times, and places (k,) of a plan averaged over a window of time; at a rest it waits that long."""
    step = plan.end / TIMES
    times = np.linspace(0.0, plan.end, TIMES + 1)
    r = plan.at(times)
    places, speed = r[:, 0, -1], r[:, 1, -1]
    wait = max(round(window / step), 1)
    rests = speed <= REST * speed.max()
    at_rest = np.flatnonzero(rests)
    counts = np.ones(len(times), dtype=np.intp)
    for run in np.split(at_rest, np.flatnonzero(np.diff(at_rest) > 1) + 1):
        counts[run[speed[run].argmin()]] += wait  # once in each rest, where it is slowest
    places = np.repeat(places, counts)
    total = np.concatenate(((0.0,), np.cumsum(0.5 * (places[1:] + places[:-1]))))
    averaged: Array = (total[wait:] - total[:-wait]) / wait
    averaged[0], averaged[-1] = places[0], places[-1]
    passed: Array = step * np.arange(len(averaged), dtype=np.float64)
    return passed, averaged


def _top(
    controller: Controller, curve: Curve, at: Array, q: Array, slopes: Array, acceleration: Array
) -> tuple[Array, list[str]]:
    """(n,) the largest speed at each knot but for accelerations, and what limits it, in words."""
    names = controller.robot.names
    limit = np.broadcast_to(VELOCITY_SHARE * controller.box.velocity_limit, slopes.shape)
    words = [f"velocity of joint {i} ({name})" for i, name in enumerate(names)]
    top, which = top_speed(slopes, limit)
    ruling = [words[i] for i in which.tolist()]

    def slower(speed: Array, cause: list[str]) -> None:
        for i in np.flatnonzero(speed < top).tolist():
            top[i], ruling[i] = speed[i], cause[i]

    if controller.braking is not None:
        room = np.maximum(np.where(slopes > 0.0, *controller.box.room(q)), 0.0) + AT_LIMIT
        speed, which = top_speed(slopes, braking_speed(room, acceleration, controller.dt))
        slower(speed, [f"position of joint {i} ({names[i]})" for i in which.tolist()])
    if controller.tool_speed is not None:
        point = np.append(np.zeros(3) if controller.tool_speed.point is None else controller.tool_speed.point, 1.0)
        fast = [velocity_at(curve.tangent(t), curve.pose(t).dot(point)[:3]) for t in at.tolist()]
        speed, _ = top_speed(np.linalg.norm(fast, axis=1)[:, None], VELOCITY_SHARE * controller.tool_speed.limit)
        slower(speed, ["the tool's speed"] * len(top))
    if controller.joint_rows is not None:
        rows = [controller.joint_rows.own(x) for x in q]
        shares = [
            inf if r is None else VELOCITY_SHARE * _rows_allow(np.asarray(r.C).dot(s), r.lower, r.upper)
            for r, s in zip(rows, slopes, strict=True)
        ]
        slower(np.array(shares), ["rows"] * len(top))
    return top, ruling


def _rows_allow(y: Array, lower: Array, upper: Array) -> float:
    """The largest v with lower <= v y <= upper; rows that standing still violates are ignored."""
    above, below = np.where(upper >= 0.0, upper, inf), np.where(lower <= 0.0, -lower, inf)
    return float(np.minimum(_most(y, above), _most(-y, below)).min(initial=inf))


def top_speed(slopes: Array, limits: Array | float) -> tuple[Array, NDArray[np.intp]]:
    """(n,) the largest v with |q'_i v| <= limits_i for (n, m) slopes q', inf at rest; and (n,) the joint that rules.

    Limits are (n, m), or one number, positive or zero.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.where(slopes != 0.0, limits / np.abs(slopes), np.inf)
    which = speed.argmin(axis=1)
    return np.take_along_axis(speed, which[:, None], axis=1)[:, 0], which


def drivable(at: Array, positions: Array, slopes: Array, top: Array, acceleration: Array) -> Array:
    """(n,) the largest v^2 at each knot from which all later ones can be driven.

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
