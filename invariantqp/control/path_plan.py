"""A joint motion along a path and how fast it may be driven: what a follower looks up in every tick.

Forward, v^2 at a knot is at most what lets every later knot be driven and the tool stop at the end (`path_speed`);
backward it is the same towards the start. Between knots v^2 is linear and the joint motion a cubic.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.curve import Poses, piece_of
from invariantqp.control.joint_path import AT_LIMIT, SHORTEST
from invariantqp.control.path_knot import Knot
from invariantqp.control.path_speed import drivable, smooth_speed, top_speed
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.velocity.limits import braking_speed

# Shares of the velocity and acceleration limits that a path is driven at; feedback needs the rest.
VELOCITY_SHARE = 0.998
ACCELERATION_SHARE = 0.965
# With a jerk but no acceleration, the path accelerates at this share of what the slowest joint could.
EASY_SHARE = 0.7
# Below this share of its top speed, what rules at a knot is the acceleration needed elsewhere.
RULED = 1.0 - 1e-6
ACCELERATION = "acceleration"


class PathPlan(NamedTuple):
    """A joint motion along a path, from a start to where it ends or is blocked.

    Attributes:
        at: the path's parameter at the knots, as a list.
        q: (n, m) joint positions there.
        slopes: (n, m) q'.
        forward: the largest v^2 at each knot, driven forward, as a list.
        backward: the same, driven backward.
        ruling: (n,) what limits the speed at each knot, in words.
        off: how far the tool is off the path at each knot, in the measure, as a list.
        ratio: how far from a singularity the arm is at each, as in `Knot`.
        blocked: why the path ends at the last knot, in words; "" where it does not.
        braking: the least path acceleration of which the joints are capable anywhere.
    """

    at: list[float]
    q: Array
    slopes: Array
    forward: list[float]
    backward: list[float]
    ruling: list[str]
    off: list[float]
    ratio: list[float]
    blocked: str
    braking: float

    @property
    def start(self) -> float:
        """Where it begins."""
        return self.at[0]

    @property
    def end(self) -> float:
        """Where it ends."""
        return self.at[-1]

    def leaves(self, at: float, most: float) -> bool:
        """Whether the tool is farther off the path than `most` on the piece at a place."""
        i = self.piece(at)
        return max(self.off[i], self.off[i + 1]) > most

    def piece(self, at: float) -> int:
        """The number of the piece at a place."""
        return piece_of(self.at, at)

    def nearest(self, at: float) -> int:
        """The number of the knot nearest a place."""
        i = self.piece(at)
        return i if at - self.at[i] < self.at[i + 1] - at else i + 1

    def joints(self, at: float) -> Array:
        """Joint positions (m,) at a place."""
        i = self.piece(at)
        h = self.at[i + 1] - self.at[i]
        u = (at - self.at[i]) / h
        a, b, c = u * u * (3.0 - 2.0 * u), h * u * (1.0 - u) * (1.0 - u), h * u * u * (1.0 - u)
        q: Array = (1.0 - a) * self.q[i] + a * self.q[i + 1] + b * self.slopes[i] - c * self.slopes[i + 1]
        return q

    def slope(self, at: float) -> Array:
        """(m,) the slope of the joint positions at a place."""
        i = self.piece(at)
        h = self.at[i + 1] - self.at[i]
        u = (at - self.at[i]) / h
        a, b, c = 6.0 * u * (1.0 - u) / h, (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
        slope: Array = a * (self.q[i + 1] - self.q[i]) + b * self.slopes[i] + c * self.slopes[i + 1]
        return slope

    def speeds(self, at: Array, *, back: bool = False) -> Array:
        """The largest speeds at places (k,); zero beyond the ends."""
        squares = np.interp(at, self.at, self.backward if back else self.forward, left=0.0, right=0.0)
        speeds: Array = np.sqrt(squares)
        return speeds

    def speed(self, at: float, dt: float, share: float = 1.0, *, back: bool = False) -> float:
        """The largest speed for a tick of dt [s] from a place on: what it lands on and its middle allow it.

        Of that speed `share` is driven.
        """
        knots, squares, sign = (self.at, self.backward, -1.0) if back else (self.at, self.forward, 1.0)
        i, passed, part = self.piece(at), inf, share * share
        while True:
            here, rate = self._square(i, at, back=back)
            here, rate = part * here, sign * part * rate
            root = rate * rate * dt * dt + 4.0 * here
            # v^2 = here + rate v dt on this piece, and at most what the knots before it allow
            v = min(passed, 0.5 * (rate * dt + sqrt(root)) if root > 0.0 else 0.0)
            j = i if back else i + 1
            if j in (0, len(knots) - 1) or v * dt <= sign * (knots[j] - at):
                break
            passed = min(passed, max(share * sqrt(squares[j]), sign * (knots[j] - at) / dt))
            i += -1 if back else 1
        v = max(0.0, min(v, sign * ((knots[0] if back else knots[-1]) - at) / dt))
        return min(v, share * self._limit(at + 0.5 * sign * dt * v, back=back))

    def _limit(self, at: float, *, back: bool) -> float:
        """The largest speed at a place; zero beyond the ends."""
        if not self.start <= at <= self.end:
            return 0.0
        return sqrt(max(self._square(self.piece(at), at, back=back)[0], 0.0))

    def _square(self, i: int, at: float, *, back: bool) -> tuple[float, float]:
        """The largest v^2 at a place, as piece i goes on, and its slope."""
        squares = self.backward if back else self.forward
        slope = (squares[i + 1] - squares[i]) / (self.at[i + 1] - self.at[i])
        return squares[i] + slope * (at - self.at[i]), slope


def plan_of(
    controller: Controller,
    curve: Poses,
    knots: list[Knot],
    blocked: str,
    fastest: float = inf,
    smooth: float | None = None,
) -> PathPlan:
    """The plan of knots; the tool stops at the first and the last of them.

    Args:
        controller: whose limits hold.
        curve: the path.
        knots: one or more.
        blocked: why the path ends at the last of them, in words; "" where it does not.
        fastest: the largest v that will be asked for.
        smooth: the largest acceleration along the path that will be asked for, where its jerk is limited; joints then
            have to leave room for all of it everywhere. None is no limit of jerk.
    """
    if len(knots) == 1:  # blocked from the start on
        knots = [knots[0], knots[0]._replace(at=knots[0].at + SHORTEST * curve.end)]
    acceleration = accelerations_of(controller)
    at = np.array([k.at for k in knots])
    q = np.array([k.q for k in knots])
    slopes = np.array([k.slope for k in knots])
    top, ruling = _top(controller, curve, at, q, slopes, acceleration)
    top = np.minimum(top, fastest)
    with np.errstate(divide="ignore"):
        braking = float(np.where(slopes != 0.0, acceleration / np.abs(slopes), inf).min())
    if smooth is not None and np.isfinite(braking):
        top = np.minimum(top, smooth_speed(at, q, slopes, acceleration, min(smooth, EASY_SHARE * braking)))
    final = 0.0 if np.isfinite(acceleration).any() else inf
    forward = drivable(at, q, slopes, top, acceleration, final)
    backward = drivable(at[-1] - at[::-1], q[::-1], -slopes[::-1], top[::-1], acceleration, final)[::-1]
    for i in np.flatnonzero(np.sqrt(forward) < RULED * top).tolist():
        ruling[i] = ACCELERATION
    return PathPlan(
        at=at.tolist(),
        q=q,
        slopes=slopes,
        forward=forward.tolist(),
        backward=backward.tolist(),
        ruling=ruling,
        off=[k.off for k in knots],
        ratio=[k.ratio for k in knots],
        blocked=blocked,
        braking=braking,
    )


def accelerations_of(controller: Controller) -> Array:
    """(m,) what a path may ask of the joints' acceleration, inf where there is no limit."""
    if controller.braking is None:
        return np.full(len(controller.robot.names), inf)
    acceleration: Array = ACCELERATION_SHARE * controller.braking.acceleration
    return acceleration


def _top(
    controller: Controller, curve: Poses, at: Array, q: Array, slopes: Array, acceleration: Array
) -> tuple[Array, list[str]]:
    """(n,) the largest speed at each knot but for accelerations, and what limits it, in words."""
    robot, names = controller.robot, controller.robot.names
    limit = np.broadcast_to(VELOCITY_SHARE * robot.velocity_limit, slopes.shape)
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
    limit = np.where(y > 0.0, np.where(upper >= 0.0, upper, inf), np.where(lower <= 0.0, -lower, inf))
    moving = y != 0.0
    return float((limit[moving] / np.abs(y[moving])).min()) if moving.any() else inf
