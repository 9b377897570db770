"""What a row of the comparison is, and the loop around those that are a function of one tick.

Every row is given the same of the arm and of each tick. What a method cannot take is part of its row (`Takes`), and
reports print it. A method is a whole control loop, or a function of one tick that `in_loop` puts in one: the same for
all of these, and as lean as one writes it by hand:

    s = gain log(T^-1 T_target) + feedforward,    x = clip(solve(J, s, limits, posture, exact rows))

J and s are in the tool frame, whose origin and axes are those of the robot's model, as in most scripts: by Pinocchio
where it is installed, so that nothing goes through the base frame of this library.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control import controller
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import tracking_gain
from invariantqp.extras import is_installed
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits import JointBox, accelerations
from invariantqp.velocity.measure import root_at
from invariantqp.velocity.solution import Status, VelocitySolution

Family = Literal["invariant", "QP", "Moore-Penrose", "damped", "library"]
FAMILIES: tuple[Family, ...] = ("invariant", "QP", "Moore-Penrose", "damped", "library")
# Which extra of this package installs a module.
EXTRAS = {"pinocchio": "pin", "pink": "peers", "mink": "peers", "placo": "placo", "pydrake": "drake"}
# Names of the rows that charts, tables and sentences refer to.
OURS, OURS_PYTHON, HAND_WRITTEN = "invariantqp", "invariantqp (Python)", "hand-written loop"
SCALED_LEAST_SQUARES = "QP with length and LM"
PENROSE, DLS = "Moore-Penrose", "DLS"
# lambda as scripts choose it, in mixed units of J, and in Lambda = lambda I of [DS] [m].
LAMBDA = 0.05
# The cost of a posture task in Pink's own examples, beside frame tasks of unit costs; a QP's weight is its square.
POSTURE_COST = 1e-3
# What a row says where its method has no place for something that it is given.
CANNOT = "cannot take it"


@dataclass(frozen=True)
class Takes:
    """What a method makes of what every row is given; CANNOT where it has no place for it."""

    posture: str  # the joint velocity towards the middle of the joint ranges, for arms with more than six joints
    exact: str  # a point that is to be met exactly
    limits: str  # the limits on joint positions and velocities
    damping: str  # what it does near singularities
    feedforward: str = "added to the twist"  # the target's own twist


class LoopSetting(NamedTuple):
    """What every method is given of the arm and the loop before the first tick."""

    m: int  # number of joints
    dt: float  # duration of a tick [s]
    point: Array  # (3,) the point of the tool where accuracy counts, in the tool frame [m]
    length: float  # L, how many metres at that point a radian counts for


class TickInputs(NamedTuple):
    """What every method is given in one tick, in the tool frame, angular part first."""

    J: Array  # (6, m) joint twists
    s: Array  # (6,) wanted twist
    lower: Array  # (m,) least joint velocities
    upper: Array  # (m,) largest joint velocities
    posture: Array  # (m,) joint velocity wanted where the twist leaves joints free
    C: Array  # (k, m) rows to be met exactly, k = 0 or 3
    e: Array  # (k,) what they have to be
    q: Array  # (m,) joint positions


Solve = Callable[[TickInputs], Array]


@dataclass(frozen=True, eq=False)
class Method:
    """A row."""

    name: str  # in tables and charts
    family: Family
    why: str  # what it is and where it comes from, in one line
    takes: Takes
    loop: MakeController  # its control loop, of robot and law
    needs: tuple[str, ...] = ()  # Python modules that have to be installed; imported where the loop is made
    shown: bool = True  # whether the first table and the chart have it

    @property
    def extra(self) -> str:
        """The extra of this package that installs what it needs."""
        return EXTRAS[self.needs[0]] if self.needs else ""

    @property
    def installed(self) -> bool:
        """Whether every module that it needs is installed."""
        return all(map(is_installed, self.needs))

    def as_json(self) -> dict[str, Any]:
        """Its description in results.json."""
        row = {key: getattr(self, key) for key in ("name", "family", "why", "shown")}
        return {**row, "takes": asdict(self.takes)}


def answer(x: Array, status: Status = Status.OK, reason: str = "") -> VelocitySolution:
    """A velocity (m,) as the answer of a tick; what else an answer says is not known of the method."""
    return VelocitySolution(np.asarray(x), "", status, reason, (), np.full(6, np.nan), 1.0, 0.0, 0.0, "")


def posture_of(robot: Robot, law: LawSpec) -> tuple[Array, Array]:
    """The posture (m,) that every method is given, and the gain of each joint towards it (m,) [1/s]."""
    return controller.posture_of(law.posture, law.posture_gain, robot)


def in_loop(make: Callable[[LoopSetting], Solve]) -> MakeController:
    """A control loop around the function of a tick that `make` makes."""
    return partial(MethodLaw, make=make)


class MethodLaw:
    """The loop around a function of a tick."""

    def __init__(self, robot: Robot, law: LawSpec, make: Callable[[LoopSetting], Solve]) -> None:
        """Of `law`, dt, gain, delay, acceleration_limit, point, length, posture, exact and position_margin count."""
        by_pinocchio = kinematics() != OURS and getattr(robot, "model", None) is not None
        self._robot = robot
        self._read = _read_by_pinocchio(robot) if by_pinocchio else _read_by_twists(robot)
        self._gain = tracking_gain(law.gain, law.dt, law.delay)
        point = np.asarray(law.point, np.float64)
        setting = LoopSetting(len(robot.names), law.dt, point, ToolMeasure(robot, point, law.length).length)
        self._solve = make(setting)
        self._middle, self._pull = posture_of(robot, law)
        limits = robot.position_lower, robot.position_upper, robot.velocity_limit
        self._box = JointBox(*limits, 1.0 / law.dt, law.position_margin)
        self._reach = AccelerationReach(law, setting.m)
        self._exact, self._point = law.exact is not None, point
        self._at_point = root_at(point, 1.0)[3:]
        self._none = np.zeros((0, setting.m)), np.zeros(0)

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever the method raises."""
        positions = arrays.vector(q, len(self._middle), "q")
        J, error, ahead, wanted = self._read(positions, self._robot.target(target), feedforward)
        C, e = self._none
        if self._exact:
            there = wanted[:3, :3].dot(self._point) + wanted[:3, 3]
            C = self._at_point.dot(J)
            e = self._gain * (there - self._point) + ahead[3:] + se3.cross(ahead[:3], there)
        lower, upper = self._reach.within(*self._box.at(positions))
        pull = self._pull * (self._middle - positions)
        tick = TickInputs(J, self._gain * error + ahead, lower, upper, pull, C, e, positions)
        x = np.minimum(np.maximum(self._solve(tick), lower), upper)
        return answer(self._reach.cut(x))


