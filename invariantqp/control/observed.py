"""What a controller knows of its arm in one tick."""

from __future__ import annotations

from typing import Any, NamedTuple

from invariantqp.control.measure import ToolMeasure
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, Sighting


class Observed(NamedTuple):
    """One tick."""

    positions: Array  # (m,) checked joint positions, as measured
    there: Array  # (m,) where the joints are when the command of this tick acts
    sighting: Sighting  # the robot's state there
    target: Any  # as the robot returned it
    root: Array  # (6, 6) of the measure
    before: Array  # (m,) the joint velocity before


def at_rest(
    robot: Robot,
    measure: ToolMeasure,
    positions: Array,
    there: Array,
    sighting: Sighting | None,
    before: Array,
    at: Array | None = None,
) -> Observed:
    """The tick of an arm whose target is where its tool is now; `sighting` and `at` are as in `Controller.follow`.

    Raises:
        BadInput: `sighting` is something else.
    """
    if sighting is None:
        sighting = robot.sight(there, robot.target(robot.pose(there)))
    elif not isinstance(sighting, Sighting):
        raise BadInput("sighting", excerpt(sighting), "what robot.sight returned at q")
    return Observed(positions, there, sighting, sighting.pose, measure.root_for(sighting.J, sighting.pose, at), before)
