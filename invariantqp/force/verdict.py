"""What the hybrid controller does in a tick, for what its watch remembers."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from invariantqp.errors import written
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.watch import Watch

# A retreat is over at this share of its distance: the rest is rounding.
ALL_THE_WAY = 1.0 - 1e-9
# What the controller is to do in a tick.
FOLLOW, SLOW, HOLD, RETREAT = "follow", "slow", "hold", "retreat"
# The same for what a task does about a loss, where it is not to approach.
LOSS = {"hold": (HOLD, ": standing still"), "continue": (FOLLOW, "")}


class Verdict(NamedTuple):
    """What to do in this tick, with which status, and why; "" is the velocity law's own status."""

    action: str
    status: str
    reason: str


def verdict(watch: Watch, task: HybridTask, *, can_leave: bool) -> Verdict:
    """What to do now; `can_leave` is whether the contact can be left."""
    if watch.status:
        answer = task.on_loss if watch.status == "lost" else task.on_overload or (RETREAT if can_leave else HOLD)
        action = RETREAT if answer == "retreat" and watch.left < ALL_THE_WAY * task.retreat_distance else HOLD
        what = {RETREAT: "retreating", HOLD: "standing still until reset"}[action]
        return Verdict(action, watch.status, f"{watch.leaving}: {what}")
    airborne = watch.touch.airborne
    if watch.touching or airborne <= task.lost_after:
        return Verdict(FOLLOW if watch.touching else SLOW, "", "")
    if airborne == inf:
        return Verdict(SLOW, "lost", "no contact yet: approaching")
    action, what = LOSS.get(task.on_loss, (SLOW, ": approaching"))
    return Verdict(action, "lost", f"no contact for {written(airborne)} s{what}")
