"""A tick along a path, all of it in the compiled core: place, speed, twist, law, and what is told.

The core drives as `path_driver` would in Python, or hands the tick back. It drives an arm that is on its path; pushes,
paths that are left or end short, and carried metrics are Python's.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.given_path import GivenPath
from invariantqp.control.joint_path import OFF_PATH
from invariantqp.control.path_pace import ASTRAY, ON_TIME, OVERRIDDEN, Pace
from invariantqp.control.path_plan import PathPlan
from invariantqp.control.path_report import ENDED, PAUSE, SETTLING, TURN
from invariantqp.control.path_solution import PathSolution
from invariantqp.control.path_state import PathState
from invariantqp.engine import core
from invariantqp.geometry.arrays import Array

# What rules where no knot of the plan does, as the core counts it: from -1 down; the last is a stop.
RULINGS = ("", ENDED, SETTLING, ASTRAY, OVERRIDDEN, ON_TIME)


class Course(NamedTuple):
    """A drive in the compiled core.

    Attributes:
        controller: whose law answers.
        path: the path.
        plan: the joint motion along it.
        pace: how fast it is meant to be driven.
        numbers: all of it as the core takes it; empty for a drive that the core does not have.
    """

    controller: Controller
    path: GivenPath
    plan: PathPlan
    pace: Pace
    numbers: Array

    def step(
        self,
        q: ArrayLike,
        state: PathState,
        velocity: ArrayLike | None,
        override: float,
        *,
        paused: bool,
        back: bool,
    ) -> tuple[PathSolution, PathState] | None:
        """One tick and the state after it; None where Python has to drive, or to say what is wrong.

        Args:
            q: (m,) joint positions.
            state: after the tick before.
            velocity: (m,) joint velocity now; None is that of the state.
            override: share of the speed asked for.
            paused: whether the tool is to come to rest.
            back: whether it is to go backward, once at rest.
        """
        if core is None or not self.numbers.size:
            return None
        loop = self.controller
        found: Any = core.drive(loop.compiled, loop.kept, self.numbers, q, state, velocity, override, paused, back)
        if found is None:
            return None
        answer, after, at, speed, across, rule, status, more = found
        if more:
            answer = loop.told(answer, q)
        ruling = self.plan.ruling[rule] if rule >= 0 else RULINGS[rule] or (PAUSE if paused else TURN)
        reason = "" if status == "done" else answer.reason
        rate = self.pace.rate
        lag = None if rate is None else after.ticks * self.pace.dt - at / rate
        return PathSolution(answer.velocity, status, reason, at, speed, ruling, lag, across, answer), after


def course_of(controller: Controller, path: GivenPath, plan: PathPlan, pace: Pace, tolerance: float) -> Course:
    """A drive as the compiled core takes it.

    Args:
        controller: whose law answers.
        path: the path.
        plan: the joint motion along it.
        pace: how fast it is meant to be driven.
        tolerance: how far from the path's end a tool that is there may be.
    """
    if core is None or controller.compiled is None or controller.measure.carried is not None:
        return Course(controller, path, plan, pace, np.empty(0))
    curve = path.curve
    cut = bool(plan.blocked) or plan.off[-1] > OFF_PATH * controller.measure.length
    sizes = plan.q.shape[1], len(plan.at), len(curve.at)
    asked = pace.rate or 0.0, pace.acceleration, pace.jerk or 0.0, tolerance
    knots = plan.at, plan.forward, plan.backward, plan.off, plan.ratio, plan.q.ravel(), plan.slopes.ravel()
    poses = curve.at, path.places, curve.poses.ravel(), curve.cubics.ravel()
    numbers = np.concatenate(((*sizes, path.slow, *asked, plan.braking, cut), *knots, *poses))
    return Course(controller, path, plan, pace, numbers)
