"""The hybrid loop body: joint positions, a target and a wrench in, a joint velocity inside the limits out.

    s = P s_motion + sum of unit rates along Z,     s_motion = gain log(T_target T^-1) + feedforward
    velocity = law(J(q), s, box(q)),                torque = J'W_d for arms that take torques

read (`sensor`) -> split (`contact`) -> estimate, monitor and law (`core/force.hpp`) -> `Controller.follow`. Everything
is in the base frame; **wrenches are those that the tool exerts** (a `WrenchSensor` turns readings into them). Neither
part of s disturbs the other: see `contact`.

Reference: [DS] Sect. 6.3; Raibert & Craig 1981 for what it replaces (`compare.frames`).
"""

from __future__ import annotations

from copy import copy, deepcopy
from math import exp, inf, isnan, pi
from typing import Any, NamedTuple

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.tracking import DELAY_SHARE, tracking_twist
from invariantqp.engine import law
from invariantqp.errors import BadInput, excerpt, written
from invariantqp.force import messages
from invariantqp.force.contact import (
    Beyond,
    HybridTask,
    KeptSplit,
    Split,
    can_yield,
    contact_now,
    force_rows,
    larger_part,
    load_at,
    moved_between,
    overload_of,
    pressed_by,
    require_same_side,
    way_out,
    weakest,
)
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.motion import MOST, kept_of, lowered, retreat, slid, taken_up, trembling
from invariantqp.force.normal import NormalEstimate
from invariantqp.force.sensor import DRIFT, Order, Wrench, WrenchSensor, load_of, order_of, wrench_of
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, Sighting, middle, require_robot
from invariantqp.velocity.measure import length_at, root_at
from invariantqp.velocity.solution import Status, VelocitySolution, no_motion

# The longest dead time for which commands are remembered.
MOST_TICKS = 10_000
# The pose of a tool on which nothing depends.
ANYWHERE = np.eye(4)
LOSSES = ("approach", "hold", "retreat", "continue")


class Memory(NamedTuple):
    """What a hybrid loop remembers between ticks, beside its inner loop.

    Attributes:
        press: of the engine: touch, estimate, law and monitor.
        tool: (4, 4) its pose in the last tick; None before the first.
        out: (3,) the way out in the last tick; None in the air.
        motion: (6,) along the contact in the last tick, base frame.
        ways: (m,) of the joints, commanded and not done yet, oldest first.
        normal: of the surface, where it is estimated.
        beyond: the edge of the surface.
        gain: largest of the force law, for noise [length/s per force].
        at_once: whether what stopped the tool was found out of the air.
    """

    press: Any
    tool: Array | None = None
    out: Array | None = None
    motion: Array = np.zeros(6)
    ways: tuple[Array, ...] = ()
    normal: NormalEstimate = NormalEstimate()
    beyond: Beyond = Beyond()
    gain: float = 0.0
    at_once: bool = False


