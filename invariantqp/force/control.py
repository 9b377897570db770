"""The hybrid controller: joint positions, a target and a wrench in, a joint velocity within the limits out.

    s = P s_motion + sum of unit rates along Z,     s_motion = gain log(T_target T^-1) + feedforward
    velocity = law(J(q), s, box(q)),                torque = J'W_d for arms that take torques

The engine computes a tick (`core/hybrid.hpp`); this file reads the arguments and reports. Twists and wrenches are in
the base frame; **wrenches are those that the tool exerts** (a `WrenchSensor` turns readings into them).

Reference: [DS] Sect. 6.3; Raibert & Craig 1981.
"""

from __future__ import annotations

from copy import copy, deepcopy
from math import degrees, exp, inf, isnan, nan, pi
from typing import Any

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller, bad_input
from invariantqp.engine import law
from invariantqp.errors import BadInput, InvariantQPError, excerpt, written
from invariantqp.force import messages
from invariantqp.force.contact import HybridTask, SplitCache
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.sensor import WrenchSensor
from invariantqp.force.wrench import Order, Wrench, are_numbers, order_of, wrench_of
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.robots.kinematics import Robot, middle, require_robot
from invariantqp.velocity.measure import length_at
from invariantqp.velocity.solution import Status, VelocitySolution, has_no_motion

# The tool pose of a contact that does not depend on it.
NO_TOOL = np.eye(4)
# In the engine's order.
ON_LOSS = ("approach", "hold", "retreat", "continue")
# Settings of the engine that are attributes of the task.
TASK_SETTINGS = (
    *("size", "slope", "yields", "lost_after", "approach_speed", "approach_distance", "approach_time", "grip"),
    *("retreat_distance", "retreat_speed", "slide_speed", "edge_margin", "normal_within", "max_force", "max_moment"),
)


@frozen(eq=False, repr=False, slots=False)
class HybridSolution(Compared):
    """The joint velocity of a hybrid tick; all twists and wrenches in the base frame.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], within the limits.
        status: "lost", "overload" or "fault" (the sensor's), "degraded" if the force oscillates or is not reached, the
            edge is near or the normal is out of bounds, or the velocity law's own: see `Status`.
        reason: why, in words; "" if there is nothing to report.
        motion: (6,) the desired twist along S, P s_motion.
        force: (6,) the desired twist along Z for the wrench error; in a retreat, outwards.
        wrench: (6,) the measured wrench: without weight and bias, filtered.
        error: (6,) P*(W_d - W), in S*.
        intensities: (6-k,) parts of the measured wrench in the contact's constraints; the first is the press.
        wanted: (6,) W_d.
        contact: the contact of this tick, with the estimated normal.
        velocity_solution: of the velocity law.
        J: (6, m) joint twists.

    If the joint positions cannot be true, wrenches are NaN.
    """

    velocity: Array
    status: Status
    reason: str
    motion: Array = field(repr=False)
    force: Array = field(repr=False)
    wrench: Array
    error: Array = field(repr=False)
    intensities: Array
    wanted: Array = field(repr=False)
    contact: Contact = field(repr=False)
    velocity_solution: VelocitySolution = field(repr=False)
    J: Array = field(repr=False)

    @property
    def twist(self) -> Array:
        """(6,) the desired twist, motion and force together."""
        return self.motion + self.force

    @property
    def torque(self) -> Array:
        """(m,) J'W_d, the joint torques that exert the desired wrench, for torque-controlled arms [N m, N]."""
        torque: Array = self.J.T.dot(self.wanted)
        return torque


