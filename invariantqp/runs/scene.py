"""The contact of a task, twice: as it really is, for a plant, and as the controller believes it to be.

The two differ by [contact] tilt, and by what a physics engine adds. A run is judged by the belief, in which the task is
told: motion along what the contact leaves free, force along what it resists.

    relative force error = |P*(W_d - W)| / |W_d|,    |W|^2 = |f|^2 + k m'K^-1 m about the place of contact

k and K are the contact's stiffness [N/m] and [N m/rad], so a moment counts as the force that stretches it as much.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np
from scipy.linalg import orth

from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.wrench import WrenchSensor
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Surface
from invariantqp.runs.plants.sensor import SimulatedSensor
from invariantqp.runs.plants.springs import Springs
from invariantqp.systems.contacts import Contact, ContactKind
from invariantqp.systems.projectors import dual_projectors

# Newton steps that move a wanted point onto the surface: a plane takes one, a round bar a few.
DROP_STEPS = 6


@dataclass(frozen=True, eq=False)
class ContactScene:
    """What the tool touches, what the controller believes of it, and what it has to do there."""

    kind: ContactKind  # of contact, in its own frame
    springs: Springs  # the contact as it really is
    simulated_sensor: SimulatedSensor  # the force sensor as it really is
    task: HybridTask  # for the hybrid controller, as it believes the contact to be
    sensor: WrenchSensor  # what the controller knows of its force sensor
    stiffness: Array  # (6,) in the contact's frame, angular first [N m/rad, N/m]
    normal: Array  # (3,) of the plane in which the path is drawn
    surface: Surface | None  # the surface as the controller believes it to be; None for a hinge

    def on_surface(self, T: Array) -> Array:
        """A wanted tool pose (4, 4) with its point moved onto the surface, along the plane's normal."""
        if self.surface is None:
            return T
        on = T.copy()
        for _ in range(DROP_STEPS):
            depth, normal = self.surface.depth(on[:3, 3])
            on[:3, 3] += depth / normal.dot(self.normal) * self.normal
        return on

    def motion_error(self, contact: Contact, T: Array, wanted: Array) -> tuple[float, float]:
        """Distance [m] and angle [rad] of a tool pose from a wanted one along what the contact leaves free."""
        R = np.asarray(contact.pose)[:3, :3]
        turn = se3.rotation_vector(wanted[:3, :3].dot(T[:3, :3].T))
        turns, slides = self._free
        slid, rotated = slides.T.dot(R.T.dot(wanted[:3, 3] - T[:3, 3])), turns.T.dot(R.T.dot(turn))
        return sqrt(slid.dot(slid)), sqrt(rotated.dot(rotated))

    def force(self, contact: Contact, wrench: Array) -> tuple[float, float]:
        """Of a wrench that the tool exerts (6,), base frame: its part along the wanted one, and |P*(W_d - W)| [N]."""
        resisted = self._resisted.dot(contact.adjoint.T.dot(wrench))
        e = self.wanted - resisted
        size = self.wanted_norm
        press = float((self.wanted * self._weights).dot(resisted)) / size if size > 0.0 else 0.0
        return press, sqrt((e * e).dot(self._weights))

    @cached_property
    def wanted(self) -> Array:
        """(6,) the wrench to exert, in the contact's frame."""
        return self.task.split(self.kind).wanted(np.asarray(self.task.wrench))

    @cached_property
    def wanted_norm(self) -> float:
        """|W_d| [N]."""
        return sqrt((self.wanted * self.wanted).dot(self._weights))

    @cached_property
    def _weights(self) -> Array:
        weights: Array = self.stiffness[3] / self.stiffness
        return weights

    @cached_property
    def _resisted(self) -> Array:
        """P* with the contact's stiffness as the metric, whatever the controller uses."""
        return dual_projectors(np.asarray(self.kind.freedoms), metric=self.stiffness).force

    @cached_property
    def _free(self) -> tuple[Array, Array]:
        """Orthonormal rotations and translations of the tool's point that the contact leaves free."""
        S = np.asarray(self.kind.freedoms)
        return orth(S[:3]), orth(S[3:])
