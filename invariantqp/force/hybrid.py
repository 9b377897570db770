"""The hybrid loop body: joint positions, a target and a wrench in, a joint velocity inside the limits out.

    s = P s_motion + (I - P) C (I - P)' (W_d - W),     s_motion = gain log(T_target T^-1) + feedforward
    velocity = law(J(q), s, box(q)),                   torque = J'W_d for arms that take torques

Everything is told in the base frame; **wrenches are those that the tool exerts** (a `WrenchSensor` turns readings into
them). Neither part of s touches the other: see `hybrid_task`.

Reference: [DS] Sect. 6.3; Raibert & Craig 1981 for what it replaces (`compare.laws.raibert_craig`).
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.tracking import tracking_twist
from invariantqp.errors import BadInput
from invariantqp.force.hybrid_task import HybridTask, Split
from invariantqp.force.watch import HOLD, RETREAT, SLOW, Watch
from invariantqp.force.wrench import Smoothing, WrenchSensor
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, middle
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.exact import ExactRows
from invariantqp.velocity.solution import VelocitySolution


class HybridSolution(NamedTuple):
    """A joint velocity for a force/motion task, and how it came about; all twists and wrenches in the base frame.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "lost" or "overload", or the velocity law's own: "ok", "scaled", "guarded", "degraded", "held".
        reason: in words, "" where there is nothing to say.
        motion: (6,) twist asked of the velocity law along S, P s_motion.
        force: (6,) twist asked of it for the wrench error, along Z; the way out in a retreat.
        wrench: (6,) as measured: carried to the base, compensated, smoothed.
        error: (6,) P*(W_d - W), in S*.
        intensities: (6-k,) the measured wrench's parts in the contact's constraints; the first is the press.
        wanted: (6,) W_d.
        contact: the contact of this tick.
        law: the velocity law's answer.
        J: (6, m) joint twists.
    """

    velocity: Array
    status: str
    reason: str
    motion: Array
    force: Array
    wrench: Array
    error: Array
    intensities: Array
    wanted: Array
    contact: Contact
    law: VelocitySolution
    J: Array

    @property
    def twist(self) -> Array:
        """(6,) all that was asked of the velocity law."""
        return self.motion + self.force

    @property
    def torque(self) -> Array:
        """(m,) J'W_d, the joint torques that exert the wanted wrench, for torque-controlled arms [N m, N]."""
        torque: Array = self.J.T.dot(self.wanted)
        return torque


