"""What a method of the comparison is, and what it is told about the arm before and during a run.

A method is either a function of (J, s, lower, upper), or a whole system with a control loop of its own. A method that
knows the joint limits keeps its answer inside them; the answer of every other method is clipped to them joint by joint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Literal, NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.runs.controllers import MakeController

# (J (6, m), s (6,), lower (m,), upper (m,)) to a joint velocity (m,); J and s are in the frame that the method names.
Solve = Callable[[Array, Array, Array, Array], Array]

Family = Literal["invariant", "Moore-Penrose", "damped", "QP", "system"]
FAMILIES: tuple[Family, ...] = ("invariant", "Moore-Penrose", "damped", "QP", "system")

# The problems that have an exact answer in `compare.exact.references`; "" where a method solves none of them.
ExactProblem = Literal[
    "",
    "law",
    "measured",
    "inertia",
    "pitch",
    "filter",
    "convexified",
    "least squares",
    "ridge",
    "least squares box",
    "weighted",
    "damped",
    "damped box",
]

# Inertia of a tool of one kilogram that is a ball with a radius of gyration of 5 cm [kg m^2; kg].
TOOL_INERTIA = np.repeat((0.0025, 1.0), 3)


@dataclass(frozen=True, eq=False)
class Setting:
    """What every method is told of the arm and the control loop before the first tick.

    Attributes:
        m: number of joints.
        dt: duration of a tick [s].
        pitch: h of the pitch forms [length/rad].
        point: (3,) the point of the tool where accuracy is asked for, in the frame of J of methods meant for the tool
            frame [length].
        length: L, how many units of length at that point a radian counts for [length/rad].
        joint_metric: (m, m) what counts as a short joint velocity, for arms with slides; None is the identity.
        inertia: (6,) diagonal of the tool's inertia in the tool frame.
        body: (4, 4) pose of the tool frame in the frame of J.
        unit: how many units of length of J make a metre.
    """

    m: int
    dt: float = 0.001
    pitch: float = 0.3
    point: Array = field(default_factory=lambda: np.zeros(3))
    length: float = 1.0
    joint_metric: Array | None = None
    inertia: Array = field(default_factory=TOOL_INERTIA.copy)
    body: Array = field(default_factory=lambda: np.eye(4))
    unit: float = 1.0


class Question(NamedTuple):
    """What is given to a method in one tick.

    Attributes:
        J: (6, m) joint twists in the method's frame.
        s: (6,) wanted twist in the same frame.
        lower: (m,) least joint velocities.
        upper: (m,) largest joint velocities.
    """

    J: Array
    s: Array
    lower: Array
    upper: Array


@dataclass(frozen=True, eq=False)
class Method:
    """One way to compute joint velocities from a twist.

    Attributes:
        name: its name in tables and charts.
        family: the kind of method.
        limits: "inside" if the method is told the limits, "clipped" if its answer is cut to them.
        why: what it is and where it comes from, in one line.
        make: makes a solver with its own workspace; None for a system that is no function of J and s.
        frame: the frame of J and s that the method is meant for; an invariant method gives the same answer in any.
        problem: the exact problem that its answer solves while no limit is active.
        limited: the exact problem that it solves, or that clipping approximates, while limits are active.
        system: a whole control loop, (robot, law) to controller; None for a method that `laws.baselines` puts in one.
        needs: Python modules that have to be installed.
        extra: the extra of this package that installs them.
        group: methods with the same group differ in a setting only.
    """

    name: str
    family: Family
    limits: Literal["inside", "clipped"]
    why: str
    make: Callable[[Setting], Solve] | None = None
    frame: Literal["base", "tool"] = "tool"
    problem: ExactProblem = ""
    limited: ExactProblem = ""
    system: MakeController | None = None
    needs: tuple[str, ...] = ()
    extra: Literal["", "compare", "peers"] = ""
    group: str = ""

    @property
    def installed(self) -> bool:
        """Whether every module that it needs is installed."""
        return all(find_spec(module) is not None for module in self.needs)

    def as_json(self) -> dict[str, str]:
        """Its description in results.json."""
        keys = ("name", "family", "limits", "why", "frame", "problem", "limited", "group")
        return {key: getattr(self, key) for key in keys}
