"""All limits of a loop: what they allow in a tick, and the words for joints that cannot keep theirs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invariantqp.control.changes import Changes
from invariantqp.control.joint_rows import LIMITS, JointRows, Loop, LoopRows, PinkLimit, Rows, joint_rows
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, Sighting
from invariantqp.velocity.limits import BrakingBox, JointBox, LimitRows, ToolSpeed, accelerations
from invariantqp.velocity.qp import Cone
from invariantqp.velocity.solution import VelocitySolution, with_trouble

Strained = tuple[tuple[int, str], ...]
Limit = Rows | ToolSpeed | PinkLimit | LoopRows
ORIGIN = np.zeros(3)
# A joint that turns is never this far outside its position range [rad]: its position is no measurement in radians.
FAR_OUTSIDE = 0.5


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
    believed: tuple[Array, Array] | None  # (m,) bounds of positions that are believed, or None for all

    def at(
        self, robot: Robot, sighting: Sighting, target: Any, q: Array, before: Array, now: Changes | None = None
    ) -> TickLimits:
        """The limits at joint positions q (m,), coming from the joint velocity `before` (m,), changed for `now`."""
        strained: Strained = ()
        box, braking = self.box, self.braking
        if now is not None:
            box, braking = now.box(box, braking, before)
        if braking is None:
            lower, upper = box.at(q)
            placed = box.placed(q)
        else:
            bounds = braking.at(q, before)
            lower, upper, strained = bounds[:3]
            placed = bounds[3:]
        rows = cone = None
        trouble = ""
        speed = self.tool_speed
        if speed is not None or now is not None:
            point = ORIGIN if speed is None or speed.point is None else speed.point
            here = robot.points(sighting, target, point)[0]
            cone = None if speed is None else speed.cone(sighting.J, here)
        if now is not None:
            step = np.full(len(q), np.inf) if braking is None else braking.acceleration * box.dt
            cone = now.cone(
                cone, Cone(velocity_at(sighting.J, here), np.inf, np.zeros(3)), (lower, upper), before, step
            )
        if self.joint_rows is not None:
            rows, trouble = self.joint_rows.at(q, before)
        return TickLimits(lower, upper, rows, cone, strained, trouble, placed)

    def wrong(self, q: Array, names: tuple[str, ...]) -> str:
        """Why joint positions (m,) cannot be true, "" where they may be; of several joints, the worst."""
        if self.believed is None:
            return ""
        lower, upper = self.believed
        beyond = np.maximum(q - upper, lower - q)
        i = int(beyond.argmax())
        if not beyond[i] > 0.0:
            return ""
        return (
            f"joint {i} ({names[i]}): {q[i]:.1f} rad is {beyond[i] + FAR_OUTSIDE:.1f} outside its position range; are "
            'these degrees? Give far_outside="return" to move back from there'
        )

    def told(
        self, solution: VelocitySolution, q: ArrayLike, names: tuple[str, ...], strained: Strained = ()
    ) -> VelocitySolution:
        """The solution, whose reason names joints that are `strained`, or outside their range, and what holds it."""
        if self.joint_rows is not None:
            solution = self.joint_rows.told(solution)
        if strained:
            return with_trouble(solution, _named(strained, names))
        if not solution.active or self.braking is not None:
            return solution
        far = self.box.outside(q, solution.active)
        return solution._replace(reason=f"{_named(far, names)}; {solution.reason}") if far else solution


def loop_limits(
    robot: Robot,
    dt: float,
    delay: float,
    acceleration_limit: ArrayLike | None,
    position_margin: float,
    tool_speed: ToolSpeed | float | None,
    rows: Rows | None,
    limits: Sequence[Limit],
    far_outside: Literal["hold", "return"],
    turning: NDArray[np.bool_],
) -> LoopLimits:
    """The limits for the arguments of a controller; `turning` (m,) says which joints turn.

    Raises:
        BadInput: something that is not a limit, two tool speeds.
        MissingExtra: a limit of Pink's without Pink.
    """
    margin = arrays.not_negative(position_margin, "position_margin", "a distance kept from position limits")
    box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, dt, margin)
    braking = None
    if acceleration_limit is not None:
        braking = BrakingBox(box, accelerations(acceleration_limit, len(robot.names)))
    if not isinstance(limits, (list, tuple)):
        raise BadInput("limits", excerpt(limits), f"a list: {LIMITS}")
    loop = Loop(dt, delay, None if braking is None else braking.acceleration)
    combined = joint_rows(robot, rows, [limit for limit in limits if not isinstance(limit, ToolSpeed)], loop)
    speeds: list[ToolSpeed | float] = [limit for limit in limits if isinstance(limit, ToolSpeed)]
    speeds += [] if tool_speed is None else [tool_speed]
    if len(speeds) > 1:
        raise BadInput("limits", "two tool speeds", "one, here or as tool_speed=")
    tool_speed = speeds[0] if speeds else None
    if tool_speed is not None and not isinstance(tool_speed, ToolSpeed):
        tool_speed = ToolSpeed(arrays.number(tool_speed, "tool_speed", "a speed", positive=True))
    believed = None
    if arrays.choice(far_outside, "far_outside", ("hold", "return")) == "hold":
        room = np.where(turning, FAR_OUTSIDE, np.inf)
        believed = robot.position_lower - room, robot.position_upper + room
    return LoopLimits(box, braking, tool_speed, combined, believed)


def _named(joints: Strained, names: tuple[str, ...]) -> str:
    return "; ".join(f"joint {i} ({names[i]}): {what}" for i, what in joints)
