"""The same arm and the same contact on MuJoCo, a physics engine that shares no code with this package.

velocity loop: lag v' = u - v,    contact: f_i = (k / n) depth_i + damping,  friction <= mu f_i

The model is made from the URDF: the joints between base and tool with their masses, without meshes. Gravity is
compensated, as by a robot's own controller, but the force sensor measures the weight beyond it. Contacts are between
solids: `solids_of` makes them from the springs of a task; other scenes, such as a peg in a hole, give their own.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from invariantqp.errors import BadInput, RobotModelError
from invariantqp.extras import optional
from invariantqp.force.contact_kinds import SIX_DIGITS
from invariantqp.force.sensor import GRAVITY
from invariantqp.geometry import screws, se3
from invariantqp.geometry.arrays import NEGLIGIBLE, Array
from invariantqp.robots.chain import Chain
from invariantqp.robots.urdf import chain_xml
from invariantqp.workbench.runs.contactspec import Physics
from invariantqp.workbench.runs.plant import (
    HingeSprings,
    Measurement,
    Plane,
    PlantState,
    SimulatedSensor,
    Springs,
    SurfaceSprings,
)

with optional("sim", "mujoco"):
    import mujoco

# Radius of the tip of a pen and of an edge, thickness of a face [m].
TIP_RADIUS = 2e-3
# Half of the thickness of a table, and of its sides without an edge [m].
TABLE_HALF = 1.0

SolidKind = Literal["plane", "sphere", "capsule", "cylinder", "box"]
# MuJoCo's impedance d of a contact: a spring solref / ((1 - d) A), A the assumed inverse mass, and an added mass
# d / ((1 - d) A). A small d makes a spring; d near 1, usual for stiff contact, adds some 30 kg.
IMPEDANCE = 0.02
# Damping over stiffness of a contact [s]: wood and rubber, a quarter of the default. MuJoCo's convex friction lifts
# a sliding contact by friction x speed x this: 0.3 mm at 0.1 m/s.
DAMPING_TIME = 1e-2
# The most damping of a contact [N s/m]; above 1e4 the simulation step is too long for an arm's tip.
MAX_DAMPING = 500.0
# Radius of the ball that is the mass of the tool beyond the sensor [m].
TOOL_RADIUS = 0.03
# Mass of a door [kg]; the least and the largest half width, the handle's distance from the axis between them [m].
DOOR_MASS = 5.0
DOOR_HALF_WIDTH = (0.03, 0.3)
# MuJoCo's type of each solid.
GEOM_TYPES = {kind: getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}") for kind in get_args(SolidKind)}
# A nut on its thread: time constant [s] and damping ratio, and a stiff impedance, whose added mass does no harm here.
THREAD_CONSTRAINT = {"solref": (2e-3, 1.0), "solimp": (0.999, 0.999, 1e-3, 0.5, 2.0)}
# Longest simulation step [s]: contact and velocity loops are ten times slower.
SUBSTEP = 5e-4


class Solid(NamedTuple):
    """A shape at a pose."""

    kind: SolidKind  # its shape; its axis is z, a plane's normal likewise
    size: tuple[float, ...]  # radius of a sphere; radius and half length; half sides of a box; nothing of a plane [m]
    pose: Array  # (4, 4), of its middle


class Solids(NamedTuple):
    """The solids that may touch each other."""

    world: tuple[Solid, ...]  # fixed, in the base frame
    tool: tuple[Solid, ...]  # on the tool, in the tool frame
    stiffness: float  # of each of their contact points [N/m]


def solids_of(springs: SurfaceSprings, T: Array) -> Solids:
    """The surface, and on the tool at pose T a ball, an edge or a face with the points of the springs."""
    return Solids((_surface(springs.surface),), (_tip(springs, T),), springs.stiffness / len(springs.points))


def ball_at(point: Array, outwards: Array) -> Solid:
    """The tip of a pen: a ball that ends at a point (3,), its centre outwards along a unit vector (3,)."""
    return Solid("sphere", (TIP_RADIUS,), se3.transform(None, point + TIP_RADIUS * outwards))


def _surface(surface: Plane) -> Solid:
    """A plane, or a table with its edges, in the base frame."""
    if not surface.edges:
        return Solid("plane", (), se3.pose_along_z(surface.normal, surface.point))
    x = surface.edges[0] / np.linalg.norm(surface.edges[0])
    R = np.column_stack((x, np.cross(surface.normal, x), surface.normal))
    low, high = np.full(2, -TABLE_HALF), np.full(2, TABLE_HALF)
    for edge in surface.edges:
        inside = edge.dot(R)[:2]
        i = int(np.abs(inside).argmax())
        if abs(inside[1 - i]) > SIX_DIGITS * abs(inside[i]):
            raise BadInput("contact.edges", "edges at another angle", "edges at right angles, with MuJoCo")
        if inside[i] > 0.0:
            high[i] = min(high[i], inside[i])
        else:
            low[i] = max(low[i], inside[i])
    middle = surface.point + R.dot([*(0.5 * (low + high)), -TABLE_HALF])
    return Solid("box", (*(0.5 * (high - low)).tolist(), TABLE_HALF), se3.transform(R, middle))


def _tip(springs: SurfaceSprings, T: Array) -> Solid:
    """The solid of the tool that touches, in the tool frame."""
    p = springs.points.mean(axis=0)
    up = T[:3, :3].T.dot(springs.surface.normal)  # in the tool frame
    if len(springs.points) == 1:
        return ball_at(p, up)
    if len(springs.points) == 2:
        along = springs.points[1] - springs.points[0]
        half = 0.5 * float(np.linalg.norm(along))
        return Solid("capsule", (TIP_RADIUS, half), se3.pose_along_z(along, p + TIP_RADIUS * up))
    a, b = springs.points[1] - springs.points[0], springs.points[2] - springs.points[1]
    sides = 0.5 * float(np.linalg.norm(a)), 0.5 * float(np.linalg.norm(b))
    R = np.column_stack((a / (2.0 * sides[0]), b / (2.0 * sides[1]), np.cross(a, b) / (4.0 * sides[0] * sides[1])))
    return Solid("box", (*sides, 0.5 * TIP_RADIUS), se3.transform(R, p + 0.5 * TIP_RADIUS * up))


def arm_model(
    urdf: Path,
    robot: Chain,
    start: Array,
    timestep: float,
    touch: Springs | Solids | None,
    sensor: SimulatedSensor,
    physics: Physics,
) -> Any:
    """The `mujoco.MjModel` of an arm, its force sensor and its contact."""
    try:
        spec = mujoco.MjSpec.from_string(chain_xml(urdf, robot.tool, robot.names))
    except ValueError as error:
        raise RobotModelError(f"{urdf.name}: MuJoCo cannot read it ({error})") from error
    _set_options(spec, timestep)
    _add_tool(spec, robot.tool, sensor)
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
        _set_contact_stiffness(model, touch)
    return model


def _add_servo(spec: Any, joint: str, armature: float) -> None:
    """A velocity loop for a joint, whose gains the plant sets, without limits: those are the controller's task."""
    spec.joint(joint).limited = 0
    spec.joint(joint).armature = armature
    spec.add_actuator(
        name=joint,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
    )


