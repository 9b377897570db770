"""Contact lost or overloaded, a sensor at fault: what the hybrid controller does then, and what it remembers.

lost        unilateral contact that is not felt (`touch`) for longer than lost_after; over when it is felt again
            an approach that meets nothing within approach_distance or approach_time, or in which the tool never comes
            nearer as commanded, stands still until `reset`
overload    |f| > max_force or |m about the place of contact or the grip| > max_moment; until `reset`. Where less is
            wanted than before, the limit falls with what is felt
fault       what the readings say of the sensor (`health`), that they jumped and stay (`level`) or disagree with the
            motion (`agreement`), a press that is still read above where it touched, or a tool that stops on its way
            though nothing is felt; until `reset`
"""

from __future__ import annotations

from math import exp, inf
from typing import NamedTuple

import numpy as np

from invariantqp.errors import written
from invariantqp.force.agreement import Agreement, ways_in
from invariantqp.force.felt import ABOVE_NOISE, OVERLOAD, Felt
from invariantqp.force.health import Health
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.level import Level
from invariantqp.force.noise import Noise
from invariantqp.force.regulation import REACHED
from invariantqp.force.settling import Settling
from invariantqp.force.touch import LEAST_NOISE, Touch, loss_limit
from invariantqp.geometry.arrays import Array
from invariantqp.velocity.solution import Status

# A larger press that was wanted before is still expected for this long [s], and while it falls.
LET_GO = 1.0
# Over which share of retreat_distance a tool has to follow commands, from which share of that on it is judged, of which
# share it has to come at least, and of which it has moved at all: something holds it.
LED = 0.5
JUDGED = 1.0 - exp(-1.0)
FOLLOWED = 0.2
MOVED = 0.02
# How far readings may lead the tool above where it touched, in sizes of the contact (2 mm of 50), beside a slope; below
# this share of the wanted press it may be in the air.
ABOVE = 0.04
PRESSED = 0.25


class Watch(NamedTuple):
    """What is remembered from tick to tick; `after` makes the next one.

    Attributes:
        touch: whether there is contact.
        health: of the sensor.
        noise: of its readings.
        settling: of the press.
        agreement: of press and motion.
        level: of the readings in the air.
        most: force and moment that are an overload.
        approached: way towards the contact in the air, since the start or the last loss [length].
        waited: for how long it has not been felt [s].
        led: how far it was commanded nearer since then, of commands that can have acted, and how far it came, both
            with what was longer ago than LED forgotten [length].
        leaving: why the tool retreats or stands still until `reset`, "" if it does neither.
        status: the status then.
        pushed: how far it has gone in since the touch [length].
        left: how far it has retreated from there [length].
        gone: how far it has come out since the touch by the joints, and across (3,) [length].
    """

    touch: Touch = Touch()
    health: Health = Health()
    noise: Noise = Noise()
    settling: Settling = Settling()
    agreement: Agreement = Agreement()
    level: Level = Level()
    most: tuple[float, float] = (0.0, 0.0)
    approached: float = 0.0
    waited: float = 0.0
    led: tuple[float, float] = (0.0, 0.0)
    leaving: str = ""
    status: Status | None = None
    pushed: float = 0.0
    left: float = 0.0
    gone: tuple[float, Array] = (0.0, np.zeros(3))

    @property
    def touching(self) -> bool:
        """Whether there is contact, as far as is known."""
        return self.touch.touching

    def after(self, task: HybridTask, felt: Felt, dt: float) -> Watch:
        """The watch after a tick of dt [s]."""
        if self.status in (Status.OVERLOAD, Status.FAULT):
            return self
        most = _let_go(self.most, (felt.force, felt.moment), felt.most, exp(-dt / LET_GO))
        too_much = _too_much(felt, most)
        if too_much:
            return self.stopping(Status.OVERLOAD, too_much, task)
        if self.status:
            return self
        press, wanted = (0.0, 0.0) if felt.press is None else felt.press
        never_felt = self.touch.airborne == inf  # what was never felt cannot be kept either
        least = None if never_felt and task.lost_below == 0.0 else task.lost_below
        limit = 0.0 if felt.press is None else loss_limit(least, wanted, felt.noise)
        noise = self._noisier(felt, limit)
        health = self.health.after(felt.reading, felt.press, limit, felt.noise, dt)
        touch = self.touch.after(press, limit, felt.noise, dt)
        lost, settling = not touch.touching and touch.airborne > task.lost_after, self.settling
        if limit > 0.0:
            settling = settling.after((press, wanted), dt, touching=touch.touching, lost=lost, noise=felt.noise)
        if felt.press is None:
            settling = self.settling.after_missing(felt.missing, dt)
        watch = self._replace(touch=touch, health=health, noise=noise, settling=settling, most=most)
        fault = health.fault
        if wanted > 0.0 and limit > 0.0 and not fault:
            watch, fault = _compared(watch, task, felt, (press, wanted), dt)
            watch, above = _led_out(watch, task, felt, (press, wanted), before=self.touching)
            fault = fault or above
        if fault:
            return watch.stopping(Status.FAULT, fault, task)
        if touch.touching:
            return watch._replace(waited=0.0, led=(0.0, 0.0))
        watch = watch._replace(
            approached=0.0 if self.touch.touching else self.approached,
            waited=self.waited + dt,
            led=_followed(self.led, felt, LED * task.retreat_distance),
        )
        return watch.stopping(*_given_up(task, watch), task)

    def stopping(self, status: Status | None, why: str, task: HybridTask) -> Watch:
        """The watch that leaves: from where it touched; from where it approached if readings are not to be believed."""
        back = self.pushed + (self.approached if status is Status.FAULT else 0.0)
        return self._replace(status=status, leaving=why, left=-min(back, task.approach_distance))

    def doubts(self, press: float | None, noise: float, late: float, *, lost: bool) -> tuple[str, ...]:
        """What is wrong with noise and press, in words, "" for nothing.

        Args:
            press: wanted [force]; None where contact cannot be lost.
            noise: as it was told [force].
            late: sum of tick, delay and low-pass [s].
            lost: whether contact is, so that no press settles.
        """
        unsettled = "" if lost else self.settling.trouble(press, late)
        return self.noise.trouble(noise), unsettled

    def _noisier(self, felt: Felt, limit: float) -> Noise:
        """The noise after a reading, learnt from in the air alone: in touch the press changes, too."""
        if limit == 0.0 or self.touch.touching:
            return self.noise
        return self.noise.after(felt.reading, self.health.reading, max(felt.noise, LEAST_NOISE * limit))

    def after_motion(self, out: float, beyond: bool) -> Watch:
        """The watch after a tick that moved the place of contact outwards by a distance [length], or off an edge."""
        if self.status:
            return self._replace(left=self.left + max(0.0, out))
        if beyond:  # where the surface is, is to be found again
            return self._replace(agreement=Agreement(), level=Level())
        if self.touching:
            return self._replace(pushed=max(0.0, self.pushed - out))
        return self._replace(approached=self.approached + max(0.0, -out), pushed=0.0)


