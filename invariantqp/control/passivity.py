"""One end of a link between operator and robot that is late: it lets out no more energy than came in at the other end.

    power = wrench . twist    of what leaves the link at this end, the same in every frame
    out(t) <= store + in_there(t - delay),      in and out the sums of power dt below and above zero

A delay makes energy: what the operator feels answers to what was done before, and tool and hand push each other higher
and higher. One end at the robot and one at the operator's device, each given what has come in at the other, keep the
link passive for any delay, if need be by passing on less of the twist, or of the force: damping, as strong as it has to
be in that tick. A wall that only the operator presses is let go of slowly: let the robot press. In free motion energy
bounds nothing, and a link that is lost would let the tool go on for ever: a packet also has to be young.

A robot that is itself late does later what is passed on now: the books count what it did, and what is still on its way
is paid in advance. Motion that is not passed on takes with it the energy that came in for it, unless the hand pushes
as hard as the tool: otherwise a hand that moves far against a soft force would pay for a hard one at the tool.

Reference: Hannaford & Ryu 2002; Ryu, Artigas & Preusche 2010 (time-domain passivity of late links); Franken et al. 2011
(a store that is refilled).
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import Literal

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.delay import LONGEST, DelayEstimate
from invariantqp.control.tracking import ticks_late
from invariantqp.errors import BadInput, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared
from invariantqp.velocity.solution import Status

# A hand pushes as hard as the tool from this share of its power on: the force of the tool came to it a while ago.
AS_HARD = 0.9
# The two powers are compared over this time [s]: packets come in lumps.
SMOOTHED = 0.1
# Time in which a store that dampers and friction have emptied fills again while nothing is pushed [s].
REFILL = 10.0
# More than this share of the store has left beyond what may: the robot, or what it meets, is not as declared.
OVERSPENT = 0.5
# A robot is later than declared by more than so many ticks.
LATE_TICKS = 1.5
# Time over which the robot's answer is remembered [s]: a few swings of a hand.
REMEMBERED = 2.0


@frozen(eq=False, slots=False)
class LinkTick(Compared):
    """What one end passes on in a tick.

    Attributes:
        passed: (6,) the twist, or the wrench, times share.
        share: from 0 to 1.
        status: "ok", "scaled" while less than all is passed on, "held" while nothing is, for the age of the packet,
            "degraded" while the robot or what it meets is not as declared.
        reason: why, in words.
        left: energy that may still leave here [N length].
    """

    passed: Array
    share: float
    status: Status
    reason: str
    left: float = field(repr=False)


class LinkEnd:
    """One end of a link, at the robot or at the operator's device; `step` is one tick.

    Attributes:
        dt, passes, store, timeout: as given.
        came_in: energy that has come in here [N length]: send it along, to be `received` at the other end.
        went_out: energy that has left here [N length].
    """

    def __init__(
        self,
        *,
        dt: float,
        passes: Literal["twist", "wrench"],
        store: float = 0.02,
        timeout: float = 0.5,
        delay: float = 0.0,
        stiffness: float | None = None,
    ) -> None:
        """An end of a link at rest.

        Args:
            dt: tick [s].
            passes: what arrives here and is passed on: the operator's "twist" at the robot, the "wrench" that is to be
                felt at the device.
            store: energy that may leave before any has come in [N length]: what a touch takes until the other end feels
                it. A spring of stiffness k pressed with f takes f^2 / 2 k.
            timeout: how old a packet may be and still be passed on [s].
            delay: by how much the robot does later what is passed on, dead time and lag of its motors together [s].
            stiffness: of the hardest thing that the tool may meet, at the origin of the frame of twists: the tool's tip
                [N/length]. The tool is then no faster than what strikes with `store` at most, sqrt(2 store / stiffness)
                / (delay + dt), and presses with little more than the hand, or than sqrt(2 store stiffness). The store
                is refilled by what comes back, and in 10 s of free motion.

        Raises:
            BadInput: not a positive tick, another word, a negative store or delay, a timeout or a stiffness that is not
                positive, a delay of more than 10 000 ticks or without a stiffness, a stiffness at the device.
        """
        self.dt: float = arrays.number(dt, "dt", "seconds", positive=True)
        self.passes: str = arrays.choice(passes, "passes", ("twist", "wrench"))
        self.store: float = arrays.not_negative(store, "store", "an energy")
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        late = arrays.not_negative(delay, "delay", "seconds")
        ticks_late(late, self.dt)  # refuses one that is too long
        self._hard = stiffness is not None
        k = 0.0 if stiffness is None else arrays.number(stiffness, "stiffness", "a stiffness", positive=True)
        if late and not self._hard:
            raise BadInput("stiffness", "none beside a delay", "that of the hardest thing that the tool may meet")
        if self._hard and self.passes == "wrench":
            raise BadInput("stiffness", "one at the device", "one at the robot, which passes twists")
        self.came_in: float = 0.0
        self.went_out: float = 0.0
        self._in_flight: InFlight = InFlight(self.dt, late, k)
        self._delay, self._stiffness = late, k
        self._told = 0.0
        self._left, self._share, self._powers = self.store, 1.0, np.zeros(2)
        self._met: Array = np.zeros(6)
        self._last: Array = self._met

    def step(
        self, twist: ArrayLike, wrench: ArrayLike, received: float, age: float = 0.0, *, done: ArrayLike | None = None
    ) -> LinkTick:
        """What to pass on in this tick.

        Args:
            twist: (6,) in any frame: at the robot what arrived from the operator, in the part that is the operator's to
                move (`SharedTask.operator_projector`); at the device that of the hand.
            wrench: (6,) (m; f) in the same frame: at the robot what the tool exerts, at the device what is to be felt.
                wrench . twist is the power that leaves the link here.
            received: energy that has come in at the other end, as it last said [N length].
            age: of the packet that said so, now minus its time stamp [s]. One older than `timeout`, or more than a tick
                from the future, is not believed: nothing is passed on.
            done: (6,) at the robot, the twist that the tool had in the last tick, measured (J q'), in the same part and
                frame. None: what was passed on `delay` before. A robot that is later than declared is seen by it.
        """
        v, w = arrays.twist(twist), arrays.twist(wrench, "wrench")
        told = arrays.not_negative(received, "received", "an energy")
        old = arrays.number(age, "age", "seconds", infinite=True)
        if done is not None and self.passes == "wrench":
            raise BadInput("done", "a twist at the device", "None there, or the tool's twist at the robot")
        held = self._doubt(old)
        at_robot = self.passes == "twist"
        passed, met = (v, w) if at_robot else (w, v)
        seen = None if done is None else arrays.twist(done, "done")
        did = self._in_flight.done if seen is None else seen
        # What was done, or felt, met this at the end of its tick: all of a damper's force, the most of a spring's. With
        # a stiffness the mean force counts: of a blow the other would be twice the energy.
        energy = float(did.dot(0.5 * (met + self._last) if self._hard else met)) * self.dt
        self._last = met
        if at_robot and did.any():  # a tool at rest feels no damper and no friction
            self._met = met
        left = self._after(energy, float(v.dot(w)) * self.dt, self._told if held else told)
        overspent = left < -OVERSPENT * self.store
        if self._hard and overspent:  # a spring of stiffness k that took E presses with sqrt(2 E k)
            force = w[3:]
            self._in_flight.stiffness = max(
                self._in_flight.stiffness, float(force.dot(force)) / (2.0 * (self.store - left))
            )
        self._share = 0.0 if held else self._in_flight.share(passed, (met, self._met), left)
        through = self._share * passed
        self._in_flight.push(through, seen)
        excess = -left if overspent and (self._hard or seen is not None) else 0.0
        status, reason = (Status.HELD, held) if held else self._status(float(passed.dot(met)), excess)
        return LinkTick(through, self._share, status, reason, left)

    def _after(self, energy: float, asked: float, told: float) -> float:
        """What is left once an energy has left here, while another is asked for, and so much is told by the other end.

        Without a stiffness it is the store and all that came in, less what went out. With one it is never more than the
        store, and what comes back from a spring fills the store before the other end hears of it.
        """
        back, gain = max(0.0, -energy), max(0.0, told - self._told)
        self._told = told
        self.went_out += max(0.0, energy)
        if not self._hard:
            self.came_in += back
            return told + self.store - self.went_out
        self._powers += min(1.0, self.dt / SMOOTHED) * (np.array([gain, max(0.0, asked)]) - self._powers)
        came = gain if self._powers[0] >= AS_HARD * self._powers[1] else self._share * gain
        if asked <= 0.0:
            came += self.store * self.dt / REFILL
        self._left = min(self.store, self._left + came - max(0.0, energy))
        kept = min(back, self.store - self._left)
        self._left += kept
        self.came_in += back - kept
        return self._left

    def _status(self, power: float, excess: float) -> tuple[Status, str]:
        """Status and reason of a tick that asks for a power, once so much energy has left that may not, 0 for none."""
        trouble = []
        if self._in_flight.late > LATE_TICKS * self.dt:
            late = written(1e3 * self._in_flight.late, 3)
            tell = f"tell delay={written(self._delay + self._in_flight.late, 3)}"
            trouble.append(f"the robot follows {late} ms later than told: {tell} and a stiffness")
        if self._in_flight.stiffness > self._stiffness:
            met_with = written(self._in_flight.stiffness, 2)
            trouble.append(f"the tool met something harder than told: tell stiffness={met_with}")
        if excess:
            trouble.append(f"{written(excess, 2)} more energy has left than may: robot or contact are not as told")
        status = Status.DEGRADED if trouble else Status.OK if self._share == 1.0 else Status.SCALED
        if self._share < 1.0:
            why = "would give out energy" if power > 0.0 else "would strike too hard what may be ahead"
            trouble.append(f"the link {why}: {written(100.0 * self._share, 3)} % of the {self.passes} passed on")
        return status, "; ".join(trouble)

    def _doubt(self, age: float) -> str:
        """Why a packet of this age is not believed, "" where it is."""
        if age > self.timeout:
            return f"the last packet is {age:.3g} s old: nothing is passed on"
        return f"the last packet is {-age:.3g} s ahead of this clock: nothing is passed on" if age < -self.dt else ""


class InFlight:
    """Motion that was passed on to a late robot and is still to be done, and the energy that it may take.

    energy = sum over the ways d still to be done of max(0, d . (w + k (r - d / 2))),   r the way to the end of d

    w is met now, k the stiffness of the hardest thing that the tool may meet: it may stand right before the tool, and
    what is on its way to a late robot cannot be called back. So in free motion, too, no more is passed on than may
    strike.
    """

    def __init__(self, dt: float, delay: float, stiffness: float) -> None:
        """Nothing on its way, for ticks of dt [s], a declared delay [s] and a stiffness [N/length]."""
        self.late: float = 0.0  # by how much later than declared it was seen to follow [s]
        self._dt, self._told = dt, ceil(delay / dt - arrays.NEGLIGIBLE)
        self.stiffness: float = stiffness  # declared or met
        self._passed = np.zeros((1 + self._told + round(LONGEST / dt), 6))  # the latest last
        self._delay = DelayEstimate(dt, self._told * dt, 3, 1.0 - dt / REMEMBERED)

    @property
    def done(self) -> Array:
        """(6,) the twist that the robot has in this tick by its declared delay."""
        return np.asarray(self._passed[-1 - self._told])

    def push(self, twist: Array, seen: Array | None) -> None:
        """After a tick in which a twist (6,) was passed on; `seen` is the tool's in the tick before, if measured."""
        if seen is not None:
            self.late = max(self.late, self._delay.after(seen[3:], twist[3:]) or 0.0)
        self._passed[:-1] = self._passed[1:].copy()
        self._passed[-1] = twist

    def share(self, twist: Array, met: tuple[Array, Array], left: float) -> float:
        """How much of a twist (6,) can be paid with the energy left [N length], from 0 to 1.

        Now, after all that is on its way; and for as long as the robot is late, so that a tool is slow and does not
        stop and go. `met` are wrenches (6,), now and when something was done last: the one that takes more counts.
        """
        ticks = self._told + round(self.late / self._dt)
        owed, further = self._owed(met[0], ticks) if ticks else (0.0, np.zeros(3))
        line = twist[3:]
        hard, power = self.stiffness * float(line.dot(line)), max(float(twist.dot(met[0])), float(twist.dot(met[1])))
        once = _payable(self._dt * (power + float(line.dot(further))), self._dt**2 * hard, left - owed)
        time = (1 + ticks) * self._dt
        return min(1.0, once, _payable(time * power, time**2 * hard, left))

    def _owed(self, met: Array, ticks: int) -> tuple[float, Array]:
        """The energy that the last so many ticks will take, and the force (3,) that they will add."""
        ways = self._dt * self._passed[-ticks:]
        pressed = np.tile(met, (ticks, 1))
        sums = ways[:, 3:].cumsum(axis=0)
        pressed[:, 3:] += self.stiffness * (sums - 0.5 * ways[:, 3:])
        energies = (ways * pressed).sum(axis=1)
        return float(energies[energies > 0.0].sum()), self.stiffness * sums[-1]


def _payable(push: float, hard: float, left: float) -> float:
    """The largest share with push share + hard share^2 / 2 <= left; one or more where all can be had."""
    left = max(0.0, left)
    if push + 0.5 * hard <= left:
        return 1.0
    root = sqrt(push * push + 2.0 * hard * left)
    return 2.0 * left / (push + root) if push > 0.0 else (root - push) / hard
