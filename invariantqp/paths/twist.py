"""A twist of the tool as joint velocities that change inside the joints' acceleration and jerk limits.

    x = law(J, s, box),     dv/dt = min(A / |d|, sqrt(2 J / |d|)) d,   d = x - v

All joints change together, along d: the direction of what is done goes straight from one twist to the next.
"""

from __future__ import annotations

import numpy as np

from invariantqp.control.controller import Controller
from invariantqp.control.demands import View, rows_of
from invariantqp.geometry.arrays import Array
from invariantqp.paths.time_law import JointLimits
from invariantqp.velocity.law import Demand
from invariantqp.velocity.solve import solve


class TwistLaw:
    """Joint velocities for twists, by a loop's law."""

    def __init__(self, controller: Controller) -> None:
        """Of a loop."""
        self._loop = controller
        speed = controller.box.velocity_limit
        self._fastest = np.where(np.isfinite(speed), speed, 1.0)

    def velocity(self, q: Array, v: Array, twist: Array, limits: JointLimits) -> Array:
        """(m,) for the next tick, at q and v (m,) now, on the way to what a twist (6,) asks for."""
        x = self._asked(q, v, twist) if twist.any() else np.zeros(len(q))
        d, a = x - v, limits.towards(v, x)
        away = d != 0.0
        if not away.any():
            return x
        share = float((a[away] / d[away]).min())
        return x if share * limits.dt >= 1.0 else v + limits.dt * share * d

    def _asked(self, q: Array, v: Array, twist: Array) -> Array:
        """(m,) what the law makes of a twist, inside the limits of position and speed."""
        loop = self._loop
        robot = loop.robot
        target = robot.target(robot.pose(q))
        sighting = robot.sight(q, target)
        root = loop.measure.root_for(sighting.J, sighting.pose)
        exact = rows_of(loop.exact, View(robot, sighting, target, 0.0, twist)) if loop.exact else None
        rows = loop.joint_rows.at(q, v).rows if loop.joint_rows is not None else None
        cone = None
        if loop.tool_speed is not None:
            point = np.zeros(3) if loop.tool_speed.point is None else loop.tool_speed.point
            cone = loop.tool_speed.cone(sighting.J, robot.points(sighting, target, point)[0])
        lower, upper = loop.box.at(q)
        pull, fastest = loop.posture_pull(q), self._fastest
        demand = Demand(sighting.J, twist, root, lower, upper, exact, pull, rows, cone, loop.row_rank, fastest=fastest)
        return solve(loop.law, demand).velocity
