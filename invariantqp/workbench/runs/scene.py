"""The contact of a task: the true one, of the plant, and the nominal one, of the controller.

They differ by [contact] tilt. Errors are measured by the nominal one: of motion along its freedoms, of force along its
constraints.

    relative force error = |P*(W_d - W)| / |W_d|,    |W|^2 = |f|^2 + k m'K^-1 m about the place of contact

k and K are the contact's stiffness [N/m] and [N m/rad], so a moment counts as the force that stretches it as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import atan2, inf, sqrt

import numpy as np
from scipy.linalg import orth

from invariantqp.errors import BadInput
from invariantqp.force.contact import HybridTask
from invariantqp.force.contact_kinds import (
    SIX_DIGITS,
    Contact,
    ContactKind,
    face_contact,
    hinge,
    line_contact,
    point_contact,
)
from invariantqp.force.sensor import WrenchSensor
from invariantqp.force.wrench import Wrench
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.systems.projectors import dual_projectors
from invariantqp.workbench.runs.contactspec import SIZE_COUNT, ContactSpec, ForceSpec
from invariantqp.workbench.runs.plant import HingeSprings, Plane, SimulatedSensor, Springs, SurfaceSprings
from invariantqp.workbench.runs.taskfile import Task

# Size of a point contact, by which moments are weighed against forces [m].
POINT_SIZE = 0.05
# Points of each kind of contact, in halves of its sides; the corners of a face in order.
CORNERS = {
    "point": ((0, 0),),
    "edge": ((-1, 0), (1, 0)),
    "face": ((-1, -1), (1, -1), (1, 1), (-1, 1)),
}


@dataclass(frozen=True, eq=False)
class ContactScene:
    """The true contact and sensor of a plant, and the controller's task and model of them."""

    kind: ContactKind  # of contact, in its own frame
    springs: Springs  # the true contact
    simulated_sensor: SimulatedSensor  # the true force sensor
    task: HybridTask  # for the hybrid controller, on the nominal contact
    sensor: WrenchSensor  # the controller's model of its force sensor
    stiffness: Array  # (6,) in the contact's frame, angular first [N m/rad, N/m]
    normal: Array  # (3,) of the plane of the path
    surface: Plane | None  # the nominal surface; None for a hinge

    def on_surface(self, T: Array) -> Array:
        """A desired tool pose (4, 4) with its origin moved onto the surface along the normal."""
        if self.surface is None:
            return T
        on = T.copy()
        on[:3, 3] += self.surface.depth(T[:3, 3]) * self.normal
        return on

    def motion_error(self, contact: Contact, T: Array, wanted: Array) -> tuple[float, float]:
        """Distance [m] and angle [rad] of a tool pose from the desired one along the contact's freedoms."""
        R = np.asarray(contact.pose)[:3, :3]
        turn = se3.rotation_vector(wanted[:3, :3].dot(T[:3, :3].T))
        turns, slides = self._free
        slid, rotated = slides.T.dot(R.T.dot(wanted[:3, 3] - T[:3, 3])), turns.T.dot(R.T.dot(turn))
        return sqrt(slid.dot(slid)), sqrt(rotated.dot(rotated))

    def force(self, contact: Contact, wrench: Array) -> tuple[float, float]:
        """Of a wrench (6,) that the tool exerts, base frame: the part along the desired one, and |P*(W_d - W)| [N]."""
        resisted = self._constraint_projector.dot(contact.adjoint.T.dot(wrench))
        e = self.wanted - resisted
        size = self.wanted_norm
        press = float((self.wanted * self._weights).dot(resisted)) / size if size > 0.0 else 0.0
        return press, sqrt((e * e).dot(self._weights))

    @cached_property
    def wanted(self) -> Array:
        """(6,) the desired wrench, in the contact's frame."""
        return self.task.split(self.kind).desired(np.asarray(self.task.wrench))

    @property
    def _weights(self) -> Array:
        return np.asarray(self.stiffness[3] / self.stiffness)

    @cached_property
    def wanted_norm(self) -> float:
        """|W_d| [N]."""
        return sqrt((self.wanted * self.wanted).dot(self._weights))

    @cached_property
    def _constraint_projector(self) -> Array:
        """P* with the contact's stiffness as the metric, whatever the controller uses."""
        return dual_projectors(np.asarray(self.kind.freedoms), metric=self.stiffness).force

    @cached_property
    def _free(self) -> tuple[Array, Array]:
        """Orthonormal rotations and translations of the tool's point that the contact leaves free."""
        S = np.asarray(self.kind.freedoms)
        return orth(S[:3]), orth(S[3:])


# Springs, stiffness, nominal contact at a (4, 4) tool pose, normal and surface, as in `ContactScene`.
_ContactParts = tuple[Springs, Array, Callable[[Array], Contact], Array, Plane | None]


def scene_of(task: Task, T: Array, noise: float = 0.0) -> ContactScene | None:
    """The contact of a task whose tool starts at pose T (4, 4); None without contact.

    `noise` is the standard deviation of a force component of the plant's sensor [N].
    """
    contact, force, sensor = task.contact, task.force, task.sensor
    if contact is None or force is None:
        return None
    springs, stiffness, contact_at, normal, surface = (_hinge if contact.kind == "hinge" else _surface)(contact, T)
    mount = se3.transform(se3.rotation(np.asarray(sensor.mount_turn)), sensor.mount)
    return ContactScene(
        kind=contact_at(T).kind,
        springs=springs,
        simulated_sensor=SimulatedSensor(mount, sensor.mass, sensor.centre),
        task=_hybrid_task(contact, force, stiffness, contact_at),
        sensor=WrenchSensor(
            mount,
            order="moment first",
            reads="reaction",
            cutoff=inf if sensor.cutoff is None else sensor.cutoff,
            **sensor.model_dump(include={"mass", "centre", "force_deadband", "moment_deadband"}),
            noise=noise,
            origin=se3.inverse(mount)[:3, 3],
        ),
        stiffness=stiffness,
        normal=normal,
        surface=surface,
    )


