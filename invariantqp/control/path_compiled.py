"""A tick along a path, all of it in the compiled core: place, speed, twist, law, and what is told.

The core drives as `path_driver` would in Python, or hands the tick back. It drives an arm that is on its path; pushes,
paths that are left or end short, and carried metrics are Python's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.given_path import GivenPath
from invariantqp.control.joint_path import OFF_PATH
from invariantqp.control.path_orders import PAUSE, TURN
from invariantqp.control.path_pace import ASTRAY, ON_TIME, OVERRIDDEN, Pace
from invariantqp.control.path_plan import PathPlan
from invariantqp.control.path_report import BACK, ENDED, SETTLING
from invariantqp.control.path_solution import PathSolution
from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import Status

if TYPE_CHECKING:
    from invariantqp.engine import Loop

# What rules where no knot of the plan does, as the core counts it: from the last on.
RULINGS = (TURN, PAUSE, BACK, ENDED, SETTLING, ASTRAY, OVERRIDDEN, ON_TIME)
# A tick by the core, for a Course, whose state and memory it writes, and what `PathDriver.step` is given; then whether
# the tool is to come to rest, and to go backward. The solution, and whether there are words to add to it; None where
# Python has to drive, or to say what is wrong with an argument.
compiled_drive: Callable[..., tuple[PathSolution, bool] | None] = getattr(core, "drive", lambda *_: None)
if core is not None:
    core.tell_as(PathSolution, Status)


class Course(NamedTuple):
    """A drive as the compiled core takes it."""

    loop: Loop  # of the controller
    kept: Array  # its memory
    state: Array  # of the drive; the numbers of its `PathState`
    numbers: Array  # path, plan and pace
    rulings: tuple[str, ...]  # what rules, in words: at each knot of the plan, then RULINGS


def course_of(
    controller: Controller,
    path: GivenPath,
    plan: PathPlan,
    pace: Pace,
    overrides: tuple[float, float],
    tolerance: float,
    state: Array,
) -> Course | None:
    """A drive as the compiled core takes it; None for one that it does not have.

    The plan is for overrides above the first and up to the second of `overrides`. `tolerance` is how far from the
    path's end a tool that is there may be; ticks write `state` (11 + 2 m,) of the drive.
    """
    if core is None or controller.compiled is None or controller.measure.carried is not None:
        return None
    curve = path.curve
    cut = bool(plan.blocked) or plan.off[-1] > OFF_PATH * controller.measure.length
    sizes = plan.q.shape[1], len(plan.at), len(curve.at)
    asked = pace.rate or 0.0, pace.acceleration, pace.jerk or 0.0, tolerance
    knots = plan.at, plan.forward, plan.backward, plan.off, plan.ratio, plan.q.ravel(), plan.slopes.ravel()
    poses = curve.at, path.places, curve.poses.ravel(), curve.cubics.ravel()
    numbers = np.concatenate(((*sizes, path.slow, *asked, plan.braking, cut, *overrides), *knots, *poses))
    return Course(controller.compiled, controller.kept, state, numbers, (*plan.ruling, *RULINGS))
