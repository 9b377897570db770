"""The arm and the contact of a run as a MuJoCo model, made from the URDF through MuJoCo's own reader.

The model has the joints between base and tool, with their masses and without meshes. Gravity is compensated, as a
robot's own controller does; the force sensor still feels what hangs on it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import numpy as np

from invariantqp.errors import RobotModelError
from invariantqp.extras import optional
from invariantqp.force.wrench import GRAVITY
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.robots.urdf import chain_xml
from invariantqp.runs.physics import Physics
from invariantqp.runs.plants.sensor import SimulatedSensor
from invariantqp.runs.plants.solids import Solid, SolidKind, Solids, solids_of
from invariantqp.runs.plants.springs import HingeSprings, Springs, SurfaceSprings

with optional("sim", "mujoco"):
    import mujoco

# MuJoCo's impedance d of a contact. Its spring is solref / ((1 - d) A), A the inverse mass it assumes, and a mass of
# d / ((1 - d) A) sticks to it. A small d makes a spring; d near 1, as is usual for stiff contact, adds some 30 kg.
IMPEDANCE = 0.02
# Damping over stiffness of a contact [s]. MuJoCo's convex friction lifts a sliding contact by friction x speed x this:
# 15 micrometres at 0.1 m/s. With critical damping it would be half a millimetre, and contact would be lost.
RELAXATION = 5e-4
# The mass of the tool beyond its sensor is a ball of this radius [m].
TOOL_RADIUS = 0.03
# Mass of a door [kg], and half its width [m]; at least this, and less where the handle is nearer to the axis: a nut.
DOOR_MASS = 5.0
DOOR_HALF = (0.03, 0.3)
# A pitch below this [m/rad] is rounding, and makes no thread.
LEAST_PITCH = 1e-9
# Which of MuJoCo's shapes a solid is.
GEOMS = {kind: getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}") for kind in get_args(SolidKind)}
# How fast a nut follows its thread [s] and the damping ratio, and how little it gives: it pushes both ways, so that the
# mass of MuJoCo's stiff constraints does no harm.
THREAD = {"solref": (2e-3, 1.0), "solimp": (0.999, 0.999, 1e-3, 0.5, 2.0)}
# Mass and inertia given to a massless link, without which MuJoCo cannot move it [kg, kg m^2].
LEAST_MASS = 1e-6
LEAST_INERTIA = 1e-9


def arm_model(
    urdf: Path,
    robot: Robot,
    start: Array,
    timestep: float,
    touch: Springs | Solids | None,
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
    if isinstance(touch, SurfaceSprings):
        touch = solids_of(touch, robot.pose(start))
    if isinstance(touch, Solids):
        _add_solids(spec, touch, sensor, physics)
    elif touch is not None:
        _add_door(spec, touch, sensor, physics)
    for name in robot.names:
        _add_servo(spec, name, physics.armature)
    try:
        model = spec.compile()
    except ValueError as error:
        raise RobotModelError(f"{urdf.name}: MuJoCo cannot make a model of it ({error})") from error
    if touch is not None:
        _stiffen(model, touch)
    return model


def tool_body(robot: Robot) -> str:
    """The name of the link that is the robot's tool."""
    return str(getattr(robot, "tool", ""))


def _add_servo(spec: Any, joint: str, armature: float) -> None:
    """A velocity loop for a joint; the plant sets its gains. Limits are left to the controller under test."""
    spec.joint(joint).limited = 0
    spec.joint(joint).armature = armature
    spec.add_actuator(
        name=joint,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
    )


def _stiffen(model: Any, touch: Solids | HingeSprings) -> None:
    """Give the contact its stiffness: MuJoCo scales it by the inverse masses it assumes for the two bodies."""
    each, A = touch.stiffness, model.body_invweight0[model.body("sensor").id, 0]
    if isinstance(touch, HingeSprings):
        each, A = each / len(touch.points), A + model.body_invweight0[model.body("door").id, 0]
    spring = (1.0 - IMPEDANCE) * A * each
    damper = spring * RELAXATION
    impedance = (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)
    if isinstance(touch, HingeSprings):
        tied = model.eq_type == mujoco.mjtEq.mjEQ_CONNECT
        model.eq_solref[tied] = (-spring, -damper)
        model.eq_solimp[tied] = impedance
    else:
        for i in range(len(touch.tool)):
            tip = model.geom(f"tip {i}").id
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


def _add_solids(spec: Any, solids: Solids, sensor: SimulatedSensor, physics: Physics) -> None:
    """What does not move, and what is on the tool."""
    common: dict[str, Any] = {"contype": 1, "conaffinity": 1, "condim": 3, "friction": (physics.friction, 0.0, 0.0)}
    for solid in solids.world:
        spec.worldbody.add_geom(type=GEOMS[solid.kind], size=_size(solid), **_place(solid.pose), **common)
    to_sensor = se3.inverse(sensor.mount)
    for i, solid in enumerate(solids.tool):
        place = _place(to_sensor.dot(solid.pose))
        shape = {"type": GEOMS[solid.kind], "size": _size(solid)}
        spec.body("sensor").add_geom(name=f"tip {i}", mass=0.0, priority=1, **shape, **place, **common)


def _size(solid: Solid) -> list[float]:
    """As MuJoCo writes it; of a plane, the spacing of a grid."""
    return [0.0, 0.0, 1.0] if solid.kind == "plane" else [*solid.size, 0.0, 0.0][:3]


def _add_door(spec: Any, springs: HingeSprings, sensor: SimulatedSensor, physics: Physics) -> None:
    """A door on its hinge, or a nut on its bolt, tied to the tool at the points of the springs."""
    axis, foot = screws.axis(springs.screw)
    pitch = screws.pitch(springs.screw)
    half = float(np.clip(np.linalg.norm(np.cross(axis, springs.home[:3, 3] - foot)), *DOOR_HALF))
    door = spec.worldbody.add_body(
        name="door",
        pos=foot,
        mass=DOOR_MASS,
        ipos=np.zeros(3),  # left out, MuJoCo takes the place of the body
        inertia=np.full(3, DOOR_MASS * half**2 / 3.0),
        gravcomp=1.0,
        explicitinertial=True,
    )
    door.add_joint(name="hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, frictionloss=physics.hinge_friction)
    if abs(pitch) > LEAST_PITCH:
        door.add_joint(name="lead", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        screw = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1="lead", name2="hinge", **THREAD)
        screw.data[:5] = (0.0, pitch, 0.0, 0.0, 0.0)
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
