"""The hybrid loop body: joint positions, a target and a wrench in, a joint velocity inside the limits out.

    s = P s_motion + sum of unit rates along Z,     s_motion = gain log(T_target T^-1) + feedforward
    velocity = law(J(q), s, box(q)),                torque = J'W_d for arms that take torques

read (`sensor`) -> split (`contact`) -> estimate -> monitor -> law -> `Controller.follow`. Everything is in the base
frame; **wrenches are those that the tool exerts** (a `WrenchSensor` turns readings into them). Neither part of s
disturbs the other: see `contact`.

Reference: [DS] Sect. 6.3; Raibert & Craig 1981 for what it replaces (`compare.frames`).
"""

from __future__ import annotations

from copy import deepcopy
from math import exp, inf, pi, sqrt
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.tracking import DELAY_SHARE, tracking_twist
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.compiled import Packing, compiled_press, core_press, core_split
from invariantqp.force.contact import (
    SLOW_SHARE,
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
    pressed_by,
    require_same_side,
    speed_at,
    way_out,
    weakest,
)
from invariantqp.force.contact_kinds import Contact
from invariantqp.force.estimate import (
    LEAST_NOISE,
    LOST_SHARE,
    RESOLVED,
    ROUGH,
    SHORT,
    SLOWER,
    STIFF,
    UNKNOWN,
    UNSHOWN,
    Delay,
    Noise,
    NormalEstimate,
    Setting,
    Stiffness,
    Touch,
    Ways,
    loss_limit,
    weakest_touch,
)
from invariantqp.force.law import (
    MOST,
    Drive,
    fixed,
    kept_of,
    lowered,
    mass_and_damper,
    pressed,
    retreat,
    slid,
    sought,
    struck,
    surface_speed,
    taken_up,
    touch_speed,
    trembling,
)
from invariantqp.force.monitor import (
    FOLLOW,
    HOLD,
    OVERLOAD,
    RETREAT,
    SLOW,
    Monitor,
    Tick,
    Verdict,
    overload_of,
    verdict,
)
from invariantqp.force.sensor import (
    Order,
    Smoothing,
    Wrench,
    WrenchSensor,
    cleaned,
    order_of,
    ordered,
    wrench_of,
)
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.geometry.se3 import velocity_at
from invariantqp.legacy.loop import LegacyLoop
from invariantqp.robots.kinematics import Robot, Sighting, middle, require_robot
from invariantqp.velocity.measure import length_at
from invariantqp.velocity.solution import Status, VelocitySolution, no_motion

if TYPE_CHECKING:
    from invariantqp.engine import Press

# The longest dead time for which ways are remembered.
MOST_TICKS = 10_000
# What is held, a hinge or a peg, is taken for the stiffest of its constraints, this many times as fast as against a
# press: what is told wrong of it builds up all the time.
QUICKER = 2.0
# The share of how fast a surface may come or go that it may do so where it did not until now.
MAY_BE_STEEP = 0.1
# The share of an arm's lateness that can be taken back at a touch: its lag, not its dead time.
TAKEN_BACK = 0.5
# After the press swung again and again the gain is reduced by this factor, each time, to this share of it: what slides
# may swing by what it slides on, and a slower law would not come back from that.
EASES = 0.5
LEAST_EASED = 0.25
# The pose of a tool on which nothing depends.
ANYWHERE = np.eye(4)
# What `HybridController.step` is given, in its order, with the contact of the tick.
Given: TypeAlias = tuple[
    ArrayLike, Any, Any, ArrayLike | None, Contact, ArrayLike | None, ArrayLike | Wrench | None, ArrayLike | None
]