class HybridController:
    """Force along S* and motion along S of one arm; `step` is one tick, in one thread.

    Attributes:
        task: the contact and the wrench to exert.
        loop: the controller that follows the twist of each tick within the limits.
        sensor, order, force_first: as the arguments.
        splits: the split of the task for the contact of a tick.
    """

    def __init__(
        self,
        robot: Robot,
        task: HybridTask,
        *,
        dt: float,
        sensor: WrenchSensor | None = None,
        order: Order | None = None,
        force_first: bool = True,
        tare: bool = True,
        **options: Any,
    ) -> None:
        """A controller before the first contact.

        Args:
            robot: from `load_robot`, or any `Robot`.
            task: the force/motion task.
            dt: tick [s].
            sensor: turns readings into wrenches; None takes the readings of `step` as the wrench that the tool exerts,
                in the base frame, without noise.
            order: without a sensor, of plain (6,) numbers: "moment first" or "force first"; None refuses them.
            force_first: whether W'J x = W's are exact rows, W the constraints of the contact, so that limits slow the
                motion down before they change the force. They matter only if the arm cannot follow all of s.
            tare: whether the mean of the readings before the first contact is a bias. A press that is read from the
                start is first unloaded, to tell a contact from a bias.
            options: as in `Controller`: gain, form, damping, exact, acceleration_limit, tool_speed, ... Without
                `point`, twists are measured at the point of contact.

        Raises:
            BadInput, NoProjectors: as `HybridTask` and `Controller`.
        """
        if not isinstance(task, HybridTask):
            raise BadInput("task", excerpt(task), "a HybridTask")
        if not (sensor is None or isinstance(sensor, WrenchSensor)):
            raise BadInput("sensor", excerpt(sensor), "a WrenchSensor, or None")
        if sensor is not None and order is not None:
            raise BadInput("order", f"{order!r} and a sensor", "one of them", "Give order= to the sensor.")
        self.task = task
        mid = middle(require_robot(robot))
        contact = task.contact_at(robot.pose(mid))
        at_contact = options.get("point") is None
        if at_contact and options.get("length") is None:
            options["length"] = length_at(robot.jacobian(mid), contact.point)
        self.loop: Controller = Controller(robot, dt=dt, **options)
        self.sensor = sensor
        self.force_first = arrays.flag(force_first, "force_first")
        self.order = order_of(order)
        self._order = self.order if sensor is None else sensor.order
        self.splits = SplitCache(task, contact.kind)
        cutoff = inf if sensor is None else sensor.cutoff
        fault_retreats = task.on_overload == "retreat" or (task.on_overload is None and contact.kind.out is not None)
        self._settings: dict[str, Any] = {
            **{name: getattr(task, name) for name in TASK_SETTINGS},
            "dt": self.loop.dt,
            "delay": self.loop.delay,
            "noise": 0.0 if sensor is None else sensor.noise,
            "drift": 0.0 if sensor is None else sensor.drift,
            "filter_share": 1.0 - exp(-2.0 * pi * cutoff * self.loop.dt),
            "filter_time": 0.0 if cutoff == inf else 1.0 / (2.0 * pi * cutoff),
            "stiffness": task.stiffness or 0.0,
            "lost_below": nan if task.lost_below is None else task.lost_below,
            "on_loss": ON_LOSS.index(task.on_loss),
            "fault_retreats": fault_retreats,
            "tares": arrays.flag(tare, "tare") and sensor is not None,
            "sensor": None if sensor is None else sensor.fields(),
            "force_first": self.force_first,
            "measured_at_contact": at_contact,
        }
        self._engine = law.Hybrid(self._settings)
        self.reset()

    @property
    def stiffness(self) -> float | None:
        """Estimated stiffness of the contact along its first constraint [force/length]; None if not known."""
        k = self._state.law.stiffness(0)
        return None if isnan(k) else k

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.loop.robot

    @property
    def acceleration_share(self) -> float:
        """Share of the joints' acceleration that noise of the force leaves to the motion."""
        return float(self._state.acceleration_share)

    @property
    def state(self) -> Any:
        """A copy of the state between ticks, without that of `loop`; it pickles and may be set."""
        return copy(self._state)

    @state.setter
    def state(self, value: Any) -> None:
        if not isinstance(value, law.HybridState):
            raise BadInput("state", excerpt(value), "the state of a HybridController")
        self._state = copy(value)

    def __copy__(self) -> HybridController:
        return deepcopy(self)  # with a loop of its own

    def __deepcopy__(self, memo: dict[int, Any]) -> HybridController:
        other = object.__new__(type(self))
        changes = ("loop", "_state", "splits")
        vars(other).update(vars(self), **{name: deepcopy(getattr(self, name), memo) for name in changes})
        return other

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_engine"}

    def __setstate__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields)
        self._engine = law.Hybrid(self._settings)

    def reset(self) -> None:
        """Return to the state before the first contact, without faults and readings."""
        self._state = law.HybridState()

    def step(
        self,
        q: ArrayLike,
        target: Any,
        wrench: Any,
        feedforward: ArrayLike | None = None,
        contact: Contact | None = None,
        velocity: ArrayLike | None = None,
        wanted: ArrayLike | Wrench | None = None,
        posture: ArrayLike | None = None,
    ) -> HybridSolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            target: desired tool pose, as in `Controller.step`; only its part along S counts.
            wrench: the sensor's reading, or without a sensor the wrench that the tool exerts, base frame: a `Wrench`, a
                `pinocchio.Force`, a `geometry_msgs/Wrench`, or six numbers in the declared order.
            feedforward: (6,) twist of the target in the base frame; None is a target at rest.
            contact: of this tick; None takes the task's.
            velocity: as in `Controller.step`.
            wanted: the wrench to exert in this tick, as in `HybridTask`; None takes the task's.
            posture: as in `Controller.follow`.

        Raises:
            BadInput: NaN or wrong shapes; the state is unchanged. Repeat the last reading instead of one with NaN.
        """
        task, loop, inner = self.task, self.loop, self.loop.in_engine
        given = task.contact if contact is None else contact
        needs_tool = not isinstance(given, Contact) or given.kind.presses == 0
        tool = self.robot.pose(q) if needs_tool else NO_TOOL
        contact = task.contact_at(tool, contact)
        split = self.splits.at(contact, tool)
        plain = self._order is not None and are_numbers(wrench)
        reading = wrench if plain else wrench_of(wrench, self._order, "wrench")
        force_first = plain and self._order == "force first"
        goal = target if isinstance(target, np.ndarray) else self.robot.target(target)
        exert = None if wanted is None else split.desired_now(wanted)
        edge = nan if contact.edge is None else contact.edge
        states = self._state, inner.loop, inner.state
        place = self.splits.in_engine, contact.pose, edge
        rest = feedforward, velocity, exert, posture, inner.begin_callbacks(q, goal)
        try:
            found = self._engine.tick(*states, *place, q, goal, reading, force_first, *rest)
        except (ValueError, TypeError, AttributeError, ArithmeticError) as refusal:
            if isinstance(refusal, InvariantQPError) or inner.raised(refusal):
                raise
            arrays.vector(reading, 6, "wrench")
            raise bad_input(loop, q, target, feedforward, velocity, {"posture": posture}, refusal) from None
        if isinstance(found, float):  # a retreat along a normal that turned would press
            raise BadInput(
                "contact",
                f"a normal that turned by {degrees(found):.0f} degrees within a tick",
                "the outward normal of the surface that is pressed",
                "Check the function that gives it; to press on another surface, `reset` first.",
            )
        fields, J, wrenches, pose, report = found
        inside = inner.solution(fields)
        if wrenches is None:  # the joint positions cannot be true
            none, unknown = np.zeros(6), np.full(6, nan)
            wrenches = none, none, unknown, unknown, np.full(len(split.unit_parts), nan), unknown
        elif pose is not None:
            contact = Contact(contact.kind, pose, contact.edge)
        status, reason = inside.status, inside.reason
        if report is not None or (status is Status.DEGRADED and has_no_motion(inside)):
            status, reason = self._report(contact, messages.Report(*report or ()), inside)
        motion, force, measured, error, parts, exerted = wrenches
        return HybridSolution(
            inside.velocity, status, reason, motion, force, measured, error, parts, exerted, contact, inside, J
        )

    def _report(self, contact: Contact, report: messages.Report, inside: VelocitySolution) -> tuple[Status, str]:
        """Status and reason from the reports of the force law and of the velocity law."""
        state, edge = self._state.law, inf if contact.edge is None else contact.edge
        status, law_reason, stop = inside.status, inside.reason, ""
        if has_no_motion(inside) and state.touching and state.time_at_rest > 0.0 and not report.warnings:
            status, law_reason = Status.OK, ""  # compliant drives stand still against their commands as they press
        reasons = messages.warnings_of(report, self._state, self.loop, self.sensor, contact)
        is_beyond = edge <= 0.0 and report.action != messages.HOLD
        if edge < self.task.edge_margin and not (report.fault or is_beyond or report.is_lost):
            reasons.insert(0, f"{written(edge)} before the edge of the surface")
        if reasons and status is not Status.HELD:
            status = Status.DEGRADED
        if report.fault:
            status, stop = messages.status_of(report.fault), messages.fault_message(report, self._state)
        elif is_beyond:
            status, stop = Status.LOST, f"{written(-edge)} beyond the edge of the surface: not pushing"
        elif report.is_lost:
            status, stop = Status.LOST, messages.lost_message(report, state.airborne, self.task.on_loss)
        return status, "; ".join(filter(None, (stop, *reasons, law_reason)))