def _hybrid_task(
    contact: ContactSpec, force: ForceSpec, stiffness: Array, contact_at: Callable[[Array], Contact]
) -> HybridTask:
    by_stiffness = force.h is None and force.complement is None
    press: list[float] | Wrench = [force.press] + [0.0] * SIZE_COUNT[contact.kind]
    if contact.kind == "hinge":
        press = Wrench(moment=[0.0, 0.0, 0.0], force=[force.press, 0.0, 0.0])  # away from the axis
    return HybridTask(
        contact_at,
        press,
        compliance=force.rate / stiffness,
        stiffness=contact.stiffness,
        size=POINT_SIZE if contact.size is None else 0.5 * max(contact.size),
        h=force.h,
        complement=None if force.complement is None else np.array(force.complement).T,
        metric=stiffness if by_stiffness else None,
        **force.model_dump(exclude={"press", "rate", "h", "complement"}),
        **contact.model_dump(include={"normal_within", "yields"}),
    )


def _surface(contact: ContactSpec, T: Array) -> _ContactParts:
    """A plane below a tool at pose T."""
    R, tilt = T[:3, :3], se3.rotation(np.asarray(contact.tilt))
    n = np.array(contact.normal) / np.linalg.norm(contact.normal)
    x = np.array(contact.along) - n * n.dot(contact.along)
    if not np.linalg.norm(x) > SIX_DIGITS * np.linalg.norm(contact.along):
        raise BadInput("contact.along", f"{list(contact.along)} along the normal", "a direction in the surface")
    x /= np.linalg.norm(x)
    y = np.cross(n, x)
    foot = T[:3, 3] - contact.gap * n
    edges = tuple(np.array(edge) - n * n.dot(edge) for edge in contact.edges)
    for given, edge in zip(contact.edges, edges, strict=True):
        if not np.linalg.norm(edge) > SIX_DIGITS:
            found = f"{list(given)} along the normal or too short"
            raise BadInput("contact.edges", found, "a vector along the surface from the tool to an edge")
    nominal = Plane(foot, n, edges)
    true = Plane(foot, tilt.dot(n), tuple(tilt.dot(edge) for edge in edges))
    a, b = [*(0.5 * s for s in contact.size or ()), 0.0, 0.0][:2]
    points = np.array([R.T.dot(i * a * x + j * b * y) for i, j in CORNERS[contact.kind]])
    along = R.T.dot(x)

    def contact_at(tool: Array) -> Contact:
        p = tool[:3, 3]
        if contact.kind == "point":
            here = point_contact(p, n, tangent=x)
        elif contact.kind == "edge":
            here = line_contact(p, tool[:3, :3].dot(along), n)
        else:
            here = face_contact(p, n, tangent=tool[:3, :3].dot(along))
        return Contact(here.kind, here.pose, nominal.extent(p)) if edges else here

    lever = b or a or POINT_SIZE, a or POINT_SIZE, a or POINT_SIZE
    stiffness = contact.stiffness * np.array([*np.square(lever), 1.0, 1.0, 1.0])
    return SurfaceSprings(points, true, contact.stiffness), stiffness, contact_at, n, nominal


def _hinge(contact: ContactSpec, T: Array) -> _ContactParts:
    """A door held by a tool at pose T. The contact's frame is at the handle, its x axis away from the hinge."""
    p = T[:3, 3]
    axis = np.array(contact.axis) / np.linalg.norm(contact.axis)
    to_axis = np.array(contact.point)
    foot = p + to_axis - axis * axis.dot(to_axis)
    arm = p - foot
    if not np.linalg.norm(arm) > SIX_DIGITS:
        raise BadInput("contact.point", f"{list(contact.point)}, the tool on the axis", "an axis beside the tool")
    x = arm / np.linalg.norm(arm)
    handle = se3.transform(np.column_stack((x, np.cross(axis, x), axis)), p)
    closed = hinge(foot, axis)
    closed = closed.relabelled(se3.inverse(np.asarray(closed.pose)).dot(handle))
    screw = screws.revolute(axis, foot)

    def contact_at(tool: Array) -> Contact:
        r = tool[:3, 3] - foot
        return closed.moved(se3.exp(atan2(axis.dot(se3.cross(arm, r)), arm.dot(r)) * screw))

    a, b = (0.5 * s for s in contact.size or (POINT_SIZE, POINT_SIZE))
    R = T[:3, :3].T.dot(handle[:3, :3])
    points = np.array([R.dot([i * a, 0.0, j * b]) for i, j in CORNERS["face"]])
    tilt = se3.rotation(np.asarray(contact.tilt))
    true = screws.revolute(tilt.dot(axis), p + tilt.dot(to_axis))
    stiffness = contact.stiffness * np.array([b * b, a * a + b * b, a * a, 1.0, 1.0, 1.0])
    return HingeSprings(points, T.copy(), true, contact.stiffness), stiffness, contact_at, axis, None
