"""What the hybrid controller does in a tick, for what its watch remembers."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from invariantqp.errors import written
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.watch import Watch
from invariantqp.systems.contacts import Contact
from invariantqp.velocity.solution import Status

# A retreat is over at this share of its distance: the rest is rounding.
ALL_THE_WAY = 1.0 - 1e-9
# What the controller is to do in a tick.
FOLLOW, SLOW, HOLD, RETREAT = "follow", "slow", "hold", "retreat"
# The same for what a task does about a loss, where it is not to approach.
LOSS = {"hold": (HOLD, ": standing still"), "continue": (FOLLOW, "")}


class Verdict(NamedTuple):
    """What to do in this tick, with which status, and why; None is the velocity law's own status.

    `edge` says that the surface's edge is near, "" that it is not; `beyond` is whether nothing is to be pushed there.
    """

    action: str
    status: Status | None
    reason: str
    edge: str = ""
    beyond: bool = False

    def with_others(self, doubts: tuple[str, ...], status: Status, reason: str) -> tuple[Status, str]:
        """The status and the reason of the tick, with what troubles the force law and what the velocity law says."""
        trouble = [words for words in (self.edge, *doubts) if words]
        law = Status.DEGRADED if trouble and status is not Status.HELD else status
        return self.status or law, "; ".join(words for words in (self.reason, *trouble, reason) if words)


def verdict(watch: Watch, task: HybridTask, contact: Contact) -> Verdict:
    """What to do now, about loss, overload and faults first, and then about the edge of the surface."""
    answer, edge = _without_edge(watch, task, can_leave=contact.kind.out is not None), contact.edge
    if edge is None or edge >= task.edge_margin or answer.action in (HOLD, RETREAT):
        return answer
    if edge > 0.0:
        return answer._replace(edge=f"{written(edge)} before the edge of the surface")
    return Verdict(FOLLOW, Status.LOST, f"{written(-edge)} beyond the edge of the surface: not pushing", beyond=True)


def _without_edge(watch: Watch, task: HybridTask, *, can_leave: bool) -> Verdict:
    if watch.status:
        answer = task.on_loss if watch.status is Status.LOST else task.on_overload or (RETREAT if can_leave else HOLD)
        action = RETREAT if answer == "retreat" and watch.left < ALL_THE_WAY * task.retreat_distance else HOLD
        what = {RETREAT: "retreating", HOLD: "standing still until reset"}[action]
        return Verdict(action, watch.status, f"{watch.leaving}: {what}")
    airborne = watch.touch.airborne
    if watch.touching or airborne <= task.lost_after:
        return Verdict(FOLLOW if watch.touching else SLOW, None, "")
    if airborne == inf:
        return Verdict(SLOW, Status.LOST, "no contact yet: approaching")
    action, what = LOSS.get(task.on_loss, (SLOW, ": approaching"))
    return Verdict(action, Status.LOST, f"no contact for {written(airborne)} s{what}")