def _set_contact_stiffness(model: Any, touch: Solids | HingeSprings) -> None:
    """Set the stiffness of the contact, which MuJoCo scales by the inverse masses it assumes for the two bodies."""
    each, A = touch.stiffness, model.body_invweight0[model.body("sensor").id, 0]
    if isinstance(touch, HingeSprings):
        each, A = each / len(touch.points), A + model.body_invweight0[model.body("door").id, 0]
    spring = (1.0 - IMPEDANCE) * A * each
    damper = spring * min(DAMPING_TIME, MAX_DAMPING / touch.stiffness)
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


def _set_options(spec: Any, timestep: float) -> None:
    """Options of the whole model."""
    spec.option.timestep = timestep
    spec.option.gravity = GRAVITY
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # a pen at rest does not creep
    spec.compiler.boundmass, spec.compiler.boundinertia = SIX_DIGITS, NEGLIGIBLE  # of massless links [kg, kg m^2]
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
    """Add the fixed solids and those of the tool."""
    common: dict[str, Any] = {"contype": 1, "conaffinity": 1, "condim": 3, "friction": (physics.friction, 0.0, 0.0)}
    for solid in solids.world:
        spec.worldbody.add_geom(type=GEOM_TYPES[solid.kind], size=_size(solid), **_place(solid.pose), **common)
    to_sensor = se3.inverse(sensor.mount)
    for i, solid in enumerate(solids.tool):
        place = _place(to_sensor.dot(solid.pose))
        shape = {"type": GEOM_TYPES[solid.kind], "size": _size(solid)}
        spec.body("sensor").add_geom(name=f"tip {i}", mass=0.0, priority=1, **shape, **place, **common)


def _size(solid: Solid) -> list[float]:
    """The size in MuJoCo's format; of a plane, the spacing of its grid."""
    return [0.0, 0.0, 1.0] if solid.kind == "plane" else [*solid.size, 0.0, 0.0][:3]


