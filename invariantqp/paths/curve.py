"""The tool path as a curve in SE(3), of a function or through poses: a pose and a tangent at every place.

    P(at) = exp(u c1 + u^2 c2 + u^3 c3) P_i,   u = (at - at_i) / (at_i+1 - at_i)        between knots i and i + 1
    tangent = dP/d(at) P^-1 as a twist, base frame

The cubics have the pose and the tangent of the path at both of their knots: the curve is exact at knots, and its error
between two falls with the fourth power of their distance. It is the same curve in every frame of base and tool.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from math import factorial, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.measure import ToolMeasure
from invariantqp.control.target import Target, checked_target, displacement_to, met_by, nearest_pose, partial_target
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle

PoseAt = Callable[[float], Array]
SizeAt = Callable[[Array, Array], float]
DisplacementTo = Callable[[Array, Array], Array]

# Tolerance of the curve of a function, and of the joint path at a knot, relative to the measure's length: a micrometre
# for a metre. The curve has so many intervals at least, halved until that is met or they are this share of the path,
# within which a corner is rounded.
CURVE_TOLERANCE, MIN_INTERVALS = 1e-6, 128
# Tangents of a function are differences over this share of its range: rounding and truncation errors are about equal.
DIFFERENCE_SHARE = 1e-4
# A share of the usual speed that counts as standing still: of a path, of joints at its start and end, of a tool moved
# along a singular direction.
SLOW_SHARE = 1e-3


class Curve(NamedTuple):
    """Cubics between knots."""

    at: Array  # (n + 1,) the parameter at the knots, increasing
    poses: Array  # (n + 1, 4, 4) poses there
    cubics: Array  # (n, 3, 6) c1, c2, c3 of each piece
    knots: list[float]  # `at` as a list, which bisection searches faster
    part: Target | None = None  # the part of the poses that counts, None for all

    @property
    def end(self) -> float:
        """The parameter at the last knot."""
        return self.knots[-1]

    @property
    def size(self) -> int:
        """The number of directions of a twist that count."""
        return 6 if self.part is None else self.part.size

    def target(self, robot: Robot, at: float) -> Any:
        """The target of a robot's tool at a place: a `Target`, or a pose in the form of `robot.target`."""
        T = self.pose(at)
        return robot.target(T) if self.part is None else met_by(self.part, T)

    def pose(self, at: float) -> Array:
        """(4, 4) the pose at a place; beyond an end, that end's."""
        at = min(max(at, self.knots[0]), self.knots[-1])
        i = piece_of(self.knots, at)
        u = (at - self.knots[i]) / (self.knots[i + 1] - self.knots[i])
        T: Array = se3.exp(np.array((u, u * u, u * u * u)).dot(self.cubics[i]), check=False).dot(self.poses[i])
        return T

    def tangent(self, at: float) -> Array:
        """(6,) the twist per unit of the parameter at a place, base frame; none beyond the ends."""
        if not self.knots[0] <= at <= self.knots[-1]:
            return np.zeros(6)
        i = piece_of(self.knots, at)
        h = self.knots[i + 1] - self.knots[i]
        u = (at - self.knots[i]) / h
        (there, rate) = np.array(((u, u * u, u * u * u), (1.0 / h, 2.0 * u / h, 3.0 * u * u / h))).dot(self.cubics[i])
        power: Array = rate
        tangent: Array = rate
        for k in (2, 3, 4):  # the derivative of exp: the sum of ad^k / (k + 1)!, of which a piece needs no more
            power = se3.bracket(there, power, check=False)
            tangent = tangent + power / factorial(k)
        return tangent


def piece_of(knots: list[float], at: float) -> int:
    """The index of the piece between increasing knots; places beyond the ends are on the first or last."""
    return bisect_right(knots, at, 1, len(knots) - 1) - 1


def curve_through(at: Array, poses: Array, tangents: Array, part: Target | None = None) -> Curve:
    """The curve with poses (n + 1, 4, 4) and tangents (n + 1, 6), base frame, at increasing parameters (n + 1,).

    With `part` it may jump at knots in the free directions, and moves least in them in between.
    """
    displacement = displacement_function(part)
    cubics = np.empty((len(at) - 1, 3, 6))
    for i, h in enumerate(np.diff(at).tolist()):
        d = displacement(poses[i], poses[i + 1])
        first, last = h * tangents[i], h * tangents[i + 1]
        # The inverse of the derivative of exp, at the far end of the piece.
        once = se3.bracket(d, last, check=False)
        last = last - 0.5 * once + se3.bracket(d, once, check=False) / 12.0
        cubics[i] = first, 3.0 * d - 2.0 * first - last, first + last - 2.0 * d
    return Curve(at, poses, cubics, at.tolist(), part)


def displacement_function(part: Target | None) -> DisplacementTo:
    """The function of two poses (4, 4) that returns the twist (6,) from one to the part of the other that counts."""
    return se3.displacement if part is None else partial(displacement_to, part)


