"""One end of a delayed teleoperation link: it passes on no more energy than has entered at the other end.

    power = wrench . twist      that leaves the link at this end, the same in every frame
    out(t) <= store + received(t - delay),      in and out the sums of power dt below and above zero

A delay generates energy: the operator feels the response to an earlier command, and tool and hand excite each other.
One end at the robot and one at the operator's device, each given the energy that has entered at the other, keep the
link passive for any delay: an end passes on less of the twist or of the force, which is a variable damper.
A wall pressed only by the operator is released slowly; let the robot press. In free motion energy bounds
nothing, so that packets also have a maximum age.

The robot itself may have a delay: the energy balance counts the measured twist and reserves energy for commands in
flight. Motion that is not passed on discards the energy that entered for it, unless the hand pushes as hard as the
tool; otherwise a large motion of the hand against a soft force would pay for a hard contact of the tool.

Reference: Hannaford & Ryu 2002; Ryu, Artigas & Preusche 2010 (time-domain passivity with delay); Franken et al. 2011
(an energy tank that is refilled).
"""

from __future__ import annotations

from math import ceil, sqrt
from typing import Literal

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.control.tracking import ticks_of_delay
from invariantqp.errors import BadInput, in_percent, in_thousandths, written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import ROUNDING, Array
from invariantqp.geometry.fields import Compared
from invariantqp.velocity.solution import Status

# The hand pushes as hard as the tool from this ratio of their powers on: the tool's force reached it earlier.
EQUAL_POWER = 0.9
# Time constant of the two powers [s]; packets arrive in bursts.
POWER_FILTER = 0.1
# Time in which the store refills in free motion, after dampers and friction have emptied it [s].
REFILL_TIME = 10.0
# Share of the store that may be overdrawn before robot or environment are reported as not declared correctly.
OVERDRAWN = 0.5
# Ticks of delay beyond the declared one that are tolerated.
LATE_TICKS = 1.5
# Time constant of the delay's regression [s]: a few swings of a hand.
MEMORY = 2.0
# The longest delay beyond the declared one that is estimated [s].
LONGEST_DELAY = 0.25
# Least and largest ratio of measured to commanded motion of a robot that follows.
MOTION_RATIO = 0.5, 1.2
# A delay is accepted if its residual is below this share of the motion's square, and of the declared delay's residual.
UNEXPLAINED = 0.1


