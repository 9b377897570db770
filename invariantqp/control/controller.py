"""The loop body: measured joint positions and a target in, a joint velocity inside the limits out.

    s = gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, box(q))

The error twist is taken in the base frame, where it is the same whatever frame the tool has.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from math import inf, isinf
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.errors import BadInput
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, Sighting, middle
from invariantqp.systems.centre import centre
from invariantqp.velocity.backends import Backend, backend_of
from invariantqp.velocity.damping import Damping, damping_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.objective import CarriedMetric, Form, form_of
from invariantqp.velocity.request import UnitsMixed, guard_of, units_mix
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.velocity.solve import solve

# How fast an arm with joints to spare drifts to the middle of their ranges [1/s]: a second's worth of patience, slow
# beside any tracking gain, and what keeps it out of its limits on long paths.
POSTURE_GAIN = 1.0
# Share of the error removed in a tick where no gain is given. A velocity held for dt leaves the path by half of
# acceleration times dt^2 in every tick, and feedback holds that to 1 / share of it: 25 micrometres at 5 m/s^2 and 1 ms.
TRACKING_SHARE = 0.1


class Controls(Protocol):
    """Anything with a step: ours, or a law to compare it with."""

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick."""
        ...


def tool_metric(robot: Robot) -> CarriedMetric:
    """diag(L^2 I, I) carried by the tool, L the arm's own length in the middle of its range.

    The form for arms on which no pitch form works: planar arms, SCARA, gantries. Where no joint turns, or all turn
    about one point, L is one unit of length.
    """
    length = centre(robot.jacobian(middle(robot))).length
    weight = length * length if 0.0 < length < inf else 1.0
    return CarriedMetric(np.repeat((weight, 1.0), 3))


class Controller:
    """Task-space velocity control of one arm; `step` is one tick.

    Attributes:
        robot: the arm.
        law: form, damping, guard, metric and solver, fixed for the loop.
        dt: tick [s].
        gain: [1/s].
        posture_gain: [1/s], 0 where the null space has no posture.
        exact: "position" where the tool point is met exactly and the form judges the rest, or None.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        dt: float,
        gain: float | None = None,
        form: Form | float | None = None,
        damping: Damping | float | None = None,
        guard: Guard | bool = True,
        posture: float | bool = True,
        joint_metric: ArrayLike | None = None,
        backend: Backend | str = "daqp",
        exact: Literal["position"] | None = None,
        point: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Make the loop's fixed part.

        Args:
            robot: from `load_robot`, or anything that meets `Robot`.
            dt: tick [s].
            gain: tracking gain [1/s], at most 1/dt; None is 0.1/dt, a tenth of the error in a tick.
            form: as in `solve_velocity`; None is the pitch form of the arm's own length in the middle of its range.
            damping: as in `solve_velocity`.
            guard: as in `solve_velocity`.
            posture: gain [1/s] of the null-space motion to the middle of the joint ranges, for arms with more than six
                joints; True is 1/s, False switches it off.
            joint_metric: as in `solve_velocity`.
            backend: as in `solve_velocity`; "osqp" keeps its workspace from tick to tick.
            exact: "position" to meet the position of a point of the tool exactly and let the form judge the rest.
            point: (3,) that point in the tool frame; the frame's origin by default.

        Raises:
            BadInput: a dt or gain that is not positive, gain above 1/dt, or an argument `solve_velocity` would refuse.
            UnknownName: no such back end.
        """
        m = len(robot.names)
        self.robot = robot
        self.dt = arrays.number(dt, "dt", "a tick in seconds", positive=True)
        self.gain = TRACKING_SHARE / self.dt if gain is None else arrays.number(gain, "gain", positive=True)
        if self.gain * self.dt > 1.0 + 1e-9:
            raise BadInput("gain", f"{self.gain:g} 1/s with dt = {self.dt:g} s", "at most 1/dt", "More overshoots.")
        if exact not in (None, "position"):
            raise BadInput("exact", repr(exact), '"position" or None')
        self.exact = exact
        self._point = arrays.vector(point, 3, "point")
        mid = middle(robot)
        J = robot.jacobian(mid)
        metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
        if metric is None and units_mix(J):
            warnings.warn(UnitsMixed.ADVICE, UnitsMixed, stacklevel=2)
        self.law = VelocityLaw(
            form_of(form, J), damping_of(damping), guard_of(guard), metric, backend_of(backend), self.dt
        )
        self.posture_gain = _posture_gain(posture) if m > 6 else 0.0
        bounded = np.isfinite(robot.position_lower) & np.isfinite(robot.position_upper)
        self._follows_tool = isinstance(self.law.form, CarriedMetric) and self.law.form.follows_tool
        self._middle = mid
        self._pull = np.where(bounded, self.posture_gain, 0.0)
        self._gains = np.full(6, self.gain)
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, self.dt)

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            target: tool pose to be at, (4, 4) in the base frame, a `pinocchio.SE3`, or what `robot.target` returned.
            feedforward: (6,) twist of the target in the base frame [rad/s; length/s]; None is a target at rest.

        Returns:
            VelocitySolution: q + dt velocity is inside the position limits, or on its way back there.

        Raises:
            BadInput: NaN or wrong shapes; the controller is as it was.
        """
        positions = arrays.vector(q, len(self._middle), "q")
        sighting = self.robot.sight(positions, target)
        s = sighting.error * self._gains
        if feedforward is not None:
            s += arrays.vector(feedforward, 6, "feedforward")
        if not s.dot(s) < inf:  # a target made elsewhere has not been looked at
            raise BadInput("target", "NaN, infinity, or numbers beyond any scale", "a rigid motion with finite numbers")
        lower, upper = self._box.at(positions)
        posture = (self._middle - positions) * self._pull if self.posture_gain else None
        exact, point = (None, None) if self.exact is None else self._point_rows(sighting, target, feedforward)
        law = self.law
        if self._follows_tool:
            law = replace(law, form=law.form.at(self.robot.pose(positions)))  # type: ignore[union-attr]
        return solve(law, Demand(sighting.J, s, lower, upper, exact, posture, point))

    def _point_rows(self, sighting: Sighting, target: Any, feedforward: ArrayLike | None) -> tuple[ExactRows, Array]:
        """Velocity of the tool point, demanded exactly; and the point."""
        point, wanted = self.robot.points(sighting, target, self._point)
        b: Array = self.gain * (wanted - point)
        if feedforward is not None:
            b += velocity_at(np.asarray(feedforward, dtype=np.float64), wanted)
        return ExactRows(velocity_at(sighting.J, point), b), point


def _posture_gain(posture: float | bool) -> float:
    if isinstance(posture, bool):
        return POSTURE_GAIN if posture else 0.0
    gain = arrays.number(posture, "posture", "a gain in 1/s, True or False")
    if gain < 0.0 or isinf(gain):
        raise BadInput("posture", f"{gain:g}", "a gain in 1/s not below zero, True or False")
    return gain