def _add_door(spec: Any, springs: HingeSprings, sensor: SimulatedSensor, physics: Physics) -> None:
    """Add a door on a hinge, or a nut on a bolt, tied to the tool at the points of the springs."""
    axis, foot = screws.axis(springs.screw)
    pitch = screws.pitch(springs.screw)
    half = float(np.clip(np.linalg.norm(np.cross(axis, springs.home[:3, 3] - foot)), *DOOR_HALF_WIDTH))
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
    if abs(pitch) > NEGLIGIBLE:
        door.add_joint(name="lead", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        screw = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1="lead", name2="hinge", **THREAD_CONSTRAINT)
        screw.data[:5] = (0.0, pitch, 0.0, 0.0, 0.0)
    to_sensor = se3.inverse(sensor.mount)
    for i, (on_door, on_tool) in enumerate(zip(springs.handle(0.0), springs.points, strict=True)):
        door.add_site(name=f"door {i}", pos=on_door - foot)
        spec.body("sensor").add_site(name=f"grip {i}", pos=to_sensor[:3, :3].dot(on_tool) + to_sensor[:3, 3])
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=f"grip {i}", name2=f"door {i}"
        )


def _place(T: Array) -> dict[str, Array]:
    """A pose in MuJoCo's format."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, T[:3, :3].ravel())
    return {"pos": T[:3, 3], "quat": quat}


class MujocoPlant:
    """An arm with lagging velocity loops, a noisy force sensor, and friction where it touches.

    Attributes:
        model: the `mujoco.MjModel`.
        data: its `mujoco.MjData`.
    """

    def __init__(
        self,
        urdf: Path,
        robot: Chain,
        start: Array,
        dt: float,
        touch: Springs | Solids | None,
        sensor: SimulatedSensor | None = None,
        physics: Physics | None = None,
    ) -> None:
        """The arm of a URDF at rest at `start` (m,), with the joints and the tool frame of `robot`.

        None as the sensor is one at the tool frame, without a mass.
        """
        self._physics = Physics() if physics is None else physics
        sensor = SimulatedSensor(np.eye(4)) if sensor is None else sensor
        self._steps = max(1, round(dt / SUBSTEP))
        self.model: Any = arm_model(urdf, robot, start, dt / self._steps, touch, sensor, self._physics)
        self.data: Any = mujoco.MjData(self.model)
        self._joints = np.array([self.model.joint(name).qposadr[0] for name in robot.names])
        self._dofs = np.array([self.model.joint(name).dofadr[0] for name in robot.names])
        self._tool = self.model.body(robot.tool).id
        self._sensor = self.model.body("sensor").id
        self._pending = deque([np.zeros(len(start))] * round(self._physics.delay / dt))
        self._rng = np.random.default_rng(self._physics.seed)
        self.data.qpos[self._joints] = start
        self._set_servo_gains(start)
        mujoco.mj_forward(self.model, self.data)

    def measure(self) -> Measurement:
        """Exact joint positions, and the force sensor's reading with noise."""
        physics = self._physics
        noise = self._rng.standard_normal(6) * np.repeat((physics.moment_noise, physics.force_noise), 3)
        return Measurement(self._q(), noise - self.data.sensordata)  # MuJoCo's sensor has what the arm exerts

    def command(self, velocity: Array) -> None:
        """Simulate one tick at joint velocities (m,), after the dead time."""
        self._pending.append(velocity)
        self.data.ctrl[:] = self._pending.popleft()
        for _ in range(self._steps):
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)  # sensors and forces at the new positions

    def state(self) -> PlantState:
        """Joint positions, the tool's pose by MuJoCo's kinematics, and the wrench of all contacts of the tool."""
        data = self.data
        mujoco.mj_rnePostConstraint(self.model, data)
        moment, force = data.cfrc_ext[self._sensor].reshape(2, 3)
        centre = data.subtree_com[self.model.body_rootid[self._sensor]]  # the point of MuJoCo's moments
        pose = se3.transform(data.xmat[self._tool].reshape(3, 3), data.xpos[self._tool])
        return PlantState(self._q(), pose, np.concatenate((moment + se3.cross(centre, force), force)))

    def _q(self) -> Array:
        return np.asarray(self.data.qpos[self._joints].copy())

    def _set_servo_gains(self, start: Array) -> None:
        """Set the servos' stiffness and damping so that joints follow with the declared lag.

        The servos track the integrated command, so that joints do not creep under load.
        """
        model, data = self.model, self.data
        mujoco.mj_forward(model, data)
        inertia = np.empty(len(start))
        for i, joint in enumerate(self._dofs.tolist()):
            unit, column = np.eye(model.nv)[joint], np.empty(model.nv)
            mujoco.mj_mulM(model, data, column, unit)
            inertia[i] = column[joint]
        rise_time = 2.0 * SUBSTEP  # time to reach the commanded speed, short compared with the lag [s]
        damping = inertia / rise_time
        stiffness = damping / max(self._physics.lag, rise_time)
        model.actuator_gainprm[:, 0] = stiffness
        model.actuator_biasprm[:, :3] = np.column_stack((np.zeros_like(damping), -stiffness, -damping))
        data.act[:] = start
