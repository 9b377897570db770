"""A tick of a controller, all of it in the compiled core: kinematics, error, law, convergence.

The core answers what `Controller.step` would in Python, or hands the tick back. Rows that a function gives, or a limit
of Pink's, and the matrix of a form of one's own are computed in Python and passed in each tick, as is what `step`
changes. What it is given of a loop is the table of `csrc/fields.h`, by name.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from invariantqp.control.demands import Exact, ExactAxis, ExactJoints, ExactPlane, ExactPoint
from invariantqp.control.limits import LoopLimits
from invariantqp.control.measure import ToolMeasure
from invariantqp.engine import core, core_for
from invariantqp.geometry.arrays import Array
from invariantqp.legacy.law import VelocityLaw
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot

if TYPE_CHECKING:
    from invariantqp.engine import Loop, Wanted

# A tick by the core, for the loop of `compiled_loop`, the numbers of its Memory, which it writes, and what `step` is
# given; without a target (None), what `follow` is. The solution, and what of joints is to be said beside it, if any;
# None where Python has to answer, or to say what is wrong with an argument.
compiled_tick: Callable[..., tuple[Any, ...] | None] = getattr(core, "step", lambda *_: None)
# Likewise joint positions when the command of this tick acts, of its first three arguments.
acts_at: Callable[[Any, Array, Any], Array | None] = getattr(core, "acts_at", lambda *_: None)


def compiled_loop(
    robot: Robot, law: VelocityLaw, measure: ToolMeasure, limits: LoopLimits, exact: tuple[Exact, ...], **fields: Any
) -> Loop | None:
    """A loop for `compiled_tick`; None for one that the core does not have.

    Args:
        robot: the arm.
        law: of its ticks.
        measure: at a point of the tool, or of a carried metric.
        limits: of the loop; rows that are not the same in every tick are passed in each.
        exact: what is met exactly.
        fields: more fields of `csrc/fields.h`.
    """
    core, fixed, speed, carried = core_for(law.engine), law.compiled, limits.tool_speed, measure.carried
    if core is None or fixed is None or (carried is None and measure.point is None):
        return None
    m = len(robot.names)
    if type(robot) is not Chain or m > core.MOST_JOINTS:  # a class of the user's may be no such chain
        return None
    wanted = compiled_demands(exact)
    if wanted is None or len(wanted) > core.MOST_ROWS:
        return None
    rows = None if limits.joint_rows is None else limits.joint_rows.fixed
    if rows is not None:
        if len(rows.lower) > core.MOST_LIMITS:
            return None
        fields |= {"G": rows.C, "least": rows.lower, "most": rows.upper, "row_names": rows.names}
    if speed is not None:
        fields |= {"fast": speed.point, "speed_limit": speed.limit}
    if carried is not None:
        by = "tool" if carried.follows_tool else "base"
        fields |= {"carried": by, "root": carried.root(np.eye(4))}  # in the frame of its body
    box, braking = limits.box, limits.braking
    made: Loop = core.Loop(
        law=fixed,
        screws=robot.screws,
        home=robot.home,
        dt=limits.loop.dt,
        rate=box.rate,
        point=measure.point,
        length=measure.length,
        position_lower=box.position_lower,
        position_upper=box.position_upper,
        beyond=limits.beyond,
        tip=limits.tip,
        far=limits.far,
        fastest=box.velocity_limit,
        acceleration=None if braking is None else braking.acceleration,
        exact=wanted,
        joint_names=robot.names,
        **fields,
    )
    return made


def compiled_demands(exact: tuple[Exact, ...]) -> tuple[Wanted, ...] | None:
    """The demands as the core takes them; None for another kind."""
    found: list[Wanted] = []
    if core is None:
        return None
    for demand in exact:
        if type(demand) is ExactPoint:
            found.append(core.Wanted(kind="point", point=demand.point))
        elif type(demand) is ExactAxis:
            found.append(core.Wanted(kind="axis", direction=demand.axis))
        elif type(demand) is ExactPlane:
            found.append(core.Wanted(kind="plane", point=demand.point, direction=demand.normal))
        elif type(demand) is ExactJoints:
            rows = zip(demand.A, demand.b, strict=True)
            found += [core.Wanted(kind="joints", row=row, speed=float(b)) for row, b in rows]
        else:
            return None
    return tuple(found)
