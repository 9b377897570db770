"""The hybrid loop body: joint positions, a target and a wrench in, a joint velocity inside the limits out.

    s = P s_motion + (I - P) C (I - P)' (W_d - W + integral),     s_motion = gain log(T_target T^-1) + feedforward
    velocity = law(J(q), s, box(q)),                   torque = J'W_d for arms that take torques

Everything is in the base frame; **wrenches are those that the tool exerts** (a `WrenchSensor` turns readings into
them). Neither part of s disturbs the other: see `hybrid_task`.

Reference: [DS] Sect. 6.3; Raibert & Craig 1981 for what it replaces (`compare.frames`).
"""

from __future__ import annotations

from copy import deepcopy
from math import hypot, inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.tracking import tracking_twist
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.beyond import Beyond
from invariantqp.force.felt import Felt, felt_of
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.kept_split import KeptSplit, contact_now
from invariantqp.force.lag import Lag
from invariantqp.force.normal import NormalEstimate
from invariantqp.force.place import require_same_side, way_out
from invariantqp.force.push import SLOW_SHARE, Stand, force_rows, gains_of, pressed_by, push, retreat
from invariantqp.force.reading import Order, Wrench, order_of, wanted_of, wrench_of
from invariantqp.force.regulation import Regulation
from invariantqp.force.smoothing import Smoothing
from invariantqp.force.solution import HybridSolution
from invariantqp.force.split import Split
from invariantqp.force.tremble import MOST, doubt, trembling
from invariantqp.force.two_presses import TwoPresses
from invariantqp.force.verdict import FOLLOW, HOLD, RETREAT, SLOW, verdict
from invariantqp.force.watch import Watch
from invariantqp.force.ways import Ways
from invariantqp.force.wrench import WrenchSensor, cleaned
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, Sighting, middle, require_robot
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.measure import length_at

# The longest dead time for which ways are remembered.
MOST_TICKS = 10_000


