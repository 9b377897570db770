"""How far the joints move between two changes of their measured positions, compared with what they were commanded.

    ratio = sum of commanded . moved / sum of |commanded|^2        over the last changes, fading

The ratio is one where ticks last `dt`, and 33 where they last 33 dt: all joints then move 33 times as far.
Joint positions that are updated every 33 ticks only are old by as much. Feedback overshoots where its gain times the
interval between updates is above one, and oscillates where it is above two. The ratio is near zero where the loop
oscillates because of a delay, or the robot does not execute its commands.
"""

from __future__ import annotations

from math import inf, nan
from typing import NamedTuple

import numpy as np

from invariantqp.geometry.arrays import Array
from invariantqp.legacy.response import COMMANDED_REST, RESPONSE_TIME
from invariantqp.velocity.reasons import Code, Reason

# Displacements are compared over the time of a response, or so many updates: an arm that swings because of a delay has
# a period of many. Positions that do not change for this time [s] are not updated, or rest.
FEWEST_UPDATES, LONGEST_INTERVAL = 50, 0.5
# The motion is in proportion to the commands where these explain so much of its square. With a first-order lag it is
# not while the ratio is below one half, whatever the lag; with ticks whose lengths scatter by 20 % it is. Where drives
# lag by 50 ms while an arm oscillates, the second share is left, in displacements too large for noise [rad].
PROPORTIONAL, OSCILLATES, LARGE_OSCILLATION = 0.95, 0.15, 0.03
# A displacement this large [rad, length] is more than noise and the counts of encoders of 12 bits (1.5 mrad a joint).
# Smaller ones count after so many displacements of single joints; a ratio above one also needs them to be so many times
# the smallest that was measured, which may be a count.
LEAST_MOVED, MANY_MOVED, MOST_COUNTS = 8e-3, 12, 4.0
# Ratios that are reported, and overshoots of the feedback, as gain times interval.
MOST_RATIO, LEAST_RATIO, OVERSHOOT = 2.0, 0.5, 1.2
# The joints do not follow their commands below this ratio, if these are on average above this speed [rad/s, length/s].
# They do not either, but oscillate, where so little is left of the ratio without what comes from going to and fro: of
# joints that end where they began, commanded by -gain dt q, commanded . moved is gain dt |moved|^2 / 2. Their mean
# distance from the middle is then at least this [rad, length]; less may be noise.
KEPT_SHARE, LEAST_SPEED, LEAST_OSCILLATION = 0.2, 0.015, 0.02
# Number of scalar fields.
NUMBERS = 10