@frozen(eq=False, slots=False)
class LinkTick(Compared):
    """The twist or wrench that one end passes on in a tick.

    Attributes:
        passed: (6,) the twist or wrench, times share.
        share: from 0 to 1.
        status: "ok", "scaled" below a share of 1, "held" while packets are too old, "degraded" while the robot or its
            environment is not as declared.
        reason: why, in words.
        left: energy that may still leave at this end [N length].
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
        came_in: energy that has entered at this end [N length]; send it as `received` to the other end.
        went_out: energy that has left at this end [N length].
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
            passes: "twist" at the robot, which passes on the operator's twist; "wrench" at the device, which passes on
                the force that the operator is to feel.
            store: energy that may leave before any has entered [N length]: that of a contact until the other end feels
                it. A spring of stiffness k pressed with f stores f^2 / 2 k.
            timeout: maximum age of a packet [s].
            delay: dead time and motor lag of the robot together [s].
            stiffness: of the stiffest environment, at the origin of the frame of twists: the tool's tip [N/length]. The
                tool's speed is then limited to an impact energy of `store`, sqrt(2 store / stiffness) / (delay + dt),
                and its force to little more than the hand's, or sqrt(2 store stiffness). The store is refilled by
                returned energy, and in 10 s of free motion.

        Raises:
            BadInput: a dt, timeout or stiffness that is not positive, another word, a negative store or delay, a delay
                above 10 000 ticks or without a stiffness, a stiffness at the device.
        """
        self.dt: float = arrays.number(dt, "dt", "seconds", positive=True)
        self.passes: str = arrays.choice(passes, "passes", ("twist", "wrench"))
        self.store: float = arrays.not_negative(store, "store", "an energy")
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        self._delay: float = arrays.not_negative(delay, "delay", "seconds")
        ticks_of_delay(self._delay, self.dt)  # raises if it is too long
        self._has_stiffness = stiffness is not None
        k = 0.0 if stiffness is None else arrays.number(stiffness, "stiffness", "a stiffness", positive=True)
        if self._delay and not self._has_stiffness:
            raise BadInput("stiffness", "none beside a delay", "that of the hardest thing that the tool may meet")
        if self._has_stiffness and self.passes == "wrench":
            raise BadInput("stiffness", "one at the device", "one at the robot, which passes twists")
        self.came_in: float = 0.0
        self.went_out: float = 0.0
        self._pending: PendingMotion = PendingMotion(self.dt, self._delay, k)
        self._stiffness, self._received = k, 0.0
        self._left, self._share, self._powers = self.store, 1.0, np.zeros(2)
        self._moving_effort: Array = np.zeros(6)  # wrench or twist opposite to what is passed, when the tool last moved
        self._last_effort: Array = np.zeros(6)

    def step(
        self, twist: ArrayLike, wrench: ArrayLike, received: float, age: float = 0.0, *, done: ArrayLike | None = None
    ) -> LinkTick:
        """The twist or wrench to pass on in this tick.

        Args:
            twist: (6,) in any frame: at the robot the operator's, projected on the operator's part of the task
                (`SharedTask.operator_projector`); at the device that of the hand.
            wrench: (6,) (m; f) in the same frame: at the robot the one that the tool exerts, at the device the one that
                the operator is to feel. wrench . twist is the power that leaves the link here.
            received: energy that has entered at the other end, from its last packet [N length].
            age: of that packet, now minus its time stamp [s]. If it is older than `timeout`, or more than a tick in the
                future, nothing is passed on.
            done: (6,) at the robot, the measured twist of the tool in the last tick (J q'), same part and frame; it
                shows a delay beyond the declared one. None: the twist passed on `delay` before.
        """
        v, w = arrays.twist(twist), arrays.twist(wrench, "wrench")
        entered = arrays.not_negative(received, "received", "an energy")
        packet_age = arrays.number(age, "age", "seconds", infinite=True)
        if done is not None and self.passes == "wrench":
            raise BadInput("done", "a twist at the device", "None there, or the tool's twist at the robot")
        outdated = self._outdated(packet_age)
        at_robot = self.passes == "twist"
        flow, effort = (v, w) if at_robot else (w, v)
        measured = None if done is None else arrays.twist(done, "done")
        executed = self._pending.executed if measured is None else measured
        # The effort at the end of a tick is all of a damper's force and the largest of a spring's. With a stiffness the
        # mean counts: the final force of an impact would count twice its energy.
        energy = float(executed.dot(0.5 * (effort + self._last_effort) if self._has_stiffness else effort)) * self.dt
        self._last_effort = effort
        if at_robot and executed.any():  # a tool at rest measures neither damper nor friction
            self._moving_effort = effort
        left = self._balance(energy, float(v.dot(w)) * self.dt, self._received if outdated else entered)
        is_overdrawn = left < -OVERDRAWN * self.store
        if self._has_stiffness and is_overdrawn:  # a spring of stiffness k that took E presses with sqrt(2 E k)
            stiffness = float(w[3:].dot(w[3:])) / (2.0 * (self.store - left))
            self._pending.stiffness = max(self._pending.stiffness, stiffness)
        self._share = 0.0 if outdated else self._pending.share(flow, (effort, self._moving_effort), left)
        passed = self._share * flow
        self._pending.push(passed, measured)
        excess = -left if is_overdrawn and (self._has_stiffness or measured is not None) else 0.0
        status, reason = (Status.HELD, outdated) if outdated else self._status(float(flow.dot(effort)), excess)
        return LinkTick(passed, self._share, status, reason, left)

    def _balance(self, energy: float, requested: float, received: float) -> float:
        """The energy that may still leave, after an energy has left here and another is requested.

        Without a stiffness it is the store and all that was received, less all that has left. With one it is at most
        the store, and energy returned by a spring refills the store before it counts as entered.
        """
        returned, gain = max(0.0, -energy), max(0.0, received - self._received)
        self._received = received
        self.went_out += max(0.0, energy)
        if not self._has_stiffness:
            self.came_in += returned
            return received + self.store - self.went_out
        self._powers += min(1.0, self.dt / POWER_FILTER) * (np.array([gain, max(0.0, requested)]) - self._powers)
        refill = gain if self._powers[0] >= EQUAL_POWER * self._powers[1] else self._share * gain
        if requested <= 0.0:
            refill += self.store * self.dt / REFILL_TIME
        self._left = min(self.store, self._left + refill - max(0.0, energy))
        stored = min(returned, self.store - self._left)
        self._left += stored
        self.came_in += returned - stored
        return self._left

    def _status(self, power: float, excess: float) -> tuple[Status, str]:
        """Status and reason of a tick that requests a power, with an energy overdrawn by `excess`."""
        reasons = []
        if self._pending.extra_delay > LATE_TICKS * self.dt:
            late = in_thousandths(self._pending.extra_delay, 3)
            delay = written(self._delay + self._pending.extra_delay, 3)
            reasons.append(f"the robot follows {late} ms later than declared: set delay={delay} and a stiffness")
        if self._pending.stiffness > self._stiffness:
            stiffness = written(self._pending.stiffness, 2)
            reasons.append(f"the tool met something stiffer than declared: set stiffness={stiffness}")
        if excess:
            reasons.append(
                f"{written(excess, 2)} more energy has left than was available: robot or contact are not as declared"
            )
        status = Status.DEGRADED if reasons else Status.OK if self._share == 1.0 else Status.SCALED
        if self._share < 1.0:
            why = "would generate energy" if power > 0.0 else "would exceed the impact energy of a contact ahead"
            reasons.append(f"the link {why}: {in_percent(self._share, 3)} % of the {self.passes} passed on")
        return status, "; ".join(reasons)

    def _outdated(self, age: float) -> str:
        """Why a packet of this age is not used, "" if it is."""
        if age > self.timeout:
            return f"the last packet is {age:.3g} s old: nothing is passed on"
        return f"the last packet is {-age:.3g} s ahead of this clock: nothing is passed on" if age < -self.dt else ""