def _compared(watch: Watch, task: HybridTask, felt: Felt, press: tuple[float, float], dt: float) -> tuple[Watch, str]:
    """The watch once the press, felt and wanted, was compared with the motion, and what of that is a fault."""
    along, slope = ways_in(felt.way, task.normal_within)
    agreement = watch.agreement.after(press, (along, slope), felt.answer, felt.noise, dt, watch.touch)
    came, highest = (along + slope, felt.came + slope), watch.settling.highest
    if watch.health.unchanged:  # a late reading cannot have risen yet
        return watch._replace(agreement=agreement, level=watch.level.waiting(came)), ""
    rising = not watch.touching or (highest or 0.0) < REACHED * press[1]
    level = watch.level.after(press, came, felt.noise) if rising else Level()
    highest = highest if agreement.touched else press[0]
    fault = level.trouble() or agreement.trouble(press, felt.noise, felt.answer, task.yields, highest)
    return watch._replace(agreement=agreement, level=level), fault


def _led_out(
    watch: Watch, task: HybridTask, felt: Felt, press: tuple[float, float], *, before: bool
) -> tuple[Watch, str]:
    """The watch, and why readings are not to be believed that still tell of a press far above where it touched.

    Args:
        watch: after the reading.
        task: how far its surface may move.
        felt: how far the tool came.
        press: felt and wanted [force].
        before: whether there was contact in the last tick.
    """
    seen = watch.approached > 0.0  # a tool that presses from the first reading on may have been pushed in
    if not (seen and before):
        return watch._replace(gone=(0.0, np.zeros(3))), ""
    out, across = watch.gone[0] - felt.came, watch.gone[1] + felt.way[1:]
    _, slope = ways_in(np.concatenate(((0.0,), across)), task.normal_within)
    now, least = watch._replace(gone=(out, across)), max(PRESSED * press[1], ABOVE_NOISE * felt.noise)
    if out - slope - task.yields <= ABOVE * task.size or press[0] <= least:
        return now, ""
    told = f"{written(press[0], 3)} N are read {written(out, 2)} above where it touched"
    return now, f"{told}: a sensor that is stuck, drifts or is not tared, or a surface that moves (yields=)"


def _let_go(
    before: tuple[float, float], felt: tuple[float, float], now: tuple[float, float], share: float
) -> tuple[float, float]:
    """What is an overload while less is wanted than before: the law needs time, and what is felt has to fall."""
    force, moment = (max(n, min(share * b, OVERLOAD * f)) for b, f, n in zip(before, felt, now, strict=True))
    return force, moment


def _too_much(felt: Felt, most: tuple[float, float]) -> str:
    """What is an overload, "" for nothing."""
    force, moment = most
    what = f"{written(felt.force)} N of {written(force)}" if felt.force > force else ""
    turn = f"{written(felt.moment)} N m of {written(moment)}" if felt.moment > moment else ""
    return " and ".join(w for w in (what, turn) if w)


def _followed(led: tuple[float, float], felt: Felt, over: float) -> tuple[float, float]:
    """How far the tool was commanded nearer and how far it came after a tick, over about a way [length]."""
    told = float(felt.way[0])
    kept = exp(-abs(told) / over)
    return kept * led[0] + told, kept * led[1] + felt.came


def _given_up(task: HybridTask, watch: Watch) -> tuple[Status | None, str]:
    """The status and why contact is looked for no longer, None and "" where it is."""
    airborne, (led, came) = watch.touch.airborne, watch.led
    before = airborne == inf
    if task.on_loss == "retreat" and not before and airborne > task.lost_after:
        return Status.LOST, f"no contact for {written(airborne)} s"
    if task.on_loss == "continue" and not before:
        return None, ""
    if led > JUDGED * LED * task.retreat_distance and came < FOLLOWED * led:
        what, moved = f"told to come {written(led, 2)} nearer, the tool came {written(came, 2)}", came > MOVED * led
        held = ", and nothing is felt: something holds it, or the sensor is stuck"
        return (Status.FAULT, what + held) if moved else (Status.LOST, f"{what}: the robot does not follow commands")
    if watch.approached > task.approach_distance:
        return Status.LOST, f"no contact within {written(task.approach_distance)} of approach"
    if watch.waited > task.approach_time:
        return Status.LOST, f"no contact within {written(task.approach_time)} s of approach"
    return None, ""
