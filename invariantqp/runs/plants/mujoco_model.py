"""The arm and the contact of a run as a MuJoCo model, made from the URDF through MuJoCo's own reader.

The model has the joints between base and tool, with their masses and without meshes. Gravity is compensated, as a
robot's own controller does; the force sensor still feels what hangs on it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from invariantqp.errors import BadInput, MissingExtra, RobotModelError
from invariantqp.force.wrench import GRAVITY
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.geometry.surfaces import Plane
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.physics import Physics
from invariantqp.runs.plants.sensor import SimulatedSensor
from invariantqp.runs.plants.springs import HingeSprings, Springs, SurfaceSprings
from invariantqp.runs.plants.urdf import chain_xml

try:
    import mujoco
except ImportError as error:
    raise MissingExtra("mujoco", "sim") from error

# MuJoCo's impedance d of a contact. Its spring is solref / ((1 - d) A), A the inverse mass it assumes, and a mass of
# d / ((1 - d) A) sticks to it. A small d makes a spring; d near 1, as is usual for stiff contact, adds some 30 kg.
IMPEDANCE = 0.02
# Damping over stiffness of a contact [s]. MuJoCo's convex friction lifts a sliding contact by friction x speed x this:
# 15 micrometres at 0.1 m/s. With critical damping it would be half a millimetre, and contact would be lost.
RELAXATION = 5e-4
# Radius of the tip of a pen and of an edge, thickness of a face [m].
TIP = 2e-3
# The mass of the tool beyond its sensor is a ball of this radius [m].
TOOL_RADIUS = 0.03
# Mass of a door [kg], and half its width [m].
DOOR_MASS = 5.0
DOOR_HALF = 0.3
# A pitch below this [m/rad] is rounding.
LEAST_PITCH = 1e-9
# Mass and inertia given to a massless link, without which MuJoCo cannot move it [kg, kg m^2].
LEAST_MASS = 1e-6
LEAST_INERTIA = 1e-9


def arm_model(
    urdf: Path,
    robot: Robot,
    start: Array,
    timestep: float,
    springs: Springs | None,
    sensor: SimulatedSensor,
    physics: Physics,
) -> Any:
    """The `mujoco.MjModel` of an arm, its force sensor and what it touches.

    Raises:
        RobotModelError: MuJoCo cannot make a model of the arm.
        BadInput: a contact that MuJoCo has no shape for.
    """
    tool = tool_body(robot)
    try:
        spec = mujoco.MjSpec.from_string(chain_xml(urdf, tool, robot.names))
    except ValueError as error:
        raise RobotModelError(f"{urdf.name}: MuJoCo cannot read it ({error})") from error
    _settings(spec, timestep)
    _add_tool(spec, tool, sensor)
    if isinstance(springs, SurfaceSprings):
        _add_surface(spec, springs, sensor, robot.pose(start), physics)
    elif springs is not None:
        _add_door(spec, springs, sensor, physics)
    for name in robot.names:
        _add_servo(spec, name)
    try:
        model = spec.compile()
    except ValueError as error:
        raise RobotModelError(f"{urdf.name}: MuJoCo cannot make a model of it ({error})") from error
    if springs is not None:
        _stiffen(model, springs)
    return model


def tool_body(robot: Robot) -> str:
    """The name of the link that is the robot's tool."""
    return str(getattr(robot, "tool", ""))


def _add_servo(spec: Any, joint: str) -> None:
    """A velocity loop for a joint; the plant sets its gains. Limits are left to the controller under test."""
    spec.joint(joint).limited = 0
    spec.add_actuator(
        name=joint,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
    )


def _stiffen(model: Any, springs: Springs) -> None:
    """Give the contact its stiffness: MuJoCo scales it by the inverse masses it assumes for the two bodies."""
    each = springs.stiffness / len(springs.points)
    A = model.body_invweight0[model.body("sensor").id, 0]
    if isinstance(springs, HingeSprings):
        A += model.body_invweight0[model.body("door").id, 0]
    spring = (1.0 - IMPEDANCE) * A * each
    damper = spring * RELAXATION
    impedance = (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)
    if isinstance(springs, HingeSprings):
        model.eq_solref[:] = (-spring, -damper)
        model.eq_solimp[:] = impedance
    else:
        tip = model.geom("tip").id
        model.geom_solref[tip] = (-spring, -damper)
        model.geom_solimp[tip] = impedance


def _settings(spec: Any, timestep: float) -> None:
    """Options of the whole model."""
    spec.option.timestep = timestep
    spec.option.gravity = GRAVITY
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # a pen at rest does not creep
    spec.compiler.boundmass = LEAST_MASS
    spec.compiler.boundinertia = LEAST_INERTIA
    for body in spec.bodies:
        body.gravcomp = 1.0


