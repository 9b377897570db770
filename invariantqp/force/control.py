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
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.control.tracking import tracking_twist
from invariantqp.errors import BadInput, excerpt
from invariantqp.force.compiled import (
    ASKING,
    GAIN_LOWERED,
    NOISY,
    UNSETTLED,
    WRONG_STIFFNESS,
    compiled_press,
    core_press,
    core_split,
    memory_of,
    packed,
)
from invariantqp.force.contact import (
    SLOW_SHARE,
    Beyond,
    HybridTask,
    KeptSplit,
    Split,
    can_yield,
    contact_now,
    force_rows,
    load_at,
    moved_between,
    pressed_by,
    require_same_side,
    speed_at,
    way_out,
    weakest,
)
from invariantqp.force.estimate import (
    LEAST_NOISE,
    RESOLVED,
    ROUGH,
    SHORT,
    STIFF,
    Delay,
    Noise,
    NormalEstimate,
    Setting,
    Stiffness,
    Touch,
    Ways,
    loss_limit,
)
from invariantqp.force.law import (
    GAIN,
    LET_GO,
    LETS_GO,
    MOST,
    UNKNOWN,
    Drive,
    approach_speed,
    fixed,
    inward_speed,
    kept_of,
    lowered,
    mass_and_damper,
    pressed,
    retreat,
    slid,
    sought,
    struck,
    trembling,
)
from invariantqp.force.memory import Memory, Pressing
from invariantqp.force.monitor import (
    ABOVE_NOISE,
    FOLLOW,
    HOLD,
    NO_FORCE,
    OVERLOAD,
    RETREAT,
    SLOW,
    Answers,
    Monitor,
    Tick,
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
    wanted_of,
    wrench_of,
)
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.geometry.se3 import velocity_at
from invariantqp.robots.kinematics import Robot, Sighting, middle, require_robot
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.measure import length_at
from invariantqp.velocity.solution import Status, VelocitySolution

if TYPE_CHECKING:
    from invariantqp.engine import Press

# The longest dead time for which ways are remembered.
MOST_TICKS = 10_000
# For how long a speed along a surface counts: as long as an estimate remembers [s].
ALONG = 0.25
# A speed along a surface below this is none [length/s]: it would never end to fade.
TINY_SPEED = 1e-12
# What is held, a hinge or a peg, is taken for this stiff at first: no touch shows it, and what is told wrong of it
# builds up from the first motion on [N/m].
HELD_STIFF = 2e4
# ... and then for the stiffest of its constraints, this many times as fast as against a press: what is told wrong of it
# builds up all the time.
QUICKER = 2.0
# The share of how fast a surface may come or go that it may do so where it did not until now.
MAY_BE_STEEP = 0.1
# The share of an arm's lateness that can be taken back at a touch: its lag, not its dead time.
TAKEN_BACK = 0.5
# A surface that is said to move may do so within this time [s].
MOVES_IN = 0.3
# After the contact was lost again and again the gain is reduced by this factor, each time, to this share of it.
SLOWER = 0.5
LEAST_EASED = 1.0 / 64.0
# The pose of a tool on which nothing depends.
ANYWHERE = np.eye(4)
# All that a verdict needs to know of checks, where the tool lets go to see whether readings fall.
LETTING_GO = Monitor(answers=(Answers(asked=(0.0, 0.0)),))


