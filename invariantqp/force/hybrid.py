"""The hybrid loop body: joint positions, a target and a wrench in, a joint velocity inside the limits out.

    s = P s_motion + (I - P) C (I - P)' (W_d - W + integral),     s_motion = gain log(T_target T^-1) + feedforward
    velocity = law(J(q), s, box(q)),                   torque = J'W_d for arms that take torques

Everything is in the base frame; **wrenches are those that the tool exerts** (a `WrenchSensor` turns readings into
them). Neither part of s disturbs the other: see `hybrid_task`.

Reference: [DS] Sect. 6.3; Raibert & Craig 1981 for what it replaces (`compare.laws.raibert_craig`).
"""

from __future__ import annotations

from copy import deepcopy
from math import inf, pi, sqrt
from typing import Any

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.tracking import tracking_twist
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.hybrid_task import HybridTask, Split
from invariantqp.force.reading import Order, Wrench, order_of, wanted_of, wrench_of
from invariantqp.force.regulation import Regulation
from invariantqp.force.smoothing import Smoothing
from invariantqp.force.watch import FOLLOW, HOLD, RETREAT, SLOW, Felt, Watch
from invariantqp.force.wrench import WrenchSensor
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, middle, require_robot
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.measure import length_at
from invariantqp.velocity.solution import VelocitySolution


