"""Other libraries on the same tasks, each imported where its loop is made: Pink, mink, placo and Drake.

Pink has the robot's own Pinocchio model. mink and placo get a URDF rebuilt joint by joint from the same screws: at
q = 0 the axes of every link are those of the base. Drake needs no model: it is given J and s in the tool frame and the
given bounds. Their limits on joint positions and velocities are on, and none stops when a limit is exceeded.

Pink, mink and placo take no feedforward twist. Instead they get a target that lies ahead on the path, as far as it
takes for their own gain to ask for the velocity of the path. Their frame task has unit costs, the posture task the cost
of Pink's own examples and the gain per tick that makes the given gain per second.

Reference: Caron et al., Pink (pin-pink); Zakka, mink; Duclusaud et al., placo; Tedrake et al., Drake.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.method import (
    POSTURE_COST,
    AccelerationReach,
    LoopSetting,
    Method,
    Solve,
    Takes,
    TickInputs,
    answer,
    in_loop,
    pose_of,
    posture_of,
)
from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import RobotModelError
from invariantqp.geometry import arrays, screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import UNLIMITED, Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.backends import SolverFailure
from invariantqp.velocity.limits import accelerations
from invariantqp.velocity.solution import VelocitySolution

# Of the QP of an arm with a posture task, Pink's default; without one it is damped as much as that task would.
QP_DAMPING = 1e-12
# What the frame at the given point is called.
POINT = "given point"
# placo reads masses, and MuJoCo requires them of every moving link; kinematics does not depend on them [kg], [kg m^2].
LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    "</link>"
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" '
    'rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="{speed}" effort="1"/></joint>'
)


class Joint(NamedTuple):
    """A hinge or a slide at q = 0, in the base frame."""

    axis: Array  # (3,) unit direction
    point: Array  # (3,) a point of its axis; the origin for a slide [m]
    slides: bool  # whether it is a slide


def joints_of(robot: Robot) -> list[Joint]:
    """The joints of an arm, base first; helical ones are refused: the models of other libraries have none."""
    found = []
    for name, screw in zip(robot.names, robot.jacobian(np.zeros(len(robot.names))).T, strict=True):
        if not screw[:3].any():
            found.append(Joint(screw[3:] / np.linalg.norm(screw[3:]), np.zeros(3), slides=True))
        elif abs(screws.pitch(screw)) < arrays.NEGLIGIBLE:
            found.append(Joint(*screws.axis(screw), slides=False))
        else:
            raise RobotModelError(f"joint {name} is helical; other libraries model hinges and slides only")
    return found


def qp_damping(pull: Array) -> float:
    """Damping of the QP of an arm that is pulled to its posture by (m,) gains."""
    return QP_DAMPING if pull.any() else POSTURE_COST**2


def share_of(law: LawSpec) -> float:
    """The part of the tracking error that a control loop corrects in one tick."""
    return tracking_gain(law.gain, law.dt, law.delay) * law.dt


def lead_target(pose: Array, feedforward: ArrayLike | None, lead: float) -> Array:
    """The (4, 4) pose that the target will have in `lead` seconds."""
    ahead = np.zeros(6) if feedforward is None else arrays.twist(feedforward)
    return se3.exp(lead * ahead, check=False).dot(pose) if ahead.any() else pose


def at_point(law: LawSpec) -> Array:
    """(4, 4) frame in the tool frame whose origin is the given point."""
    return se3.transform(np.eye(3), np.asarray(law.point))


class TaskLaw:
    """The loop of Pink and of mink, whose tasks and whose `solve_ik` are called alike; a subclass has its model.

    A point to be met exactly is an equality constraint: the first three rows of a frame task there.
    """

    def __init__(
        self,
        robot: Robot,
        law: LawSpec,
        library: Any,
        configuration: Any,
        *,
        pose: Callable[[Array], Any],
        tool: tuple[str, ...],
        point: tuple[str, ...],
        posture: tuple[Any, ...] = (),
        **options: Any,
    ) -> None:
        """Set up a library's tasks with its `Configuration` of the robot; of the law, dt, gain, delay,
        acceleration_limit, posture, exact and point are used.

        `pose` makes the library's poses from (4, 4); `tool` and `point` are the tool frame and one at the given point
        as its `FrameTask` takes them, `posture` what its `PostureTask` takes before the cost, `options` go to its
        `solve_ik`.
        """
        self._solve, self._options, self._pose = library.solve_ik, options, pose
        self._configuration, self._offset = configuration, at_point(law)
        self._dt, self._share, self._reach = law.dt, share_of(law), AccelerationReach(law, len(robot.names))
        self._task = library.FrameTask(*tool, 1.0, 1.0, gain=self._share)
        self._tasks: list[Any] = [self._task]
        mid, pull = posture_of(robot, law)
        self._damping = qp_damping(pull)
        if pull.any():
            self._tasks.append(library.PostureTask(*posture, cost=POSTURE_COST, gain=float(pull.max()) * law.dt))
            self._tasks[-1].set_target(mid)
        self._exact: list[Any] = []
        if law.exact is not None:
            self._exact.append(_position_task(library.FrameTask)(*point, 1.0, 1.0, gain=self._share))

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever the library raises."""
        ahead = lead_target(pose_of(target), feedforward, self._dt / self._share)
        self._configuration.update(np.asarray(q, dtype=np.float64))
        self._task.set_target(self._pose(ahead))
        for task in self._exact:
            task.set_target(self._pose(ahead.dot(self._offset)))
        x = self._solve(
            self._configuration,
            self._tasks,
            self._dt,
            solver="daqp",
            damping=self._damping,
            constraints=self._exact,
            **self._options,
        )
        return answer(self._reach.cut(x))