class HybridController:
    """Force along S*, motion along S, one arm; `step` is one tick. One controller drives one arm, in one thread.

    Attributes:
        task: what the contact allows and what to exert on it.
        loop: the `Controller` that follows the twist of each tick inside the limits.
        sensor: what cleans the readings, or None where wrenches come clean and in the base frame.
        order: of plain numbers where there is no sensor.
        splits: the task's split for the contact of a tick.
        room: share of the joints' acceleration that noise in the force leaves to the motion.
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
        cutoff, self._noise = (inf, 0.0) if sensor is None else (sensor.cutoff, sensor.noise)
        delay = float(options.get("delay", 0.0))
        if delay > MOST_TICKS * self.loop.dt:
            raise BadInput("delay", f"{delay:g} s", f"a dead time of at most {MOST_TICKS} ticks")
        self._timing = self.loop.dt, delay, cutoff
        self._smoothing = Smoothing.of(cutoff, self.loop.dt)
        self.reset()
        self.splits = KeptSplit(task, contact.kind)

    @property
    def stiffness(self) -> float | None:
        """Of the contact along the press [force/length], as told or as last identified; None is not known yet."""
        return self._regulation.known(self.task.stiffness)

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.loop.robot

    def __copy__(self) -> HybridController:
        return deepcopy(self)  # with a loop of its own

    def reset(self) -> None:
        """Forget an overload, a fault or a loss, and the readings: the state before the first touch."""
        self._tool: Array | None = None
        self._out: Array | None = None
        self.room: float = 1.0
        self._regulation = Regulation(presses=TwoPresses() if self.task.two_presses else None)
        self._watch, self._normal, self._stand, self._beyond = Watch(), NormalEstimate(), Stand(), Beyond()
        self._ways, self._lag = Ways(self._timing[1], self.loop.dt), Lag(*self._timing)
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
            BadInput: NaN or wrong shapes; the controller's state is as it was.
        """
        robot, loop, lag, late = self.loop.robot, self.loop, self._lag, self._lag.sums
        positions = arrays.vector(q, len(robot.names), "q")
        reading = wrench_of(wrench, self.order if self.sensor is None else self.sensor.order, "wrench")
        velocity = None if velocity is None else arrays.vector(velocity, len(robot.names), "velocity")
        sighting = robot.sight(positions, target)
        if loop.wrong(positions):
            return self._halted(positions, velocity, sighting, contact)
        s = tracking_twist(sighting.error, lag.gain(loop.gain), feedforward)
        tool = sighting.pose if isinstance(sighting.pose, np.ndarray) else robot.pose(positions)
        given = contact_now(self.task, tool, contact)
        split, (contact, told) = self.splits.at(given, tool), self._turned(given)
        # What is held stays where it is: the arm is looked at where it will be when this command acts.
        held = self._ways.joints and given.kind.presses == 0
        then = robot.sight(self._ways.coming(positions), target) if held else sighting
        asked = (self.task.wrench,) if wanted is None else (wanted_of(wanted, "wanted"), "wanted")
        exert = self._regulation.share * split.wanted(*asked)
        raw, measured, smoothing = cleaned(self.sensor, reading, tool, self._smoothing)

        # From the contact frame to the base frame.
        A, B = contact.adjoint, contact.coadjoint
        inside = A.T.dot(measured)
        error = split.projectors.force.dot(exert - inside)
        out = way_out(contact)
        require_same_side(self._out, out)
        felt = felt_of(
            self.task,
            contact,
            split,
            (reading, raw),
            (B.dot(exert), B.dot(error)),
            (self._tool, tool),
            (out, self._ways.place[0]),
            noise=max(self._noise, self._watch.noise.found),
            answer=self._regulation.answer(self.task.stiffness),
        )
        watch = self._watch.after(self.task, felt, loop.dt)
        regulation = self._regulated(felt, watch, late, split, A.T.dot(raw))
        motion = A.dot(split.projectors.motion.dot(B.T.dot(s)))

        answer = verdict(watch, self.task, contact)
        trembles = trembling(
            loop, sighting.J, A.dot(split.admittance), contact.point, self.task.size, felt.noise, smoothing.share
        )
        gains = gains_of(self.task, split, regulation, felt.wanted, late, trembles, watch.touch, watch.level)
        slow, waits = answer.action == SLOW, watch.health.stale or answer.beyond
        pushed = push(
            self.task,
            contact,
            split,
            gains,
            exert,
            error,
            regulation.integral,
            motion,
            slow=slow,
            joints=len(positions),
        )
        force, where = pushed.twist, contact.point if self._at_contact else None
        if answer.action == HOLD:
            motion = force = np.zeros(6)
            inner = loop.rest(positions, "", velocity, sighting)
        else:
            if answer.action == RETREAT:
                motion, force = np.zeros(6), retreat(self.task, contact, watch.left, loop.dt)
            elif waits:
                force = self._beyond.twist(self.task, contact, loop.dt) if answer.beyond else np.zeros(6)
            rows = force_rows(contact, then.J, motion + force) if self.force_first else None
            inner = loop.follow(positions, motion + force, velocity, rows, then, where, posture)
        acts = pushed.free and inner.scale == 1.0 and answer.action == FOLLOW and not waits
        twist, k = then.J.dot(inner.velocity), regulation.known(self.task.stiffness)
        way, shown = loop.dt * velocity_at(twist, contact.point), self._ways.place[0]
        self._normal = self._normal.found(self.task, told, shown, felt.press, k, touching=watch.touching)
        lag.after(positions, loop.dt * inner.velocity, sighting.J, contact.point, self.task.size)
        self._ways.add(loop.dt * inner.velocity, way, loop.dt * split.unit[1].dot(B.T.dot(twist)), late[2])
        self._watch, self._smoothing, self._beyond, self._tool, self._stand, self._regulation, self.room, self._out = (
            watch.after_motion(out.dot(way), answer.beyond),
            smoothing,
            self._beyond.after(contact.point, out.dot(way), beyond=answer.beyond),
            tool,
            self._stand.after(self.task, contact, motion, twist, loop.dt, joints=sighting.J.shape[1]),
            regulation.after(error, gains.rate, loop.dt, regulation.integrated(felt.press) if acts else 0.0),
            max(1.0 - gains.noise, 1.0 - MOST),
            out if watch.touching else None,
        )
        doubts = (
            *watch.doubts(felt.wanted, self._noise, late[0] + late[2], lost=bool(answer.status)),
            lag.trouble(loop.gain),
            doubt(gains.kept, felt.noise) if watch.touching else "",
            self._stand.trouble(),
            pressed_by(self.task, split, contact, tool, sighting.J, motion),
            self._normal.trouble(),
            regulation.mistold(self.task.stiffness),
        )
        status, reason = answer.with_others(doubts, inner.status, inner.reason)
        return HybridSolution(
            velocity=inner.velocity,
            status=status,
            reason=reason,
            motion=motion,
            force=force,
            wrench=measured.copy(),
            error=B.dot(error),
            intensities=split.intensities.dot(inside),
            wanted=B.dot(exert),
            contact=contact,
            velocity_solution=inner,
            J=sighting.J,
        )

    def _halted(self, q: Array, velocity: Array | None, sighting: Sighting, contact: Contact | None) -> HybridSolution:
        """What is told of a tick whose joint positions cannot be true, nor where wrenches act; its state stays."""
        inner, none, unknown = self.loop.rest(q, "", velocity, sighting), np.zeros(6), np.full(6, np.nan)
        here = contact_now(self.task, self.robot.pose(q), contact)
        return HybridSolution(
            velocity=inner.velocity,
            status=inner.status,
            reason=inner.reason,
            motion=none,
            force=none,
            wrench=unknown,
            error=unknown,
            intensities=np.full(here.constraints.shape[1], np.nan),
            wanted=unknown,
            contact=here,
            velocity_solution=inner,
            J=sighting.J,
        )

    def _regulated(
        self, felt: Felt, watch: Watch, late: tuple[float, float, float], split: Split, raw: Array
    ) -> Regulation:
        """What the force law knows of the stiffness, and its caution; the raw wrench in the contact's frame."""
        regulation = self._regulation
        if felt.press is not None and split.kind.presses == 1:
            if watch.health.unchanged:
                return regulation.waiting(felt.way)
            regulation = regulation.felt(felt.press, felt.way, felt.noise, self.loop.dt, late, watch.touch, felt.came)
        elif not watch.status:
            parts, told = split.unit[0].dot(raw), self.task.stiffness is not None
            held, ways = self.task.adapts and not split.kind.presses, self._ways.shown(len(parts))
            regulation = regulation.swung(parts, ways, self.loop.dt, late[0], held=held, told=told)
        rests = hypot(*felt.way[1:].tolist()) <= SLOW_SHARE * self.task.approach_speed * self.loop.dt
        return regulation.slower() if self.task.adapts and watch.settling.unstable(rests=rests) else regulation

    def _turned(self, contact: Contact) -> tuple[Contact, Array]:
        """The told contact with the normal found, and its normal as told, zero where that is trusted."""
        if self.task.normal_within is None:
            return contact, np.zeros(3)
        told = way_out(contact)
        return self._normal.applied(contact, told), told