@frozen(eq=False, repr=False, slots=False)
class HybridSolution(Compared):
    """A joint velocity for a force/motion task, and how it was found; all twists and wrenches in the base frame.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "lost", "overload" or "fault" (the sensor's), "degraded" also where the force is not reached or chatters,
            or the velocity law's own: "ok", "scaled", "guarded", "degraded", "held".
        reason: why, in words, "" where there is nothing to report.
        motion: (6,) the wanted twist along S, P s_motion.
        force: (6,) the wanted twist for the wrench error, along Z; the way out in a retreat.
        wrench: (6,) the measured wrench: without weight and bias, smoothed, in the base frame.
        error: (6,) P*(W_d - W), in S*.
        intensities: (6-k,) the measured wrench's parts in the contact's constraints; the first is the press.
        wanted: (6,) W_d.
        contact: the contact of this tick.
        velocity_solution: the velocity law's answer.
        J: (6, m) joint twists.
    """

    velocity: Array
    status: str
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
        loop: the `Controller` that follows the twist of each tick inside the limits.
        sensor: what cleans the readings, or None where wrenches come clean and in the base frame.
        order: of plain numbers where there is no sensor.
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
        self._at_contact = options.get("point") is None
        if self._at_contact and options.get("length") is None:
            options["length"] = length_at(robot.jacobian(mid), contact.point)
        self.loop: Controller = Controller(robot, dt=dt, **options)
        self.sensor = sensor
        self.force_first = arrays.flag(force_first, "force_first")
        self.order = order_of(order)
        cutoff = inf if sensor is None else sensor.cutoff
        self._late = self.loop.dt + options.get("delay", 0.0) + 1.0 / (2.0 * pi * cutoff)
        self._smoothing = Smoothing.of(cutoff, self.loop.dt)
        self._watch = Watch()
        self._regulation = Regulation()
        self._moved: Array = np.zeros(3)
        self._split = task.split(contact.kind)

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.loop.robot

    def __copy__(self) -> HybridController:
        return deepcopy(self)  # with a loop of its own

    def reset(self) -> None:
        """Forget an overload, a fault or a loss, and the readings: the state before the first touch."""
        self._watch = Watch()
        self._regulation = Regulation()
        self._moved = np.zeros(3)
        self._smoothing = self._smoothing._replace(value=None)

    def step(
        self,
        q: ArrayLike,
        target: Any,
        wrench: Any,
        feedforward: ArrayLike | None = None,
        contact: Contact | None = None,
        velocity: ArrayLike | None = None,
        wanted: ArrayLike | Wrench | None = None,
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

        Returns:
            HybridSolution.

        Raises:
            BadInput: NaN or wrong shapes; the controller's state is as it was.
        """
        robot, loop = self.loop.robot, self.loop
        positions = arrays.vector(q, len(robot.names), "q")
        reading = wrench_of(wrench, self.order if self.sensor is None else self.sensor.order, "wrench")
        if velocity is not None:
            velocity = arrays.vector(velocity, len(robot.names), "velocity")
        sighting = robot.sight(positions, target)
        s = tracking_twist(sighting.error, loop.gain, feedforward)
        tool = robot.pose(positions)
        if contact is None:
            contact = self.task.contact_at(tool)
        elif not isinstance(contact, Contact):
            raise BadInput("contact", excerpt(contact), "a Contact")
        split = self._split_for(contact)
        exert = split.wanted(self.task.wrench)
        if wanted is not None:
            exert = split.wanted(wanted_of(wanted, "wanted"), "wanted")
        raw, measured, smoothing = self._measure(reading, tool)

        # From the contact frame to the base frame.
        A, B = se3.adjoint(contact.pose, check=False), se3.coadjoint(contact.pose, check=False)
        felt = self._felt(reading, raw, contact, tool[:3, 3], split, exert)
        watch = self._watch.after(self.task, felt, loop.dt)
        verdict = watch.verdict(self.task, can_leave=contact.kind.out is not None)
        regulation, factor, rate = self._regulated(felt, split, watch)

        inside = A.T.dot(measured)
        parts = split.intensities.dot(inside)
        error = split.projectors.force.dot(exert - inside)
        motion = A.dot(split.projectors.motion.dot(B.T.dot(s)))
        where, share = contact.point if self._at_contact else None, 1.0
        if verdict.action == SLOW and self.task.adapts and felt.press is not None:
            # Towards the contact, whatever the noise says, so slowly that the touch is gentle.
            force = A.dot(split.admittance.dot(split.projectors.force.dot(exert)))
            gentle = regulation.approach_speed(felt.press[1], self.task.stiffness, self._late)
            force *= min(gentle, self.task.approach_speed) / max(self._speed(contact, force), np.finfo(float).tiny)
        else:
            force = factor * A.dot(split.admittance.dot(error + regulation.integral))
            if verdict.action == SLOW or watch.touching:
                share = min(1.0, self.task.approach_speed / max(self._speed(contact, force), np.finfo(float).tiny))
                force *= share
        if watch.health.stale:
            force *= 0.0
        if verdict.action == HOLD:
            motion, force = np.zeros(6), np.zeros(6)
            inner = loop.rest(positions, "", velocity, sighting)
        elif verdict.action == RETREAT:
            speed = min(self.task.retreat_speed, (self.task.retreat_distance - watch.left) / loop.dt)
            motion, force = np.zeros(6), speed * A.dot(np.asarray(contact.kind.out))
            inner = loop.follow(positions, force, velocity, self._rows(contact, sighting.J, force), sighting, where)
        else:
            rows = self._rows(contact, sighting.J, force)
            inner = loop.follow(positions, motion + force, velocity, rows, sighting, where)
        self._moved = loop.dt * contact.pose[:3, :3].T.dot(
            velocity_at(sighting.J.dot(inner.velocity), contact.point)
        )
        free = share == 1.0 and inner.scale == 1.0 and verdict.action == FOLLOW
        self._regulation = regulation.after(error, rate, loop.dt, float(free))
        self._watch = watch.after_motion(-float(self._moved[2]))
        self._smoothing = smoothing
        trouble = "" if verdict.status or felt.press is None else watch.settling.trouble(felt.press[1], self._late)
        reasons = (verdict.reason, trouble, inner.reason)
        status = inner.status if inner.status == "held" or not trouble else "degraded"
        return HybridSolution(
            velocity=inner.velocity,
            status=verdict.status or status,
            reason="; ".join(r for r in reasons if r),
            motion=motion,
            force=force,
            wrench=measured.copy(),
            error=B.dot(error),
            intensities=parts,
            wanted=B.dot(exert),
            contact=contact,
            velocity_solution=inner,
            J=sighting.J,
        )

    def _felt(self, reading: Array, raw: Array, contact: Contact, tool: Array, split: Split, exert: Array) -> Felt:
        """What the raw reading tells of the contact."""
        press, noise = None, 0.0 if self.sensor is None else self.sensor.noise
        if contact.kind.unilateral:
            inside = se3.adjoint(contact.pose, check=False).T.dot(raw)
            press = (float(split.intensities[0].dot(inside)), float(split.intensities[0].dot(exert)))
        return Felt(reading, press, *_load(raw, contact.point, tool), self.task.most(exert, noise), noise)

    def _regulated(self, felt: Felt, split: Split, watch: Watch) -> tuple[Regulation, float, float | None]:
        """The force law's memory, the factor on its compliance, and the rate of its integral (None without one)."""
        regulation, stiffness = self._regulation, self.task.stiffness
        if stiffness is None and felt.press is not None:
            estimate = regulation.estimate.after(felt.press[0], self._moved, watch.touching, felt.noise, self.loop.dt)
            regulation = regulation._replace(estimate=estimate)
        if self.task.adapts and watch.settling.chatters:
            regulation = regulation.slower()
        factor = regulation.factor(split.compliance, stiffness, self._late) if self.task.adapts else 1.0
        k = regulation.known(stiffness)
        touching = watch.touching if felt.press is not None else True
        rate = factor * split.compliance * k if k is not None and touching else None
        return regulation, factor, rate

    def _split_for(self, contact: Contact) -> Split:
        """The task's split for the kind of this contact, kept while the kind is the same."""
        if contact.kind is not self._split.kind:
            self._split = self.task.split(contact.kind)
        return self._split

    def _measure(self, reading: Array, tool: Array) -> tuple[Array, Array, Smoothing]:
        """The wrench that the tool exerts, base frame, raw and cleaned; and the low-pass after it."""
        sensor = self.sensor
        if sensor is None:
            return reading, reading, self._smoothing
        load = sensor.load(reading, tool)
        smooth, after = self._smoothing.after(load)
        return sensor.in_base(load, tool), sensor.in_base(sensor.deadband(smooth), tool), after

    def _rows(self, contact: Contact, J: Array, force: Array) -> ExactRows | None:
        """W'J x = W's where that leaves the arm at least two degrees of freedom, else None."""
        n = contact.constraints.shape[1]
        m = J.shape[1]
        if not self.force_first or n == 0 or (m < 6 and n > m - 2):
            return None
        W = contact.constraints
        return ExactRows(W.T.dot(J), W.T.dot(force))

    def _speed(self, contact: Contact, force: Array) -> float:
        """How fast a force twist moves the place of contact, turning counted by the contact's size [length/s]."""
        v, w = velocity_at(force, contact.point), self.task.size * force[:3]
        return sqrt(max(v.dot(v), w.dot(w)))


def _load(wrench: Array, *places: Array) -> tuple[float, float]:
    """|f|, and |m| about the place where it is least: a handle is held far from its hinge."""
    m, f = wrench[:3], wrench[3:]
    moments = [m - se3.cross(place, f) for place in places]
    return sqrt(f.dot(f)), sqrt(min(m.dot(m) for m in moments))
