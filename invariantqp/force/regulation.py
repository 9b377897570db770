"""The force law's gain and its integral action.

    twist = factor (I - P) C (I - P)' (e + 1/T_i integral of e)       e the wrench error

On a contact of stiffness k the loop is a first-order lag of rate c k, stable with dead time d below c k d = pi / 2. The
rate is at most RATE, and a quarter of 1 / (dt + delay + time constant of the low-pass), from which on no overshoot is
visible. Until the stiffness is known it is supposed: at least the rise of the press over the way into the surface, and
softer and softer until the press is felt. Where there is not one press, all constraints together show how stiff it is
at least; against what is held, a hinge or a peg, the law grows faster until they do, since an arm in series leaves less
of a stiffness than was told. A normal told wrong moves the surface at constant speed, and the integral leaves no error
of that. Critical damping is T_i = 4 / (c k); T_i = 6 / (c k) lets less of the sensor's noise through. Without k there
is no integral, since a too fast one oscillates.
"""

from __future__ import annotations

from math import exp, hypot, inf
from typing import NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.agreement import SHARE, Answer, answer_of
from invariantqp.force.constraint_stiffness import ConstraintStiffness
from invariantqp.force.place import TINY
from invariantqp.force.rise import Rise
from invariantqp.force.stiffness import SLOPE, StiffnessEstimate
from invariantqp.force.touch import Touch
from invariantqp.force.two_presses import TwoPresses
from invariantqp.geometry.arrays import Array

# How fast a force error is corrected where nothing else is asked for [1/s].
RATE = 80.0
# The largest rate times what is late: tick, delay and low-pass.
LATE_SHARE = 0.25
# c k T_i.
OVERDAMPED = 5.0
# Stiffness of a contact of which nothing is known yet [N/m]: for the speed of the approach that of metal on a stiff
# arm, for the gain a smaller one. On a stiffer contact the press grows so fast that it is known within a few ticks.
STIFF = 1e5
USUAL = 2e4
# How much faster the law may be against all constraints together: a third of the rate from which on it would swing for
# ever. What a swing shows is the most that any share of the delay makes of it (MuJoCo: 2e5 N/m of 1e5).
SWINGS = 2.0
# What an arm in series may leave of a stiffness that was told of a thing that is held.
LEAST_LEFT = SHARE
# How much more a delay counts at the touch than a low-pass, which raw readings of an overload do not wait for.
DELAYED = 0.5
# No contact is supposed to be softer [N/m].
SOFTEST = 100.0
# Until this share of the press is felt, the contact is supposed to be softer and softer, with this time constant in
# units of that of the force law.
REACHED = 0.5
SOFTENING = 4.0
# An error above this share of the wanted press counts as this much in the integral.
INTEGRATED = 0.2
# After the contact was lost again and again the rate is reduced by this factor, each time.
SLOWER = 0.5
LEAST_CAUTION = 1.0 / 64.0
# A stiffness told is wrong where the last touch showed another by more than this factor.
MISTOLD = 3.0
# A contact may look softer than it is by this factor, where a sensor saturates in the touch.
SOFTENED = 4.0


