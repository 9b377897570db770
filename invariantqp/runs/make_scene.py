"""The contact of a task made from its file: springs for the plant, beliefs for the controller."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, inf
from typing import Literal, NamedTuple

import numpy as np

from invariantqp.errors import BadInput
from invariantqp.force.hybrid_task import HybridTask
from invariantqp.force.reading import Wrench
from invariantqp.force.wrench import WrenchSensor
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Cylinder, Plane, Surface
from invariantqp.runs.contactspec import ContactSpec, ForceSpec, SensorSpec
from invariantqp.runs.plants.sensor import SimulatedSensor
from invariantqp.runs.plants.springs import HingeSprings, Springs, SurfaceSprings
from invariantqp.runs.scene import ContactScene
from invariantqp.runs.taskfile import Task
from invariantqp.systems.contacts import Contact, face_contact, hinge, line_contact, point_contact

# The length over which a point contact is taken to extend, where moments are weighed against forces [m].
POINT_SIZE = 0.05
# If a handle is nearer to its hinge than this [m], or an edge nearer to the normal [rad], rounding chose its direction.
LEAST_ARM = 1e-6
# The corners of a face or a handle in order, and the ends of an edge, in halves of its sides.
CORNERS = {
    "point": ((0, 0),),
    "edge": ((-1, 0), (1, 0)),
    "face": ((-1, -1), (1, -1), (1, 1), (-1, 1)),
    "hinge": ((-1, -1), (1, -1), (1, 1), (-1, 1)),
}


class _Touched(NamedTuple):
    """What is touched."""

    springs: Springs  # as it really is
    stiffness: Array  # (6,) in the contact's frame
    contact_at: Callable[[Array], Contact]  # the contact that the controller believes in, for a tool at a (4, 4) pose
    normal: Array  # (3,) of the plane in which the path is drawn
    surface: Surface | None  # as the controller believes it to be; None for a hinge


def scene_of(task: Task, T: Array, noise: float = 0.0) -> ContactScene | None:
    """The contact of a task whose tool starts at pose T (4, 4); None where the tool touches nothing.

    `noise` is the standard deviation of a force component of the plant's sensor [N].

    Raises:
        BadInput, NoProjectors: a contact that cannot be, or a complement Z that does not split it.
    """
    contact, force, sensor = task.contact, task.force, task.sensor
    if contact is None or force is None:
        return None
    touched = (_hinge if contact.kind == "hinge" else _surface)(contact, T)
    mount = se3.transform(se3.rotation(np.asarray(sensor.mount_turn)), sensor.mount)
    return ContactScene(
        kind=touched.contact_at(T).kind,
        springs=touched.springs,
        simulated_sensor=SimulatedSensor(mount, sensor.mass, sensor.centre),
        task=_hybrid_task(contact, force, touched),
        sensor=_believed_sensor(sensor, mount, noise),
        stiffness=touched.stiffness,
        normal=touched.normal,
        surface=touched.surface,
    )


def _hybrid_task(contact: ContactSpec, force: ForceSpec, touched: _Touched) -> HybridTask:
    by_stiffness = force.h is None and force.complement is None
    return HybridTask(
        touched.contact_at,
        _wanted(contact, force),
        compliance=force.rate / touched.stiffness,
        stiffness=contact.stiffness,
        size=POINT_SIZE if contact.size is None else 0.5 * max(contact.size),
        h=force.h,
        complement=None if force.complement is None else np.array(force.complement).T,
        metric=touched.stiffness if by_stiffness else None,
        max_force=force.max_force,
        max_moment=force.max_moment,
        on_overload=force.on_overload,
        on_loss=force.on_loss,
        approach_speed=force.approach_speed,
        edge_margin=force.edge_margin,
        normal_within=contact.normal_within,
        yields=contact.yields,
    )


def _wanted(contact: ContactSpec, force: ForceSpec) -> list[float] | Wrench:
    """The press as a part in the contact's constraints, or on a hinge as a wrench."""
    if contact.kind == "hinge":
        return Wrench(moment=[0.0, 0.0, 0.0], force=[force.press, 0.0, 0.0])  # away from the axis
    return [force.press] + [0.0] * {"point": 0, "edge": 1, "face": 2}[contact.kind]