@frozen(eq=False, repr=False, slots=False)
class HybridSolution(Compared):
    """A joint velocity for a force/motion task, and how it was found; all twists and wrenches in the base frame.

    Attributes:
        velocity: (m,) joint velocity [rad/s, length/s], inside the limits.
        status: "lost", "overload" or "fault" (the sensor's), "degraded" where the force chatters or is not reached, the
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
        loop: the `Controller` that follows the twist of each tick inside the limits.
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
        self._filter_time = 0.0 if cutoff == inf else 1.0 / (2.0 * pi * cutoff)
        self.splits = KeptSplit(task, contact.kind)
        self._split: tuple[Split, Any] | None = None  # the last one, as the core has it
        self._core = core_press(
            task,
            sensor,
            self.loop,
            order=self.order if sensor is None else sensor.order,
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
            self._kept = memory_of(self._kept)
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
            BadInput: NaN or wrong shapes; the controller's state is as it was.
        """
        if self._core is not None:
            if contact is None:
                contact = self.task.contact_at(self._tool(q))
            found = self._by_core(self._core, q, target, wrench, feedforward, contact, velocity, wanted, posture)
            if found is not None:
                return found
        return self._by_python(q, target, wrench, feedforward, contact, velocity, wanted, posture)

    def _by_python(  # noqa: PLR0915 (the order of the stages is the subject)
        self,
        q: ArrayLike,
        target: Any,
        wrench: Any,
        feedforward: ArrayLike | None,
        contact: Contact | None,
        velocity: ArrayLike | None,
        wanted: ArrayLike | Wrench | None,
        posture: ArrayLike | None,
    ) -> HybridSolution:
        """A tick in Python, the definition."""
        task, loop, delay, dt = self.task, self.loop, self._delay, self.loop.dt
        robot = loop.robot
        positions = arrays.vector(q, len(robot.names), "q")
        reading = wrench_of(wrench, self.order if self.sensor is None else self.sensor.order, "wrench")
        velocity = None if velocity is None else arrays.vector(velocity, len(robot.names), "velocity")
        sighting = robot.sight(positions, target)
        if loop.wrong(positions):
            return self._halted(positions, velocity, sighting, contact)
        chase = tracking_twist(sighting.error, delay.gain(loop.gain))
        ahead = np.zeros(6) if feedforward is None else arrays.vector(feedforward, 6, "feedforward")
        tool = sighting.pose if isinstance(sighting.pose, np.ndarray) else robot.pose(positions)
        given = contact_now(task, tool, contact)
        split, (contact, told) = self.splits.at(given, tool), self._turned(given)
        kind = contact.kind
        exert = split.exert if wanted is None else split.wanted(wanted_of(wanted, "wanted"), "wanted")
        memory = self.memory
        smoothing = self._smoothing._replace(value=memory.smooth)
        raw, measured, smoothing = cleaned(self.sensor, reading, tool, smoothing)
        out = way_out(contact)
        require_same_side(memory.out, out)

        # From the contact frame to the base frame.
        A, B = contact.adjoint, contact.coadjoint
        inside, raw_inside = A.T.dot(measured), A.T.dot(raw)
        error = split.projectors.force.dot(exert - inside)
        felt, asked = split.unit_parts.dot(inside), split.unit_parts.dot(exert)
        P, Bt = split.projectors.motion, B.T
        chased, led = A.dot(P.dot(Bt.dot(chase))), A.dot(P.dot(Bt.dot(ahead)))
        motion = slid(task, contact, chased + led, chased, led)

        # What is known after this reading.
        before, noise = memory.pressing, max(self._noise, memory.noise.found)
        tick, pressing, found_noise = self._read(contact, split, reading, (raw, raw_inside), (exert, error), tool, out)
        setting = self._setting(before, asked, noise, smoothing.share)
        known = self._known(before, pressing, felt, asked, kind.presses, setting, tick.limit)
        pressing = pressing._replace(known=known)
        n = kind.presses
        monitor = memory.monitor.after(
            task,
            tick,
            tuple((known[i], float(felt[i]), float(asked[i]), setting.noise) for i in range(n)),
            min(1.0, dt / (2.0 * self._filter_time)) if self._filter_time else 1.0,
        )
        rests = before.along <= SLOW_SHARE * task.approach_speed
        if monitor.settling.unstable(rests=rests):
            pressing = pressing._replace(eased=max(LEAST_EASED, SLOWER * pressing.eased))
        overall = _weakest_touch(pressing.touches)
        answer = verdict(monitor, overall, task, contact)

        # The law.
        waits = (n > 0 and monitor.dead.stale) or answer.beyond
        kept, trembles = self._kept_gain(sighting.J, A, split, contact, known, setting, noise, pressing.eased)
        drives, acts = self._driven(
            pressing, monitor, split, felt, asked, setting, kept, contact, tick.most[0], slow=answer.action == SLOW
        )
        rates = np.array([drive.rate for drive in drives])
        force = A.dot(split.twist.dot(rates))
        where = contact.point if self._at_contact else None
        # What is held stays where it is: the arm is looked at where it will be when this command acts.
        held = self._ways.joints and n == 0
        then = robot.sight(self._ways.coming(positions), target) if held else sighting
        if answer.action == HOLD:
            motion = force = np.zeros(6)
            inner = loop.rest(positions, "", velocity, sighting)
        else:
            if answer.action == RETREAT:
                left, away = monitor.left
                motion, force = np.zeros(6), retreat(task, contact, left + task.retreat_distance - away, dt)
            elif waits:
                force = self._beyond.twist(task, contact, dt) if answer.beyond else np.zeros(6)
            rows = force_rows(contact, then.J, motion + force) if self.force_first else None
            inner = loop.follow(positions, motion + force, velocity, rows, then, where, posture)

        # What is remembered.
        twist = then.J.dot(inner.velocity)
        way = dt * velocity_at(twist, contact.point)
        done = split.unit_rates.dot(Bt.dot(twist))
        free = acts and inner.scale == 1.0 and answer.action == FOLLOW and not waits
        touching = overall.touching
        lag = delay.arm
        shows = 1.0 - exp(-dt / max(lag, 1e-9))
        # Where another lag is found, what does not show yet is what would not with it: no way jumps.
        still = lag / before.lag if before.lag > 0.0 else 1.0
        led = still * memory.coming + way
        self._normal = self._normal.found(
            task,
            told,
            shows * led,
            None if tick.press is None else (float(felt[0]), float(asked[0])),
            (task.stiffness or known[0].bound) if n else None,
            touching=touching,
        )
        delay.after(positions, dt * inner.velocity, sighting.J, contact.point, task.size, velocity, touching=touching)
        outwards = float(out.dot(way))
        self._ways.add(dt * inner.velocity, way, delay.late or 0.0)
        along = max(speed_at(contact, motion, task.size), before.along * exp(-dt / ALONG))
        along = along if along > TINY_SPEED else 0.0
        ways = []
        for (shown, coming), rate in zip(_ways_of(before, len(felt)), done.tolist(), strict=True):
            along_it = still * coming + dt * rate
            ways.append((shown + shows * along_it, along_it - shows * along_it))
        pressing = pressing._replace(
            drives=tuple(d._replace(speed=float(r) - d.slope) for d, r in zip(drives, done, strict=True)),
            ways=tuple(ways),
            known=tuple(one.shown(before.lag - lag) for one in pressing.known) if before.lag > 0.0 else pressing.known,
            lag=lag,
            along=along,
            steep=max(max((abs(d.slope) for d in drives), default=0.0), before.steep * exp(-dt / ALONG)),
            free=free,
        )
        self._beyond = self._beyond.after(contact.point, outwards, beyond=answer.beyond)
        self._kept = memory = Memory(
            pressing=pressing,
            monitor=monitor.after_motion(overall, outwards, beyond=answer.beyond),
            noise=found_noise,
            stand=memory.stand.after(task, contact, motion, twist, dt, joints=sighting.J.shape[1]),
            tool=tool,
            out=out if touching else None,
            last=reading,
            coming=(1.0 - shows) * led,
            smooth=smoothing.value,
        )
        self.room = max(1.0 - trembles, 1.0 - MOST)
        late = delay.whole + (delay.late or 0.0)
        doubts = (
            found_noise.trouble(self._noise) if "noise" in task.checks else "",
            "" if answer.status else monitor.settling.trouble(tick.wanted, late),
            delay.trouble(loop.gain),
            lowered(kept / pressing.eased, noise) if touching else "",
            memory.stand.trouble(),
            pressed_by(task, split, contact, tool, sighting.J, motion),
            self._normal.trouble(),
            pressing.known[0].trouble(task.stiffness) if n == 1 and rests else "",
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

    def _tool(self, q: ArrayLike) -> Array:
        """(4, 4) the tool's pose, where the contact depends on it."""
        return ANYWHERE if isinstance(self.task.contact, Contact) else self.loop.robot.pose(q)

    def _by_core(
        self,
        core: Press,
        q: ArrayLike,
        target: Any,
        wrench: Any,
        feedforward: ArrayLike | None,
        contact: Contact,
        velocity: ArrayLike | None,
        wanted: ArrayLike | Wrench | None,
        posture: ArrayLike | None,
    ) -> HybridSolution | None:
        """A tick by the core; None where Python has to answer, or to say what is wrong with an argument."""
        task, loop, delay = self.task, self.loop, self._delay
        kept = self._kept if isinstance(self._kept, bytes) else packed(self._kept)
        if kept is None or not isinstance(contact, Contact):
            return None
        if contact.edge is not None and contact.edge < task.edge_margin:
            return None
        order = self.order if self.sensor is None else self.sensor.order
        if order is None or type(wrench) is not np.ndarray:
            wrench = ordered(wrench_of(wrench, order, "wrench"), order)
        presses = contact.kind.presses
        split = self.splits.at(contact, ANYWHERE if presses else self.loop.robot.pose(q))
        if self._split is None or self._split[0] is not split:
            self._split = split, core_split(split)
        if self._split[1] is None:
            return None
        here, told = self._turned(contact)
        moves = self._ways.joints and not presses
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
            then=self._ways.coming(np.asarray(q)) if moves else None,
            feedforward=feedforward,
            exert=None if wanted is None else split.wanted(wanted_of(wanted, "wanted"), "wanted"),
            velocity=velocity,
            posture=posture,
        )
        if found is None:
            return None
        solution, troubles, motion, force, measured, error, parts, exert, J = found[:9]
        numbers, way, shown, (felt, asked, bound), touching, airborne, doubts, kept_share, self.room = found[9:]
        self._kept = numbers
        inner = loop.named((solution, troubles))
        step = loop.dt * inner.velocity
        self._ways.add(step, way, delay.late or 0.0)
        self._beyond = Beyond()
        if task.normal_within is not None:
            k = task.stiffness or bound
            self._normal = self._normal.found(task, told, shown, (felt, asked), k, touching=touching)
        status, reason = inner.status, inner.reason
        if doubts or not touching or delay.late or self._normal.held:
            touch = Touch(touching=touching, airborne=airborne)
            answer = verdict(LETTING_GO if doubts & ASKING else Monitor(), touch, task, here)
            memory = memory_of(numbers) if doubts & ~ASKING else Memory()
            settling, late = memory.monitor.settling, delay.whole + (delay.late or 0.0)
            words = (
                memory.noise.trouble(self._noise) if doubts & NOISY else "",
                settling.trouble(settling.wanted if presses else None, late) if doubts & UNSETTLED else "",
                delay.trouble(loop.gain),
                lowered(kept_share, max(self._noise, memory.noise.found)) if doubts & GAIN_LOWERED else "",
                memory.stand.trouble(),
                self._normal.trouble(),
                memory.pressing.known[0].trouble(task.stiffness) if doubts & WRONG_STIFFNESS else "",
            )
            status, reason = answer.with_others(words, status, reason)
        return HybridSolution(
            velocity=inner.velocity,
            status=status,
            reason=reason,
            motion=motion,
            force=force,
            wrench=measured,
            error=error,
            intensities=parts,
            wanted=exert,
            contact=here,
            velocity_solution=inner,
            J=J,
        )

    def _read(
        self,
        contact: Contact,
        split: Split,
        reading: Array,
        wrenches: tuple[Array, Array],
        wanted: tuple[Array, Array],
        tool: Array,
        out: Array,
    ) -> tuple[Tick, Pressing, Noise]:
        """What a tick tells, and what is touched after it.

        Args:
            contact: in the base frame.
            split: of it.
            reading: (6,) as it came.
            wrenches: (6,) that the tool exerts, not smoothed, base frame and contact frame.
            wanted: (6,) W_d and what is missing of it, contact frame.
            tool: (4, 4) its pose.
            out: (3,) the way out.
        """
        task, dt, (raw, raw_inside), (exert, error) = self.task, self.loop.dt, wrenches, wanted
        memory = self.memory
        noise, before = max(self._noise, memory.noise.found), memory.pressing
        presses = split.intensities[: contact.kind.presses]
        press = weakest(presses, raw_inside, exert)
        touches, limits = [], []
        old = before.touches if len(before.touches) == len(presses) else (Touch(),) * len(presses)
        for touch, row in zip(old, presses, strict=True):
            asked = float(row.dot(exert))
            least = None if touch.airborne == inf and task.lost_below == 0.0 else task.lost_below
            limits.append(loss_limit(least, asked, noise))
            touches.append(touch.after(float(row.dot(raw_inside)), limits[-1], noise, dt))
        overall, limit = _weakest_touch(tuple(touches)), max(limits, default=0.0)
        found = memory.noise
        if limit > 0.0 and not overall.touching:  # in touch the press changes, too
            found = found.after(reading, memory.last, max(noise, LEAST_NOISE * limit))
        moved = moved_between(memory.tool, tool, contact.point)
        came = -float(out.dot(moved))
        force, moment = map(max, split.load, load_at(contact.coadjoint.dot(exert), contact.point))
        most = _overload_of(task, force, moment, noise)
        grip = tool[:3, :3].dot(task.grip) + tool[:3, 3]
        load = load_at(raw, contact.point, grip)
        missing = 0.0
        if press is None:
            lacks = load_at(contact.coadjoint.dot(error), contact.point, grip)
            missing = max(lacks[0] / most[0], lacks[1] / most[1])
        tick = Tick(
            dt,
            reading,
            press,
            *load,
            most,
            missing,
            noise,
            limit,
            overall,
            -float(out.dot(self._ways.place[0])),
            came,
            moved + came * out,
        )
        return tick, before._replace(touches=tuple(touches)), found

    def _setting(self, before: Pressing, asked: Array, noise: float, share: float) -> Setting:
        """What estimates and laws have in common in a tick."""
        task, dt = self.task, self.loop.dt
        late = dt + self._filter_time + self._delay.arm + UNKNOWN
        rough = ROUGH * float(np.abs(asked).max(initial=0.0))
        speed = task.slope * before.along + min(task.yields / MOVES_IN, task.approach_speed)
        sigma = noise * sqrt(share / (2.0 - share)) + rough
        steep = before.steep + MAY_BE_STEEP * speed if before.touches else 0.0
        begins = task.stiffness or STIFF
        return Setting(
            dt,
            share,
            self._filter_time,
            late,
            UNKNOWN,
            sigma,
            speed,
            steep,
            begins,
            RESOLVED * task.size if before.touches else 0.0,
            not before.touches,
        )

    def _known(
        self, before: Pressing, now: Pressing, felt: Array, asked: Array, presses: int, setting: Setting, limit: float
    ) -> tuple[Stiffness, ...]:
        """The stiffness of each constraint after a reading; of what is not touched nothing."""
        n = len(felt)
        known = before.known if len(before.known) == n else (Stiffness.of(setting.begins),) * n
        if self.memory.monitor.dead.unchanged > 0.0 and presses:
            return known
        touching = all(touch.touching for touch in now.touches)
        made = []
        parts = zip(known, felt.tolist(), asked.tolist(), _ways_of(before, n), strict=True)
        most = float(np.abs(asked).max(initial=0.0)) or inf
        for i, (one, force, wish, (way, _)) in enumerate(parts):
            there = now.touches[i].airborne <= self.task.lost_after if i < presses else touching
            short = int(wish - force > SHORT * most) - int(force - wish > SHORT * most)
            felt_at_all = i >= presses or (now.touches[i].touching and force > limit)
            if there:
                made.append(one.after(force, way, setting, short, felt=felt_at_all))
            else:
                made.append(one.in_air(force, way, limit, setting))
        return tuple(made)

    def _kept_gain(
        self,
        J: Array,
        A: Array,
        split: Split,
        contact: Contact,
        known: tuple[Stiffness, ...],
        setting: Setting,
        noise: float,
        eased: float,
    ) -> tuple[float, float]:
        """The share of the gain that noise and chatter leave, and the share of the joints' acceleration noise takes."""
        if self.loop.braking is None or noise == 0.0 or not known:
            return eased, 0.0
        admittance = A.dot(split.twist.dot(split.unit_parts))
        share = trembling(self.loop, J, admittance, contact.point, self.task.size, noise, self._smoothing.share)
        gain = split.gain
        if self.task.compliance is None:
            laws = (mass_and_damper(one, setting, eased) for one in known)
            gain = max(1.0 / (M / setting.dt + D) for M, D in laws)
        kept = kept_of(gain, share) if self.task.compliance is None else 1.0
        return kept * eased, gain * kept * share

    def _driven(
        self,
        now: Pressing,
        monitor: Monitor,
        split: Split,
        felt: Array,
        asked: Array,
        setting: Setting,
        eased: float,
        contact: Contact,
        most_force: float,
        *,
        slow: bool,
    ) -> tuple[tuple[Drive, ...], bool]:
        """The law of each constraint, and whether it acts in full."""
        task, n = self.task, len(felt)
        drives = now.drives if len(now.drives) == n else (Drive(),) * n
        presses = len(now.touches)
        touching = all(touch.touching for touch in now.touches)
        yields = can_yield(contact, len(self.loop.robot.names))
        made, acts = [], touching and yields
        fastest = task.approach_speed
        # What a lagging arm has not done yet can be taken back at a touch, what is sent and read late cannot.
        striking = 2.0 * setting.dt + (1.0 - TAKEN_BACK) * self._delay.arm
        for i, drive in enumerate(drives):
            error = float(asked[i] - felt[i])
            known = now.known[i]
            let_go, gentle = None, 0.0
            if i < presses:
                let_go, gentle = monitor.let_go(i), approach_speed(task, float(asked[i]), striking)
            if let_go is not None:
                made.append(Drive(-gentle - setting.slope_speed - LETS_GO * let_go))
                acts = False
                continue
            if task.compliance is not None:
                top, k = (fastest if slow and i < presses else inf), task.stiffness or 0.0
                grows = now.free and yields and not slow
                wished = float(asked[i]) if i < presses else 0.0
                made.append(fixed(drive, error, split.gain, k, wished, setting.dt, top, grows=grows))
                acts = acts and made[-1].rate < top
                continue
            if presses == 0:
                least = min(task.stiffness or HELD_STIFF, HELD_STIFF)
                k = max(least, *((one.known or 0.0) / QUICKER for one in now.known))
                gain = eased * GAIN / ((setting.late - UNKNOWN) * k)
                made.append(fixed(drive, error, gain, k, 0.0, setting.dt, inf, grows=now.free and yields))
                continue
            if i < presses:
                touch = now.touches[i]
                if not touch.touching:
                    made.append(sought(drive, gentle, setting, fastest, touch, task))
                    continue
                wished = float(asked[i])
                if known.time <= setting.late:  # the filters still hold the air: nothing is pushed in
                    # Of several presses one may read another's friction, which turns round where the tool does.
                    coming = _ways_of(now, n)[i][1] if presses == 1 and self._delay.lag is not None else 0.0
                    made.append(struck(drive, coming, error, known, setting, LET_GO * fastest, eased))
                    continue
                free = max(
                    gentle, inward_speed(task, most_force - float(felt[i]) - monitor.unseen(task, i), setting.late)
                )
                most, grows = (free, LET_GO * fastest), now.free and yields
            else:
                most, wished = (fastest, fastest), 0.0
                grows = now.free and yields
                if not touching:
                    made.append(Drive())
                    continue
            made.append(
                pressed(
                    drive._replace(slope=monitor.believed(i, setting.dt) * drive.slope),
                    error,
                    wished,
                    known,
                    setting,
                    most,
                    eased,
                    grows=grows,
                )
            )
        return tuple(made), acts

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

    def _turned(self, contact: Contact) -> tuple[Contact, Array]:
        """The told contact with the normal found, and its normal as told, zero where that is trusted."""
        if self.task.normal_within is None:
            return contact, np.zeros(3)
        told = way_out(contact)
        return self._normal.applied(contact, told), told


def _ways_of(pressing: Pressing, n: int) -> tuple[tuple[float, float], ...]:
    return pressing.ways if len(pressing.ways) == n else ((0.0, 0.0),) * n


def _weakest_touch(touches: tuple[Touch, ...]) -> Touch:
    """Of several presses: there is contact where all are felt."""
    if len(touches) == 1:
        return touches[0]
    if not touches:
        return Touch(touching=True, airborne=0.0)
    return Touch(
        min(touch.evidence for touch in touches),
        all(touch.touching for touch in touches),
        max(touch.airborne for touch in touches),
    )


def _overload_of(task: HybridTask, force: float, moment: float, noise: float) -> tuple[float, float]:
    """The force and the moment that are an overload, for the size of the wanted ones.

    Args:
        task: says them, or leaves them to what is wanted.
        force: wanted [N].
        moment: wanted, about the place of contact [N length].
        noise: standard deviation of a force component [N]: readings of the wanted force stay below the limit.
    """
    most, turning = task.max_force, task.max_moment
    if most is None:
        most = max(OVERLOAD * force, force + ABOVE_NOISE * noise) if force > 0.0 else NO_FORCE
    if turning is None:
        turning = max(OVERLOAD * moment, moment + task.size * most)
    return most, turning
