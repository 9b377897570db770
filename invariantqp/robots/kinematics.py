"""What a controller needs to know of an arm: names, limits, tool pose, joint twists. `Chain` has it.

Joint positions q are (m,) [rad, length]; poses (4, 4) and twists (omega; v) are in the base frame.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
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

# A position or velocity limit as large as this is read as none [rad, m, rad/s, m/s].
UNLIMITED = 1e9
# Position limits of a joint that turns, this far from zero [rad], two whole turns, are questioned.
QUESTIONED_TURN = 4.0 * pi
# A pose is never so many times the arm's length away: this is halfway from one to a thousand, as in millimetres.
FAR_AWAY, MILLIMETRES = sqrt(1000.0), "Are these millimetres?"


class Sighting(NamedTuple):
    """An arm in one state, in the base frame, and how far it is from its target.

    Attributes:
        J: (6, m) joint twists.
        error: (6,) twist that takes the tool to its target in unit time; the same whatever frame the tool has.
        pose: the tool pose, (4, 4) or with such a `.homogeneous`, in the form that `points` takes.
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
        """(m, 3) where each joint is: a point of its axis, to draw the arm by."""

    def target(self, pose: ArrayLike) -> Any:
        """A target pose, checked once, in the form that `sight` takes fastest; given such a target, the same."""

    def sight(self, q: Array, target: Any) -> Sighting:
        """Joint twists and tool error at a checked q, for what `target` returned."""

    def points(self, sighting: Sighting, target: Any, point: Array) -> tuple[Array, Array]:
        """Where a point (3,) of the tool frame is, and where it should be [length]."""

    def with_tool(self, offset: ArrayLike) -> Robot:
        """The same arm with its tool frame moved by a (4, 4) offset in the old tool frame."""


# What a robot is known by.
ROBOT = ("names", "position_lower", "position_upper", "velocity_limit", "pose", "jacobian", "target", "sight", "points")


def require_robot(robot: Robot) -> Robot:
    """The robot itself, once it is seen to be one and not a robot's name, for instance."""
    if isinstance(robot, type) or not all(hasattr(robot, name) for name in ROBOT):
        raise BadInput("robot", excerpt(robot), "a robot, such as load_robot returns")
    return robot


def remembered(robot: Robot, name: str, make: Callable[[Robot], T]) -> T:
    """`make(robot)`, computed once: the frozen robots of this library never change; of others, computed each time."""
    if not isinstance(robot, Compared):
        return make(robot)
    kept: dict[str, Any] = vars(robot).setdefault("_remembered", {})
    if name not in kept:
        kept[name] = make(robot)
    found: T = kept[name]
    return found


def middle(robot: Robot) -> Array:
    """The middle of each joint's range; 0, or the limit nearest it, where the range is not bounded."""
    lower, upper = robot.position_lower, robot.position_upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    centre = 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0))
    return np.minimum(np.maximum(centre, lower), upper)


def joint_ranges(robot: Robot) -> tuple[Array, Array]:
    """(m,) the limits, or a turn about the middle, or a unit of length, of joints that have none."""
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


def far_away(robot: Robot, J: Array, tip: Array) -> float:
    """How far away from its tool at `tip` (3,), with joint twists J (6, m) there, an arm's poses are believed [length].

    inf where no hinge moves the tool, and no length is the arm's.
    """
    ways = (robot.position_upper - robot.position_lower)[angular_speeds(J) == 0.0]
    length = reach(J, tip)
    return FAR_AWAY * (length + float(ways.sum())) if length > 0.0 else inf


def refuse_far(places: Array, tip: Array, far: float, argument: str) -> None:
    """Refuse places (..., 3) of poses that are farther from a tool at `tip` (3,) than is believed."""
    if places.ndim == 1:
        away = dist(places.tolist(), tip.tolist())
    else:
        with np.errstate(over="ignore"):
            away = float(np.linalg.norm(places - tip, axis=-1).max())
    if away > far:
        raise BadInput(argument, _far(away, far), "a pose in the arm's unit of length", MILLIMETRES)


def question_pose(robot: Robot, argument: str, pose: Array) -> None:
    """Warn of a pose (4, 4) beside an arm, of its tool or its base, that looks like millimetres."""
    mid, away = middle(robot), float(np.linalg.norm(pose[:3, 3]))
    far = far_away(robot, robot.jacobian(mid), robot.pose(mid)[:3, 3])
    if away > far:
        warnings.warn(f"{argument}: {_far(away, far)}. {MILLIMETRES}", UserWarning, stacklevel=3)


def question_speed(speed: float, far: float, argument: str) -> None:
    """Warn of a limit of a tool's speed that looks like millimetres: farther in a second than poses are believed."""
    if speed > far:
        times = f"{speed * FAR_AWAY / far:.3g} times the arm's length in a second"
        warnings.warn(f"{argument}: {speed:.4g} [length/s], {times}. {MILLIMETRES}", UserWarning, stacklevel=4)


def _far(away: float, far: float) -> str:
    return f"a pose {away:.4g} [length] away, {away * FAR_AWAY / far:.3g} times the arm's length"


def question_range(lower: Array, upper: Array, turns: NDArray[np.bool_], argument: str) -> None:
    """Warn of position limits (m,) that look like degrees; `turns` (m,) says which joints turn."""
    far = np.where(turns, np.maximum(*(np.where(np.isfinite(a), np.abs(a), 0.0) for a in (lower, upper))), 0.0)
    most = float(far.max(initial=0.0))
    if most > QUESTIONED_TURN:
        turned = f"may turn to {most:.4g} rad, {most / (2.0 * pi):.3g} turns; are these degrees?"
        warnings.warn(f"{argument}: joint {int(far.argmax())} {turned}", UserWarning, stacklevel=3)