def curve_of_samples(at: Array, poses: Array, part: Target | None = None) -> Curve:
    """The curve through poses; the tangent at each is that of the parabola through it and its neighbours."""
    n = len(at)
    h = np.diff(at)
    d = np.array([displacement_function(part)(a, b) for a, b in pairwise(poses)])
    mean = d / h[:, None]  # each piece's mean twist, which is that of its middle
    tangents = np.empty((n, 6))
    if n == 2:
        tangents[:] = mean[0]
    else:
        tangents[1:-1] = (h[1:, None] * mean[:-1] + h[:-1, None] * mean[1:]) / (h[:-1] + h[1:])[:, None]
        tangents[0] = mean[0] + (mean[0] - mean[1]) * h[0] / (h[0] + h[1])
        tangents[-1] = mean[-1] + (mean[-1] - mean[-2]) * h[-1] / (h[-1] + h[-2])
    return curve_through(at, poses, tangents, part)


def straight_lines(at: Array, poses: Array, part: Target | None = None) -> PoseAt:
    """The function of straight lines from pose to pose, each at one twist, that turns at the poses."""
    knots = at.tolist()
    displacements = [displacement_function(part)(a, b) for a, b in pairwise(poses)]

    def pose(t: float) -> Array:
        i = piece_of(knots, t)
        T: Array = se3.exp((t - knots[i]) / (knots[i + 1] - knots[i]) * displacements[i], check=False).dot(poses[i])
        return T

    return pose


def curve_of(pose: PoseAt, end: float, size: SizeAt, length: float, part: Target | None = None) -> Curve:
    """The curve of a function on [0, end], within CURVE_TOLERANCE.

    `size` returns the size of a twist (6,) of a tool at a pose (4, 4) in the measure, whose L is `length`.
    """
    step, finest, tolerance, displacement = (
        DIFFERENCE_SHARE * end,
        CURVE_TOLERANCE * end,
        CURVE_TOLERANCE * length,
        displacement_function(part),
    )
    knots: dict[float, tuple[Array, Array]] = {}

    def knot(t: float) -> tuple[Array, Array]:
        if t not in knots:
            knots[t] = pose(t), _tangent(pose, t, step, end, displacement)
        return knots[t]

    open_pieces = [(end * i / MIN_INTERVALS, end * (i + 1) / MIN_INTERVALS) for i in range(MIN_INTERVALS)]
    while open_pieces:
        a, b = open_pieces.pop()
        (A, s), (B, t) = knot(a), knot(b)
        middle = 0.5 * (a + b)
        truth = knot(middle)[0]
        guess = curve_through(np.array((a, b)), np.array((A, B)), np.array((s, t)), part).pose(middle)
        off = displacement(truth, guess)
        if size(off, truth) > tolerance and b - a > finest:
            open_pieces += [(a, middle), (middle, b)]
    at = np.array(sorted(knots))
    poses, tangents = zip(*(knots[t] for t in at.tolist()), strict=True)
    return curve_through(at, np.array(poses), np.array(tangents), part)


def by_length(curve: Curve, size: SizeAt) -> tuple[Curve, Array]:
    """The curve parameterized by its length, with `size` as in `curve_of`; and the old parameter at its knots.

    Pieces on which the tool stands still are left out.
    """
    tangents = np.array([curve.tangent(t) for t in curve.knots])
    speed = np.array([size(s, T) for s, T in zip(tangents, curve.poses, strict=True)])
    middle = [0.5 * (a + b) for a, b in zip(curve.knots, curve.knots[1:], strict=False)]
    speed_between = np.array([size(curve.tangent(t), curve.pose(t)) for t in middle])
    # Simpson's rule on each piece.
    lengths = np.diff(curve.at) * (speed[:-1] + 4.0 * speed_between + speed[1:]) / 6.0
    total = float(lengths.sum())
    kept = np.append(True, lengths > arrays.ROUNDING * total)
    at = np.append(0.0, np.cumsum(lengths))[kept]
    # Where the old parameter stands still the tangent is the direction in which the tool sets out or arrives.
    slow = speed <= CURVE_TOLERANCE * speed.max()
    nearest = np.where(np.arange(len(speed)) < len(speed) - 1, 1, -1)
    for i in np.flatnonzero(slow & kept).tolist():
        j = min(max(i + int(nearest[i]), 0), len(speed) - 1)
        tangents[i] = np.sign(nearest[i]) * displacement_function(curve.part)(curve.poses[i], curve.poses[j])
        speed[i] = size(tangents[i], curve.poses[i])
    tangents = tangents / np.where(speed > 0.0, speed, 1.0)[:, None]
    return curve_through(at, curve.poses[kept], tangents[kept], curve.part), curve.at[kept]


def _tangent(pose: PoseAt, t: float, step: float, end: float, displacement: DisplacementTo) -> Array:
    """(6,) the derivative of a function of poses, by second-order differences."""
    if t - step >= 0.0 and t + step <= end:
        return displacement(pose(t - step), pose(t + step)) / (2.0 * step)
    if t + 2.0 * step > end:
        step = -step
    near, far = (displacement(pose(t), pose(t + k * step)) for k in (1, 2))
    tangent: Array = (4.0 * near - far) / (2.0 * step)
    return tangent