class PendingMotion:
    """Motion passed on to a robot with a delay and not yet executed, and the energy that it may take.

    energy = sum over the pending displacements d of max(0, d . (w + k (r - d / 2))),   r the sum of d up to its end

    w is the wrench now, k the stiffness of the stiffest environment, which may begin right before the tool: commands in
    flight cannot be recalled. So the impact energy is limited in free motion, too.

    Attributes:
        extra_delay: estimated delay beyond the declared one [s].
        stiffness: declared or identified [N/length].
    """

    def __init__(self, dt: float, delay: float, stiffness: float) -> None:
        """Nothing pending, for ticks of dt [s], a declared delay [s] and a stiffness [N/length]."""
        self.extra_delay, self.stiffness = 0.0, stiffness
        self._dt, self._declared = dt, ceil(delay / dt - arrays.NEGLIGIBLE)
        self._passed = np.zeros((1 + self._declared + round(LONGEST_DELAY / dt), 6))  # the latest last
        self._estimate = DelayEstimate(dt, self._declared * dt, 3)

    @property
    def executed(self) -> Array:
        """(6,) the twist of the robot in this tick according to its declared delay."""
        return np.asarray(self._passed[-1 - self._declared])

    def push(self, twist: Array, measured: Array | None) -> None:
        """Add a twist (6,) that was passed on; `measured` is the tool's in the tick before, or None."""
        if measured is not None:
            self.extra_delay = max(self.extra_delay, self._estimate.update(measured[3:], twist[3:]))
        self._passed[:-1] = self._passed[1:].copy()
        self._passed[-1] = twist

    def share(self, twist: Array, wrenches: tuple[Array, Array], left: float) -> float:
        """The share of a twist (6,), from 0 to 1, that the energy left [N length] allows.

        In one tick after all pending motion, and held for as long as the robot's delay, so that the tool moves slowly
        instead of stopping and starting. `wrenches` (6,) are those now and when the tool last moved; the larger power
        counts.
        """
        ticks = self._declared + round(self.extra_delay / self._dt)
        pending, force = self._pending(wrenches[0], ticks) if ticks else (0.0, np.zeros(3))
        v = twist[3:]
        hardness, power = self.stiffness * float(v.dot(v)), max(float(twist.dot(w)) for w in wrenches)
        once = _largest_scale(self._dt * (power + float(v.dot(force))), self._dt**2 * hardness, left - pending)
        time = (1 + ticks) * self._dt
        return min(1.0, once, _largest_scale(time * power, time**2 * hardness, left))

    def _pending(self, wrench: Array, ticks: int) -> tuple[float, Array]:
        """The energy that the last `ticks` twists will take, and the force (3,) that they will add."""
        displacements = self._dt * self._passed[-ticks:]
        wrenches = np.tile(wrench, (ticks, 1))
        sums = displacements[:, 3:].cumsum(axis=0)
        wrenches[:, 3:] += self.stiffness * (sums - 0.5 * displacements[:, 3:])
        energies = (displacements * wrenches).sum(axis=1)
        return float(energies[energies > 0.0].sum()), self.stiffness * sums[-1]


