"""A tick of a controller, all of it in the compiled core: kinematics, error, law, convergence.

The core answers what `Controller.step` would in Python, or hands the tick back. It has joint limits,
those of accelerations too, an exact point and a tool speed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.convergence import Convergence
from invariantqp.control.demands import Exact, ExactPoint
from invariantqp.control.measure import ToolMeasure
from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.law import VelocityLaw
from invariantqp.velocity.limits.box import JointBox
from invariantqp.velocity.limits.braking import BrakingBox
from invariantqp.velocity.limits.toolspeed import ToolSpeed
from invariantqp.velocity.solution import VelocitySolution


class Tick(NamedTuple):
    """The solution of a tick, and what the loop keeps of it: velocity (a copy), rotation of the error, convergence."""

    solution: VelocitySolution
    velocity: Array
    turn: Array
    convergence: Convergence


def compiled_loop(
    robot: Robot,
    law: VelocityLaw,
    measure: ToolMeasure,
    box: JointBox,
    braking: BrakingBox | None,
    gain: float,
    middle: Array,
    pull: Array,
    slow: float,
    exact: tuple[Exact, ...],
    row_rank: int | None,
    speed: ToolSpeed | None,
) -> Array | None:
    """The fixed numbers of a loop for `compiled_tick`; None for a loop that the core does not have.

    Args:
        robot: the arm.
        law: of its ticks.
        measure: at a point of the tool.
        box: joint limits.
        braking: the same with acceleration limits, or None.
        gain: of the error [1/s].
        middle: (m,) the posture, middle of the joint ranges.
        pull: (m,) gains of the posture [1/s].
        slow: 1 / |v|, v the measured twist at full speed.
        exact: what is met exactly; the core has a single ExactPoint.
        row_rank: how many of its rows the arm can keep at best.
        speed: limit of a point of the tool.
    """
    if core is None or law.compiled is None or measure.carried is not None or measure.point is None:
        return None
    if len(exact) > 1 or not all(type(demand) is ExactPoint for demand in exact):
        return None
    if speed is not None and speed.exact:
        return None
    if type(robot) is not Chain or len(middle) > core.MOST_JOINTS:  # a class of the user's may be no such chain
        return None
    point = next((demand.point for demand in exact if isinstance(demand, ExactPoint)), np.zeros(3))
    numbers = [len(middle), law.dt, gain, measure.length, slow, pull.any(), *law.compiled]
    numbers += [len(exact), -1 if row_rank is None else row_rank, 0.0 if speed is None else speed.limit]
    numbers += [braking is not None]
    fast = np.zeros(3) if speed is None or speed.point is None else speed.point
    low, high = box.position_lower / box.dt, box.position_upper / box.dt
    fixed = np.array(numbers, np.float64), measure.point, point, fast, robot.home, robot.screws
    acceleration = np.zeros(len(middle)) if braking is None else braking.acceleration
    room = box.position_lower, box.position_upper, acceleration
    made: Array = core.loop(*fixed, low, high, box.velocity_limit, middle, pull, *room)
    return made


def compiled_tick(
    loop: Array, q: ArrayLike, target: Any, feedforward: ArrayLike | None, before: Array, convergence: Convergence
) -> Tick | None:
    """The core's answer; None where Python has to answer, or to say what is wrong with an argument."""
    pose = target if type(target) is np.ndarray else getattr(target, "homogeneous", None)
    pose = getattr(target, "pose", None) if pose is None else pose
    found = None if core is None else core.step(loop, q, pose, feedforward, before, convergence)
    if found is None:
        return None
    solution, velocity, turn, watch = found
    return Tick(VelocitySolution._make(solution), velocity, turn, Convergence._make(watch))