class HybridController:
    """Force along S*, motion along S, one arm; `step` is one tick.

    Attributes:
        task: what the contact allows and what to exert on it.
        loop: the velocity law with its limits.
        sensor: what cleans the readings, or None where wrenches come clean and in the base frame.
        force_first: whether the force part of the twist is met exactly, so that limits slow the tool down before they
            let go of the force.
    """

    def __init__(
        self,
        robot: Robot,
        task: HybridTask,
        *,
        dt: float,
        sensor: WrenchSensor | None = None,
        force_first: bool = True,
        **options: Any,
    ) -> None:
        """Make the loop's fixed part.

        Args:
            robot: from `load_robot`, or anything that meets `Robot`.
            task: the force/motion task.
            dt: tick [s].
            sensor: how readings become wrenches; None takes what `step` is given as the wrench that the tool exerts, in
                the base frame.
            force_first: whether W'Jx = W's are exact rows. They cost time only where the arm cannot do all of s: at
                limits, near singularities, with fewer than six joints.
            options: as in `Controller`: gain, form, damping, exact, acceleration_limit, tool_speed, ...

        Raises:
            BadInput, NoProjectors: what `HybridTask` and `Controller` refuse.
        """
        self.task = task
        if not isinstance(task, HybridTask):
            raise BadInput("task", repr(task), "a HybridTask")
        if not (sensor is None or isinstance(sensor, WrenchSensor)):
            raise BadInput("sensor", repr(sensor), "a WrenchSensor, or None")
        self.loop: Controller = Controller(robot, dt=dt, **options)
        self.sensor = sensor
        self.force_first = force_first
        self._smoothing = Smoothing.of(inf if sensor is None else sensor.cutoff, self.loop.dt)
        self._watch = Watch()
        self._split = task.split(task.contact_at(robot.pose(middle(robot))).kind)

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.loop.robot

    def reset(self) -> None:
        """Forget an overload or a loss, and what was read: as before the first touch."""
        self._watch = Watch()
        self._smoothing = self._smoothing._replace(value=None)

    def step(
        self,
        q: ArrayLike,
        target: Any,
        wrench: ArrayLike,
        feedforward: ArrayLike | None = None,
        contact: Contact | None = None,
        velocity: ArrayLike | None = None,
        wanted: ArrayLike | None = None,
    ) -> HybridSolution:
        """One tick: the joint velocity to command until the next.

        Args:
            q: (m,) measured joint positions [rad, length].
            target: tool pose to be at, as in `Controller.step`; only its part along S counts.
            wrench: (6,) the sensor's reading (m; f), or without a sensor the wrench that the tool exerts, base frame.
            feedforward: (6,) twist of the target in the base frame; None is a target at rest.
            contact: the contact now; None asks the task.
            velocity: as in `Controller.step`.
            wanted: what to exert in this tick, as `HybridTask.wrench`; None is what the task says.

        Returns:
            HybridSolution.

        Raises:
            BadInput: NaN or wrong shapes; controller, filter and watch are as they were.
        """
        robot, loop = self.loop.robot, self.loop
        positions = arrays.vector(q, len(robot.names), "q")
        reading = arrays.vector(wrench, 6, "wrench")
        if velocity is not None:
            velocity = arrays.vector(velocity, len(robot.names), "velocity")
        sighting = robot.sight(positions, target)
        s = tracking_twist(sighting, loop.gain, feedforward)
        tool = robot.pose(positions)
        if contact is None:
            contact = self.task.contact_at(tool)
        elif not isinstance(contact, Contact):
            raise BadInput("contact", repr(contact), "a Contact")
        split = self._split_for(contact)
        exert = split.wanted(np.asarray(self.task.wrench))
        if wanted is not None:
            exert = split.wanted(arrays.vector(wanted, None, "wanted"), "wanted")
        raw, measured, smoothing = self._measured(reading, tool)

        A, B = se3.carried(contact.pose), se3.carried_wrenches(contact.pose)  # from the contact's frame to the base's
        felt = A.T.dot(measured)
        parts = split.intensities.dot(felt)
        error = split.projectors.force.dot(exert - felt)
        motion = A.dot(split.projectors.motion.dot(B.T.dot(s)))
        force = A.dot(split.admittance.dot(error))
        press = (float(parts[0]), float(split.intensities[0].dot(exert))) if contact.kind.unilateral else None
        watch = self._watch.seen(self.task, press, _load(contact, raw), loop.dt)
        verdict = watch.verdict(self.task)

        if verdict.action == SLOW:
            force *= self._share(contact, force)
        if verdict.action == HOLD:
            motion = force = np.zeros(6)
            law = loop.rest(positions, "", velocity, sighting)
        elif verdict.action == RETREAT:
            out = A.dot(np.asarray(contact.kind.out))
            speed = min(self.task.retreat_speed, (self.task.retreat_distance - watch.left) / loop.dt)
            motion, force = np.zeros(6), speed * out
            law = loop.follow(positions, force, velocity, self._rows(contact, sighting.J, force), sighting)
            v = velocity_at(sighting.J.dot(law.velocity), contact.point)
            watch = watch.further(loop.dt * float(velocity_at(out, contact.point).dot(v)))
        else:
            law = loop.follow(positions, motion + force, velocity, self._rows(contact, sighting.J, force), sighting)
        self._watch, self._smoothing = watch, smoothing
        return HybridSolution(
            velocity=law.velocity,
            status=verdict.status or law.status,
            reason="; ".join(r for r in (verdict.reason, law.reason) if r),
            motion=motion,
            force=force,
            wrench=measured.copy(),
            error=B.dot(error),
            intensities=parts,
            wanted=B.dot(exert),
            contact=contact,
            law=law,
            J=sighting.J,
        )

    def _split_for(self, contact: Contact) -> Split:
        """The task's constants for the kind of this contact, kept while the kind is the same."""
        if contact.kind is not self._split.kind:
            self._split = self.task.split(contact.kind)
        return self._split

    def _measured(self, reading: Array, tool: Array) -> tuple[Array, Array, Smoothing]:
        """The wrench that the tool exerts, base frame, as it came and cleaned; and the low-pass after it."""
        sensor = self.sensor
        if sensor is None:
            return reading, reading, self._smoothing
        load = sensor.loaded(reading, tool)
        smooth, after = self._smoothing.after(load)
        return sensor.in_base(load, tool), sensor.in_base(sensor.dead(smooth), tool), after

    def _rows(self, contact: Contact, J: Array, force: Array) -> ExactRows | None:
        """W'Jx = W's, as long as that leaves the arm two joints to move with."""
        n = contact.constraints.shape[1]
        m = J.shape[1]
        if not self.force_first or n == 0 or (m < 6 and n > m - 2):
            return None
        W = contact.constraints
        return ExactRows(W.T.dot(J), W.T.dot(force))

    def _share(self, contact: Contact, force: Array) -> float:
        """The share of the force law's twist that keeps the place of contact below the approach speed."""
        task = self.task
        v, w = velocity_at(force, contact.point), task.size * force[:3]
        speed = sqrt(max(v.dot(v), w.dot(w)))
        return min(1.0, task.approach_speed / speed) if speed > 0.0 else 1.0


def _load(contact: Contact, wrench: Array) -> tuple[float, float]:
    """|f| and |m| about the place of contact."""
    f = wrench[3:]
    m = wrench[:3] - se3.cross(contact.point, f)
    return sqrt(f.dot(f)), sqrt(m.dot(m))