def _believed_sensor(sensor: SensorSpec, mount: Array, noise: float) -> WrenchSensor:
    return WrenchSensor(
        mount,
        order="moment first",
        reads="reaction",
        mass=sensor.mass,
        centre=sensor.centre,
        cutoff=inf if sensor.cutoff is None else sensor.cutoff,
        force_deadband=sensor.force_deadband,
        moment_deadband=sensor.moment_deadband,
        noise=noise,
        origin=se3.inverse(mount)[:3, 3],
    )


def _surface(contact: ContactSpec, T: Array) -> _Touched:
    """A plane or a round bar below a tool at pose T."""
    R, tilt = T[:3, :3], se3.rotation(np.asarray(contact.tilt))
    n = np.array(contact.normal) / np.linalg.norm(contact.normal)
    x = np.array(contact.along) - n * n.dot(contact.along)
    if not np.linalg.norm(x) > LEAST_ARM * np.linalg.norm(contact.along):
        raise BadInput("contact.along", f"{list(contact.along)} along the normal", "a direction in the surface")
    x /= np.linalg.norm(x)
    y = np.cross(n, x)
    foot = T[:3, 3] - contact.gap * n
    edges = tuple(_in_plane(np.array(edge), n) for edge in contact.edges)
    believed = _shaped(foot, n, x, contact.radius, edges)
    real = _shaped(foot, tilt.dot(n), tilt.dot(x), contact.radius, tuple(tilt.dot(edge) for edge in edges))
    a, b = [*(0.5 * s for s in contact.size or ()), 0.0, 0.0][:2]
    points = np.array([R.T.dot(i * a * x + j * b * y) for i, j in CORNERS[contact.kind]])
    along = R.T.dot(x)

    def contact_at(tool: Array) -> Contact:
        p = tool[:3, 3]
        if contact.kind == "point":
            here = point_contact(p, believed.depth(p)[1], tangent=x)
        elif contact.kind == "edge":
            here = line_contact(p, tool[:3, :3].dot(along), n)
        else:
            here = face_contact(p, n, tangent=tool[:3, :3].dot(along))
        return Contact(here.kind, here.pose, believed.extent(p)) if edges and isinstance(believed, Plane) else here

    lever = b or a or POINT_SIZE, a or POINT_SIZE, a or POINT_SIZE
    shape: Literal["point", "edge", "face"] = contact.kind  # type: ignore[assignment]
    stiffness = contact.stiffness * np.array([*np.square(lever), 1.0, 1.0, 1.0])
    return _Touched(SurfaceSprings(shape, points, real, contact.stiffness), stiffness, contact_at, n, believed)


def _shaped(foot: Array, normal: Array, along: Array, radius: float | None, edges: tuple[Array, ...]) -> Surface:
    return Plane(foot, normal, edges) if radius is None else Cylinder(foot - radius * normal, along, radius)


def _in_plane(edge: Array, normal: Array) -> Array:
    across: Array = edge - normal * normal.dot(edge)
    if not np.linalg.norm(across) > LEAST_ARM:
        raise BadInput(
            "contact.edges",
            f"{edge.tolist()} along the normal or too short",
            "a way along the surface from the tool to an edge",
        )
    return across


def _hinge(contact: ContactSpec, T: Array) -> _Touched:
    """A door held by a tool at pose T. The contact's frame is at the handle, its x axis away from the hinge."""
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
    closed = closed.relabelled(se3.inverse(np.asarray(closed.pose)).dot(handle))
    screw = screws.revolute(axis, foot)

    def contact_at(tool: Array) -> Contact:
        r = tool[:3, 3] - foot
        return closed.moved(se3.exp(atan2(axis.dot(se3.cross(arm, r)), arm.dot(r)) * screw))

    a, b = (0.5 * s for s in contact.size or (POINT_SIZE, POINT_SIZE))
    R = T[:3, :3].T.dot(handle[:3, :3])
    points = np.array([R.dot([i * a, 0.0, j * b]) for i, j in CORNERS["hinge"]])
    tilt = se3.rotation(np.asarray(contact.tilt))
    real = screws.revolute(tilt.dot(axis), p + tilt.dot(to_axis))
    stiffness = contact.stiffness * np.array([b * b, a * a + b * b, a * a, 1.0, 1.0, 1.0])
    return _Touched(HingeSprings(points, T.copy(), real, contact.stiffness), stiffness, contact_at, axis, None)