class AccelerationReach:
    """The velocities (m,) that acceleration limits leave after the `last` one commanded, zero at first."""

    def __init__(self, law: LawSpec, m: int) -> None:
        limit = law.acceleration_limit
        self._most = None if limit is None else law.dt * accelerations(limit, m)
        self.last: Array = np.zeros(m)

    def within(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Bounds (m,) cut to what is within reach: never empty, since an arm cannot do more."""
        if self._most is None:
            return lower, upper
        low, high = self.last - self._most, self.last + self._most
        return np.minimum(np.maximum(lower, low), high), np.minimum(np.maximum(upper, low), high)

    def cut(self, x: Array) -> Array:
        """A velocity cut to what is within reach, joint by joint; it is the last one from now on."""
        self.last, _ = self.within(x, x)
        return self.last


# What is read of an arm at q, with its target and feedforward, in the tool frame: joint twists (6, m), the twist to the
# target in unit time (6,), the target's own (6,), and its pose (4, 4).
ReadState = Callable[[Array, Any, Any], tuple[Array, Array, Array, Array]]


def kinematics() -> str:
    """The library whose functions they are; a time is to be read with it."""
    return "Pinocchio" if is_installed("pinocchio") else OURS


def _read_by_pinocchio(robot: Any) -> ReadState:
    from invariantqp.robots.pinocchio import pin

    model, data = robot.model, robot.model.createData()
    frame = model.getFrameId(robot.tool)

    def read(q: Array, target: Any, feedforward: Any) -> tuple[Array, Array, Array, Array]:
        pin.forwardKinematics(model, data, q)
        tool = pin.updateFramePlacement(model, data, frame)
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL).take(se3.SWAPPED, axis=0)
        gap = tool.actInv(target if isinstance(target, pin.SE3) else pin.SE3(pose_of(target)))
        ahead = np.zeros(6)
        if feedforward is not None:
            ahead = tool.actInv(pin.Motion(feedforward[3:], feedforward[:3])).vector.take(se3.SWAPPED)
        return J, pin.log6(gap).vector.take(se3.SWAPPED), ahead, gap.homogeneous

    return read


def _read_by_twists(robot: Robot) -> ReadState:
    def read(q: Array, target: Any, feedforward: Any) -> tuple[Array, Array, Array, Array]:
        sighting = robot.sight(q, target)
        back = se3.inverse(pose_of(sighting.pose), check=False)
        to_tool = se3.adjoint(back, check=False)
        ahead = np.zeros(6) if feedforward is None else to_tool.dot(feedforward)
        wanted = back.dot(pose_of(target))
        return to_tool.dot(sighting.J), to_tool.dot(sighting.error), ahead, wanted

    return read


def pose_of(target: Any) -> Array:
    """The (4, 4) pose of a target, which may be an array or the target object of a robot of this library."""
    pose = getattr(target, "homogeneous", getattr(target, "pose", target))
    return np.asarray(pose, dtype=np.float64)
