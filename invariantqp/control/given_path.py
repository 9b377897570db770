"""The path that a caller gives, as a curve: from a function of a parameter, or through poses."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.curve import Curve, by_length, curve_of, curve_of_samples
from invariantqp.control.measure import ToolMeasure
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, middle

# A path shorter than this, relative to the measure's length, stands still.
STILL = 1e-9
# A path that goes at this share of its mean speed nearly stands still: rounding decides which place is nearest there.
SLOW = 1e-3


class GivenPath(NamedTuple):
    """A path to drive along."""

    curve: Curve  # with the parameter that is driven: the caller's, or the length in the measure
    places: Array  # (n,) the caller's parameter at the knots of the curve
    slow: float  # a tangent of this size, in the measure, is that of a path that nearly stands still

    def place(self, at: float) -> float:
        """The caller's parameter at a place of the curve."""
        return float(np.interp(at, self.curve.at, self.places))

    def pose(self, place: float) -> Array:
        """(4, 4) the pose where the caller's parameter is `place`."""
        return self.curve.pose(float(np.interp(place, self.places, self.curve.at)))


def given_path(
    robot: Robot, measure: ToolMeasure, path: Any, end: float, times: ArrayLike | None, *, timed: bool
) -> GivenPath:
    """The path of a caller.

    Args:
        robot: whose tool is to follow it.
        measure: of its controller.
        path: a function of a parameter in [0, end] that returns poses, or (n, 4, 4) poses.
        end: of a function's parameter.
        times: (n,) the parameter of poses; None is their number, from 0. A function has its own.
        timed: whether the caller's parameter is the one that is driven; otherwise it is the length.

    Raises:
        BadInput: not a path, one that stands still, or times of a function.
    """
    J = robot.jacobian(middle(robot))

    def size(twist: Array, pose: Array) -> float:
        v = measure.root_for(J, pose).dot(twist)
        return sqrt(float(v.dot(v)))

    if callable(path):
        if times is not None:
            raise BadInput(
                "times", "times for a path that is a function", "none", "end=T and rate=1 time it in seconds."
            )
        last = arrays.number(end, "end", "the end of the path's parameter", positive=True)
        curve = curve_of(lambda at: arrays.pose(path(at), "path"), last, size, measure.length)
    else:
        poses = _poses(path)
        at = np.arange(len(poses), dtype=np.float64)
        if times is not None:
            at = arrays.vector(times, len(poses), "times")
            if not (np.diff(at) > 0.0).all():
                raise BadInput("times", "times that do not increase", "one for each pose, increasing")
        curve = curve_of_samples(at - at[0], poses)
    along, places = by_length(curve, size)
    if len(along.knots) < 2 or not along.end > STILL * measure.length:
        raise BadInput("path", "a path that stands still", "one along which the tool moves")
    if timed:
        return GivenPath(curve, curve.at, SLOW * along.end / curve.end)
    return GivenPath(along, places, SLOW)


def _poses(path: Any) -> Array:
    """(n, 4, 4) checked poses.

    Raises:
        BadInput: something else, or fewer than two.
    """
    several = path.ndim > 0 if isinstance(path, np.ndarray) else isinstance(path, Sequence)
    if not several or isinstance(path, (str, bytes)):
        raise BadInput("path", excerpt(path), "a function of a parameter, or poses (n, 4, 4)")
    if len(path) < 2:
        raise BadInput("path", f"{len(path)} poses", "two or more")
    return np.array([arrays.pose(T, f"path[{i}]") for i, T in enumerate(path)])
