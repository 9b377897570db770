"""A tick of a controller, all of it in the compiled core: kinematics, error, law, convergence.

The core answers what `Controller.step` would in Python, or hands the tick back. It has joint limits, those of
accelerations too, fixed `LimitRows`, a tool speed, a joint metric, forms and carried metrics, and the exact demands of
`demands`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from invariantqp.control.demands import Exact, ExactAxis, ExactJoints, ExactPlane, ExactPoint
from invariantqp.control.joint_rows import JointRows
from invariantqp.control.loop_limits import LoopLimits
from invariantqp.control.measure import ToolMeasure
from invariantqp.engine import core
from invariantqp.geometry.arrays import Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.law import VelocityLaw
from invariantqp.velocity.solution import VelocitySolution

# A tick by the core, for the loop of `compiled_loop`, the numbers of its Memory, which it writes, and what `step` is
# given; without a target (None), what `follow` is. The solution, and whether there are words to add to it; None where
# Python has to answer, or to say what is wrong with an argument.
compiled_tick: Callable[..., tuple[VelocitySolution, bool] | None] = getattr(core, "step", lambda *_: None)


def compiled_loop(
    robot: Robot,
    law: VelocityLaw,
    measure: ToolMeasure,
    limits: LoopLimits,
    gain: float,
    posture: Array,
    pull: Array,
    delay: float,
    slack: float,
    slow: float,
    exact: tuple[Exact, ...],
    row_rank: int | None,
) -> Array | None:
    """The fixed numbers of a loop for `compiled_tick`; None for a loop that the core does not have.

    Args:
        robot: the arm.
        law: of its ticks.
        measure: at a point of the tool, or of a carried metric.
        limits: of the loop; of rows on the joint velocity, the core has those that are the same in every tick.
        gain: of the error [1/s].
        posture: (m,) joint positions.
        pull: (m,) gains of the posture [1/s].
        delay: of the robot [s].
        slack: of a chase.
        slow: 1 / |v|, v the measured twist at full speed.
        exact: what is met exactly.
        row_rank: how many of its rows the arm can keep at best.
    """
    box, braking, speed, joint_rows = limits[:4]
    carried = measure.carried
    if core is None or law.compiled is None or (carried is None and measure.point is None):
        return None
    m, planned = len(posture), (law.planned.compiled or law.compiled)[:2]
    if type(robot) is not Chain or m > core.MOST_JOINTS:  # a class of the user's may be no such chain
        return None
    wanted, rows = compiled_demands(exact, m), _rows(joint_rows, m)
    if wanted is None or len(wanted) > core.MOST_ROWS or rows is None or len(rows[0]) > core.MOST_JOINTS:
        return None
    numbers = [m, box.dt, gain, measure.length, slow, pull.any()]
    numbers += [-1 if row_rank is None else row_rank, 0.0 if speed is None else speed.limit, braking is not None]
    kind = 0 if carried is None else 2 if carried.follows_tool else 1
    numbers += [len(wanted), len(rows[0]), law.metric is not None, 0, kind]
    numbers += [delay, slack, *planned]
    fast = np.zeros(3) if speed is None or speed.point is None else speed.point
    low, high = box.position_lower / box.dt, box.position_upper / box.dt
    point = np.zeros(3) if measure.point is None else measure.point
    root = np.eye(6) if carried is None else carried.root(np.eye(4))  # in the frame of its body
    fixed = np.array(numbers, np.float64), point, fast, robot.home, robot.screws
    acceleration = np.zeros(m) if braking is None else braking.acceleration
    room = box.position_lower, box.position_upper, acceleration
    same = np.eye(m)
    metric = same if law.to_joint is None else law.to_joint, same if law.from_joint is None else law.from_joint
    held = wanted, *rows
    made: Array = core.loop(
        *fixed, low, high, box.velocity_limit, posture, pull, *room, *held, *metric, law.compiled, root
    )
    return made


def compiled_demands(exact: tuple[Exact, ...], m: int) -> Array | None:
    """(k, 8 + m) the demands as the core takes them: kind, point, direction, speed, row; None for another kind."""
    found, nothing, still = [], np.zeros(3), np.zeros(m)
    for demand in exact:
        if type(demand) is ExactPoint:
            found.append((0.0, *demand.point, *nothing, 0.0, *still))
        elif type(demand) is ExactAxis:
            found.append((1.0, *nothing, *demand.axis, 0.0, *still))
        elif type(demand) is ExactPlane:
            found.append((2.0, *demand.point, *demand.normal, 0.0, *still))
        elif type(demand) is ExactJoints:
            found += [(3.0, *nothing, *nothing, b, *row) for row, b in zip(demand.A, demand.b, strict=True)]
        else:
            return None
    return np.array(found, np.float64).reshape(len(found), 8 + m)


def _rows(limits: JointRows | None, m: int) -> tuple[Array, Array, Array] | None:
    """(k, m) C, (k,) lower and upper of `LimitRows`; None where they may change from tick to tick."""
    if limits is None:
        return np.empty((0, m)), np.empty(0), np.empty(0)
    return None if limits.fixed is None else (limits.fixed.C, limits.fixed.lower, limits.fixed.upper)
