"""The loop body: measured joint positions and a target in, a joint velocity inside the limits out.

    s = gain log(T_target T^-1) + feedforward,     velocity = law(J(q), s, box(q))

The error twist is taken in the base frame, where it is the same whatever frame the tool has.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.demands import Exact, View, demands_of, require_rows, rows_of
from invariantqp.control.joint_rows import PinkLimit, Rows, joint_rows
from invariantqp.control.own_form import choose_form
from invariantqp.control.posture import joint_gains, posture_gain
from invariantqp.control.tracking import tracking_twist
from invariantqp.errors import BadInput, excerpt
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot, Sighting, middle, require_robot
from invariantqp.velocity.damping import Damping, damping_of
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.forms import CarriedMetric, Form
from invariantqp.velocity.guard import Guard
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.limits.box import JointBox, accelerations
from invariantqp.velocity.limits.braking import BrakingBox
from invariantqp.velocity.limits.toolspeed import ToolSpeed
from invariantqp.velocity.qp.backends import Backend, backend_of
from invariantqp.velocity.request import UnitsMixed, guard_of, units_mix
from invariantqp.velocity.solution import VelocitySolution
from invariantqp.velocity.solve import solve, standing

# Share of the error removed in a tick where no gain is given. A velocity held for dt leaves the path by half of
# acceleration times dt^2 in every tick, and feedback holds that to 1 / share of it: 25 micrometres at 5 m/s^2 and 1 ms.
TRACKING_SHARE = 0.1
# The largest share of the error that a tick may remove: all of it, give or take the rounding of gain * dt.
WHOLE_ERROR = 1.0 + 1e-9


class Controller:
    """Task-space velocity control of one arm; `step` is one tick. One controller drives one arm, in one thread.

    A copy, shallow or deep, is a loop of its own.

    Attributes:
        robot: the arm.
        law: form, damping, guard, metric and solver, fixed for the loop.
        dt: tick [s].
        gain: [1/s].
        posture_gain: [1/s], 0 where the null space has no posture.
        exact: what is met exactly; the form measures the rest.
        form_reason: why this form was chosen, in words.
    """

    form_reason: str

    def __init__(
        self,
        robot: Robot,
        *,
        dt: float,
        gain: float | None = None,
        form: Form | float | Literal["auto"] | None = None,
        damping: Damping | float | None = None,
        guard: Guard | bool = True,
        posture: float | bool = True,
        joint_metric: ArrayLike | None = None,
        backend: Backend | str = "daqp",
        exact: Exact | ExactRows | Sequence[Exact | ExactRows] | Literal["position"] | None = None,
        acceleration_limit: ArrayLike | None = None,
        position_margin: float = 0.0,
        tool_speed: ToolSpeed | float | None = None,
        rows: Rows | None = None,
        limits: Sequence[PinkLimit] = (),
    ) -> None:
        """Make the loop's fixed part.

        Args:
            robot: from `load_robot`, or anything that meets `Robot`.
            dt: tick [s].
            gain: tracking gain [1/s], at most 1/dt; None is 0.1/dt, a tenth of the error in a tick.
            form: as in `solve_velocity`; None or "auto" is what `invariantqp inspect` recommends: a pitch of the order
                of the arm's own length, away from principal pitches, or the metric carried by the tool if none works.
            damping: as in `solve_velocity`.
            guard: as in `solve_velocity`.
            posture: gain [1/s] of the null-space motion to the middle of the joint ranges, for arms with more than six
                joints; True is 1/s, False switches it off.
            joint_metric: as in `solve_velocity`.
            backend: as in `solve_velocity`; "osqp" keeps its workspace from tick to tick.
            exact: what is met exactly, while the form measures the rest: "position" for the tool frame's origin, an
                ExactPoint, ExactAxis, ExactPlane, ExactJoints or ExactRows, or several of them.
            acceleration_limit: (m,) or one for all joints [rad/s^2, length/s^2], inf where there is none; a joint then
                also keeps room to brake before its position limits. None is no limit.
            position_margin: distance kept from position limits [rad, length].
            tool_speed: the largest speed of a point of the tool [length/s], 0.25 m/s beside a person; a number is the
                limit of the tool frame's origin.
            rows: LimitRows on the joint velocity, or a function of q (m,) that returns them (or None) in every tick.
            limits: limits and barriers made for Pink from `robot.model`: anything with
                `compute_qp_inequalities(configuration, dt)`. They add to the robot's own limits and give way where
                they contradict these. Reasons number them after `rows`, in their order. Pink cannot pickle them.

        Raises:
            BadInput: a dt or gain that is not positive, a gain above 1/dt, something that is no limit, or an argument
                that `solve_velocity` would refuse.
            UnknownName: no such back end.
            MissingExtra: `limits` without Pink.
        """
        self.robot = require_robot(robot)
        m = len(robot.names)
        self.dt: float = arrays.number(dt, "dt", "a tick in seconds", positive=True)
        self.gain: float = TRACKING_SHARE / self.dt if gain is None else arrays.number(gain, "gain", positive=True)
        if self.gain * self.dt > WHOLE_ERROR:
            raise BadInput("gain", f"{self.gain:g} 1/s with dt = {self.dt:g} s", "at most 1/dt", "More overshoots.")
        self.exact: tuple[Exact, ...] = demands_of(exact)
        mid = middle(robot)
        J = robot.sight(mid, robot.target(robot.pose(mid))).J  # what the first look loads is loaded before the loop
        metric = None if joint_metric is None else arrays.positive_definite(joint_metric, m, "joint_metric")
        if metric is None and units_mix(J):
            warnings.warn(UnitsMixed.ADVICE, UnitsMixed, stacklevel=2)
        chosen, self.form_reason, blind = choose_form(robot, form, J)
        self.law: VelocityLaw = VelocityLaw(
            form=chosen,
            damping=damping_of(damping),
            guard=guard_of(guard),
            metric=metric,
            backend=backend_of(backend),
            dt=self.dt,
            note="no pitch form sees all of this arm: twists are measured at the tool" if blind else "",
        )
        self.posture_gain: float = posture_gain(posture, m)
        self._follows_tool = isinstance(self.law.form, CarriedMetric) and self.law.form.follows_tool
        self._middle = mid
        self._pull = joint_gains(robot, self.posture_gain)
        self._gains = np.full(6, self.gain)
        margin = arrays.not_negative(position_margin, "position_margin", "a distance kept from position limits")
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, self.dt, margin)
        self._braking = None
        if acceleration_limit is not None:
            self._braking = BrakingBox(self._box, accelerations(acceleration_limit, m))
        self._before = np.zeros(m)
        self._joint_rows = joint_rows(robot, rows, limits, self.dt)
        if tool_speed is not None and not isinstance(tool_speed, ToolSpeed):
            tool_speed = ToolSpeed(arrays.number(tool_speed, "tool_speed", "a speed", positive=True))
        self._tool_speed = tool_speed
        point = None if tool_speed is None else tool_speed.point
        self._limited_point = np.zeros(3) if point is None else np.asarray(point)

    def __copy__(self) -> Controller:
        return deepcopy(self)  # solvers and limits write to what they keep between ticks

    def step(
        self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None, velocity: ArrayLike | None = None
    ) -> VelocitySolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            target: tool pose to be at, (4, 4) in the base frame, a `pinocchio.SE3`, or what `robot.target` returned.
            feedforward: (6,) twist of the target in the base frame [rad/s; length/s]; None is a target at rest.
            velocity: (m,) joint velocity now [rad/s, length/s], for the acceleration limits; None is the one commanded
                last, zero before the first tick.

        Returns:
            VelocitySolution: q + dt velocity is inside the position limits, or on its way back inside.

        Raises:
            BadInput: NaN or wrong shapes; the controller is as it was.
        """
        positions = arrays.vector(q, len(self._middle), "q")
        sighting = self.robot.sight(positions, target)
        s = tracking_twist(sighting, self._gains, feedforward)
        return self._tick(_Observed(positions, sighting, target), s, velocity, self.gain, feedforward)

    def follow(
        self,
        q: ArrayLike,
        twist: ArrayLike,
        velocity: ArrayLike | None = None,
        rows: ExactRows | None = None,
        sighting: Sighting | None = None,
    ) -> VelocitySolution:
        """One tick for a twist of the tool instead of a target; exact demands then follow that twist.

        Args:
            q: (m,) measured joint positions [rad, length].
            twist: (6,) wanted, base frame [rad/s; length/s].
            velocity: as in `step`.
            rows: more exact rows, for this tick alone: parts of the twist, A = K'J and b = K'twist for some K.
            sighting: what `robot.sight` returned at q, if it was called in this tick already.

        Returns:
            VelocitySolution, as from `step`.

        Raises:
            BadInput: NaN or wrong shapes; the controller is as it was.
        """
        positions = arrays.vector(q, len(self._middle), "q")
        s = arrays.twist(twist)
        if rows is not None:
            require_rows(rows, len(self._middle))
        return self._tick(self._here(positions, sighting), s, velocity, 0.0, s, rows)

    def rest(
        self, q: ArrayLike, reason: str, velocity: ArrayLike | None = None, sighting: Sighting | None = None
    ) -> VelocitySolution:
        """One tick of standing still; outside its limits, an arm moves back inside.

        Args:
            q: (m,) measured joint positions [rad, length].
            reason: why, in words; the solution repeats it.
            velocity: as in `step`.
            sighting: as in `follow`.

        Raises:
            BadInput: NaN or wrong shapes; the controller is as it was.
        """
        positions = arrays.vector(q, len(self._middle), "q")
        if not isinstance(reason, str):
            raise BadInput("reason", excerpt(reason), "a text")
        return self._tick(self._here(positions, sighting), np.zeros(6), velocity, 0.0, None, stand=reason)

    def _here(self, positions: Array, sighting: Sighting | None) -> _Observed:
        """The state of an arm whose target is where its tool is now."""
        if sighting is None:
            sighting = self.robot.sight(positions, self.robot.target(self.robot.pose(positions)))
        elif not isinstance(sighting, Sighting):
            raise BadInput("sighting", excerpt(sighting), "what robot.sight returned at q")
        return _Observed(positions, sighting, sighting.pose)

    def _bounds(self, positions: Array, before: Array) -> tuple[Array, Array, tuple[tuple[int, str], ...]]:
        """The box of this tick, and the joints whose limits contradict each other."""
        if self._braking is None:
            return *self._box.at(positions), ()
        return self._braking.at(positions, before)

    def _tick(
        self,
        state: _Observed,
        s: Array,
        velocity: ArrayLike | None,
        gain: float,
        ahead: ArrayLike | None,
        more: ExactRows | None = None,
        stand: str | None = None,
    ) -> VelocitySolution:
        """The joint velocity for the twist s; exact demands follow the target with `gain` and the twist `ahead`.

        `stand` is a reason to stand still instead, None for none.
        """
        positions, sighting, target = state
        before = self._before if velocity is None else arrays.vector(velocity, len(positions), "velocity")
        lower, upper, strained = self._bounds(positions, before)
        posture = (self._middle - positions) * self._pull if self.posture_gain else None
        exact, point = (None, None) if not self.exact else self._rows(state, gain, ahead)
        if more is not None:
            exact = more if exact is None else exact.with_rows(more)
        law = self.law
        if self._follows_tool:
            pose = self.robot.pose(positions)
            law = replace(law, form=law.form.at(pose))  # type: ignore[union-attr]
            point = pose[:3, 3] if point is None else point  # the guard measures where the form does
        demand = Demand(sighting.J, s, lower, upper, exact, posture, point, implied=exact is not None and exact is more)
        if self._tool_speed is not None:
            fast, _ = self.robot.points(sighting, target, self._limited_point)
            demand = demand._replace(cone=self._tool_speed.cone(sighting.J, fast))
        if self._joint_rows is not None:
            rows, trouble = self._joint_rows.at(positions, before)
            demand, stand = demand._replace(rows=rows), trouble or stand
        solution = solve(law, demand) if stand is None else standing(law, demand, stand)
        self._before = solution.velocity.copy()
        if not strained:
            return solution
        joints = [f"joint {i} ({self.robot.names[i]}): {what}" for i, what in strained]
        reason = "; ".join([*joints, solution.reason] if solution.reason else joints)
        return solution._replace(status="held" if solution.status == "held" else "degraded", reason=reason)

    def _rows(self, state: _Observed, gain: float, ahead: ArrayLike | None) -> tuple[ExactRows | None, Array | None]:
        """The exact demands of this tick, and the point that they fix."""
        twist = np.zeros(6) if ahead is None else np.asarray(ahead, dtype=np.float64)
        return rows_of(self.exact, View(self.robot, state.sighting, state.target, gain, twist))


class _Observed(NamedTuple):
    """One tick: checked joint positions, what the robot saw at them, and its target."""

    positions: Array
    sighting: Sighting
    target: Any
