"""All limits of a loop: what they allow in a tick, and the words for joints that cannot keep theirs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.joint_rows import JointRows, PinkLimit, Rows, joint_rows
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, Sighting
from invariantqp.velocity.limits.box import JointBox, accelerations
from invariantqp.velocity.limits.braking import BrakingBox
from invariantqp.velocity.limits.rows import LimitRows
from invariantqp.velocity.limits.toolspeed import ToolSpeed
from invariantqp.velocity.qp.quadratic import Cone
from invariantqp.velocity.solution import VelocitySolution, with_trouble

Strained = tuple[tuple[int, str], ...]
ORIGIN = np.zeros(3)


class TickLimits(NamedTuple):
    """The limits of one tick."""

    lower: Array  # (m,) of the joint velocity
    upper: Array  # (m,)
    rows: LimitRows | None  # on combinations of joint velocities, or None
    cone: Cone | None  # the speed limit of a point, or None
    strained: Strained  # joints whose limits contradict each other, and what gave way, in words
    trouble: str  # why there is nothing to do but stand still, "" for nothing
    placed: tuple[Array, Array]  # (m,) bounds of the joint velocity by position limits alone


class LoopLimits(NamedTuple):
    """The limits of a loop."""

    box: JointBox  # position and velocity limits
    braking: BrakingBox | None  # the same with acceleration limits, or None
    tool_speed: ToolSpeed | None  # the speed limit of a point of the tool, or None
    joint_rows: JointRows | None  # limits on combinations of joint velocities, or None

    def at(self, robot: Robot, sighting: Sighting, target: Any, q: Array, before: Array) -> TickLimits:
        """The limits at joint positions q (m,), coming from the joint velocity `before` (m,)."""
        strained: Strained = ()
        if self.braking is None:
            lower, upper = self.box.at(q)
            placed = self.box.placed(q)
        else:
            bounds = self.braking.at(q, before)
            lower, upper, strained = bounds[:3]
            placed = bounds[3:]
        rows = cone = None
        trouble = ""
        if self.tool_speed is not None:
            point = ORIGIN if self.tool_speed.point is None else self.tool_speed.point
            cone = self.tool_speed.cone(sighting.J, robot.points(sighting, target, point)[0])
        if self.joint_rows is not None:
            rows, trouble = self.joint_rows.at(q, before)
        return TickLimits(lower, upper, rows, cone, strained, trouble, placed)

    def told(
        self, solution: VelocitySolution, q: ArrayLike, names: tuple[str, ...], strained: Strained = ()
    ) -> VelocitySolution:
        """The solution, whose reason names joints that are `strained`, or outside their range and held by limits."""
        if strained:
            return with_trouble(solution, _named(strained, names))
        if not solution.active or self.braking is not None:
            return solution
        far = self.box.outside(q, solution.active)
        return solution._replace(reason=f"{_named(far, names)}; {solution.reason}") if far else solution


def loop_limits(
    robot: Robot,
    dt: float,
    acceleration_limit: ArrayLike | None,
    position_margin: float,
    tool_speed: ToolSpeed | float | None,
    rows: Rows | None,
    limits: Sequence[PinkLimit],
) -> LoopLimits:
    """The limits for the arguments of a controller.

    Raises:
        BadInput: something that is not a limit.
        MissingExtra: `limits` without Pink.
    """
    margin = arrays.not_negative(position_margin, "position_margin", "a distance kept from position limits")
    box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, dt, margin)
    braking = None
    if acceleration_limit is not None:
        braking = BrakingBox(box, accelerations(acceleration_limit, len(robot.names)))
    combined = joint_rows(robot, rows, limits, dt)
    if tool_speed is not None and not isinstance(tool_speed, ToolSpeed):
        tool_speed = ToolSpeed(arrays.number(tool_speed, "tool_speed", "a speed", positive=True))
    return LoopLimits(box, braking, tool_speed, combined)


def _named(joints: Strained, names: tuple[str, ...]) -> str:
    return "; ".join(f"joint {i} ({names[i]}): {what}" for i, what in joints)
