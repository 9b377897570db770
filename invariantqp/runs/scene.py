"""A task's contact twice: as it is (`touch`, for a plant) and as the controller believes it to be (`task`).

The two differ by [contact] tilt, and by what a physics engine adds. A run is judged in the belief, in which the task is
told: motion along what the contact leaves free, force along what it resists.

    relative force error = |P*(W_d - W)| / |W_d|,    |W|^2 = |f|^2 + k m'K^-1 m about the place of contact

k and K are the contact's stiffness [N/m] and [N m/rad]: a moment counts as the force that strains it as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import atan2, inf, sqrt
from typing import Literal

import numpy as np
from scipy.linalg import orth
from scipy.spatial.transform import Rotation

from invariantqp.errors import BadInput
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.wrench import WrenchSensor
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Cylinder, Plane, Surface
from invariantqp.runs.contactspec import ContactSpec, ForceSpec
from invariantqp.runs.plants.touch import Grip, Touch, Wrist
from invariantqp.systems.contact_kinds import ContactKind
from invariantqp.systems.contacts import Contact, face_contact, hinge, line_contact, point_contact
from invariantqp.systems.projectors import dual_projectors

# Over what a contact without extent is taken to spread where moments are weighed against forces [m].
POINT_SIZE = 0.05
# Newton steps of a wanted point onto the surface: a plane takes one, a round bar a few.
DROP_STEPS = 6
# A handle nearer to its hinge [m], or an edge nearer to the normal [rad], has a direction that only rounding chose.
LEAST_ARM = 1e-6

At = Callable[[Array], Contact]


@dataclass(frozen=True, eq=False)
class Scene:
    """What is touched, what the controller believes, and what it is to do there.

    Attributes:
        kind: of contact, in its own frame.
        touch: the contact as it is.
        wrist: the force sensor as it is.
        task: for the hybrid controller.
        sensor: what the controller knows of its sensor.
        stiffness: (6,) in the contact's frame, angular first [N m/rad, N/m].
        normal: (3,) of the plane that the path is drawn in.
        surface: what the controller believes to be there; None is a hinge.
    """

    kind: ContactKind
    touch: Touch | Grip
    wrist: Wrist
    task: HybridTask
    sensor: WrenchSensor
    stiffness: Array
    normal: Array
    surface: Surface | None

    def drop(self, T: Array) -> Array:
        """A wanted tool pose (4, 4) with its point put on the surface, along the plane's normal."""
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
        turn = Rotation.from_matrix(wanted[:3, :3].dot(T[:3, :3].T)).as_rotvec()
        turns, slides = self._free
        slid, rotated = slides.T.dot(R.T.dot(wanted[:3, 3] - T[:3, 3])), turns.T.dot(R.T.dot(turn))
        return sqrt(slid.dot(slid)), sqrt(rotated.dot(rotated))

    def force(self, contact: Contact, wrench: Array) -> tuple[float, float]:
        """Of a wrench that the tool exerts (6,), base frame: its part along the wanted one, and |P*(W_d - W)| [N]."""
        felt = self._resisted.dot(se3.adjoint(np.asarray(contact.pose), check=False).T.dot(wrench))
        e = self.wanted - felt
        size = self.wanted_norm
        press = float((self.wanted * self._weights).dot(felt)) / size if size > 0.0 else 0.0
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
        """P* along the contact's stiffness, whatever the controller uses."""
        return dual_projectors(np.asarray(self.kind.freedoms), metric=self.stiffness).force

    @cached_property
    def _free(self) -> tuple[Array, Array]:
        """Orthonormal turns and slides of the tool's point that the contact leaves free."""
        S = np.asarray(self.kind.freedoms)
        return orth(S[:3]), orth(S[3:])


def scene_of(contact: ContactSpec, force: ForceSpec, T: Array) -> Scene:
    """The scene of a task whose tool starts at pose T (4, 4).

    Raises:
        BadInput, NoProjectors: a contact or a form of Z that is none.
    """
    tilt = Rotation.from_rotvec(contact.tilt).as_matrix()
    surface: Surface | None = None
    touch: Touch | Grip
    if contact.kind == "hinge":
        touch, stiffness, at, normal = _hinge(contact, T, tilt)
    else:
        surface, touch, stiffness, at, normal = _surface(contact, T, tilt)
    mount = se3.transform(Rotation.from_rotvec(force.sensor_turn).as_matrix(), force.sensor)
    task = HybridTask(
        at,
        _wanted(contact, force),
        compliance=force.rate / stiffness,
        size=POINT_SIZE if contact.size is None else 0.5 * max(contact.size),
        h=force.pitch,
        complement=None if force.complement is None else np.array(force.complement).T,
        metric=stiffness if force.form == "stiffness" else None,
        max_force=inf if force.max_force is None else force.max_force,
        max_moment=inf if force.max_moment is None else force.max_moment,
        on_overload=force.on_overload,
        on_loss=force.on_loss,
        approach_speed=force.approach_speed,
    )
    sensor = WrenchSensor(
        mount,
        force.tool_mass,
        force.tool_centre,
        cutoff=inf if force.cutoff is None else force.cutoff,
        force_deadband=force.force_deadband,
        moment_deadband=force.moment_deadband,
        origin=se3.inverse(mount, check=False)[:3, 3],
    )
    wrist = Wrist(mount, force.tool_mass, force.tool_centre)
    return Scene(at(T).kind, touch, wrist, task, sensor, stiffness, normal, surface)


