"""The same arm and the same contact on MuJoCo, a physics engine that shares no code with this package.

velocity loop: lag v' = u - v,    contact: f_i = (k / n) depth_i + damping,  friction <= mu f_i

The model is made from the URDF through MuJoCo's own reader: the joints between base and tool, with their masses and
without meshes. Gravity is compensated, as a robot's own controller does; the force sensor still feels what hangs on it.
What touches are solids: springs of a task file become shapes by `solids_of`; a scene of another kind, such as a peg in
a hole, gives its own.
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
TIP = 2e-3
# Half of a side of a table that has an edge elsewhere, and of the thickness of a table [m].
FAR = 1.0

SolidKind = Literal["plane", "sphere", "capsule", "cylinder", "box"]
# MuJoCo's impedance d of a contact. Its spring is solref / ((1 - d) A), A the inverse mass it assumes, and a mass of
# d / ((1 - d) A) sticks to it. A small d makes a spring; d near 1, as is usual for stiff contact, adds some 30 kg.
IMPEDANCE = 0.02
# Damping over stiffness of a contact [s]: wood and rubber, a quarter of MuJoCo's own default. MuJoCo's convex friction
# lifts a sliding contact by friction x speed x this, 0.3 mm at 0.1 m/s, which the law presses after.
RELAXATION = 1e-2
# The most damping [N s/m]: metal rings. From 1e4 on, the engine's step is too long for an arm's tip.
DAMPING = 500.0
# The mass of the tool beyond its sensor is a ball of this radius [m].
TOOL_RADIUS = 0.03
# Mass of a door [kg], and half its width [m]; at least this, and less where the handle is nearer to the axis: a nut.
DOOR_MASS = 5.0
DOOR_HALF = (0.03, 0.3)
# Which of MuJoCo's shapes a solid is.
GEOMS = {kind: getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}") for kind in get_args(SolidKind)}
# How fast a nut follows its thread [s] and the damping ratio, and how little it gives: it pushes both ways, so that the
# mass of MuJoCo's stiff constraints does no harm.
THREAD = {"solref": (2e-3, 1.0), "solimp": (0.999, 0.999, 1e-3, 0.5, 2.0)}
# Longest step of the engine [s]: contact and velocity loops are ten times slower.
SUBSTEP = 5e-4


class Solid(NamedTuple):
    """A shape at a pose."""

    kind: SolidKind  # its shape; its axis is z, a plane's normal likewise
    size: tuple[float, ...]  # radius of a sphere; radius and half length; half sides of a box; nothing of a plane [m]
    pose: Array  # (4, 4), of its middle


class Solids(NamedTuple):
    """What touches."""

    world: tuple[Solid, ...]  # what does not move, in the base frame
    tool: tuple[Solid, ...]  # what is on the tool, in the tool frame
    stiffness: float  # of each of their contact points [N/m]


def solids_of(springs: SurfaceSprings, T: Array) -> Solids:
    """The surface, and on the tool at pose T a ball, an edge or a face that touches it at the points of the springs."""
    return Solids((_surface(springs.surface),), (_tip(springs, T),), springs.stiffness / len(springs.points))


def ball_at(point: Array, outwards: Array) -> Solid:
    """The tip of a pen that ends at a point (3,), below its middle against a direction (3,), in one frame."""
    return Solid("sphere", (TIP,), se3.transform(None, point + TIP * outwards))


def _surface(surface: Plane) -> Solid:
    """A plane, or a table with its edges, in the base frame."""
    if not surface.edges:
        return Solid("plane", (), se3.pose_along_z(surface.normal, surface.point))
    x = surface.edges[0] / np.linalg.norm(surface.edges[0])
    R = np.column_stack((x, np.cross(surface.normal, x), surface.normal))
    low, high = np.full(2, -FAR), np.full(2, FAR)
    for edge in surface.edges:
        inside = edge.dot(R)[:2]
        i = int(np.abs(inside).argmax())
        if abs(inside[1 - i]) > SIX_DIGITS * abs(inside[i]):
            raise BadInput("contact.edges", "edges at another angle", "edges at right angles, with MuJoCo")
        if inside[i] > 0.0:
            high[i] = min(high[i], inside[i])
        else:
            low[i] = max(low[i], inside[i])
    middle = surface.point + R.dot([*(0.5 * (low + high)), -FAR])
    return Solid("box", (*(0.5 * (high - low)).tolist(), FAR), se3.transform(R, middle))


def _tip(springs: SurfaceSprings, T: Array) -> Solid:
    """The part of the tool that touches, in the tool frame."""
    p = springs.points.mean(axis=0)
    up = T[:3, :3].T.dot(springs.surface.normal)  # in the tool frame
    if len(springs.points) == 1:
        return ball_at(p, up)
    if len(springs.points) == 2:
        along = springs.points[1] - springs.points[0]
        half = 0.5 * float(np.linalg.norm(along))
        return Solid("capsule", (TIP, half), se3.pose_along_z(along, p + TIP * up))
    a, b = springs.points[1] - springs.points[0], springs.points[2] - springs.points[1]
    sides = 0.5 * float(np.linalg.norm(a)), 0.5 * float(np.linalg.norm(b))
    R = np.column_stack((a / (2.0 * sides[0]), b / (2.0 * sides[1]), np.cross(a, b) / (4.0 * sides[0] * sides[1])))
    return Solid("box", (*sides, 0.5 * TIP), se3.transform(R, p + 0.5 * TIP * up))


def arm_model(
    urdf: Path,
    robot: Chain,
    start: Array,
    timestep: float,
    touch: Springs | Solids | None,
    sensor: SimulatedSensor,
    physics: Physics,
) -> Any:
    """The `mujoco.MjModel` of an arm, its force sensor and what it touches."""
    try:
        spec = mujoco.MjSpec.from_string(chain_xml(urdf, robot.tool, robot.names))
    except ValueError as error:
        raise RobotModelError(f"{urdf.name}: MuJoCo cannot read it ({error})") from error
    _settings(spec, timestep)
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
        _stiffen(model, touch)
    return model


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
    damper = spring * min(RELAXATION, DAMPING / touch.stiffness)
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
    if abs(pitch) > NEGLIGIBLE:
        door.add_joint(name="lead", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        screw = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1="lead", name2="hinge", **THREAD)
        screw.data[:5] = (0.0, pitch, 0.0, 0.0, 0.0)
    to_sensor = se3.inverse(sensor.mount)
    for i, (on_door, on_tool) in enumerate(zip(springs.handle(0.0), springs.points, strict=True)):
        door.add_site(name=f"door {i}", pos=on_door - foot)
        spec.body("sensor").add_site(name=f"grip {i}", pos=to_sensor[:3, :3].dot(on_tool) + to_sensor[:3, 3])
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_SITE, name1=f"grip {i}", name2=f"door {i}"
        )


def _place(T: Array) -> dict[str, Array]:
    """A pose as MuJoCo writes it."""
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
        """The arm of a URDF at rest at `start` (m,); `robot` says which joints move, and which frame is the tool's.

        Without a sensor there is one at the tool frame, with nothing on it.
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
        self._late = deque([np.zeros(len(start))] * round(self._physics.delay / dt))
        self._rng = np.random.default_rng(self._physics.seed)
        self.data.qpos[self._joints] = start
        self._tune(start)
        mujoco.mj_forward(self.model, self.data)

    def measure(self) -> Measurement:
        """Joint positions, exact, and the force sensor's reading with its noise."""
        physics = self._physics
        noise = self._rng.standard_normal(6) * np.repeat((physics.moment_noise, physics.force_noise), 3)
        return Measurement(self._q(), noise - self.data.sensordata)  # MuJoCo's sensor has what the arm exerts

    def command(self, velocity: Array) -> None:
        """One tick of the engine."""
        self._late.append(velocity)
        self.data.ctrl[:] = self._late.popleft()
        for _ in range(self._steps):
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)  # sensors and forces of where the arm is now

    def state(self) -> PlantState:
        """Joint positions, the tool's pose by MuJoCo's kinematics, and the wrench of all that touches the tool."""
        data = self.data
        mujoco.mj_rnePostConstraint(self.model, data)
        moment, force = data.cfrc_ext[self._sensor].reshape(2, 3)
        centre = data.subtree_com[self.model.body_rootid[self._sensor]]  # the point of MuJoCo's moments
        pose = se3.transform(data.xmat[self._tool].reshape(3, 3), data.xpos[self._tool])
        return PlantState(self._q(), pose, np.concatenate((moment + se3.cross(centre, force), force)))

    def _q(self) -> Array:
        return np.asarray(self.data.qpos[self._joints].copy())

    def _tune(self, start: Array) -> None:
        """Velocity loops of the given lag: servos on the integral of the command, so no load makes a joint creep."""
        model, data = self.model, self.data
        mujoco.mj_forward(model, data)
        inertia = np.empty(len(start))
        for i, joint in enumerate(self._dofs.tolist()):
            unit, column = np.eye(model.nv)[joint], np.empty(model.nv)
            mujoco.mj_mulM(model, data, column, unit)
            inertia[i] = column[joint]
        servo = 2.0 * SUBSTEP  # the time in which it brings its inertia to the commanded speed, short beside the lag
        damping = inertia / servo
        stiffness = damping / max(self._physics.lag, servo)
        model.actuator_gainprm[:, 0] = stiffness
        model.actuator_biasprm[:, :3] = np.column_stack((np.zeros_like(damping), -stiffness, -damping))
        data.act[:] = start