class Pressing(NamedTuple):
    """What a controller remembers of its constraints, each by itself.

    Attributes:
        touches: of each press.
        known: stiffness of each constraint.
        drives: of each constraint.
        ways: unit way commanded until now as it shows, and what of it does not show yet [length].
        lag: of the arm, with which it shows [s].
        along: speed along the contact, the highest of the last time [length/s].
        steep: the fastest slope of its laws of the last time [length/s].
        eased: share of the gain, less than 1 after swings.
        free: whether the last tick did all that the law asked for.
    """

    touches: Annotated[tuple[Touch, ...], 6] = ()
    known: Annotated[tuple[Stiffness, ...], 6] = ()
    drives: Annotated[tuple[Drive, ...], 6] = ()
    ways: Annotated[tuple[tuple[float, float], ...], 6] = ()
    lag: float = 0.0
    along: float = 0.0
    steep: float = 0.0
    eased: float = 1.0
    free: bool = True

    def of(self, constraints: int, presses: int, begins: float) -> Pressing:
        """The same for so many constraints and presses: where they are others than before nothing is known of them.

        Args:
            constraints: n.
            presses: how many of them.
            begins: the stiffness that an estimate begins with [force/length].
        """
        return self._replace(
            touches=self.touches if len(self.touches) == presses else (Touch(),) * presses,
            known=self.known if len(self.known) == constraints else (Stiffness.of(begins),) * constraints,
            drives=self.drives if len(self.drives) == constraints else (Drive(),) * constraints,
            ways=self.ways if len(self.ways) == constraints else ((0.0, 0.0),) * constraints,
        )

    def rests(self, task: HybridTask) -> bool:
        """Whether the tool has hardly moved along the contact."""
        return self.along <= SLOW_SHARE * task.approach_speed


class Memory(NamedTuple):
    """The state between ticks, but for the normal, the delay, and what was commanded and does not act yet.

    Attributes:
        pressing: of each constraint.
        monitor: all checks.
        noise: of readings in the air.
        tool: (4, 4) its pose in the last tick; None before the first.
        out: (3,) the way out in the last tick; None in the air.
        last: (6,) reading; None before the first.
        coming: ways of the joints that do not show yet; () before any.
        smooth: (6,) wrench in the sensor's frame; None before the first.
        motion: (6,) along the contact in the last tick, base frame.
    """

    pressing: Pressing = Pressing()
    monitor: Monitor = Monitor()
    noise: Noise = Noise()
    tool: Annotated[Array, 4, 4] | None = None
    out: Annotated[Array, 3] | None = None
    last: Annotated[Array, 6] | None = None
    coming: Annotated[tuple[float, ...], 16] = ()
    smooth: Annotated[Array, 6] | None = None
    motion: Annotated[Array, 6] = np.zeros(6)


PACKING = Packing(Memory)