def _wanted(contact: ContactSpec, force: ForceSpec) -> list[float]:
    if contact.kind == "hinge":
        return [0.0, 0.0, 0.0, force.press, 0.0, 0.0]  # away from the axis
    return [force.press] + [0.0] * {"point": 0, "edge": 1, "face": 2}[contact.kind]


def _surface(contact: ContactSpec, T: Array, tilt: Array) -> tuple[Surface, Touch, Array, At, Array]:
    """What is believed, what is, its stiffness, and the believed contact of a tool at a pose."""
    R = T[:3, :3]
    n = np.array(contact.normal) / np.linalg.norm(contact.normal)
    x = np.array(contact.along) - n * n.dot(contact.along)
    if not np.linalg.norm(x) > LEAST_ARM * np.linalg.norm(contact.along):
        raise BadInput("contact.along", f"{list(contact.along)} along the normal", "a direction in the surface")
    x /= np.linalg.norm(x)
    y = np.cross(n, x)
    foot = T[:3, 3] - contact.gap * n
    believed, true = _shaped(foot, n, x, contact.radius), _shaped(foot, tilt.dot(n), tilt.dot(x), contact.radius)
    a, b = [*(0.5 * s for s in contact.size or ()), 0.0, 0.0][:2]
    corners = {"point": [(0, 0)], "edge": [(-1, 0), (1, 0)], "face": [(-1, -1), (1, -1), (1, 1), (-1, 1)]}[contact.kind]
    points = np.array([R.T.dot(i * a * x + j * b * y) for i, j in corners])
    along = R.T.dot(x)

    def at(tool: Array) -> Contact:
        p = tool[:3, 3]
        if contact.kind == "point":
            return point_contact(p, believed.depth(p)[1], tangent=x)
        if contact.kind == "edge":
            return line_contact(p, tool[:3, :3].dot(along), n)
        return face_contact(p, n, tangent=tool[:3, :3].dot(along))

    lever = b or a or POINT_SIZE, a or POINT_SIZE, a or POINT_SIZE
    shape: Literal["point", "edge", "face"] = contact.kind  # type: ignore[assignment]
    stiffness = contact.stiffness * np.array([*np.square(lever), 1.0, 1.0, 1.0])
    return believed, Touch(shape, points, true, contact.stiffness), stiffness, at, n


def _shaped(foot: Array, normal: Array, along: Array, radius: float | None) -> Surface:
    return Plane(foot, normal) if radius is None else Cylinder(foot - radius * normal, along, radius)


def _hinge(contact: ContactSpec, T: Array, tilt: Array) -> tuple[Grip, Array, At, Array]:
    """What is, its stiffness, and the believed contact of a tool at a pose, its frame at the handle, x off the axis."""
    p = T[:3, 3]
    axis = np.array(contact.axis) / np.linalg.norm(contact.axis)
    to_axis = np.array(contact.point)
    foot = p + to_axis - axis * axis.dot(to_axis)
    arm = p - foot
    if not np.linalg.norm(arm) > LEAST_ARM:
        raise BadInput("contact.point", f"{list(contact.point)}, the tool on the axis", "an axis beside the tool")
    x = arm / np.linalg.norm(arm)
    handle = se3.transform(np.column_stack((x, np.cross(axis, x), axis)), p)
    closed = hinge(foot, axis)
    closed = closed.relabelled(se3.inverse(np.asarray(closed.pose), check=False).dot(handle))
    screw = screws.revolute(axis, foot)

    def at(tool: Array) -> Contact:
        r = tool[:3, 3] - foot
        return closed.moved(se3.exp(atan2(axis.dot(np.cross(arm, r)), arm.dot(r)) * screw, check=False))

    a, b = (0.5 * s for s in contact.size or (POINT_SIZE, POINT_SIZE))
    R = T[:3, :3].T.dot(handle[:3, :3])
    points = np.array([R.dot([i * a, 0.0, j * b]) for i, j in [(-1, -1), (1, -1), (1, 1), (-1, 1)]])
    true = screws.revolute(tilt.dot(axis), p + tilt.dot(to_axis))
    stiffness = contact.stiffness * np.array([b * b, a * a + b * b, a * a, 1.0, 1.0, 1.0])
    return Grip(points, T.copy(), true, contact.stiffness), stiffness, at, axis