class MotionRatio(NamedTuple):
    """The sums of the ratio, and the ticks between updates of the measured positions."""

    pending: Array  # (m,) commanded since the last update, NaN where joints did not respond to all of it
    commanded: float  # sum of squares, fading
    product: float  # likewise of commanded times moved
    moved: float
    updates: float  # number of them, fading
    time: float  # since the largest displacement became as large [s]; while it grows with time, a third of that
    largest: float  # square of the largest displacement, moved or commanded, fading
    waiting: float  # ticks since the last update
    interval: float  # ticks between the last two updates
    interval_before: float  # ticks between the two updates before
    finest: float  # the smallest nonzero displacement of a joint, inf before there is one

    @classmethod
    def at_first(cls, joints: int) -> MotionRatio:
        """Before the first tick."""
        return cls.of(np.append(np.zeros(joints + NUMBERS - 1), inf))

    @classmethod
    def of(cls, numbers: Array) -> MotionRatio:
        """As `numbers` gives it."""
        return cls(numbers[:-NUMBERS].copy(), *numbers[-NUMBERS:].tolist())

    @property
    def numbers(self) -> Array:
        """(m + NUMBERS,) all of it as the compiled core takes it."""
        return np.concatenate((self.pending, self[1:]))

    @property
    def ratio(self) -> float:
        """How far the joints moved, by how far they were commanded; 0 where they were not."""
        return self.product / self.commanded if self.commanded > 0.0 else 0.0

    def after(self, commanded: Array, moved: Array, dt: float, *, responds: bool) -> MotionRatio:
        """After a tick of dt [s] in which joints were commanded to move, and moved, by displacements (m,).

        `responds` is whether all of them do.
        """
        moved2, interval = float(moved.dot(moved)), self.waiting + 1.0
        if max(moved2, float(commanded.dot(commanded))) <= COMMANDED_REST**2 or interval * dt > LONGEST_INTERVAL:
            return self.at_first(len(moved))
        pending = self.pending + (commanded if responds else nan)
        if moved2 == 0.0:
            return self._replace(pending=pending, waiting=interval)
        pending = np.nan_to_num(pending)
        pending2 = float(pending.dot(pending))
        if moved2 > 4.0 * max(self.largest, self.ratio**2 * pending2):
            # Twice as far as lately, or as the ratio says: another motion.
            kept, time, before = 0.0, 0.0, 0.0
        else:
            kept = max(1.0 - interval * dt / RESPONSE_TIME, 1.0 - 1.0 / FEWEST_UPDATES)
            time, before = self.time, self.interval
        largest = max(moved2, pending2, kept * self.largest)
        return MotionRatio(
            pending=np.zeros(len(moved)),
            commanded=kept * self.commanded + pending2,
            product=kept * self.product + float(pending.dot(moved)),
            moved=kept * self.moved + moved2,
            updates=kept * self.updates + 1.0,
            time=time * min(self.largest / largest, 1.0) + interval * dt,
            largest=largest,
            waiting=0.0,
            interval=interval,
            interval_before=before,
            finest=min(self.finest, float(np.abs(moved[moved != 0.0]).min())),
        )

    def trouble(self, dt: float, gain: float, fastest_gain: float, farthest: int, *, chases: bool) -> Reason | None:
        """What is wrong with a loop of ticks of dt [s], None where nothing is known to be.

        Args:
            dt: of the loop [s].
            gain: at which targets are approached [1/s].
            fastest_gain: the larger of that and the gain at which position limits are approached [1/s].
            farthest: the joint that is farthest from where it was commanded to be, which is named.
            chases: whether the loop follows a target; only of such a loop it is said that joints do not follow.
        """
        ratio, updates, ticks = self.ratio, self.updates, min(self.interval, self.interval_before)
        large = max(self.commanded, self.moved) >= LEAST_MOVED**2 * updates
        fine = ratio < 1.0 or self.moved >= (MOST_COUNTS * self.finest) ** 2 * updates
        many = fine and len(self.pending) * updates >= MANY_MOVED
        lagging = ratio > MOST_RATIO and self.moved >= LARGE_OSCILLATION**2 * updates
        share = OSCILLATES if lagging else PROPORTIONAL
        proportional = ratio > 0.0 and self.product**2 >= share * self.commanded * self.moved
        measured = ticks > 0.0 and (large or many) and proportional
        if ticks > 1.0 and ticks * fastest_gain * dt > OVERSHOOT and (large or measured):
            return Reason(Code.STATES_ARE_OLD, numbers=(ticks, 1e3 * ticks * dt, 1e3 * dt))
        too_far = ratio > MOST_RATIO or ratio * ticks * fastest_gain * dt > OVERSHOOT
        if measured and (too_far or (ratio < LEAST_RATIO and self.time > RESPONSE_TIME)):
            return Reason(Code.DT_IS_WRONG, numbers=(ratio, 1e3 * ratio * dt, 1e3 * dt))
        follows = ratio >= KEPT_SHARE or self.commanded <= (LEAST_SPEED * dt) ** 2 * updates
        progress = self.product - 0.5 * gain * dt * self.moved
        far = self.commanded >= (LEAST_OSCILLATION * gain * dt) ** 2 * updates
        oscillates = far and progress < KEPT_SHARE * self.commanded
        if chases and (oscillates or not follows) and self.time > RESPONSE_TIME:
            return Reason(Code.NOT_FOLLOWING, (farthest,))
        return None
