"""`Robot`, the protocol that controllers need of an arm, and functions of its joint ranges and limits.

Joint positions q are (m,) [rad, length]; poses (4, 4) and twists (omega; v) are in the base frame.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from math import dist, inf, pi, sqrt
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.geometry.screws import angular_speeds
from invariantqp.systems.points import reach

T = TypeVar("T")

# A position or velocity limit as large as this counts as none [rad, m, rad/s, m/s].
UNLIMITED = 1e9
# Position limits of a hinge farther from zero than two whole turns [rad] are taken for degrees.
PLAUSIBLE_ANGLE = 4.0 * pi
# A pose farther away than this many times the arm's length is taken for millimetres: the mean of 1 and 1000 by ratio.
MAX_REACHES, MILLIMETRES_HINT = sqrt(1000.0), "Are these millimetres?"


class RobotState(NamedTuple):
    """Pose, Jacobian and error of an arm at joint positions q, in the base frame.

    Attributes:
        J: (6, m) joint twists.
        error: (6,) twist that takes the tool to its target in unit time; independent of the tool frame.
        pose: the tool pose, (4, 4) or an object with a (4, 4) `.homogeneous`.
    """

    J: Array
    error: Array
    pose: Any


class Robot(Protocol):
    """An arm between its base and its tool."""

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names, base first."""

    @property
    def position_lower(self) -> Array:
        """(m,) lower position limits, -inf where there is none."""

    @property
    def position_upper(self) -> Array:
        """(m,) upper position limits, inf where there is none."""

    @property
    def velocity_limit(self) -> Array:
        """(m,) velocity limits, positive, inf where there is none."""

    def pose(self, q: ArrayLike) -> Array:
        """(4, 4) pose of the tool."""

    def jacobian(self, q: ArrayLike) -> Array:
        """(6, m) joint twists as columns."""

    def origins(self, q: ArrayLike) -> Array:
        """(m, 3) a point of each joint's axis."""

    def target(self, pose: ArrayLike) -> Any:
        """A checked target pose in the form that `state` takes; a checked one is returned as it is."""

    def state(self, q: Array, target: Any) -> RobotState:
        """Joint twists, error twist and tool pose at a checked q, for a target from `target`."""

    def points(self, state: RobotState, target: Any, point: Array) -> tuple[Array, Array]:
        """The current and the target position of a point (3,) of the tool frame [length]."""

    def with_tool(self, offset: ArrayLike) -> Robot:
        """The same arm with its tool frame moved by a (4, 4) offset in the old tool frame."""


# Attributes that a robot must have.
ROBOT = ("names", "position_lower", "position_upper", "velocity_limit", "pose", "jacobian", "target", "state", "points")


# Those of robots whose joint positions are computed for a pose.
POSED_ROBOT = ("names", "position_lower", "position_upper", "pose", "jacobian")


def require_robot(robot: Robot, attributes: Sequence[str] = ROBOT) -> Robot:
    """The robot; raises BadInput for anything that lacks one of the attributes."""
    if isinstance(robot, type) or not all(hasattr(robot, name) for name in attributes):
        raise BadInput("robot", excerpt(robot), "a robot, such as load_robot returns")
    return robot


def cached_for(robot: Robot, name: str, make: Callable[[Robot], T]) -> T:
    """`make(robot)`, computed once for a robot of this library, which never changes, and each time for others."""
    if not isinstance(robot, Compared):
        return make(robot)
    cache: dict[str, Any] = vars(robot).setdefault("_cache", {})
    if name not in cache:
        cache[name] = make(robot)
    value: T = cache[name]
    return value


def middle(robot: Robot) -> Array:
    """(m,) the middle of each joint's range [rad, length]; 0, or the limit nearest it, where it has no bounds.

    Raises:
        BadInput: not a robot.
    """
    require_robot(robot, POSED_ROBOT)
    lower, upper = robot.position_lower, robot.position_upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    centre = 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0))
    return np.minimum(np.maximum(centre, lower), upper)


def joint_ranges(robot: Robot) -> tuple[Array, Array]:
    """(m,) lower and upper limits [rad, length]; without one, half a turn or half a unit of length from the middle.

    Raises:
        BadInput: not a robot.
    """
    mid = middle(robot)
    half = np.where(angular_speeds(robot.jacobian(mid)) > 0.0, np.pi, 0.5)
    low, high = robot.position_lower, robot.position_upper
    return np.where(np.isfinite(low), low, mid - half), np.where(np.isfinite(high), high, mid + half)


def whole_turns(J: Array) -> Array:
    """(m,) the joint displacement of a whole turn of each hinge of joint twists J (6, m); 0 of other joints."""
    speed, drift = angular_speeds(J), np.linalg.norm(J[3:], axis=0)
    hinge = (speed > 0.0) & (np.abs((J[:3] * J[3:]).sum(axis=0)) <= arrays.NEGLIGIBLE * speed * drift)
    return np.where(hinge, 2.0 * pi / np.where(hinge, speed, 1.0), 0.0)


def continuous_turns(lower: Array, upper: Array, J: Array) -> Array:
    """(m,) whole turns of continuous joints, hinges without position limits (m,); 0 of other joints."""
    return np.where(np.isinf(lower) & np.isinf(upper), whole_turns(J), 0.0)


