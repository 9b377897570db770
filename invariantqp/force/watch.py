"""Contact lost or overloaded, a sensor at fault: what the hybrid controller does then, and what it remembers.

lost        unilateral contact that is not felt (`touch`) for longer than lost_after; over when it is felt again
            an approach that meets nothing within approach_distance or approach_time stands still until `reset`
overload    |f| > max_force or |m about the place of contact| > max_moment; until `reset`
fault       what the readings say of the sensor (`health`); until `reset`
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from invariantqp.errors import written
from invariantqp.force.health import Health
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.settling import Settling
from invariantqp.force.touch import Touch, loss_limit
from invariantqp.geometry.arrays import Array

# A retreat is over at this share of its distance: the rest is rounding.
ALL_THE_WAY = 1.0 - 1e-9
# What the controller is to do in a tick.
FOLLOW, SLOW, HOLD, RETREAT = "follow", "slow", "hold", "retreat"


class Verdict(NamedTuple):
    """What to do in this tick, with which status, and why; "" is the velocity law's own status."""

    action: str
    status: str
    reason: str


FINE = Verdict(FOLLOW, "", "")


class Felt(NamedTuple):
    """What a tick tells of the contact, raw: not smoothed.

    Attributes:
        reading: (6,) as it came.
        press: felt and wanted [force]; None where the contact cannot be lost.
        force, moment: about the place of contact.
        most: force and moment that are an overload.
        noise: standard deviation of a force component [force].
    """

    reading: Array
    press: tuple[float, float] | None
    force: float
    moment: float
    most: tuple[float, float]
    noise: float


class Watch(NamedTuple):
    """What is remembered from tick to tick; `after` makes the next one.

    Attributes:
        touch: whether there is contact.
        health: of the sensor.
        settling: of the press.
        approached: way towards the contact since it was last felt [length].
        waited: for how long it has not been felt [s].
        leaving: why the tool retreats or stands still until `reset`, "" if it does neither.
        status: the status then.
        left: how far it has retreated [length].
    """

    touch: Touch = Touch()
    health: Health = Health()
    settling: Settling = Settling()
    approached: float = 0.0
    waited: float = 0.0
    leaving: str = ""
    status: str = ""
    left: float = 0.0

    @property
    def touching(self) -> bool:
        """Whether there is contact, as far as is known."""
        return self.touch.touching

    def after(self, task: HybridTask, felt: Felt, dt: float) -> Watch:
        """The watch after a tick of dt [s]."""
        if self.status in ("overload", "fault"):
            return self
        force, moment = felt.most
        if felt.force > force or felt.moment > moment:
            what = f"{written(felt.force)} N of {written(force)}" if felt.force > force else ""
            turn = f"{written(felt.moment)} N m of {written(moment)}" if felt.moment > moment else ""
            return self._leaving("overload", " and ".join(w for w in (what, turn) if w))
        if self.status:
            return self
        press, wanted = (0.0, 0.0) if felt.press is None else felt.press
        limit = 0.0 if felt.press is None else loss_limit(task.lost_below, wanted, felt.noise)
        health = self.health.after(felt.reading, felt.press, limit, felt.noise, dt)
        if health.fault:
            return self._replace(health=health)._leaving("fault", health.fault)
        touch = self.touch.after(press, limit, felt.noise, dt)
        settling = self.settling.after(press, wanted, touch.touching, dt) if limit > 0.0 else self.settling
        watch = self._replace(touch=touch, health=health, settling=settling)
        if touch.touching:
            return watch._replace(approached=0.0, waited=0.0)
        watch = watch._replace(waited=self.waited + dt)
        if task.on_loss == "retreat" and task.lost_after < touch.airborne < inf:
            return watch._leaving("lost", f"press {written(press)} N below {written(limit)}")
        ended = watch._ended(task)
        return watch._leaving("lost", ended) if ended else watch

    def _ended(self, task: HybridTask) -> str:
        """Why the approach is over, "" where it goes on."""
        if task.on_loss == "continue" and self.touch.airborne < inf:
            return ""
        if self.approached > task.approach_distance:
            return f"no contact within {written(task.approach_distance)} of approach"
        if self.waited > task.approach_time:
            return f"no contact within {written(task.approach_time)} s of approach"
        return ""

    def _leaving(self, status: str, why: str) -> Watch:
        return self._replace(status=status, leaving=why, left=0.0)

    def after_motion(self, out: float) -> Watch:
        """The watch after a tick that moved the place of contact outwards by a distance [length]."""
        if self.status:
            return self._replace(left=self.left + max(0.0, out))
        return self if self.touching else self._replace(approached=self.approached + max(0.0, -out))

    def verdict(self, task: HybridTask, *, can_leave: bool) -> Verdict:
        """What to do now; `can_leave` is whether the contact can be left."""
        if self.status:
            answer = task.on_loss if self.status == "lost" else task.on_overload or (RETREAT if can_leave else HOLD)
            action = RETREAT if answer == "retreat" and self.left < ALL_THE_WAY * task.retreat_distance else HOLD
            what = {RETREAT: "retreating", HOLD: "standing still until reset"}[action]
            return Verdict(action, self.status, f"{self.leaving}: {what}")
        if self.touching:
            return FINE
        airborne = self.touch.airborne
        if airborne <= task.lost_after:
            return Verdict(SLOW, "", "")
        if airborne == inf:
            return Verdict(SLOW, "lost", "no contact yet: approaching")
        reason = f"no contact for {written(airborne)} s"
        if task.on_loss == "hold":
            return Verdict(HOLD, "lost", f"{reason}: standing still")
        if task.on_loss == "continue":
            return Verdict(FOLLOW, "lost", reason)
        return Verdict(SLOW, "lost", f"{reason}: approaching")
