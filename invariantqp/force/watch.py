"""Contact lost or overloaded: what the hybrid controller does then, and what it remembers between ticks.

lost        unilateral contact, press < lost_below for longer than lost_after; over when it is felt again
overload    |f| > max_force or |m about the place of contact| > max_moment; stays until `reset`
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from invariantqp.errors import written
from invariantqp.force.hybrid_task import LOST_SHARE, HybridTask

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


class Watch(NamedTuple):
    """What is remembered from tick to tick; `after` makes the next one.

    Attributes:
        airborne: for how long no contact has been felt [s]; inf before the first touch.
        leaving: why the tool retreats or stands still until `reset`, "" if it does neither.
        status: the status then.
        left: how far it has retreated [length].
    """

    airborne: float = inf
    leaving: str = ""
    status: str = ""
    left: float = 0.0

    def after(self, task: HybridTask, press: tuple[float, float] | None, load: tuple[float, float], dt: float) -> Watch:
        """The watch after a tick.

        Args:
            task: its limits.
            press: felt and wanted [force]; None where the contact cannot be lost.
            load: force, and moment about the place of contact.
            dt: tick [s].
        """
        force, moment = load
        if self.status == "overload":
            return self
        if force > task.max_force or moment > task.max_moment:
            what = f"{written(force)} N of {written(task.max_force)}" if force > task.max_force else ""
            turn = f"{written(moment)} N m of {written(task.max_moment)}" if moment > task.max_moment else ""
            return Watch(self.airborne, " and ".join(w for w in (what, turn) if w), "overload", 0.0)
        if self.status == "lost":
            return self
        felt, wanted = (0.0, 0.0) if press is None else press
        limit = max(0.0, LOST_SHARE * wanted) if task.lost_below is None else task.lost_below
        if press is None or felt >= limit or limit == 0.0:
            return Watch(0.0)
        airborne = self.airborne + dt
        if task.on_loss == "retreat" and inf > airborne > task.lost_after:
            return Watch(airborne, f"press {written(felt)} N below {written(limit)}", "lost", 0.0)
        return Watch(airborne)

    def after_retreat(self, moved: float) -> Watch:
        """The watch after a tick of retreat that moved the place of contact outwards by a distance [length]."""
        return self._replace(left=self.left + max(0.0, moved))

    def verdict(self, task: HybridTask) -> Verdict:
        """What to do now."""
        if self.status:
            answer = task.on_overload if self.status == "overload" else task.on_loss
            action = RETREAT if answer == "retreat" and self.left < ALL_THE_WAY * task.retreat_distance else HOLD
            what = {RETREAT: "retreating", HOLD: "standing still until reset"}[action]
            return Verdict(action, self.status, f"{self.leaving}: {what}")
        if self.airborne <= task.lost_after:
            return FINE
        if self.airborne == inf:
            return Verdict(SLOW, "lost", "no contact yet: approaching")
        reason = f"no contact for {written(self.airborne)} s"
        if task.on_loss == "hold":
            return Verdict(HOLD, "lost", f"{reason}: standing still")
        if task.on_loss == "continue":
            return Verdict(FOLLOW, "lost", reason)
        return Verdict(SLOW, "lost", f"{reason}: approaching")
