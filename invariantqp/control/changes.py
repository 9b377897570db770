"""Limits that change while a loop runs: a speed slider, and lower limits of joint and tool speed, for one tick.

    v_max(tick) = max(speed min(v_max, velocity_limit), |x_before| - a dt)

A limit below what the joints have now is approached as fast as their accelerations allow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from attrs import evolve
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.limits import BrakingBox, JointBox
from invariantqp.velocity.qp import Cone

# What stands in the reason of a tick whose slider is at zero.
STOPPED = "speed is 0"


class Changes(NamedTuple):
    """What is other in this tick than the controller was made with."""

    speed: float  # share of the motion's speed, in [0, 1]
    velocity_limit: Array  # (m,) [rad/s, length/s], inf where there is none but the controller's
    tool_speed: float  # likewise [length/s]

    def box(self, box: JointBox, braking: BrakingBox | None, before: Array) -> tuple[JointBox, BrakingBox | None]:
        """Joint limits of this tick, coming from the joint velocity `before` (m,)."""
        limit = np.minimum(box.velocity_limit, self.velocity_limit)
        limit = self.speed * limit if self.speed > 0.0 else np.zeros(len(limit))  # which may be infinite
        if braking is not None:
            slowest = np.abs(before) - braking.acceleration * box.dt
            limit = np.minimum(np.maximum(limit, slowest), box.velocity_limit)
        slower = JointBox(box.position_lower, box.position_upper, limit, box.dt)
        return slower, None if braking is None else evolve(braking, box=slower)

    def cone(
        self, cone: Cone | None, own: Cone, bounds: tuple[Array, Array], before: Array, step: Array
    ) -> Cone | None:
        """The limit of the tool's speed in this tick: lower than the controller's `cone`, for the point of `own`.

        `step` (m,) is by how much joint velocities may change, inf where there is no limit of acceleration.
        """
        limit = min(np.inf if cone is None else cone.limit, self.tool_speed)
        if limit == np.inf:
            return cone
        limit *= self.speed
        # All joints slower by the same share is a velocity that accelerations allow, along the way the tool goes now.
        over = np.abs(before) - step
        share = float((over[over > 0.0] / np.abs(before[over > 0.0])).max(initial=0.0))
        slower = np.minimum(np.maximum(share * before, bounds[0]), bounds[1])
        return (own if cone is None else cone)._replace(limit=max(limit, own.speed(slower)))


def changes_of(speed: float, velocity_limit: ArrayLike | None, tool_speed: float | None, m: int) -> Changes | None:
    """What a tick of m joints is told to change; None for nothing.

    Raises:
        BadInput: a speed outside [0, 1], a limit below zero, a tool speed that is not above zero.
    """
    if type(speed) is float and speed == 1.0 and velocity_limit is None and tool_speed is None:
        return None
    share = arrays.not_negative(speed, "speed", "a share of the speed, from 0 to 1")
    if share > 1.0:
        raise BadInput("speed", f"{share:g}", "a share of the speed, from 0 to 1")
    joints = np.full(m, np.inf) if velocity_limit is None else _limits(velocity_limit, m)
    tool = np.inf
    if tool_speed is not None:
        tool = arrays.number(tool_speed, "tool_speed", "a speed", positive=True)
    if share == 1.0 and tool == np.inf and (joints == np.inf).all():
        return None
    return Changes(share, joints, tool)


def _limits(value: ArrayLike, m: int) -> Array:
    expected = f"{m} speeds, zero or more, or one for all"
    a = arrays.array(value, "velocity_limit", expected)
    a = np.full(m, float(a)) if a.ndim == 0 else a
    if a.shape != (m,) or not (a >= 0.0).all():  # NaN is not above zero either
        found = f"shape {a.shape}" if a.shape != (m,) else f"{a[~(a >= 0.0)][0]:g}"
        raise BadInput("velocity_limit", found, expected)
    return a