class Placed(NamedTuple):
    """What is measured and wanted in a tick, in the frame of the contact but for what is said to be elsewhere.

    Attributes:
        contact: in the base frame.
        split: of it.
        declared: (3,) the normal as declared, base frame; zero where that is trusted.
        tool: (4, 4) its pose.
        out: (3,) the way out, base frame.
        raw: (6,) wrench that the tool exerts, not smoothed, base frame.
        measured: (6,) the same, smoothed.
        W: (6,) that.
        W_raw: (6,) likewise.
        W_d: (6,) wanted.
        error: (6,) P*(W_d - W).
        force: (n,) unit parts of W.
        wanted: (n,) unit parts of W_d.
    """

    contact: Contact
    split: Split
    declared: Array
    tool: Array
    out: Array
    raw: Array
    measured: Array
    W: Array
    W_raw: Array
    W_d: Array
    error: Array
    force: Array
    wanted: Array

    @property
    def presses(self) -> int:
        """How many of the constraints are presses."""
        return self.contact.kind.presses

    def along(self, twist: Array) -> Array:
        """(6,) the part of a twist (6,) along S, base frame."""
        A, B = self.contact.adjoint, self.contact.coadjoint
        return np.asarray(A.dot(self.split.projectors.motion.dot(B.T.dot(twist))))


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
        options: the loop's arguments, by name.
        loop: the loop that follows the twist of each tick inside the limits.
        sensor: what cleans the readings, or None where wrenches come clean and in the base frame.
        order: of plain numbers where there is no sensor.
        splits: the task's split for the contact of a tick.
        room: share of the joints' acceleration that noise in the force leaves to the motion.
        force_first: whether the force part of the twist is met exactly, so that limits slow the motion down before
            they change the force.
    """

    _kept: Memory | bytes  # what is kept from tick to tick; its numbers after a tick by the core

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
        self.options: dict[str, Any] = {"dt": dt, **options}
        self.loop: LegacyLoop = LegacyLoop(robot, **self.options)
        self.sensor = sensor
        self.force_first = arrays.flag(force_first, "force_first")
        self.order = order_of(order)
        self._order = self.order if sensor is None else sensor.order
        cutoff, self._noise = (inf, 0.0) if sensor is None else (sensor.cutoff, sensor.noise)
        delay = float(options.get("delay", 0.0))
        if delay > MOST_TICKS * self.loop.dt:
            raise BadInput("delay", f"{delay:g} s", f"a dead time of at most {MOST_TICKS} ticks")
        self._timing = self.loop.dt, delay, cutoff
        self._smoothing = Smoothing.of(cutoff, self.loop.dt)
        self._filter_time = 0.0 if cutoff == inf else 1.0 / (2.0 * pi * cutoff)
        self.splits = KeptSplit(task, contact.kind)
        self._split: tuple[Split, Any] | None = None  # the last one, as the core has it
        self._core = core_press(
            task,
            sensor,
            self.loop,
            order=self._order,
            share=self._smoothing.share,
            filter_time=self._filter_time,
            force_first=self.force_first,
            at_contact=self._at_contact,
        )
        self.reset()

    @property
    def stiffness(self) -> float | None:
        """Of the contact along its first constraint [force/length], as estimated; None where it is not known."""
        known = self.memory.pressing.known
        return known[0].known if known else None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.loop.robot

    @property
    def memory(self) -> Memory:
        """What the loop keeps from tick to tick, as it is now."""
        if isinstance(self._kept, bytes):
            kept: Memory = PACKING.unpacked(self._kept)
            self._kept = kept
        return self._kept

    def __copy__(self) -> HybridController:
        return deepcopy(self)  # with a loop of its own

    def reset(self) -> None:
        """Forget an overload, a fault or a loss, and the readings: the state before the first touch."""
        self._kept = Memory()
        self.room: float = 1.0
        self._normal, self._beyond = NormalEstimate(), Beyond()
        self._ways, self._delay = Ways(self._timing[1], self.loop.dt), Delay(*self._timing)

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
        if self.loop.turns.any():
            q = self.loop.unwrapped(q)
        contact = contact_now(self.task, self._tool(q) if contact is None else ANYWHERE, contact)
        given = q, target, wrench, feedforward, contact, velocity, wanted, posture
        kept, normal, beyond = self._kept, self._normal, self._beyond
        found = None if self._core is None else self._by_core(self._core, given)
        solution = self._by_python(given) if found is None else found
        if no_motion(solution.velocity_solution) and solution.status not in (Status.OVERLOAD, Status.FAULT):
            # While joints do not move although they are commanded to, a reading can show an overload, nothing else.
            overload = self.memory.monitor.overload
            self._kept, self._normal, self._beyond = kept, normal, beyond
            memory = self.memory
            self._kept = memory._replace(coming=(), monitor=memory.monitor._replace(overload=overload))
            self._ways = Ways(self._timing[1], self.loop.dt)
        return solution

    def _by_python(self, given: Given) -> HybridSolution:
        """A tick in Python, the definition."""
        q, target, wrench, feedforward, contact, velocity, wanted, posture = given
        task, loop, memory, dt, delay = self.task, self.loop, self.memory, self.loop.dt, self._delay
        robot, joints = loop.robot, len(loop.robot.names)
        positions, reading = arrays.vector(q, joints, "q"), wrench_of(wrench, self._order, "wrench")
        velocity = None if velocity is None else arrays.vector(velocity, joints, "velocity")
        sighting = robot.sight(positions, target)
        if loop.wrong(positions):
            return self._halted(positions, velocity, sighting, contact)
        loop.near(robot.points(sighting, robot.target(target), np.zeros(3))[1], "target")
        ahead = np.zeros(6) if feedforward is None else arrays.vector(feedforward, 6, "feedforward")
        tool = sighting.pose if isinstance(sighting.pose, np.ndarray) else robot.pose(positions)
        here, smooth = self._placed(contact, tool, reading, wanted)
        require_same_side(memory.out, here.out)

        # What is known after this reading.
        noise, presses = max(self._noise, memory.noise.found), here.presses
        before = memory.pressing.of(len(here.force), presses, task.stiffness or STIFF)
        tick, touches, found_noise = self._read(here, reading, before)
        setting, now = self._setting(before, here, noise), before._replace(touches=touches)
        now = now._replace(known=self._known(now, here, setting, tick))
        parts = zip(now.known[:presses], here.force.tolist(), here.wanted.tolist(), strict=False)
        shared = min(1.0, dt / (2.0 * self._filter_time)) if self._filter_time else 1.0
        monitor = memory.monitor.after(task, tick, tuple((*one, setting.noise) for one in parts), shared)
        if monitor.settling.unstable(setting.late):
            now = now._replace(eased=max(LEAST_EASED, EASES * now.eased))
        said = verdict(monitor, tick.touch, task, here.contact)

        # The law.
        waits = (presses > 0 and monitor.dead.stale) or said.beyond
        kept, trembles = self._kept_gain(sighting.J, here, now, setting, noise)
        drives, acts = self._driven(now, monitor, here, setting, kept, tick, slow=said.action == SLOW)
        chase = tracking_twist(sighting.error, delay.gain(loop.gain))
        motion, force = self._twists(here, said, monitor, chase, ahead, drives, waits=waits)
        # What is held stays where it is: the arm is looked at where it will be when this command acts.
        held = self._ways.joints and presses == 0
        then = robot.sight(self._ways.coming(positions), target) if held else sighting
        if said.action == HOLD:
            inner = loop.rest(positions, "", velocity, sighting)
        else:
            where = here.contact.point if self._at_contact else None
            rows = force_rows(here.contact, then.J, motion + force) if self.force_first else None
            inner = loop.follow(
                positions,
                motion + force,
                velocity,
                at="base",
                rows=rows,
                sighting=then,
                measured_at=where,
                posture=posture,
            )

        # What is remembered.
        twist, step, touching = then.J.dot(inner.velocity), dt * inner.velocity, tick.touch.touching
        way = dt * velocity_at(twist, here.contact.point)
        after, led = self._remembered(
            now,
            here,
            motion,
            then.J,
            step,
            drives,
            setting.late,
            free=acts and inner.scale == 1.0 and said.action == FOLLOW and not waits,
        )
        shows, outwards = 1.0 - exp(-dt / max(after.lag, 1e-9)), float(here.out.dot(way))
        self._normal = self._normal.found(
            task,
            here.declared,
            shows * velocity_at(then.J.dot(led), here.contact.point),
            None if tick.press is None else (float(here.force[0]), float(here.wanted[0])),
            (task.stiffness or now.known[0].bound) if presses else None,
            touching=touching,
        )
        delay.after(positions, step, sighting.J, here.contact.point, task.size, velocity, touching=touching)
        self._ways.add(step, way, delay.late or 0.0)
        self._beyond = self._beyond.after(here.contact.point, outwards, beyond=said.beyond)
        self._kept = Memory(
            pressing=after,
            monitor=monitor.after_motion(tick.touch, outwards, beyond=said.beyond),
            noise=found_noise,
            tool=tool,
            out=here.out if touching else None,
            last=reading,
            coming=tuple(((1.0 - shows) * led).tolist()),
            smooth=smooth,
            motion=motion,
        )
        self.room = max(1.0 - trembles, 1.0 - MOST)
        B, split = here.contact.coadjoint, here.split
        few = pressed_by(task, split, here.contact, tool, sighting.J, motion)
        return HybridSolution(
            inner.velocity,
            *self._said(inner, here.contact, tick.touch, kept / now.eased, said, few),
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

    def _tool(self, q: ArrayLike) -> Array:
        """(4, 4) the tool's pose, where the contact depends on it."""
        return ANYWHERE if isinstance(self.task.contact, Contact) else self.loop.robot.pose(q)

    def _by_core(self, core: Press, given: Given) -> HybridSolution | None:
        """A tick by the core; None where Python has to answer, or to say what is wrong with an argument."""
        q, target, wrench, feedforward, contact, velocity, wanted, posture = given
        task, loop, delay = self.task, self.loop, self._delay
        kept = self._kept if isinstance(self._kept, bytes) else PACKING.packed(self._kept)
        if kept is None or (contact.edge is not None and contact.edge < task.edge_margin):
            return None
        if self._order is None or type(wrench) not in {np.ndarray, list, tuple}:
            wrench = ordered(wrench_of(wrench, self._order, "wrench"), self._order)
        presses = contact.kind.presses
        split = self.splits.at(contact, ANYWHERE if presses else loop.robot.pose(q))
        if self._split is None or self._split[0] is not split:
            self._split = split, core_split(split)
        if self._split[1] is None:
            return None
        here, declared = self._turned(contact)
        found = compiled_press(
            core,
            self._split[1],
            loop.compiled,
            loop.kept,
            *delay.ready(len(loop.robot.names)),
            kept,
            q,
            target,
            wrench,
            contact=here.pose,
            shows=self._ways.place[0],
            then=self._ways.coming(np.asarray(q)) if self._ways.joints and not presses else None,
            feedforward=feedforward,
            exert=None if wanted is None else split.wanted_now(wanted),
            velocity=velocity,
            posture=posture,
        )
        if found is None:
            return None
        solution, troubles, motion, force, measured, error, parts, exert, J = found[:9]
        self._kept, way, shown, (press, goal, bound), touching, airborne, speaks, kept_share, self.room = found[9:]
        inner = loop.said(solution, troubles)
        self._ways.add(loop.dt * inner.velocity, way, delay.late or 0.0)
        self._beyond = Beyond()
        if task.normal_within is not None:
            k = task.stiffness or bound
            self._normal = self._normal.found(task, declared, shown, (press, goal), k, touching=touching)
        said = inner.status, inner.reason
        if not touching or speaks or delay.late or self._normal.held:
            said = self._said(inner, here, Touch(touching=touching, airborne=airborne), kept_share, speaks=speaks)
        return HybridSolution(inner.velocity, *said, motion, force, measured, error, parts, exert, here, inner, J)

    def _said(
        self,
        inner: VelocitySolution,
        contact: Contact,
        touch: Touch,
        kept: float,
        said: Verdict | None = None,
        few: str = "",
        *,
        speaks: bool = True,
    ) -> tuple[Status, str]:
        """Status and reason of a tick.

        Args:
            inner: the velocity law's answer.
            contact: of this tick.
            touch: whether there is contact.
            kept: share of the gain that noise leaves.
            said: the verdict; None from the core, which answers no tick that stops.
            few: what fewer than six joints make of the motion, in words.
            speaks: whether there is something to say of what is kept.
        """
        task, delay = self.task, self._delay
        memory = self.memory if speaks else Memory()
        said = said or verdict(memory.monitor, touch, task, contact)
        settling, pressing, presses = memory.monitor.settling, memory.pressing, contact.kind.presses
        late, noise = delay.whole + (delay.late or 0.0), max(self._noise, memory.noise.found)
        rests = pressing.rests(task)
        doubts = (
            memory.noise.trouble(self._noise),
            "" if said.status else settling.trouble(settling.wanted if presses else None, late),
            delay.trouble(self.loop.gain),
            lowered(kept, noise) if touch.touching else "",
            few,
            self._normal.trouble(),
            pressing.known[0].trouble(task.stiffness) if rests and presses == len(pressing.known) == 1 else "",
        )
        return said.with_others(doubts, inner.status, inner.reason)

    def _placed(self, given: Contact, tool: Array, reading: Array, wanted: Any) -> tuple[Placed, Array | None]:
        """What is measured and wanted with the tool at a (4, 4) pose; and the low-pass after the reading (6,).

        Args:
            given: contact of this tick, with the normal as declared.
            tool: pose.
            reading: as it came.
            wanted: of this tick; None is the task's own.
        """
        split, (contact, declared) = self.splits.at(given, tool), self._turned(given)
        W_d = split.exert if wanted is None else split.wanted_now(wanted)
        smoothing = self._smoothing._replace(value=self.memory.smooth)
        raw, measured, smoothing = cleaned(self.sensor, reading, tool, smoothing)
        A = contact.adjoint
        W = A.T.dot(measured)
        return Placed(
            contact,
            split,
            declared,
            tool,
            way_out(contact),
            raw,
            measured,
            W,
            A.T.dot(raw),
            W_d,
            split.projectors.force.dot(W_d - W),
            split.unit_parts.dot(W),
            split.unit_parts.dot(W_d),
        ), smoothing.value

    def _read(self, here: Placed, reading: Array, before: Pressing) -> tuple[Tick, tuple[Touch, ...], Noise]:
        """What a tick tells the checks, what is touched after it, and how noisy readings (6,) are."""
        task, dt, memory = self.task, self.loop.dt, self.memory
        noise, contact = max(self._noise, memory.noise.found), here.contact
        presses = here.split.intensities[: here.presses]
        press = weakest(presses, here.W_raw, here.W_d)
        touches, limits = [], []
        for touch, row in zip(before.touches, presses, strict=True):
            least = None if touch.airborne == inf and task.lost_below == 0.0 else task.lost_below
            limits.append(loss_limit(least, float(row.dot(here.W_d)), noise))
            touches.append(touch.after(float(row.dot(here.W_raw)), limits[-1], noise, dt))
        overall, limit = weakest_touch(touches), max(limits, default=0.0)
        found = memory.noise
        if limit > 0.0 and not overall.touching:  # in touch the press changes, too
            found = found.after(reading, memory.last, max(noise, LEAST_NOISE * limit))
        moved = moved_between(memory.tool, here.tool, contact.point)
        came = -float(here.out.dot(moved))
        force, moment = map(max, here.split.load, load_at(contact.coadjoint.dot(here.W_d), contact.point))
        most = overload_of(task, force, moment, noise)
        grip = here.tool[:3, :3].dot(task.grip) + here.tool[:3, 3]
        missing = 0.0
        if press is None:
            lacks = load_at(contact.coadjoint.dot(here.error), contact.point, grip)
            missing = max(lacks[0] / most[0], lacks[1] / most[1])
        force, moment = load_at(here.raw, contact.point, grip)
        tick = Tick(
            dt,
            reading,
            None if press is None else press[:2],
            0.0 if press is None else press[2],
            larger_part(here.raw[3:], here.out) if task.max_force is None else force,
            moment,
            most,
            missing,
            noise,
            limit,
            overall,
            -float(here.out.dot(self._ways.place[0])),
            came,
            moved + came * here.out,
        )
        return tick, tuple(touches), found

    def _setting(self, before: Pressing, here: Placed, noise: float) -> Setting:
        """What estimates and laws have in common in a tick."""
        task, dt, share, held = self.task, self.loop.dt, self._smoothing.share, here.presses == 0
        moves = task.yields + max((check.moves for check in self.memory.monitor.answers), default=0.0)
        speed = surface_speed(task, before.along, moves)
        return Setting(
            dt,
            share,
            self._filter_time,
            dt + self._filter_time + self._delay.arm + UNKNOWN,
            noise * sqrt(share / (2.0 - share)) + ROUGH * float(np.abs(here.wanted).max(initial=0.0)),
            speed,
            0.0 if held else before.steep + MAY_BE_STEEP * speed,
            task.stiffness or STIFF,
            0.0 if held else RESOLVED * task.size,
            held,
        )

    def _known(self, now: Pressing, here: Placed, setting: Setting, tick: Tick) -> tuple[Stiffness, ...]:
        """The stiffness of each constraint after a reading; of what is not touched nothing."""
        if self.memory.monitor.dead.unchanged > 0.0 and here.presses:
            return now.known
        most = SHORT * (float(np.abs(here.wanted).max(initial=0.0)) or inf)
        made = []
        parts = zip(now.known, now.ways, here.force.tolist(), here.wanted.tolist(), strict=True)
        for i, (known, (way, _), force, wanted) in enumerate(parts):
            press = i < here.presses
            touch = now.touches[i] if press else tick.touch
            near = touch.touching or (press and touch.lasts(self.task.lost_after))
            if near and self._beyond.left is None:  # beyond an edge a reading shows no surface
                short = int(wanted - force > most) - int(force - wanted > most)
                felt = not press or (touch.touching and force > tick.limit)
                made.append(known.after(force, way, setting, short, felt=felt))
            else:
                made.append(known.in_air(force, way, tick.limit, touch, setting))
        return tuple(made)

    def _kept_gain(self, J: Array, here: Placed, now: Pressing, setting: Setting, noise: float) -> tuple[float, float]:
        """The share of the gain that noise and swings leave, and the share of the joints' acceleration noise takes."""
        split, eased = here.split, now.eased
        admittance = here.contact.adjoint.dot(split.twist.dot(split.unit_parts))
        share = trembling(self.loop, J, admittance, here.contact.point, self.task.size, noise, setting.share)
        if self.task.compliance is not None:
            return eased, split.gain * share
        laws = (mass_and_damper(one, setting, eased) for one in now.known)
        gain = max((1.0 / (M / setting.dt + D) for M, D in laws), default=0.0)
        kept = kept_of(gain, share)
        return kept * eased, gain * kept * share

    def _driven(
        self, now: Pressing, monitor: Monitor, here: Placed, setting: Setting, eased: float, tick: Tick, *, slow: bool
    ) -> tuple[tuple[Drive, ...], bool]:
        """The law of each constraint, and whether it acts in full.

        Args:
            now: what is remembered and estimated.
            monitor: after this reading.
            here: what is measured and wanted.
            setting: of this tick.
            eased: share of the gain that noise and swings leave.
            tick: what the checks are told.
            slow: whether contact is looked for.
        """
        task, dt = self.task, self.loop.dt
        yields = can_yield(here.contact, len(self.loop.robot.names))
        there = tick.touch.lasts(setting.late)  # what is lost for less no law could have acted on
        slow = slow or (not there and tick.touch.lasts(task.lost_after))
        grows, fastest = now.free and yields and not slow, task.approach_speed
        acts, stiffest = there and yields, task.stiffness or 0.0
        # What a lagging arm has not done yet can be taken back at a touch within a tick, what is sent late cannot. A
        # touch is felt at the end of its tick, but for what passes for air.
        dead, felt = self._delay.declared + (self._delay.late or 0.0), 1.0 - LOST_SHARE
        striking = dt + (1.0 - TAKEN_BACK) * (dead + min(self._delay.arm - dead, dt))
        least = min(task.stiffness or STIFF, UNSHOWN * STIFF)
        held = max(least, *((one.known or 0.0) / QUICKER for one in now.known), least)
        leaves = surface_speed(task, now.along, task.yields)
        drives: list[Drive] = []
        for i, (drive, known) in enumerate(zip(now.drives, now.known, strict=True)):
            press, error = i < here.presses, float(here.wanted[i] - here.force[i])
            wanted = float(here.wanted[i]) if press else 0.0
            gentle = touch_speed(task, felt * wanted, felt * tick.most[0], striking) if press else 0.0
            # Let go no faster than it would touch again with an overload.
            released = monitor.release(task.slope, i, setting, OVERLOAD * gentle) if press else None
            if task.compliance is not None:
                top = fastest if slow and press else inf
                drives.append(fixed(drive, error, here.split.gain, stiffest, dt, top, grows=grows))
                acts = acts and drives[-1].rate < top
            elif here.presses == 0:
                gain = eased * DELAY_SHARE / ((setting.late - UNKNOWN) * held)
                drives.append(fixed(drive, error, gain, held, dt, inf, grows=grows))
            elif not press and not there:
                drives.append(Drive())
            elif not press:
                speeds, beside = (fastest, fastest), now.known[0]
                drives.append(pressed(drive, error, 0.0, known, setting, speeds, eased, grows=grows, beside=beside))
            elif not now.touches[i].lasts(setting.late):
                drives.append(sought(drive, gentle, leaves, setting, now.touches[i], task))
            elif known.time <= setting.late:  # the filters still hold the air: nothing is pushed in
                # Of several presses one may read another's friction, which turns round where the tool does.
                coming = now.ways[i][1] if here.presses == 1 and self._delay.lag is not None else 0.0
                drives.append(struck(drive, coming, error, known, setting, OVERLOAD * fastest, eased))
            else:
                force = float(here.force[i])
                room = max(tick.most[0] - force - monitor.unseen(task, i, force), wanted)
                inwards = touch_speed(task, room, room, setting.late)
                # Until the press was reached, speed and slope together: beside a touch what the way along may ask for.
                speeds = inwards + (0.0 if known.reached else task.slope * now.along), OVERLOAD * fastest
                drives.append(pressed(drive, error, wanted, known, setting, speeds, eased, grows=grows))
            if released is not None:  # beside what the law does anyway, or nothing would be asked
                acts = False
                drives[i] = Drive(min(drives[i].rate, 0.0) - released - drive.slope, drive.slope)
        return tuple(drives), acts

    def _twists(
        self,
        here: Placed,
        answer: Verdict,
        monitor: Monitor,
        chase: Array,
        ahead: Array,
        drives: tuple[Drive, ...],
        *,
        waits: bool,
    ) -> tuple[Array, Array]:
        """(6,) motion along S towards the target and with it, and (6,) force along Z, as the verdict says."""
        task, dt, contact, none = self.task, self.loop.dt, here.contact, np.zeros(6)
        if answer.action == HOLD:
            return none, none
        if answer.action == RETREAT:
            left, away = monitor.left
            return none, retreat(task, contact, left + task.retreat_distance - away, dt)
        motion = slid(task, contact, here.along(chase), here.along(ahead))
        if self.loop.braking is None:
            motion = taken_up(task, contact, here.along(self.memory.motion), motion, dt)
        if waits:
            return motion, self._beyond.twist(task, contact, dt) if answer.beyond else none
        return motion, contact.adjoint.dot(here.split.twist.dot(np.array([drive.rate for drive in drives])))

    def _remembered(
        self,
        now: Pressing,
        here: Placed,
        motion: Array,
        J: Array,
        step: Array,
        drives: tuple[Drive, ...],
        late: float,
        *,
        free: bool,
    ) -> tuple[Pressing, Array]:
        """What is kept of the constraints after a tick with joint twists J (6, m) and ways (m,); the ways that come.

        A speed along the surface counts for as long as an estimate looks back, SLOWER times what is late [s]. Ways show
        as those of an arm that lags, where its joints have them: what was commanded along a contact is none into it.
        Where another lag is found than before, what does not show yet is what would not with it: no way jumps.
        """
        task, dt, lag, before = self.task, self.loop.dt, self._delay.arm, now.lag
        shows, still = 1.0 - exp(-dt / max(lag, 1e-9)), lag / before if before > 0.0 else 1.0
        coming = still * np.array(self.memory.coming or np.zeros_like(step)) + step
        rates = here.split.unit_rates.dot(here.contact.coadjoint.T)
        done, ways = (rates.dot(J.dot(way)).tolist() for way in (step / dt, coming))
        fades = exp(-dt / (SLOWER * late))
        after = now._replace(
            drives=tuple(d._replace(speed=rate - d.slope) for d, rate in zip(drives, done, strict=True)),
            ways=tuple((way[0] + shows * c, c - shows * c) for way, c in zip(now.ways, ways, strict=True)),
            lag=lag,
            along=max(speed_at(here.contact, motion, task.size), now.along * fades),
            steep=max(*(abs(drive.slope) for drive in drives), now.steep * fades, 0.0),
            free=free,
        )
        return after, coming

    def _halted(self, q: Array, velocity: Array | None, sighting: Sighting, here: Contact) -> HybridSolution:
        """A tick whose joint positions cannot be true, nor where wrenches act; what is kept stays."""
        inner, none, unknown = self.loop.rest(q, "", velocity, sighting), np.zeros(6), np.full(6, np.nan)
        parts = np.full(here.constraints.shape[1], np.nan)
        found = none, none, unknown, unknown, parts, unknown, here, inner, sighting.J
        return HybridSolution(inner.velocity, inner.status, inner.reason, *found)

    def _turned(self, contact: Contact) -> tuple[Contact, Array]:
        """The contact with the normal found, and its normal as declared, zero where that is trusted."""
        if self.task.normal_within is None:
            return contact, np.zeros(3)
        declared = way_out(contact)
        return self._normal.applied(contact, declared), declared
