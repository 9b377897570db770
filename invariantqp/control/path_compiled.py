"""A tick along a path, all of it in the compiled core: place, speed, twist, law, and what is told.

The core drives as `path_driver` would in Python, or hands the tick back. It drives an arm that is on its path; pushes,
and paths that are left or end short, are Python's.
"""

from __future__ import annotations

from typing import Any

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


def compiled_course(controller: Controller, path: GivenPath, plan: PathPlan, pace: Pace, tolerance: float) -> Array:
    """The fixed numbers of a drive for `compiled_drive`; empty for a drive that the core does not have.

    Args:
        controller: whose law answers.
        path: the path.
        plan: the joint motion along it.
        pace: how fast it is meant to be driven.
        tolerance: how far from the path's end a tool that is there may be.
    """
    if core is None or controller.compiled is None:
        return np.empty(0)
    curve = path.curve
    cut = bool(plan.blocked) or plan.off[-1] > OFF_PATH * controller.measure.length
    sizes = plan.q.shape[1], len(plan.at), len(curve.at)
    asked = pace.rate or 0.0, pace.acceleration, pace.jerk or 0.0, tolerance
    numbers = *sizes, path.slow, *asked, plan.braking, cut
    joints = plan.q.ravel(), plan.slopes.ravel()
    poses = curve.at, path.places, curve.poses.ravel(), curve.cubics.ravel()
    return np.concatenate((numbers, plan.at, plan.forward, plan.backward, plan.off, plan.ratio, *joints, *poses))


def compiled_drive(
    controller: Controller,
    course: Array,
    plan: PathPlan,
    pace: Pace,
    q: ArrayLike,
    state: PathState,
    velocity: ArrayLike | None,
    *,
    override: float,
    paused: bool,
    back: bool,
) -> tuple[PathSolution, PathState] | None:
    """The core's answer and the state after it; None where Python has to drive, or to say what is wrong.

    Args:
        controller: whose law answers.
        course: from `compiled_course`.
        plan: the joint motion along the path.
        pace: how fast it is meant to be driven.
        q: (m,) joint positions.
        state: after the tick before.
        velocity: (m,) joint velocity now; None is that of the state.
        override: share of the speed asked for.
        paused: whether the tool is to come to rest.
        back: whether it is to go backward, once at rest.
    """
    if core is None or not len(course):
        return None
    found: Any = core.drive(controller.compiled, course, q, state, velocity, override, paused, back)
    if found is None:
        return None
    fields, kept, at, speed, across, rule, status = found
    after = PathState._make((*kept, state.ticks + 1))
    answer = controller.followed(fields, after.velocity, q)
    ruling = plan.ruling[rule] if rule >= 0 else RULINGS[rule] or (PAUSE if paused else TURN)
    reason = "" if status == "done" else answer.reason
    lag = None if pace.rate is None else after.ticks * pace.dt - at / pace.rate
    return PathSolution(answer.velocity, status, reason, at, speed, ruling, lag, across, answer), after
