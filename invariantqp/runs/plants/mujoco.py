"""The same arm and the same contact on a physics engine that shares no code with us: MuJoCo, as an independent referee.

    velocity loop: lag v' = u - v,    contact: f_i = (k / n) depth_i + damping,  friction <= mu f_i

The one file that imports MuJoCo. The model comes from the URDF, through MuJoCo's own reader: the joints between base
and tool, with their masses and without meshes. Gravity is compensated as a robot's own controller does; the force
sensor still feels what hangs on it.
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
from invariantqp.runs.plants.touch import Grip, Physics, Sensed, Touch, Truth, Wrist
from invariantqp.runs.plants.urdf import chain_xml

try:
    import mujoco
except ImportError as error:
    raise MissingExtra("mujoco", "sim") from error

# Longest step of the engine [s]: contact and servos are ten times slower.
SUBSTEP = 5e-4
# MuJoCo's impedance d of a contact. Its spring is solref / ((1 - d) A), A the inverse mass it assumes, and a mass of
# d / ((1 - d) A) clings to it: small, it is a spring; near 1, as is usual for stiff contact, some 30 kg.
IMPEDANCE = 0.02
# Time [s] in which a joint's servo brings its inertia to the speed commanded; beside the lag it does not show.
SERVO = 1e-3
# Damping over stiffness of a contact [s]. MuJoCo's convex friction lifts a sliding contact by friction x speed x this:
# at 0.1 m/s 15 micrometres; with critical damping it would be half a millimetre, and the contact would break.
RELAXATION = 5e-4
# Radius of a pen's ball and of an edge, thickness of a face [m].
TIP = 2e-3
# Of whatever the tool weighs beyond its sensor, as a ball of this radius [m].
TOOL_RADIUS = 0.03
# Mass of a door [kg], and half its width [m].
DOOR_MASS = 5.0
DOOR_HALF = 0.3
# A pitch below this [m/rad] is rounding.
LEAST_PITCH = 1e-9
# What a massless link is given to be movable at all [kg, kg m^2].
LEAST_MASS = 1e-6
LEAST_INERTIA = 1e-9


class MujocoPlant:
    """An arm with lagging velocity loops, a noisy force sensor, and friction where it touches.

    Attributes:
        model: the `mujoco.MjModel`, to look at.
        data: its `mujoco.MjData`.
    """

    def __init__(
        self,
        urdf: Path,
        robot: Robot,
        start: Array,
        dt: float,
        touch: Touch | Grip | None,
        wrist: Wrist | None = None,
        physics: Physics | None = None,
    ) -> None:
        """The arm at rest at joint positions `start`.

        Args:
            urdf: the file that `robot` was made from.
            robot: says which joints move, and which tool frame.
            start: (m,) [rad, m].
            dt: tick [s].
            touch: what the tool touches.
            wrist: the force sensor; None is at the tool frame, with nothing on it.
            physics: friction, lag, noise.

        Raises:
            RobotModelError: MuJoCo cannot make a model of it.
            BadInput: a contact that this scene has no shape for.
        """
        self._physics = Physics() if physics is None else physics
        wrist = Wrist(np.eye(4)) if wrist is None else wrist
        tool = getattr(robot, "tool", "").removesuffix(" link")
        try:
            spec = mujoco.MjSpec.from_string(chain_xml(urdf, tool, robot.names))
        except ValueError as error:
            raise RobotModelError(f"{urdf.name}: MuJoCo cannot read it ({error})") from error
        self._steps = max(1, round(dt / SUBSTEP))
        _settings(spec, dt / self._steps)
        _add_tool(spec, tool, wrist)
        if isinstance(touch, Touch):
            _add_surface(spec, touch, wrist, robot.pose(start), self._physics)
        elif touch is not None:
            _add_door(spec, touch, wrist, self._physics)
        for name in robot.names:
            spec.joint(name).limited = 0  # limits are the controller's to keep
            spec.add_actuator(
                name=name,
                target=name,
                trntype=mujoco.mjtTrn.mjTRN_JOINT,
                dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR,
                biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            )
        try:
            self.model: Any = spec.compile()
        except ValueError as error:
            raise RobotModelError(f"{urdf.name}: MuJoCo cannot make a model of it ({error})") from error
        self.data: Any = mujoco.MjData(self.model)
        self._joints = np.array([self.model.joint(name).qposadr[0] for name in robot.names])
        self._dofs = np.array([self.model.joint(name).dofadr[0] for name in robot.names])
        self._tool = self.model.body(tool).id
        self._sensor = self.model.body("sensor").id
        self._rng = np.random.default_rng(self._physics.seed)
        self.data.qpos[self._joints] = start
        self._tune(start)
        if touch is not None:
            self._stiffen(touch)
        mujoco.mj_forward(self.model, self.data)

    def sense(self) -> Sensed:
        """Encoders, exact, and the force sensor with its noise."""
        physics = self._physics
        noise = self._rng.standard_normal(6) * np.repeat((physics.moment_noise, physics.force_noise), 3)
        return Sensed(self._q(), noise - self.data.sensordata)  # MuJoCo has what the arm does to the tool

    def command(self, velocity: Array) -> None:
        """One tick of the engine."""
        self.data.ctrl[:] = velocity
        for _ in range(self._steps):
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)  # sensors and forces of where the arm is now

    def truth(self) -> Truth:
        """Joint positions, the tool's pose by MuJoCo's kinematics, and all that touches the tool."""
        data = self.data
        mujoco.mj_rnePostConstraint(self.model, data)
        moment, force = data.cfrc_ext[self._sensor].reshape(2, 3)
        centre = data.subtree_com[self.model.body_rootid[self._sensor]]  # about which MuJoCo has moments
        pose = se3.transform(data.xmat[self._tool].reshape(3, 3), data.xpos[self._tool])
        return Truth(self._q(), pose, np.concatenate((moment + np.cross(centre, force), force)))

    def jacobian(self) -> Array:
        """(6, m) joint twists in the base frame, by MuJoCo's kinematics."""
        linear, angular = np.zeros((2, 3, self.model.nv))
        mujoco.mj_jac(self.model, self.data, linear, angular, np.zeros(3), self._tool)
        return np.vstack((angular, linear))[:, self._dofs]

    def _q(self) -> Array:
        q: Array = self.data.qpos[self._joints].copy()
        return q

    def _tune(self, start: Array) -> None:
        """Velocity loops of the given lag: servos on the integral of the command, so no load makes a joint creep."""
        model, data = self.model, self.data
        mujoco.mj_forward(model, data)
        inertia = np.empty(len(start))
        for i, joint in enumerate(self._dofs.tolist()):
            unit, column = np.eye(model.nv)[joint], np.empty(model.nv)
            mujoco.mj_mulM(model, data, column, unit)
            inertia[i] = column[joint]
        damping = inertia / SERVO
        stiffness = damping / max(self._physics.lag, SERVO)
        model.actuator_gainprm[:, 0] = stiffness
        model.actuator_biasprm[:, :3] = np.column_stack((np.zeros_like(damping), -stiffness, -damping))
        data.act[:] = start

    def _stiffen(self, touch: Touch | Grip) -> None:
        """Give the contact its stiffness: MuJoCo scales it by the inverse masses it assumes for the two bodies."""
        model = self.model
        each = touch.stiffness / len(touch.points)
        A = model.body_invweight0[self._sensor, 0]
        if isinstance(touch, Grip):
            A += model.body_invweight0[model.body("door").id, 0]
        spring = (1.0 - IMPEDANCE) * A * each
        damper = spring * RELAXATION
        impedance = (IMPEDANCE, IMPEDANCE, 1e-3, 0.5, 2.0)
        if isinstance(touch, Grip):
            model.eq_solref[:] = (-spring, -damper)
            model.eq_solimp[:] = impedance
        else:
            tip = model.geom("tip").id
            model.geom_solref[tip] = (-spring, -damper)
            model.geom_solimp[tip] = impedance