def joint_displacement(start: Array, end: Array, turns: Array) -> Array:
    """(..., m) the displacement from joint positions to others, of continuous joints the shortest.

    An encoder of a continuous joint may read any of the positions that differ by whole turns.

    Args:
        start: (..., m) [rad, length].
        end: (..., m) [rad, length].
        turns: (m,) as `continuous_turns` returns them.
    """
    d = end - start
    return d - turns * np.round(d / np.where(turns > 0.0, turns, 1.0)) if turns.any() else d


def unwrapped(start: Array, positions: Array, turns: Array) -> Array:
    """(n, m) joint positions, of continuous joints shifted by whole turns to be near the ones before them.

    Args:
        start: (m,) joint positions before the first.
        positions: (n, m).
        turns: (m,) as `continuous_turns` returns them.
    """
    if not turns.any():
        return positions
    steps = np.diff(positions, axis=0, prepend=start[None])
    return positions - turns * np.cumsum(np.round(steps / np.where(turns > 0.0, turns, 1.0)), axis=0)


def joint_limits(m: int, lower: ArrayLike, upper: ArrayLike, speed: ArrayLike) -> tuple[Array, Array, Array]:
    """Position and velocity limits of m joints as arrays (m,)."""
    limits = []
    for name, value in (("position_lower", lower), ("position_upper", upper), ("velocity_limit", speed)):
        a = arrays.array(value, name, f"{m} limits, infinite where there is none")
        a = np.full(m, float(a)) if a.ndim == 0 else a.copy()
        if a.shape != (m,) or np.isnan(a).any():
            found = "NaN" if a.shape == (m,) else f"shape {a.shape}"
            raise BadInput(name, found, f"{m} limits, one a joint, infinite where there is none")
        limits.append(a)
    low, high, v_max = limits
    if (low > high).any():
        i = int((low > high).argmax())
        raise BadInput("position_lower", f"{low[i]:g} above {high[i]:g} at joint {i}", "lower <= upper for every joint")
    for name, a, none in (("position_lower", low, np.inf), ("position_upper", high, -np.inf)):
        if (a == none).any():
            raise BadInput(name, f"{none} at joint {int((a == none).argmax())}", f"numbers, or {-none} for no limit")
    if (v_max <= 0.0).any():
        i = int((v_max <= 0.0).argmax())
        locks = "JointLimits(velocity_limit=0) in limits=[...] locks a joint."
        raise BadInput("velocity_limit", f"{v_max[i]:g} at joint {i}", "positive limits", locks)
    return low, high, v_max


def plausible_distance(robot: Robot, J: Array, tip: Array) -> float:
    """The largest plausible distance [length] of a pose from the tool at `tip` (3,), given joint twists J (6, m) there.

    inf where no hinge moves the tool.
    """
    strokes = (robot.position_upper - robot.position_lower)[angular_speeds(J) == 0.0]
    length = reach(J, tip)
    return MAX_REACHES * (length + float(strokes.sum())) if length > 0.0 else inf


def require_plausible_distance(places: Array, tip: Array, most: float, argument: str) -> None:
    """Raise BadInput for positions (..., 3) farther than `most` [length] from a tool at `tip` (3,)."""
    if places.ndim == 1:
        away = dist(places.tolist(), tip.tolist())
    else:
        with np.errstate(over="ignore"):
            away = float(np.linalg.norm(places - tip, axis=-1).max())
    if away > most:
        raise BadInput(argument, _distance_in_words(away, most), "a pose in the arm's unit of length", MILLIMETRES_HINT)


def warn_if_implausible_pose(robot: Robot, argument: str, pose: Array) -> None:
    """Warn of the pose (4, 4) of a tool or a base that looks like millimetres."""
    mid, away = middle(robot), float(np.linalg.norm(pose[:3, 3]))
    most = plausible_distance(robot, robot.jacobian(mid), robot.pose(mid)[:3, 3])
    if away > most:
        warnings.warn(f"{argument}: {_distance_in_words(away, most)}. {MILLIMETRES_HINT}", UserWarning, stacklevel=3)


def warn_if_implausible_speed(speed: float, most: float, argument: str) -> None:
    """Warn of a tool speed limit [length/s] above `most`, which looks like millimetres."""
    if speed > most:
        times = f"{speed * MAX_REACHES / most:.3g} times the arm's length in a second"
        warnings.warn(f"{argument}: {speed:.4g} [length/s], {times}. {MILLIMETRES_HINT}", UserWarning, stacklevel=4)


def _distance_in_words(away: float, most: float) -> str:
    return f"a pose {away:.4g} [length] away, {away * MAX_REACHES / most:.3g} times the arm's length"


def warn_if_implausible_range(lower: Array, upper: Array, turns: NDArray[np.bool_], argument: str) -> None:
    """Warn of position limits (m,) that look like degrees; `turns` (m,) tells which joints are hinges."""
    largest = np.where(turns, np.maximum(*(np.where(np.isfinite(a), np.abs(a), 0.0) for a in (lower, upper))), 0.0)
    most = float(largest.max(initial=0.0))
    if most > PLAUSIBLE_ANGLE:
        turned = f"may turn to {most:.4g} rad, {most / (2.0 * pi):.3g} turns; are these degrees?"
        warnings.warn(f"{argument}: joint {int(largest.argmax())} {turned}", UserWarning, stacklevel=3)