class ParametrisedPath(NamedTuple):
    """A curve, and the parameter of its caller."""

    curve: Curve  # by the caller's parameter, or by length in the measure
    places: list[float]  # (n,) the caller's parameter at the knots of the curve
    slow: float  # size of the tangent of a path that nearly stands still, in the measure

    def place(self, at: float) -> float:
        """The caller's parameter at a place of the curve."""
        return _between(self.curve.knots, self.places, at)

    def pose(self, place: float) -> Array | Target:
        """(4, 4) the pose where the caller's parameter is `place`; a `Target` where something is free."""
        T = self.curve.pose(_between(self.places, self.curve.knots, place))
        return T if self.curve.part is None else met_by(self.curve.part, T)


def _between(knots: list[float], values: list[float], at: float) -> float:
    """Linear interpolation of values at increasing knots; constant beyond the ends."""
    i = piece_of(knots, at)
    share = (at - knots[i]) / (knots[i + 1] - knots[i])
    share = 0.0 if share < 0.0 else min(share, 1.0)
    return (1.0 - share) * values[i] + share * values[i + 1]


def parametrised_path(
    robot: Robot,
    measure: ToolMeasure,
    path: Any,
    end: float,
    times: ArrayLike | None,
    *,
    timed: bool,
    corners: bool = False,
) -> ParametrisedPath:
    """The path of a caller.

    Args:
        robot: whose tool is to follow it.
        measure: of its controller.
        path: a function of a parameter in [0, end] that returns poses, or (n, 4, 4) poses; or `Target` and points (3,)
            in place of poses, all with the same left free.
        end: of a function's parameter.
        times: (n,) the parameter of poses; None is their number, from 0. A function has its own.
        timed: whether the curve keeps the caller's parameter; otherwise it has its length.
        corners: whether straight lines join the poses, not a smooth curve.

    Raises:
        BadInput: not a path, one that stands still, or times or corners of a function.
    """
    J = robot.jacobian(middle(robot))
    last = arrays.number(end, "end", "the end of the path's parameter", positive=True)

    def size(twist: Array, pose: Array) -> float:
        v = measure.root_for(J, pose, part=part).dot(twist)
        return sqrt(float(v.dot(v)))

    if callable(path):
        if times is not None:
            raise BadInput(
                "times", "times for a path that is a function", "none", "end=T and rate=1 time it in seconds."
            )
        if corners:
            raise BadInput("corners", "True for a path that is a function", "False", "It has its own.")
        part = _part_of(path(0.0), "path")
        curve = curve_of(lambda at: _pose_of(path(at), part, "path"), last, size, measure.length, part)
    else:
        poses, part = _poses(path)
        at = np.arange(len(poses), dtype=np.float64)
        if times is not None:
            at = arrays.vector(times, len(poses), "times")
            if not (np.diff(at) > 0.0).all():
                raise BadInput("times", "times that do not increase", "one for each pose, increasing")
        at = at - at[0]
        if corners:
            curve = curve_of(straight_lines(at, poses, part), float(at[-1]), size, measure.length, part)
        else:
            curve = curve_of_samples(at, poses, part)
    along, places = by_length(curve, size)
    if len(along.knots) < 2 or not along.end > arrays.NEGLIGIBLE * measure.length:
        raise BadInput("path", "a path that stands still", "one along which the tool moves")
    if timed:
        return ParametrisedPath(curve, curve.knots, SLOW_SHARE * along.end / curve.end)
    return ParametrisedPath(along, places.tolist(), SLOW_SHARE)


def _part_of(first: Any, name: str) -> Target | None:
    """The part of a path that counts, by its first pose; None for all."""
    return None if partial_target(first) is None else checked_target(first, name)


def _pose_of(given: Any, part: Target | None, name: str) -> Array:
    """(4, 4) a pose, checked; of a target that leaves something free, any pose that meets it."""
    if part is None:
        return arrays.pose(given, name)
    target = checked_target(given, name)
    if met_by(part, np.eye(4)) != met_by(target, np.eye(4)):
        expected = "a target like the first one: the same left free, the same tool_point and tool_axis"
        raise BadInput(name, excerpt(given), expected)
    return nearest_pose(target, np.eye(4))


def _poses(path: Any) -> tuple[Array, Target | None]:
    """(n, 4, 4) checked poses, and the part of them that counts.

    Raises:
        BadInput: no poses, or fewer than two.
    """
    several = path.ndim > 0 if isinstance(path, np.ndarray) else isinstance(path, Sequence)
    if not several or isinstance(path, (str, bytes)):
        raise BadInput("path", excerpt(path), "a function of a parameter, poses (n, 4, 4), points (n, 3) or targets")
    if len(path) < 2:
        raise BadInput("path", f"{len(path)} poses", "two or more")
    part = _part_of(path[0], "path[0]")
    return np.array([_pose_of(T, part, f"path[{i}]") for i, T in enumerate(path)]), part