class Regulation(NamedTuple):
    """What the force law remembers, in the contact's frame.

    Attributes:
        estimate: of the contact's stiffness.
        integral: (6,) of the wrench error [force s].
        presses: two presses since the touch; None where they are not asked for.
        caution: share of the rate, less than 1 after chatter.
        supposed: stiffness that the gain is for until it is known [force/length].
        rise: what the first readings of touches showed of it.
        reached: whether a good share of the press has been felt since the touch.
        unread: (4,) way since the last reading that was a new one.
        swing: what all constraints together show, where there is not one press.
        left: share of the stiffness told or supposed that the gain is for.
    """

    estimate: StiffnessEstimate = StiffnessEstimate()
    integral: Array = np.zeros(6)
    presses: TwoPresses | None = None
    caution: float = 1.0
    supposed: float = USUAL
    rise: Rise = Rise()
    reached: bool = False
    unread: Array = np.zeros(4)
    swing: ConstraintStiffness = ConstraintStiffness()
    left: float = 1.0

    @property
    def share(self) -> float:
        """How much of the wanted press to exert now."""
        return 1.0 if self.presses is None else self.presses.share

    def rate(self, late: float) -> float:
        """c k [1/s] to aim at, `late` [s] being the sum of tick, delay and low-pass."""
        return self.caution * min(RATE, LATE_SHARE / late)

    def factor(self, compliance: float, stiffness: float | None, late: float) -> float:
        """By how much the compliance [length/s/force] is multiplied for that rate; None is no stiffness told.

        Where all constraints together have shown a larger stiffness, it is for that, and SWINGS times as fast.
        """
        k = self.known(stiffness) or self.supposed
        return self.rate(late) / max(compliance * self.left * k, self.swing.most / SWINGS)

    def shown(self, compliance: float, stiffness: float | None) -> float:
        """c k [1/s] that the integral is for: what is known, or a swing has shown; 0 for neither.

        Where the gain is for less than was told, the integral is at most SWINGS times as fast, as after a swing.
        """
        return max(self.swing.most, min(1.0, SWINGS * self.left) * compliance * (stiffness or 0.0))

    def approach_speed(self, press: float, stiffness: float | None, late: float, delay: float, more: float) -> float:
        """The speed [length/s] from which a touch presses by less than `press`, at the assumed stiffness.

        A delay counts for more where the stiffness is not known: it passes before that is, and before that helps. Of a
        delay that was not told, only what a usual contact makes of it.
        """
        k, stiffest = self.known(stiffness), self.rise.stiffest
        if k is not None:
            return press / (k * (late + more))
        told, all_of_it = late + DELAYED * delay, late + more + DELAYED * (delay + more)
        return press / max(max(STIFF, stiffest) * told, max(USUAL, stiffest) * all_of_it)

    def known(self, stiffness: float | None) -> float | None:
        """The stiffness that was told, less where the last touch shows less, or else that known from touches.

        Not less than what agrees with the motion: a sensor that sticks shows less, too.
        """
        k = self.estimate.value
        if stiffness is None or k is None or not self.estimate.of_touch:
            return k if stiffness is None else stiffness
        return min(stiffness, max(k, SHARE * stiffness))

    def answer(self, stiffness: float | None) -> Answer:
        """What the press owes by the stiffness told, or what touches showed: a saturated sensor makes one look soft."""
        k, seen = self.estimate.value, self.rise.seen
        shown = max(seen, self.rise.shows) if k is None else max(k, min(seen, SOFTENED * k))
        return answer_of(stiffness, shown, air=self.rise.aloft)

    def mistold(self, stiffness: float | None) -> str:
        """How the stiffness told disagrees with the last touch, in words, "" for not at all."""
        k = self.estimate.value if self.estimate.of_touch else None
        if stiffness is None or k is None or 1.0 / MISTOLD <= stiffness / k <= MISTOLD:
            return ""
        return (
            f"the press rises by {written(k, 2)} N/m where {written(stiffness, 2)} are told: the stiffness, the "
            "sensor's scale or the delay is wrong"
        )

    def waiting(self, moved: Array) -> Regulation:
        """The same after a tick whose reading is not a new one."""
        return self._replace(unread=self.unread + moved)

    def felt(
        self,
        press: tuple[float, float],
        moved: Array,
        noise: float,
        dt: float,
        late: tuple[float, float, float],
        touch: Touch,
        came: float = 0.0,
    ) -> Regulation:
        """What is known of the stiffness after one more reading.

        Args:
            press: felt and wanted [force].
            moved: (4,) way since the last reading, as `StiffnessEstimate.after` takes it.
            noise: standard deviation of the press [force].
            dt: tick [s].
            late: sum of tick, delay and low-pass, the delay alone, and the one that was not told beside them [s].
            touch: whether there is contact.
            came: way since the last tick by the joints: an arm that lags comes further than it is told [length].
        """
        felt, wanted = press
        (whole, delay), more = late[:2], late[2]
        rate = self.rate(whole + more)
        touching, moved = touch.touching, moved + self.unread
        estimate = self.estimate.after(felt, moved, noise, dt, delay + more, touching=touching)
        way = max(abs(float(moved[0])), came) + SLOPE * hypot(*moved[1:].tolist())
        presses = self.presses
        if presses is not None:
            presses = presses.after(felt, moved, dt * rate) if touching else TwoPresses()
            k = presses.stiffness(noise)
            if k is not None:  # and stays until contact is lost
                estimate = StiffnessEstimate(k, True, inf)
        now = self._replace(
            estimate=estimate, presses=presses, unread=np.zeros(4), swing=ConstraintStiffness(), left=1.0
        )
        if not estimate.fresh:
            rise = self.rise.after(press, way, noise, touch, (delay + more) / dt, known=estimate.value is not None)
            now = now._replace(rise=rise)
        if not touching or estimate.fresh:
            return now if touching else now._replace(supposed=USUAL, reached=False)
        reached = self.reached or felt >= REACHED * wanted
        softer = 1.0 if reached else exp(-dt * rate / SOFTENING)
        return now._replace(supposed=max(softer * self.supposed, now.rise.least, SOFTEST), reached=reached)

    def swung(
        self, wrench: Array, moved: Array, dt: float, late: float, *, held: bool = False, told: bool = False
    ) -> Regulation:
        """The same after one more reading of a contact without a press or with several; see `ConstraintStiffness`.

        Where a thing is `held`, the law grows faster, until it swings or is for LEAST_LEFT: what a hinge that is told
        wrong builds up is larger than the noise. Of a stiffness that is not `told`, until it is SWINGS times as fast.
        """
        if not len(wrench):
            return self
        least = (LEAST_LEFT if told else 1.0 / SWINGS) if held else 1.0
        left = max(least, exp(-dt * self.rate(late) / SOFTENING) * self.left)
        return self._replace(swing=self.swing.after(wrench, moved, dt, late), left=left)

    def after(self, error: Array, rate: float | None, dt: float, share: float) -> Regulation:
        """The integral after a tick.

        Args:
            error: (6,) of the wrench.
            rate: c k [1/s]; None forgets the integral.
            dt: tick [s].
            share: of the error that counts; 0 where limits keep the force law from acting.
        """
        if rate is None:
            return self._replace(integral=np.zeros(6))
        return self._replace(integral=self.integral + share * dt * rate / OVERDAMPED * error)

    @staticmethod
    def integrated(press: tuple[float, float] | None) -> float:
        """The share of an error that the integral counts, for a press felt and wanted: little of a touch's rise."""
        if press is None:
            return 1.0
        felt, wanted = press
        return min(1.0, INTEGRATED * wanted / max(abs(wanted - felt), INTEGRATED * wanted, TINY))

    def slower(self) -> Regulation:
        """The same, more cautious."""
        return self._replace(caution=max(LEAST_CAUTION, SLOWER * self.caution), integral=np.zeros(6))
