"""The contact of a tick, and a task's split for it: kept while the contact's kind is the same and the grip is near."""

from __future__ import annotations

from math import hypot
from typing import Any

from invariantqp.errors import BadInput, excerpt
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.split import Split
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contacts import Contact, ContactKind

# How far a grip may be from where the compliance was taken, as a share of the contact's size.
NEAR = 0.2


def contact_now(task: HybridTask, tool: Array, given: Any) -> Contact:
    """The contact given for this tick, or where that is None the task's for the tool's (4, 4) pose.

    Raises:
        BadInput: it is no contact.
    """
    if given is None:
        return task.contact_at(tool)
    if not isinstance(given, Contact):
        raise BadInput("contact", excerpt(given), "a Contact")
    return given


class KeptSplit:
    """The last split of one task."""

    def __init__(self, task: HybridTask, kind: ContactKind) -> None:
        """Of a task and the kind of its first contact.

        Raises:
            BadInput, NoProjectors: the task does not fit this contact.
        """
        self.task = task
        self._split: Split = task.split(kind)
        self._grip: Array | None = None  # for which that is

    def at(self, contact: Contact, tool: Array) -> Split:
        """The split for a contact with the tool at a (4, 4) pose.

        Raises:
            BadInput, NoProjectors: the task does not fit this contact.
        """
        task, kind, split = self.task, contact.kind, self._split
        if task.compliance is None and kind.presses == 0:
            grip = se3.inverse(contact.pose, check=False).dot(tool.dot([*task.grip, 1.0]))[:3]
            if self._grip is None or kind != split.kind or hypot(*(grip - self._grip)) > NEAR * task.size:
                split, self._grip = task.split(kind, grip), grip
        elif kind is not split.kind:
            split = task.split(kind)
        self._split = split
        return split