def _position_task(frame_task: Any) -> Any:
    """A library's frame task without the rows of orientation."""

    class PositionTask(frame_task):  # type: ignore[misc]
        def compute_error(self, configuration: Any) -> Any:
            return super().compute_error(configuration)[:3]

        def compute_jacobian(self, configuration: Any) -> Any:
            return super().compute_jacobian(configuration)[:3]

    return PositionTask


class PinkLaw(TaskLaw):
    """Pink's solve_ik on the robot's own Pinocchio model."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """Pink's tasks for the robot, which needs a Pinocchio model, without helical joints."""
        joints_of(robot)
        if getattr(robot, "model", None) is None:
            raise RobotModelError("Pink needs a robot with a Pinocchio model; this one has none")
        import pink
        import pinocchio as pin

        model: Any = robot.model.copy()  # type: ignore[attr-defined]
        frame = str(getattr(robot, "tool", ""))
        if law.exact is not None:
            tool = model.frames[model.getFrameId(frame)]
            place = tool.placement * pin.SE3(at_point(law))
            model.addFrame(pin.Frame(POINT, tool.parentJoint, place, pin.FrameType.OP_FRAME))
        configuration = pink.Configuration(model, model.createData(), np.zeros(model.nq))
        # What solve_ik has by default, and the limit of accelerations, which is given what was commanded last.
        limits = [model.configuration_limit, model.velocity_limit]
        self._accelerations = None
        if law.acceleration_limit is not None:
            self._accelerations = pink.limits.AccelerationLimit(model, accelerations(law.acceleration_limit, model.nv))
            limits.append(self._accelerations)
        super().__init__(
            robot,
            law,
            pink,
            configuration,
            pose=pin.SE3,
            tool=(frame,),
            point=(POINT,),
            safety_break=False,
            limits=limits,
        )

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever Pink raises."""
        found = super().step(q, target, feedforward)
        if self._accelerations is not None:
            self._accelerations.set_last_integration(found.velocity, self._dt)
        return found


class MinkLaw(TaskLaw):
    """mink's solve_ik on a MuJoCo model of the robot's joints."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """mink's model of the robot, without helical joints, and its tasks."""
        import mink

        model = mujoco_model(robot, at_point(law))
        speeds = {n: v for n, v in zip(robot.names, robot.velocity_limit.tolist(), strict=True) if np.isfinite(v)}
        super().__init__(
            robot,
            law,
            mink,
            mink.Configuration(model),
            pose=mink.SE3.from_matrix,
            tool=("tool", "site"),
            point=(POINT, "site"),
            posture=(model,),
            limits=[mink.ConfigurationLimit(model), *([mink.VelocityLimit(model, speeds)] if speeds else [])],
        )


def mujoco_model(robot: Robot, point: Array) -> Any:
    """`urdf` as a MuJoCo model, its two frames as sites."""
    import mujoco

    spec = mujoco.MjSpec.from_string(urdf(robot, point))
    spec.compiler.fusestatic = False
    for name in ("tool", POINT):
        spec.body(name).add_site(name=name)
    return spec.compile()