def _settings(spec: Any, timestep: float) -> None:
    spec.option.timestep = timestep
    spec.option.gravity = GRAVITY
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0  # a pen at rest does not creep
    spec.compiler.boundmass = LEAST_MASS
    spec.compiler.boundinertia = LEAST_INERTIA
    for body in spec.bodies:
        body.gravcomp = 1.0


def _add_tool(spec: Any, tool: str, wrist: Wrist) -> None:
    """A body at the sensor that carries all the tool has beyond it."""
    body = spec.body(tool).add_body(name="sensor", gravcomp=1.0, **_place(wrist.pose))
    if wrist.mass > 0.0:
        body.mass = wrist.mass
        body.ipos = wrist.centre
        body.inertia = np.full(3, 0.4 * wrist.mass * TOOL_RADIUS**2)
        body.explicitinertial = True
    body.add_site(name="sensor")
    for name, kind in (("moment", mujoco.mjtSensor.mjSENS_TORQUE), ("force", mujoco.mjtSensor.mjSENS_FORCE)):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="sensor")


def _add_surface(spec: Any, touch: Touch, wrist: Wrist, T: Array, physics: Physics) -> None:
    """The surface, and on the tool a ball, an edge or a face whose touching points are the task's."""
    shapes = mujoco.mjtGeom
    friction = (physics.friction, 0.0, 0.0)
    common: dict[str, Any] = {"contype": 1, "conaffinity": 1, "condim": 3, "friction": friction}
    p = touch.points.mean(axis=0)
    _, normal = touch.surface.depth(T[:3, :3].dot(p) + T[:3, 3])
    up = T[:3, :3].T.dot(normal)  # in the tool frame
    surface = touch.surface
    if isinstance(surface, Plane):
        place = _place(_facing(surface.normal, surface.point))
        spec.worldbody.add_geom(name="surface", type=shapes.mjGEOM_PLANE, size=(0.0, 0.0, 1.0), **place, **common)
    elif touch.shape == "point":
        place = _place(_facing(surface.axis, surface.point))
        size = (surface.radius, 1.0, 0.0)
        spec.worldbody.add_geom(name="surface", type=shapes.mjGEOM_CYLINDER, size=size, **place, **common)
    else:
        raise BadInput("physics", f"a {touch.shape} on a surface that is not flat", "a point there, or a plane")
    if touch.shape == "point":
        kind, size, frame = shapes.mjGEOM_SPHERE, (TIP, 0.0, 0.0), se3.transform(None, p + TIP * up)
    elif touch.shape == "edge":
        along = touch.points[1] - touch.points[0]
        half = 0.5 * float(np.linalg.norm(along))
        kind, size, frame = shapes.mjGEOM_CAPSULE, (TIP, half, 0.0), _facing(along, p + TIP * up)
    else:
        a, b = touch.points[1] - touch.points[0], touch.points[2] - touch.points[1]
        sides = 0.5 * float(np.linalg.norm(a)), 0.5 * float(np.linalg.norm(b))
        R = np.column_stack((a / (2.0 * sides[0]), b / (2.0 * sides[1]), np.cross(a, b) / (4.0 * sides[0] * sides[1])))
        kind, size, frame = shapes.mjGEOM_BOX, (*sides, 0.5 * TIP), se3.transform(R, p + 0.5 * TIP * up)
    place = _place(se3.inverse(wrist.pose, check=False).dot(frame))
    spec.body("sensor").add_geom(name="tip", type=kind, size=size, mass=0.0, priority=1, **place, **common)


def _add_door(spec: Any, grip: Grip, wrist: Wrist, physics: Physics) -> None:
    """A door on its hinge, tied to the tool at the points of the grip."""
    axis, moment = grip.screw[:3], grip.screw[3:]
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
    to_sensor = se3.inverse(wrist.pose, check=False)
    for i, (on_door, on_tool) in enumerate(zip(grip.held(0.0), grip.points, strict=True)):
        door.add_site(name=f"door {i}", pos=on_door - foot)
        spec.body("sensor").add_site(name=f"grip {i}", pos=to_sensor[:3, :3].dot(on_tool) + to_sensor[:3, 3])
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f"grip {i}",
            name2=f"door {i}",
        )


def _facing(z: Array, point: Array) -> Array:
    """A (4, 4) pose at a point whose z axis is along a vector."""
    z = z / np.linalg.norm(z)
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    return se3.transform(np.column_stack((x, np.cross(z, x), z)), point)


def _place(T: Array) -> dict[str, Array]:
    """A pose as MuJoCo writes it."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, T[:3, :3].ravel())
    return {"pos": T[:3, 3], "quat": quat}
