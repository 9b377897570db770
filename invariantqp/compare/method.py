"""What a row of the comparison is: a way to joint velocities, what it is told, and what it makes of that.

Every row is told the same of the arm and of each tick. What a method cannot take is part of its row (`Takes`), and
reports print it. A method is a function of one tick, put in a loop by `laws.loop`; or a whole loop of its own.
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
# What a row says where its method has no place for something that it is told.
CANNOT = "cannot take it"


@dataclass(frozen=True)
class Takes:
    """What a method makes of what every row is told; CANNOT where it has no place for it.

    Attributes:
        posture: of the joint velocity towards the middle of the joint ranges, 1/s for arms with more than six joints.
        exact: of a point that is to be met exactly.
        limits: of the limits on joint positions and velocities.
        feedforward: of the target's own twist.
        damping: what it does near singularities.
    """

    posture: str
    exact: str
    limits: str
    damping: str
    feedforward: str = "added to the twist"


@dataclass(frozen=True, eq=False)
class Setting:
    """What every method is told of the arm and the loop before the first tick.

    Attributes:
        m: number of joints.
        dt: duration of a tick [s].
        point: (3,) the point of the tool where accuracy is asked for, in the tool frame [m].
        length: L, how many metres at that point a radian counts for.
        low: (m,) least joint positions.
        high: (m,) largest joint positions.
    """

    m: int
    dt: float
    point: Array
    length: float
    low: Array
    high: Array


class Question(NamedTuple):
    """What every method is told in one tick, in the tool frame, angular part first.

    Attributes:
        J: (6, m) joint twists.
        s: (6,) wanted twist.
        lower: (m,) least joint velocities.
        upper: (m,) largest joint velocities.
        posture: (m,) joint velocity wanted where the twist leaves joints free.
        C: (k, m) rows to be met exactly, k = 0 or 3.
        e: (k,) what they have to be.
        q: (m,) joint positions.
    """

    J: Array
    s: Array
    lower: Array
    upper: Array
    posture: Array
    C: Array
    e: Array
    q: Array

    @classmethod
    def plain(cls, J: Array, s: Array, lower: Array, upper: Array) -> Question:
        """A tick without posture and exact rows."""
        m = J.shape[1]
        return cls(J, s, lower, upper, np.zeros(m), np.zeros((0, m)), np.zeros(0), np.zeros(m))


Solve = Callable[[Question], Array]
UNKNOWN = np.full(6, np.nan)


@dataclass(frozen=True, eq=False)
class Method:
    """A row.

    Attributes:
        name: its name in tables and charts.
        family: the kind of method.
        why: what it is and where it comes from, in one line.
        takes: what it makes of what it is told.
        make: makes the function of a tick; None for a loop of its own.
        system: a whole control loop, (robot, law) to controller; None where `make` is all there is.
        problem: the problem of a tick without posture and exact rows whose exact answer it claims; "" for none.
        needs: Python modules that have to be installed; imported only where the loop is made.
        extra: the extra of this package that installs them; "" where none does.
        shown: whether the first table and the chart have it.
    """

    name: str
    family: Family
    why: str
    takes: Takes
    make: Callable[[Setting], Solve] | None = None
    system: MakeController | None = None
    problem: Literal["", "law", "least squares", "ridge", "damped"] = ""
    needs: tuple[str, ...] = ()
    extra: Literal["", "drake", "peers", "pin", "placo"] = ""
    shown: bool = True

    @property
    def installed(self) -> bool:
        """Whether every module that it needs is installed."""
        return all(map(is_installed, self.needs))

    def as_json(self) -> dict[str, Any]:
        """Its description in results.json."""
        row = {key: getattr(self, key) for key in ("name", "family", "why", "problem", "shown")}
        return {**row, "takes": asdict(self.takes)}


def answer(x: Array, method: str, solver: str = "") -> VelocitySolution:
    """A velocity (m,) as the answer of a tick; what else an answer says is not known of the method."""
    return VelocitySolution(np.asarray(x), method, Status.OK, "", (), UNKNOWN, 1.0, 0.0, 0.0, solver)


def posture_of(robot: Robot, law: LawSpec) -> tuple[Array, Array]:
    """The posture (m,) that every method is told, and the gain of each joint towards it (m,) [1/s]."""
    from invariantqp.control import controller

    return controller.posture_of(law.posture, law.posture_gain, robot)