class DelayEstimate:
    """The delay of a robot beyond the declared one, from a regression of its velocity on delayed commands.

    measured(t) = ratio * commanded(t - delay)        by least squares, with forgetting, for each delay in ticks
    """

    def __init__(self, dt: float, delay: float, size: int) -> None:
        """Without data, for ticks of dt [s], a declared delay [s] and velocities (size,)."""
        self._declared, self._dt, self._forgetting = round(delay / dt), dt, 1.0 - dt / MEMORY
        delays = 2 + round((delay + LONGEST_DELAY) / dt)
        self._commands: Array = np.zeros((delays, size))  # the latest first
        self._products, self._squares = np.zeros(delays), np.zeros(delays)
        self._measured_square, self._ticks = 0.0, 0

    def update(self, measured: Array, command: Array) -> float:
        """The delay beyond the declared one [s], 0 while the declared one explains the motion.

        Args:
            measured: (size,) the velocity in the last tick.
            command: (size,) the velocity commanded in this tick.
        """
        self._measured_square = self._forgetting * self._measured_square + float(measured.dot(measured))
        self._products = self._forgetting * self._products + self._commands.dot(measured)
        self._squares = self._forgetting * self._squares + np.einsum("ij,ij->i", self._commands, self._commands)
        self._ticks += self._ticks > 0 or bool(command.any())
        self._commands[1:] = self._commands[:-1].copy()
        self._commands[0] = command
        total = self._measured_square
        if total == 0.0:
            return 0.0
        ratio = np.clip(self._products / np.maximum(self._squares, ROUNDING * total), *MOTION_RATIO)
        residual = total - ratio * (2.0 * self._products - ratio * self._squares)
        best, declared = int(np.argmin(residual)), self._declared
        threshold = UNEXPLAINED * min(total, float(residual[declared])) - ROUNDING * total
        is_later = residual[best] < threshold and best > declared and self._ticks > 2 * best
        return (best - declared) * self._dt if is_later else 0.0


def _largest_scale(linear: float, quadratic: float, budget: float) -> float:
    """The largest s <= 1 with linear s + quadratic s^2 / 2 <= budget."""
    budget = max(0.0, budget)
    if linear + 0.5 * quadratic <= budget:
        return 1.0
    root = sqrt(linear * linear + 2.0 * quadratic * budget)
    return 2.0 * budget / (linear + root) if linear > 0.0 else (root - linear) / quadratic
