"""Beyond the edge of a surface: how high the tool goes, so that it comes back above the surface, wherever that is.

    lift = slope |p - p0|       p0 the place where the surface was left, slope as much as the normal may be told wrong

Back at p0 the tool is as low as it was; elsewhere the contact is looked for again, as after any loss.
"""

from __future__ import annotations

from math import sqrt, tan
from typing import NamedTuple

import numpy as np

from invariantqp.force.agreement import SLOPE
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.place import speed_at
from invariantqp.geometry.arrays import Array
from invariantqp.systems.contacts import Contact


class Beyond(NamedTuple):
    """What is remembered since the edge.

    Attributes:
        left: (3,) p0, base frame; None on the surface.
        lift: how far the tool has been moved outwards since then [length].
    """

    left: Array | None = None
    lift: float = 0.0

    def twist(self, task: HybridTask, contact: Contact, dt: float) -> Array:
        """(6,) of the tool beyond the edge, base frame; down no faster than contact is looked for.

        Args:
            task: its approach speed and size, and how wrong its normal may be.
            contact: in the base frame.
            dt: tick [s].
        """
        if self.left is None or contact.kind.out is None:
            return np.zeros(6)
        out, way = contact.adjoint.dot(np.asarray(contact.kind.out)), contact.point - self.left
        slope = max(SLOPE, tan(task.normal_within or 0.0))
        speed = max((slope * sqrt(way.dot(way)) - self.lift) / dt, -task.approach_speed)
        return np.asarray(speed / speed_at(contact, out, task.size) * out)

    def after(self, place: Array, out: float, *, beyond: bool) -> Beyond:
        """The same after a tick at a place (3,), in which the tool was moved outwards by a distance [length]."""
        if not beyond:
            return Beyond()
        return Beyond(place, 0.0) if self.left is None else self._replace(lift=self.lift + out)
