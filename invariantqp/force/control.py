"""The hybrid loop body: joint positions, a target and a wrench in, a joint velocity inside the limits out.

    s = P s_motion + sum of unit rates along Z,     s_motion = gain log(T_target T^-1) + feedforward
    velocity = law(J(q), s, box(q)),                torque = J'W_d for arms that take torques

A tick is computed by the engine (`core/hybrid.hpp`); this file reads arguments and says what was found. Everything is
in the base frame; **wrenches are those that the tool exerts** (a `WrenchSensor` turns readings into them). Neither part
of s disturbs the other: see `contact`.

Reference: [DS] Sect. 6.3; Raibert & Craig 1981 for what it replaces (`compare.frames`).
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
from invariantqp.force.contact import HybridTask, KeptSplit, contact_now
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.sensor import DRIFT, Order, Wrench, WrenchSensor, are_numbers, order_of, wrench_of
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.robots.kinematics import Robot, middle, require_robot
from invariantqp.velocity.measure import length_at
from invariantqp.velocity.solution import Status, VelocitySolution, no_motion

# The longest dead time for which commands are remembered.
MOST_TICKS = 10_000
# The pose of a tool on which nothing depends.
ANYWHERE = np.eye(4)
LOSSES = ("approach", "hold", "retreat", "continue")
# Settings of the engine that are the task's.
OF_TASK = (
    *("size", "slope", "yields", "lost_after", "approach_speed", "approach_distance", "approach_time", "grip"),
    *("retreat_distance", "retreat_speed", "slide_speed", "edge_margin", "normal_within", "max_force", "max_moment"),
)
# What the engine says where it doubts nothing.
UNDOUBTED = (messages.FOLLOW, 0, False, 0, 0.0, 0.0, 1.0, 0.0, 0.0)


@frozen(eq=False, repr=False, slots=False)
class HybridSolution(Compared):
    """A joint velocity for a force/motion task, and how it was found; all twists and wrenches in the base frame.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "lost", "overload" or "fault" (the sensor's), "degraded" where the force swings or is not reached, the
            edge is near or the normal is out of bounds, or the velocity law's own: see `Status`.
        reason: why, in words, "" where there is nothing to report.
        motion: (6,) the wanted twist along S, P s_motion.
        force: (6,) the wanted twist for the wrench error, along Z; the way out in a retreat.
        wrench: (6,) the measured wrench: without weight and bias, smoothed, in the base frame.
        error: (6,) P*(W_d - W), in S*.
        intensities: (6-k,) the measured wrench's parts in the contact's constraints; the first is the press.
        wanted: (6,) W_d.
        contact: the contact of this tick, with the normal found.
        velocity_solution: the velocity law's answer.
        J: (6, m) joint twists.

    Where joint positions cannot be true, wrenches are NaN: where they act is not known.
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
        """(6,) the wanted twist, motion and force together."""
        return self.motion + self.force

    @property
    def torque(self) -> Array:
        """(m,) J'W_d, the joint torques that exert the wanted wrench, for torque-controlled arms [N m, N]."""
        torque: Array = self.J.T.dot(self.wanted)
        return torque


class HybridController:
    """Force along S*, motion along S, one arm; `step` is one tick. One controller drives one arm, in one thread.

    Attributes:
        task: what the contact allows and what to exert on it.
        loop: the loop that follows the twist of each tick inside the limits.
        sensor: what cleans the readings, or None where wrenches come clean and in the base frame.
        order: of plain numbers where there is no sensor.
        splits: the task's split for the contact of a tick.
        force_first: whether the force part of the twist is met exactly, so that limits slow the motion down before
            they change the force.
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
        """Make the loop's fixed part.

        Args:
            robot: from `load_robot`, or anything that meets `Robot`.
            task: the force/motion task.
            dt: tick [s].
            sensor: how readings become wrenches; None takes what `step` is given as the wrench that the tool exerts, in
                the base frame, without noise.
            order: without a sensor, of plain (6,) numbers: "moment first" or "force first"; None refuses them.
            force_first: whether W'J x = W's are exact rows, W the constraints of the contact. They matter only where
                the arm cannot do all of s: at limits, near singularities, with fewer than six joints.
            tare: whether the mean of a sensor's readings in the air before a touch is its bias. A press that is read
                from the start is first unloaded, to tell a contact from a bias.
            options: as in `Controller`: gain, form, damping, exact, acceleration_limit, tool_speed, ... Without
                `point`, twists are measured at the point of contact.

        Raises:
            BadInput, NoProjectors: what `HybridTask` and `Controller` refuse.
        """
        if not isinstance(task, HybridTask):
            raise BadInput("task", excerpt(task), "a HybridTask")
        if not (sensor is None or isinstance(sensor, WrenchSensor)):
            raise BadInput("sensor", excerpt(sensor), "a WrenchSensor, or None")
        if sensor is not None and order is not None:
            raise BadInput("order", f"{order!r} beside a sensor", "one of them", "Say it where the sensor is made.")
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
        if self.loop.delay > MOST_TICKS * self.loop.dt:
            raise BadInput("delay", f"{self.loop.delay:g} s", f"a dead time of at most {MOST_TICKS} ticks")
        self.splits = KeptSplit(task, contact.kind)
        cutoff, self._noise, self._drift = (inf, 0.0, DRIFT)
        if sensor is not None:
            cutoff, self._noise, self._drift = sensor.cutoff, sensor.noise, sensor.drift
        retreats = task.on_overload == "retreat" or (task.on_overload is None and contact.kind.out is not None)
        self._settings: dict[str, Any] = {
            **{name: getattr(task, name) for name in OF_TASK},
            "dt": self.loop.dt,
            "delay": self.loop.delay,
            "noise": self._noise,
            "drift": self._drift,
            "filter_share": 1.0 - exp(-2.0 * pi * cutoff * self.loop.dt),
            "filter_time": 0.0 if cutoff == inf else 1.0 / (2.0 * pi * cutoff),
            "stiffness": task.stiffness or 0.0,
            "lost_below": nan if task.lost_below is None else task.lost_below,
            "on_loss": LOSSES.index(task.on_loss),
            "fault_retreats": retreats,
            "tares": arrays.flag(tare, "tare") and sensor is not None,
            "sensor": None if sensor is None else sensor.fields(),
            "force_first": self.force_first,
            "measured_at_contact": at_contact,
        }
        self._engine = law.Hybrid(self._settings)
        self.reset()

    @property
    def stiffness(self) -> float | None:
        """Of the contact along its first constraint [force/length], as estimated; None where it is not known."""
        k = self._memory.press.stiffness(0)
        return None if isnan(k) else k

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.loop.robot

    @property
    def room(self) -> float:
        """Share of the joints' acceleration that noise in the force leaves to the motion."""
        return float(self._memory.room)

    @property
    def memory(self) -> Any:
        """What it remembers between ticks beside its loop, a copy; it pickles, and may be set to one that was kept."""
        return copy(self._memory)

    @memory.setter
    def memory(self, value: Any) -> None:
        if not isinstance(value, law.HybridState):
            raise BadInput("memory", excerpt(value), "the memory of a HybridController")
        self._memory = copy(value)

    def __copy__(self) -> HybridController:
        return deepcopy(self)  # with a loop of its own

    def __deepcopy__(self, memo: dict[int, Any]) -> HybridController:
        other = object.__new__(type(self))
        changes = ("loop", "_memory", "splits")
        vars(other).update(vars(self), **{name: deepcopy(getattr(self, name), memo) for name in changes})
        return other

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_engine"}

    def __setstate__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields)
        self._engine = law.Hybrid(self._settings)

    def reset(self) -> None:
        """Forget an overload, a fault or a loss, and the readings: the state before the first touch."""
        self._memory = law.HybridState()

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
            target: wanted tool pose, as in `Controller.step`; only its part along S counts.
            wrench: the sensor's reading, or without a sensor the wrench that the tool exerts, base frame: a `Wrench`, a
                `pinocchio.Force`, a `geometry_msgs/Wrench`, or six numbers where their order was said.
            feedforward: (6,) twist of the target in the base frame; None is a target at rest.
            contact: the contact now; None takes the task's.
            velocity: as in `Controller.step`.
            wanted: what to exert in this tick, as `HybridTask.wrench`; None takes the task's.
            posture: as in `Controller.follow`.

        Raises:
            BadInput: NaN or wrong shapes; the controller's state is as it was. In place of a reading with NaN give the
                one before again; too often is a dead sensor's "fault".
        """
        task, loop, inner = self.task, self.loop, self.loop.in_engine
        given, tool = task.contact if contact is None else contact, ANYWHERE
        if not isinstance(given, Contact) or given.kind.presses == 0:
            tool = self.robot.pose(q)
        contact = contact_now(task, tool, contact)
        split = self.splits.at(contact, tool)
        plain = self._order is not None and are_numbers(wrench)
        reading = wrench if plain else wrench_of(wrench, self._order, "wrench")
        first = plain and self._order == "force first"
        goal = target if isinstance(target, np.ndarray) else self.robot.target(target)
        exert = None if wanted is None else split.wanted_now(wanted)
        edge = nan if contact.edge is None else contact.edge
        functions = inner.begin_callbacks(q, goal)
        place = self.splits.in_engine, contact.pose, edge
        rest = feedforward, velocity, exert, posture, functions
        try:
            found = self._engine.tick(self._memory, inner.loop, inner.state, *place, q, goal, reading, first, *rest)
        except (ValueError, TypeError, AttributeError, ArithmeticError) as refusal:
            if isinstance(refusal, InvariantQPError) or inner.raised(refusal):
                raise
            arrays.vector(reading, 6, "wrench")
            raise bad_input(loop, q, target, feedforward, velocity, {"posture": posture}, refusal) from None
        if isinstance(found, float):
            raise _turned(found)
        fields, J, wrenches, pose, doubts = found
        answer = inner.solution(fields)
        if wrenches is None:  # the positions cannot be true, nor where wrenches act
            none, unknown = np.zeros(6), np.full(6, nan)
            parts = np.full(len(split.unit_parts), nan)
            wrenches = none, none, unknown, unknown, parts, unknown
        elif pose is not None:
            contact = Contact(contact.kind, pose, contact.edge)
        motion, force, measured, error, parts, exerted = wrenches
        status, why = answer.status, answer.reason
        if doubts is not None or (status is Status.DEGRADED and no_motion(answer)):
            status, why = self._said(contact, doubts or UNDOUBTED, answer)
        return HybridSolution(
            answer.velocity, status, why, motion, force, measured, error, parts, exerted, contact, answer, J
        )

    def _said(self, contact: Contact, doubts: tuple[Any, ...], inner: VelocitySolution) -> tuple[Status, str]:
        """Status and reason of a tick, from what the engine doubts."""
        action, reason, lost, flags, late, wanted, *_ = doubts
        state = self._memory.press
        status, why = self._stopped(contact, action, reason, wanted, lost=lost)
        trouble = messages.doubts_of(flags, state, self._noise, self._drift, late, presses=contact.kind.presses > 0)
        trouble += self._limited(contact, doubts)
        if status is None and contact.edge is not None and contact.edge < self.task.edge_margin:
            trouble.insert(0, f"{written(contact.edge)} before the edge of the surface")
        law_status, reasons = inner.status, inner.reason
        if no_motion(inner) and state.touching and state.still > 0.0 and not flags:
            law_status, reasons = Status.OK, ""  # motors that give way stand still against their commands as they press
        if trouble and law_status is not Status.HELD:
            law_status = Status.DEGRADED
        return status or law_status, "; ".join(words for words in (why, *trouble, reasons) if words)

    def _stopped(
        self, contact: Contact, action: int, reason: int, wanted: float, *, lost: bool
    ) -> tuple[Status | None, str]:
        """Status and reason where there is no contact, or the tool stands still or retreats; None in contact."""
        state, edge = self._memory.press, contact.edge
        if reason:
            why = messages.stopped(reason, state, wanted, self._memory.at_once)
            return messages.status_of(reason), why + (
                messages.LEAVES if action == messages.RETREAT else messages.STANDS
            )
        if edge is not None and edge <= 0.0 and action != messages.HOLD:
            return Status.LOST, f"{written(-edge)} beyond the edge of the surface: not pushing"
        return (Status.LOST, messages.lost(state, self.task, action)) if lost else (None, "")

    def _limited(self, contact: Contact, doubts: tuple[Any, ...]) -> list[str]:
        """What lowers gains, and what the arm or a bound does not allow."""
        *_, gain_scale, unreachable, gain = doubts
        memory, loop, state = self._memory, self.loop, self._memory.press
        trouble = []
        if 0.0 < gain < loop.gain:
            trouble.append(messages.late(state.lag - loop.delay, gain, loop.gain))
        if gain_scale < 1.0:
            trouble.append(messages.lowered(gain_scale, max(self._noise, state.noise)))
        if unreachable > 0.0:
            trouble.append(messages.unreachable(unreachable, len(loop.robot.names), contact.name))
        if memory.normal_bound > 0.0:
            trouble.append(messages.normal_bound(memory.normal_bound))
        return trouble


def _turned(angle: float) -> BadInput:
    """A normal that turned within a tick presses where it should let go, and a retreat along it goes on pressing."""
    return BadInput(
        "contact",
        f"a normal that turned by {degrees(angle):.0f} degrees within a tick",
        "the outward normal of the surface that is pressed",
        "Check the function that gives it; to press on another surface, `reset` first.",
    )
