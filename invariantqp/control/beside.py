"""Where the tool is beside its path: how far along, and how far across.

    e = log(P T^-1) = shift t + e_across,     shift = <t, e> / <t, t>,   t the path's tangent

P is the place where the tool is expected; it is behind that by `shift`, and feedback is left with e_across. Both are
measured in what is asked of the arm (`asked`).
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from invariantqp.control.asked import asked
from invariantqp.control.controller import Controller
from invariantqp.control.curve import Curve
from invariantqp.control.joint_path import OFF_PATH
from invariantqp.control.path_plan import PathPlan
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Sighting


class Beside(NamedTuple):
    """The tool and its path in a tick.

    Attributes:
        sighting: the arm.
        tangent: (6,) of the path in the middle of the tick.
        asked: (k, 6) rows of what is asked.
        shift: how far the tool is behind the expected place.
        across: (6,) the twist back to the path.
        off: its size in what is asked.
    """

    sighting: Sighting
    tangent: Array
    asked: Array
    shift: float
    across: Array
    off: float


def look(controller: Controller, curve: Curve, plan: PathPlan, q: Array, place: float, rate: float) -> Beside:
    """Where the tool is.

    Args:
        controller: with the arm.
        curve: the path.
        plan: where it cannot be had, its joint motion is the path.
        q: (m,) joint positions.
        place: where the tool is expected.
        rate: how fast the place moves.
    """
    robot = controller.robot
    i = plan.piece(place)
    middle = min(max(place + 0.5 * controller.dt * rate, 0.0), plan.end)
    if max(plan.off[i], plan.off[i + 1]) > OFF_PATH * controller.measure.length:
        target = robot.target(robot.pose(plan.joints(place)[0]))
        sighting = robot.sight(q, target)
        tangent = sighting.J.dot(plan.joints(middle)[1])
    else:
        target = robot.target(curve.pose(place))
        sighting = robot.sight(q, target)
        tangent = curve.tangent(middle)
    R = asked(controller, sighting, controller.measure.root(robot, sighting, target))
    ahead, error = R.dot(tangent), R.dot(sighting.error)
    square = float(ahead.dot(ahead))
    shift = float(ahead.dot(error)) / square if square > 0.0 else 0.0
    rest = error - shift * ahead
    return Beside(sighting, tangent, R, shift, sighting.error - shift * tangent, sqrt(float(rest.dot(rest))))