class Placed(NamedTuple):
    """What is measured and wanted in a tick, in the frame of the contact but for what is said to be elsewhere.

    Attributes:
        contact: in the base frame.
        split: of it.
        declared: (3,) the normal as declared, base frame; zero where that is trusted.
        tool: (4, 4) its pose.
        out: (3,) the way out, base frame.
        load: (6,) wrench that the tool exerts, in the sensor's frame, with its bias.
        raw: (6,) wrench that the tool exerts, not smoothed, base frame.
        measured: (6,) the same, smoothed.
        W: (6,) that.
        W_raw: (6,) likewise.
        W_d: (6,) wanted.
        error: (6,) P*(W_d - W).
        slide: (6, 6) P, base frame.
        moved: (3,) how far the tool's point at the place of contact has come since the last tick, base frame.
        force: (n,) unit parts of W.
        wanted: (n,) unit parts of W_d.
    """

    contact: Contact
    split: Split
    declared: Array
    tool: Array
    out: Array
    load: Array
    raw: Array
    measured: Array
    W: Array
    W_raw: Array
    W_d: Array
    error: Array
    slide: Array
    moved: Array
    force: Array
    wanted: Array

    @property
    def presses(self) -> int:
        """How many of the constraints are presses."""
        return self.contact.kind.presses

    def along(self, twist: Array) -> Array:
        """(6,) the part of a twist (6,) along S, base frame."""
        return np.asarray(self.slide.dot(twist))


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
        room: share of the joints' acceleration that noise in the force leaves to the motion.
        force_first: whether the force part of the twist is met exactly, so that limits slow the motion down before
            they change the force.
        memory: what it remembers between ticks; a value, which copies and pickles.
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
        self._at_contact = options.get("point") is None
        if self._at_contact and options.get("length") is None:
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
        self._share = 1.0 - exp(-2.0 * pi * cutoff * self.loop.dt)
        retreats = task.on_overload == "retreat" or (task.on_overload is None and contact.kind.out is not None)
        self._settings = {
            "dt": self.loop.dt,
            "noise": self._noise,
            "delay": self.loop.delay,
            "filter_share": self._share,
            "filter_time": 0.0 if cutoff == inf else 1.0 / (2.0 * pi * cutoff),
            "stiffness": task.stiffness or 0.0,
            "lost_below": np.nan if task.lost_below is None else task.lost_below,
            **{name: getattr(task, name) for name in ("size", "slope", "yields", "lost_after", "approach_speed")},
            **{name: getattr(task, name) for name in ("approach_distance", "approach_time", "retreat_distance")},
            "drift": self._drift,
            "on_loss": LOSSES.index(task.on_loss),
            "tares": arrays.flag(tare, "tare") and sensor is not None,
            "fault_retreats": retreats,
        }
        self._press = law.Press(self._settings)
        self.reset()

    @property
    def stiffness(self) -> float | None:
        """Of the contact along its first constraint [force/length], as estimated; None where it is not known."""
        k = self.memory.press.stiffness(0)
        return None if isnan(k) else k

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.loop.robot

    def __copy__(self) -> HybridController:
        return deepcopy(self)  # with a loop of its own

    def __deepcopy__(self, memo: dict[int, Any]) -> HybridController:
        other = object.__new__(type(self))
        changes = ("loop", "memory", "splits")
        vars(other).update(vars(self), **{name: deepcopy(getattr(self, name), memo) for name in changes})
        return other

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_press"}

    def __setstate__(self, fields: dict[str, Any]) -> None:
        vars(self).update(fields)
        self._press = law.Press(self._settings)

    def reset(self) -> None:
        """Forget an overload, a fault or a loss, and the readings: the state before the first touch."""
        self.memory = Memory(law.ForceState())
        self.room: float = 1.0

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
        contact = contact_now(self.task, self._tool(q) if contact is None else ANYWHERE, contact)
        task, loop, memory, dt = self.task, self.loop, self.memory, self.loop.dt
        robot, joints = loop.robot, len(loop.robot.names)
        positions, reading = arrays.vector(q, joints, "q"), wrench_of(wrench, self._order, "wrench")
        velocity = None if velocity is None else arrays.vector(velocity, joints, "velocity")
        goal = robot.target(target)
        sighting = robot.sight(positions, goal)
        if loop.limits.wrong(positions):
            return self._halted(positions, velocity, sighting, contact)
        loop.limits.near(robot.points(sighting, goal, np.zeros(3))[1], "target")
        ahead = np.zeros(6) if feedforward is None else arrays.vector(feedforward, 6, "feedforward")
        tool = sighting.pose if isinstance(sighting.pose, np.ndarray) else robot.pose(positions)
        state = copy(memory.press)
        here = self._placed(contact, tool, reading, wanted, state)
        require_same_side(memory.out, here.out)

        # Motion along the contact, and the force by the engine.
        chase = tracking_twist(sighting.error, self._gain(state))
        motion = slid(task, here.contact, here.along(chase), here.along(ahead))
        if state.silent:  # it stops sliding, and is then unloaded to see whether the sensor answers
            motion = np.zeros(6)
        if loop.acceleration_limit is None:
            motion = taken_up(task, here.contact, here.along(memory.motion), motion, dt)
        share = self._noise_share(sighting.J, here, max(self._noise, state.noise))
        at_edge = here.contact.edge is not None and here.contact.edge <= 0.0
        first = memory.tool is None or state.waited > task.lost_after
        kept = 1.0 if task.compliance is not None else kept_of(memory.gain, share)
        rates, action, reason, lost, acts, doubts, late, gain = self._by_engine(
            here, state, motion, reading, kept, at_edge
        )
        at_once = memory.at_once if memory.press.numbers == state.numbers else first

        # The twist, and what the loop makes of it.
        beyond = at_edge and action in (messages.FOLLOW, messages.APPROACH)
        if action in (messages.RETREAT, messages.HOLD):
            motion = np.zeros(6)
        force = self._force_twist(here, state, action, rates, beyond)
        # What is held stays where it is: the arm is looked at where it will be when this command acts.
        then = robot.sight(sum(memory.ways, start=positions), goal) if memory.ways and not here.presses else sighting
        if action == messages.HOLD:
            inner = loop.rest(positions, "", velocity, sighting)
        else:
            inner = loop.follow(
                positions,
                motion + force,
                velocity,
                at="base",
                rows=force_rows(here.contact, then.J, motion + force) if self.force_first else None,
                sighting=then,
                measured_at=here.contact.point if self._at_contact else None,
                posture=posture,
            )
        few = pressed_by(task, here.split, here.contact, tool, sighting.J, motion)
        if no_motion(inner) and not state.touching:  # readings of an arm that ignores its commands show nothing
            state, after = memory.press, memory._replace(ways=())
        else:
            free = acts and inner.scale > 0.9 and action == messages.FOLLOW and not beyond
            after = self._remembered(here, state, motion, then.J, inner.velocity, gain, free=free, beyond=beyond)
        self.memory = after._replace(press=state, at_once=at_once)
        self.room = max(1.0 - min(share * gain * kept, 1.0), 1.0 - MOST)
        status, why = self._said(here, state, action, reason, doubts, late, inner, few, kept, lost=lost)
        B, split = here.contact.coadjoint, here.split
        return HybridSolution(
            inner.velocity,
            status,
            why,
            motion,
            force,
            here.measured.copy(),
            B.dot(here.error),
            split.intensities.dot(here.W),
            B.dot(here.W_d),
            here.contact,
            inner,
            sighting.J,
        )

    def _force_twist(self, here: Placed, state: Any, action: int, rates: Array, beyond: bool) -> Array:
        """(6,) what the force adds to the motion, base frame."""
        task, dt = self.task, self.loop.dt
        if action == messages.RETREAT:
            return retreat(task, here.contact, state.left + task.retreat_distance - state.away, dt)
        if action == messages.HOLD:
            return np.zeros(6)
        if beyond:
            return self.memory.beyond.twist(task, here.contact, dt)
        twist: Array = here.contact.adjoint.dot(here.split.twist.dot(rates))
        return twist

    def _tool(self, q: ArrayLike) -> Array:
        """(4, 4) the tool's pose, where the contact depends on it."""
        return ANYWHERE if isinstance(self.task.contact, Contact) else self.loop.robot.pose(q)

    def _gain(self, state: Any) -> float:
        """The motion's gain [1/s]: as asked, or less where what the arm lags makes the tool go to and fro."""
        late = 0.0 if isnan(state.lag) else state.lag
        gain = self.loop.gain
        return min(gain, DELAY_SHARE / late) if gain * (late - self.loop.delay) > 1.0 else gain

    def _placed(self, given: Contact, tool: Array, reading: Array, wanted: Any, state: Any) -> Placed:
        """What is measured and wanted with the tool at a (4, 4) pose.

        Args:
            given: contact of this tick, with the normal as declared.
            tool: pose.
            reading: as it came.
            wanted: of this tick; None is the task's own.
            state: of the press, which takes the reading.
        """
        split, contact, declared = self.splits.at(given, tool), given, np.zeros(3)
        if self.task.normal_within is not None:
            declared = way_out(contact)
            contact = self.memory.normal.applied(contact, declared)
        W_d = split.exert if wanted is None else split.wanted_now(wanted)
        sensor, load = self.sensor, reading
        if sensor is not None:
            mounted = tool.dot(sensor.mount)
            load = load_of(sensor, reading, mounted)
        raw, measured = self._press.read(state, load)
        if sensor is not None:
            to_base = se3.coadjoint(mounted, check=False)
            raw, measured = to_base.dot(raw), to_base.dot(sensor.deadband(measured))
        A = contact.adjoint
        W = A.T.dot(measured)
        error = split.projectors.force.dot(W_d - W)
        slide = A.dot(split.projectors.motion.dot(contact.coadjoint.T))
        moved = moved_between(self.memory.tool, tool, contact.point)
        out, W_raw = way_out(contact), A.T.dot(raw)
        force, exerted = split.unit_parts.dot(W), split.unit_parts.dot(W_d)
        wrenches = load, raw, measured, W, W_raw, W_d, error
        return Placed(contact, split, declared, tool, out, *wrenches, slide, moved, force, exerted)

    def _noise_share(self, J: Array, here: Placed, noise: float) -> float:
        """The share of the joints' acceleration that noise takes, for each unit of the force gain."""
        if noise == 0.0 or self.loop.acceleration_limit is None:
            return 0.0
        admittance = here.contact.adjoint.dot(here.split.twist.dot(here.split.unit_parts))
        return trembling(self.loop, J, admittance, here.contact.point, self.task.size, noise, self._share)

    def _by_engine(
        self, here: Placed, state: Any, motion: Array, reading: Array, kept: float, at_edge: bool
    ) -> tuple[Any, ...]:
        """A tick of the engine: rates, action, reason, whether contact is lost, whether it acts, doubts, late, gain."""
        task, memory, split, contact = self.task, self.memory, here.split, here.contact
        parts = split.intensities[: here.presses]
        weak = weakest(parts, here.W_raw, here.W_d)
        came = -float(here.out.dot(here.moved))
        across = se3.norm(here.moved + came * here.out)
        grip = here.tool[:3, :3].dot(task.grip) + here.tool[:3, 3]
        done, along = np.zeros(len(split.unit_rates)), (0.0, 0.0)
        if memory.tool is not None:
            way = se3.log(here.tool.dot(se3.inverse(memory.tool, check=False)))
            done = split.unit_rates.dot(contact.coadjoint.T.dot(way))
            if not here.presses:
                root = root_at(grip, task.size)
                asked, came_along = root.dot(self.loop.dt * memory.motion), root.dot(here.along(way))
                size = float(np.sqrt(asked.dot(asked)))
                along = (size, float(asked.dot(came_along)) / size) if size > 0.0 else (0.0, 0.0)
        noise = max(self._noise, state.noise)
        force, moment = map(max, split.load, load_at(contact.coadjoint.dot(here.W_d), contact.point))
        most = overload_of(task, force, moment, noise)
        missing = 0.0
        if weak is None:
            lacks = load_at(contact.coadjoint.dot(here.error), contact.point, grip)
            missing = max(lacks[0] / most[0], lacks[1] / most[1])
        force, moment = load_at(here.raw, contact.point, grip)
        if task.max_force is None:
            force = larger_part(here.raw[3:], here.out)
        answer: tuple[Any, ...] = self._press.tick(
            state,
            len(split.unit_rates),
            here.presses,
            here.wanted,
            here.force,
            parts.dot(here.W_d),
            parts.dot(here.W_raw),
            done,
            reading,
            here.load,
            np.concatenate((task.size * motion[:3], velocity_at(motion, contact.point))),
            (force, moment),
            most,
            0.0 if weak is None else weak[2],
            missing,
            kept,
            came,
            across,
            split.gain if task.compliance is not None else 0.0,
            at_edge,
            can_yield(contact, len(self.loop.robot.names)),
            *along,
        )
        return answer

    def _remembered(
        self,
        here: Placed,
        state: Any,
        motion: Array,
        J: Array,
        velocity: Array,
        gain: float,
        *,
        free: bool,
        beyond: bool,
    ) -> Memory:
        """What is kept after a tick with joint twists J (6, m) and velocity (m,)."""
        task, dt, memory, contact = self.task, self.loop.dt, self.memory, here.contact
        twist = J.dot(velocity)
        way = dt * velocity_at(twist, contact.point)
        outwards, touching = float(here.out.dot(way)), state.touching
        given = dt * here.split.unit_rates.dot(contact.coadjoint.T.dot(twist))
        self._press.commanded(state, given, outwards, free, beyond)
        press = (float(here.force[0]), float(here.wanted[0])) if here.presses else None
        k = (task.stiffness or state.bounds(0)[0]) if here.presses else None
        ticks = round(self.loop.delay / dt)
        return Memory(
            state,
            here.tool,
            here.out if touching else None,
            motion,
            (*memory.ways, dt * velocity)[-ticks:] if ticks else (),
            memory.normal.found(task, here.declared, here.moved, press, k, touching=touching),
            memory.beyond.after(contact.point, outwards, beyond=beyond),
            gain,
        )

    def _said(
        self,
        here: Placed,
        state: Any,
        action: int,
        reason: int,
        doubts: int,
        late: float,
        inner: VelocitySolution,
        few: str,
        kept: float,
        *,
        lost: bool,
    ) -> tuple[Status, str]:
        """Status and reason of a tick."""
        task, edge, memory = self.task, here.contact.edge, self.memory
        status, why = None, ""
        if reason:
            wanted = float(here.wanted[0]) if len(here.wanted) else 0.0
            status, why = messages.status_of(reason), messages.stopped(reason, state, wanted, memory.at_once)
            why += messages.LEAVES if action == messages.RETREAT else messages.STANDS
        elif edge is not None and edge <= 0.0 and action != messages.HOLD:
            status, why = Status.LOST, f"{written(-edge)} beyond the edge of the surface: not pushing"
        elif lost:
            status, why = Status.LOST, messages.lost(state, task, action)
        trouble = messages.doubts_of(doubts, state, self._noise, self._drift, late, presses=here.presses > 0)
        if status is None and edge is not None and edge < task.edge_margin:
            trouble.insert(0, f"{written(edge)} before the edge of the surface")
        gain = self._gain(state)
        if gain < self.loop.gain:
            trouble.append(
                f"commands act {written(1e3 * (state.lag - self.loop.delay), 3)} ms later than declared: give delay=, "
                f"the motion's gain is {written(gain, 3)} instead of {written(self.loop.gain, 3)} 1/s"
            )
        if state.touching and kept < 1.0:
            trouble += filter(None, (lowered(kept, max(self._noise, state.noise)),))
        trouble += filter(None, (few, memory.normal.trouble()))
        law_status, reasons = inner.status, inner.reason
        if no_motion(inner) and state.touching and state.still > 0.0 and not doubts:
            law_status, reasons = Status.OK, ""  # motors that give way stand still against their commands as they press
        if trouble and law_status is not Status.HELD:
            law_status = Status.DEGRADED
        return status or law_status, "; ".join(words for words in (why, *trouble, reasons) if words)

    def _halted(self, q: Array, velocity: Array | None, sighting: Sighting, here: Contact) -> HybridSolution:
        """A tick whose joint positions cannot be true, nor where wrenches act; what is kept stays."""
        inner, none, unknown = self.loop.rest(q, "", velocity, sighting), np.zeros(6), np.full(6, np.nan)
        parts = np.full(here.constraints.shape[1], np.nan)
        found = none, none, unknown, unknown, parts, unknown, here, inner, sighting.J
        return HybridSolution(inner.velocity, inner.status, inner.reason, *found)
