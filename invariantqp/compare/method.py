"""What a row of the comparison is: a way to joint velocities, what it is given, and what it makes of that.

Every row is given the same of the arm and of each tick. What a method cannot take is part of its row (`Takes`), and
reports print it. A method is a function of one tick, put in a loop by `loop.MethodLaw`; or a whole loop of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from invariantqp.extras import is_installed
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import MakeController
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import Status, VelocitySolution

Family = Literal["invariant", "QP", "Moore-Penrose", "damped", "library"]
FAMILIES: tuple[Family, ...] = ("invariant", "QP", "Moore-Penrose", "damped", "library")
# Which extra of this package installs a module.
EXTRAS = {"pinocchio": "pin", "pink": "peers", "mink": "peers", "placo": "placo", "pydrake": "drake"}
# Names of the rows that charts, tables and sentences refer to.
OURS, OURS_PYTHON, HAND_WRITTEN = "invariantqp", "invariantqp (Python)", "hand-written loop"
LEAST_SQUARES, SCALED_LEAST_SQUARES = "least-squares QP", "QP with length and LM"
PENROSE, DLS = "Moore-Penrose", "DLS"
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


class Question(NamedTuple):
    """What every method is given in one tick, in the tool frame, angular part first."""

    J: Array  # (6, m) joint twists
    s: Array  # (6,) wanted twist
    lower: Array  # (m,) least joint velocities
    upper: Array  # (m,) largest joint velocities
    posture: Array  # (m,) joint velocity wanted where the twist leaves joints free
    C: Array  # (k, m) rows to be met exactly, k = 0 or 3
    e: Array  # (k,) what they have to be
    q: Array  # (m,) joint positions


Solve = Callable[[Question], Array]
UNKNOWN = np.full(6, np.nan)


@dataclass(frozen=True, eq=False)
class Method:
    """A row."""

    name: str  # in tables and charts
    family: Family
    why: str  # what it is and where it comes from, in one line
    takes: Takes
    make: Callable[[LoopSetting], Solve] | None = None  # makes the function of a tick
    system: MakeController | None = None  # or a whole control loop, (robot, law) to controller
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


def answer(x: Array, method: str, solver: str = "") -> VelocitySolution:
    """A velocity (m,) as the answer of a tick; what else an answer says is not known of the method."""
    return VelocitySolution(np.asarray(x), method, Status.OK, "", (), UNKNOWN, 1.0, 0.0, 0.0, solver)


def posture_of(robot: Robot, law: LawSpec) -> tuple[Array, Array]:
    """The posture (m,) that every method is given, and the gain of each joint towards it (m,) [1/s]."""
    from invariantqp.control import controller

    return controller.posture_of(law.posture, law.posture_gain, robot)
