"""One end of a link between operator and robot that is late: it lets out no more energy than came in at the other end.

    power = wrench . twist    of what leaves the link at this end, the same in every frame
    out(t) <= store + in_there(t - delay),      in and out the sums of power dt below and above zero

A delay makes energy: what the operator feels answers to what was done before, and tool and hand push each other higher
and higher. One end at the robot and one at the operator's device, each told what has come in at the other, keep the
link passive for any delay, if need be by passing on less of the twist, or of the force: damping, as strong as it has to
be in that tick. A wall that only the operator presses is let go of slowly: let the robot press. In free motion energy
bounds nothing, and a link that is lost would let the tool go on for ever: a packet also has to be young.

Reference: Hannaford & Ryu 2002; Ryu, Artigas & Preusche 2010 (time-domain passivity of late links).
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from attrs import field, frozen
from numpy.typing import ArrayLike

from invariantqp.errors import written
from invariantqp.geometry import arrays
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.fields import Compared


@frozen(eq=False, slots=False)
class LinkTick(Compared):
    """What one end passes on in a tick.

    Attributes:
        passed: (6,) the twist, or the wrench, times share.
        share: from 0 to 1.
        status: "ok", "scaled" while less than all is passed on, "held" while nothing is, for the age of the packet.
        reason: why, in words.
        left: energy that may still leave here [N length].
    """

    passed: Array
    share: float
    status: str
    reason: str
    left: float = field(repr=False)


class LinkEnd:
    """One end of a link, at the robot or at the operator's device; `step` is one tick.

    Attributes:
        dt: tick [s].
        passes: "twist" at the robot, "wrench" at the device.
        store: energy that may leave before any has come in [N length].
        timeout: how old a packet may be [s].
        came_in: energy that has come in here [N length]: send it along, to be `received` at the other end.
        went_out: energy that has left here [N length].
    """

    def __init__(
        self, *, dt: float, passes: Literal["twist", "wrench"], store: float = 0.02, timeout: float = 0.5
    ) -> None:
        """An end of a link at rest.

        Args:
            dt: tick [s].
            passes: what arrives here and is passed on: the operator's "twist" at the robot, the "wrench" that is to be
                felt at the device.
            store: energy that may leave before any has come in [N length]: what a touch takes until the other end feels
                it. A spring of stiffness k pressed with f takes f^2 / 2 k.
            timeout: how old a packet may be and still be passed on [s].

        Raises:
            BadInput: not a positive tick, another word, a negative store, a timeout that is not positive.
        """
        self.dt: float = arrays.number(dt, "dt", "seconds", positive=True)
        self.passes: str = arrays.choice(passes, "passes", ("twist", "wrench"))
        self.store: float = arrays.not_negative(store, "store", "an energy")
        self.timeout: float = arrays.number(timeout, "timeout", "seconds", positive=True)
        self.came_in: float = 0.0
        self.went_out: float = 0.0
        self._told = 0.0
        self._passed: Array = np.zeros(6)
        self._met: Array = np.zeros(6)

    def step(self, twist: ArrayLike, wrench: ArrayLike, received: float, age: float = 0.0) -> LinkTick:
        """What to pass on in this tick.

        Args:
            twist: (6,) in any frame: at the robot what arrived from the operator, in the part that is the operator's to
                move (`SharedTask.operator_projector`); at the device that of the hand.
            wrench: (6,) (m; f) in the same frame: at the robot what the tool exerts, at the device what is to be felt.
                wrench . twist is the power that leaves the link here.
            received: energy that has come in at the other end, as last told by it [N length].
            age: of the packet that said so, now minus its time stamp [s]. One older than `timeout`, or more than a tick
                from the future, is not believed: nothing is passed on.

        Raises:
            BadInput: NaN, shapes, a negative energy.
        """
        v, w = arrays.twist(twist), arrays.twist(wrench, "wrench")
        told = arrays.not_negative(received, "received", "an energy")
        old = arrays.number(age, "age", "seconds", infinite=True)
        held = self._doubt(old)
        if not held:
            self._told = told
        passed, met = (v, w) if self.passes == "twist" else (w, v)
        # What was passed on met this at the end of its tick: all of a damper's force, the most of a spring's.
        energy = float(self._passed.dot(met)) * self.dt
        if self.passes == "twist" and self._passed.any():  # a tool at rest feels no damper and no friction
            self._met = met
        self.went_out += max(0.0, energy)
        self.came_in += max(0.0, -energy)
        left = self._told + self.store - self.went_out
        wanted = max(float(v.dot(w)), float(passed.dot(self._met))) * self.dt
        share = 0.0 if held else min(1.0, max(0.0, left) / wanted) if wanted > 0.0 else 1.0
        self._passed = share * passed
        if held:
            return LinkTick(np.zeros(6), share, "held", held, left)
        if share == 1.0:
            return LinkTick(self._passed.copy(), share, "ok", "", left)
        less = f"{written(100.0 * share, 2)} % of the {self.passes} passed on"
        return LinkTick(self._passed.copy(), share, "scaled", f"the link would give out energy: {less}", left)

    def _doubt(self, age: float) -> str:
        """Why a packet of this age is not believed, "" where it is."""
        if age > self.timeout:
            return f"the last packet is {age:.3g} s old: nothing is passed on"
        return f"the last packet is {-age:.3g} s ahead of this clock: nothing is passed on" if age < -self.dt else ""