def _add_tool(spec: Any, tool: str, sensor: SimulatedSensor) -> None:
    """A body at the sensor for the part of the tool beyond it."""
    body = spec.body(tool).add_body(name="sensor", gravcomp=1.0, **_place(sensor.mount))
    if sensor.mass > 0.0:
        body.mass = sensor.mass
        body.ipos = sensor.centre
        body.inertia = np.full(3, 0.4 * sensor.mass * TOOL_RADIUS**2)
        body.explicitinertial = True
    body.add_site(name="sensor")
    for name, kind in (("moment", mujoco.mjtSensor.mjSENS_TORQUE), ("force", mujoco.mjtSensor.mjSENS_FORCE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="sensor")


def _add_surface(spec: Any, springs: SurfaceSprings, sensor: SimulatedSensor, T: Array, physics: Physics) -> None:
    """The surface, and on the tool a ball, an edge or a face that touches it at the points of the springs."""
    common: dict[str, Any] = {"contype": 1, "conaffinity": 1, "condim": 3, "friction": (physics.friction, 0.0, 0.0)}
    kind, size, frame = _surface_shape(springs)
    spec.worldbody.add_geom(name="surface", type=kind, size=size, **_place(frame), **common)
    kind, size, frame = _tip_shape(springs, T)
    place = _place(se3.inverse(sensor.mount).dot(frame))
    spec.body("sensor").add_geom(name="tip", type=kind, size=size, mass=0.0, priority=1, **place, **common)


def _surface_shape(springs: SurfaceSprings) -> tuple[Any, tuple[float, ...], Array]:
    """MuJoCo's shape for the surface, its size, and its pose in the base frame."""
    surface = springs.surface
    if isinstance(surface, Plane):
        return mujoco.mjtGeom.mjGEOM_PLANE, (0.0, 0.0, 1.0), se3.facing(surface.normal, surface.point)
    if springs.shape == "point":
        return mujoco.mjtGeom.mjGEOM_CYLINDER, (surface.radius, 1.0, 0.0), se3.facing(surface.axis, surface.point)
    raise BadInput("physics", f"a {springs.shape} on a round bar", "a point there, or a plane, with MuJoCo")


def _tip_shape(springs: SurfaceSprings, T: Array) -> tuple[Any, tuple[float, ...], Array]:
    """MuJoCo's shape for the part of the tool that touches, its size, and its pose in the frame of a tool at T."""
    p = springs.points.mean(axis=0)
    _, normal = springs.surface.depth(T[:3, :3].dot(p) + T[:3, 3])
    up = T[:3, :3].T.dot(normal)  # in the tool frame
    if springs.shape == "point":
        return mujoco.mjtGeom.mjGEOM_SPHERE, (TIP, 0.0, 0.0), se3.transform(None, p + TIP * up)
    if springs.shape == "edge":
        along = springs.points[1] - springs.points[0]
        half = 0.5 * float(np.linalg.norm(along))
        return mujoco.mjtGeom.mjGEOM_CAPSULE, (TIP, half, 0.0), se3.facing(along, p + TIP * up)
    a, b = springs.points[1] - springs.points[0], springs.points[2] - springs.points[1]
    sides = 0.5 * float(np.linalg.norm(a)), 0.5 * float(np.linalg.norm(b))
    R = np.column_stack((a / (2.0 * sides[0]), b / (2.0 * sides[1]), np.cross(a, b) / (4.0 * sides[0] * sides[1])))
    return mujoco.mjtGeom.mjGEOM_BOX, (*sides, 0.5 * TIP), se3.transform(R, p + 0.5 * TIP * up)


def _add_door(spec: Any, springs: HingeSprings, sensor: SimulatedSensor, physics: Physics) -> None:
    """A door on its hinge, tied to the tool at the points of the springs."""
    axis, moment = springs.screw[:3], springs.screw[3:]
    if abs(axis.dot(moment)) > LEAST_PITCH * axis.dot(axis):
        raise BadInput("physics", "a hinge with a pitch", "pitch 0 with MuJoCo", "Run it with the ideal physics.")
    foot = np.cross(axis, moment) / axis.dot(axis)
    door = spec.worldbody.add_body(
        name="door",
        pos=foot,
        mass=DOOR_MASS,
        inertia=np.full(3, DOOR_MASS * DOOR_HALF**2 / 3.0),
        gravcomp=1.0,
        explicitinertial=True,
    )
    door.add_joint(name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, frictionloss=physics.hinge_friction)
    to_sensor = se3.inverse(sensor.mount)
    for i, (on_door, on_tool) in enumerate(zip(springs.handle(0.0), springs.points, strict=True)):
        door.add_site(name=f"door {i}", pos=on_door - foot)
        spec.body("sensor").add_site(name=f"grip {i}", pos=to_sensor[:3, :3].dot(on_tool) + to_sensor[:3, 3])
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"grip {i}",
            name2=f"door {i}",
        )


def _place(T: Array) -> dict[str, Array]:
    """A pose as MuJoCo writes it."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, T[:3, :3].ravel())
    return {"pos": T[:3, 3], "quat": quat}