class PlacoLaw:
    """placo's KinematicsSolver on a URDF of the robot's joints.

    Weights and regularisation are the squares of the costs that Pink has. placo steps the whole way to a target. So its
    target is the given share of the way, moved on by a tick of the path.
    """

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """placo's model of the robot, without helical joints, and its tasks."""
        import placo

        self._dt, self._share, self._names = law.dt, share_of(law), robot.names
        self._reach = AccelerationReach(law, len(robot.names))
        self._between = placo.interpolate_frames
        self._offset = at_point(law)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "robot.urdf").write_text(urdf(robot, self._offset), encoding="utf-8")
            self._robot = placo.RobotWrapper(folder, placo.Flags.ignore_collisions)
        self._solver = solver = placo.KinematicsSolver(self._robot)
        solver.dt = law.dt
        solver.mask_fbase(True)
        solver.enable_velocity_limits(True)
        self._task = solver.add_frame_task("tool", np.eye(4))
        self._task.configure("tool", "soft", 1.0, 1.0)
        self._point = None
        if law.exact is not None:
            self._point = solver.add_position_task(POINT, np.zeros(3))
            self._point.configure(POINT, "hard", 1.0)
        self._middle, pull = posture_of(robot, law)
        self._pull, self._posture = law.dt * pull, None
        solver.add_regularization_task(qp_damping(pull))
        if pull.any():
            self._posture = solver.add_joints_task()
            self._posture.configure("posture", "soft", POSTURE_COST**2)

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever placo raises."""
        positions = np.asarray(q, np.float64)
        arm, pose = self._robot, pose_of(target)
        arm.state.q = np.concatenate((arm.state.q[:7], positions))  # after seven positions of the base
        arm.update_kinematics()
        self._task.T_world_frame = self._ahead(arm.get_T_world_frame("tool"), pose, feedforward)
        if self._point is not None:
            there = self._ahead(arm.get_T_world_frame(POINT), pose.dot(self._offset), feedforward)
            self._point.target_world = there[:3, 3]
        if self._posture is not None:
            towards = positions + self._pull * (self._middle - positions)
            self._posture.set_joints(dict(zip(self._names, towards.tolist(), strict=True)))
        x = self._solver.solve(False)[6:] / self._dt  # after six coordinates of the base
        return answer(self._reach.cut(x))

    def _ahead(self, here: Array, pose: Array, feedforward: ArrayLike | None) -> Array:
        """The given share of the way to a pose, and as far on as the pose moves in a tick."""
        return lead_target(self._between(here, pose, self._share), feedforward, self._dt)


def urdf(robot: Robot, point: Array) -> str:
    """The joints as a URDF, base first, and frames at the tool and at the given point on the last link."""
    from scipy.spatial.transform import Rotation

    def words(numbers: Array) -> str:
        return " ".join(map(repr, numbers.tolist()))

    parts, parent, origin = [LINK.format("base")], "base", np.zeros(3)
    bounds = zip(robot.position_lower, robot.position_upper, robot.velocity_limit, strict=True)
    for name, joint, limits in zip(robot.names, joints_of(robot), bounds, strict=True):
        low, high, fast = (float(np.clip(limit, -UNLIMITED, UNLIMITED)) for limit in limits)
        kind, link = "prismatic" if joint.slides else "revolute", f"{name} link"
        place = {"xyz": words(joint.point - origin), "rpy": "0 0 0", "axis": words(joint.axis)}
        ends = {"lower": low, "upper": high, "speed": fast}
        parts += [LINK.format(link), JOINT.format(name=name, kind=kind, parent=parent, child=link, **place, **ends)]
        parent, origin = link, joint.point
    fixed = {"kind": "fixed", "axis": "0 0 1", "lower": 0.0, "upper": 0.0, "speed": 0.0}
    home = robot.pose(np.zeros(len(robot.names)))
    for name, frame in (("tool", home), (POINT, home.dot(point))):
        angles = Rotation.from_matrix(frame[:3, :3]).as_euler("xyz")
        place = {"xyz": words(frame[:3, 3] - origin), "rpy": words(angles)}
        parts += [LINK.format(name), JOINT.format(name=f"to {name}", parent=parent, child=name, **place, **fixed)]
    return f'<robot name="arm">{"".join(parts)}</robot>'


def drake_velocity(setting: LoopSetting) -> Solve:
    """maximise alpha with J x = alpha s inside the limits, and bring x near the posture in the null space of J."""
    from pydrake.multibody import inverse_kinematics as drake

    parameters = drake.DifferentialInverseKinematicsParameters(setting.m, setting.m)
    parameters.set_time_step(setting.dt)
    parameters.set_joint_centering_gain(np.eye(setting.m))
    still = np.zeros(setting.m)

    def velocity(tick: TickInputs) -> Array:
        parameters.set_nominal_joint_position(tick.q + tick.posture)
        parameters.set_joint_velocity_limits((tick.lower, tick.upper))
        found = drake.DoDifferentialInverseKinematics(tick.q, still, tick.s, tick.J, parameters)
        if found.joint_velocities is None:
            raise SolverFailure("drake", str(found.status))
        return np.asarray(found.joint_velocities)

    return velocity


AHEAD = "a target ahead on the path"
IN_A_QP = Takes("posture task, cost 1e-3", "equality constraint", "inside the QP", "1e-6 without a posture task", AHEAD)

row = partial(Method, family="library")
METHODS = [
    row(
        name="Pink",
        why="frame task and posture task of Pink's solve_ik with DAQP, and its limits",
        takes=IN_A_QP,
        loop=PinkLaw,
        needs=("pink", "pinocchio"),
    ),
    row(
        name="mink",
        why="frame task and posture task of mink's solve_ik with DAQP on a MuJoCo model, and its limits",
        takes=IN_A_QP,
        loop=MinkLaw,
        needs=("mink", "mujoco"),
        shown=False,
    ),
    row(
        name="placo",
        why="frame task and joints task of placo's KinematicsSolver (C++), and its limits",
        takes=Takes("joints task, weight 1e-6", "hard task", "inside the QP", "1e-6 without a posture task", AHEAD),
        loop=PlacoLaw,
        needs=("placo",),
        shown=False,
    ),
    row(
        name="Drake",
        why="Drake's DoDifferentialInverseKinematics, which keeps the direction of the twist",
        takes=Takes("in what is left", "a part of the twist, with it", "inside; slows the twist down", "none"),
        loop=in_loop(drake_velocity),
        needs=("pydrake",),
        shown=False,
    ),
]
