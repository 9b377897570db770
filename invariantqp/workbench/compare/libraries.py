"""Other libraries, each imported where its loop is made, on the same arm: `LoopSpec.urdf`.

A library without feedforward gets a target ahead on the path, at the distance at which the gain commands the velocity
of the path. Gains per tick are gain dt. The costs of a frame task are 1 and 1, that of a posture task is 1e-3 as in
Pink's examples; without a posture task the damping is its square.

Class attributes are the settings: of those that were tried (`--methods "other settings"`) the ones that dominate our
law in the most tasks, and of these the one that is dominated in the fewest. NEO is as in the Robotics Toolbox's
examples, with the posture in place of manipulability, and with dampers at position limits that let a tick cover the
whole distance, as the other methods do.

Reference: Caron et al., Pink; Zakka, mink; Duclusaud et al., placo; Castro et al., RoboPlan; Robot Locomotion Group,
Drake; Corke & Haviland, Robotics Toolbox for Python.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.workbench.compare.method import IN_QP, OTHER_SETTINGS, SCALES, LoopSpec, Method, MethodSetting

POSTURE_COST = 1e-3
# Damping of a QP with a posture task: Pink's default.
QP_DAMPING = 1e-12
# The penalty of ElastiQP's limits; the objective is of order one.
PENALTY = 1e3


@contextmanager
def urdf_file(spec: LoopSpec) -> Iterator[str]:
    """A temporary file with the arm's URDF."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arm.urdf"
        file.write_text(spec.urdf, encoding="utf-8")
        yield str(file)


def ahead_on_screw(pose: Array, twist: Array, time: float) -> Array:
    """The pose (4, 4) a time later along its screw, for errors that are logarithms."""
    return np.asarray(se3.exp(time * twist).dot(pose))


def ahead_on_line(pose: Array, twist: Array, time: float) -> Array:
    """The pose (4, 4) a time later, its origin on a line, for errors of position and rotation vector."""
    later = ahead_on_screw(pose, twist, time)
    later[:3, 3] = pose[:3, 3] + time * se3.velocity_at(twist, pose[:3, 3])
    return later


class Library:
    """Base of the loops of libraries: the target ahead on the path, in the library's type."""

    ahead: Callable[[Array, Array, float], Array] = staticmethod(ahead_on_line)

    def __init__(self, spec: LoopSpec) -> None:
        if not spec.urdf:
            raise ValueError("the arm has helical joints, which a URDF cannot describe")
        self.spec, self.gain_per_tick = spec, spec.gain * spec.dt
        self.posture_gain = float(spec.posture_gain.max(initial=0.0))
        self.damping = QP_DAMPING if self.posture_gain else POSTURE_COST**2
        self.set_up(spec)

    def set_up(self, spec: LoopSpec) -> None:
        """Make tasks and limits."""

    def native(self, pose: Array) -> Any:
        """A pose (4, 4) in the library's type."""
        return pose

    def target(self, pose: Array, feedforward: Array | None) -> Any:
        """The target whose distance also commands the feedforward."""
        return self.native(pose if feedforward is None else self.ahead(pose, feedforward, 1.0 / self.spec.gain))


class Pink(Library):
    """solve_ik of pin-pink with DAQP."""

    lm_damping = 300.0
    ahead = staticmethod(ahead_on_screw)

    def set_up(self, spec: LoopSpec) -> None:
        import pink
        import pinocchio as pin

        model = pin.buildModelFromXML(spec.urdf)
        middle = np.clip(spec.posture, spec.lower, spec.upper)
        self.make_tasks(pink, pin.SE3, pink.Configuration(model, model.createData(), middle), ("tool",), ())
        limits = [pink.limits.ConfigurationLimit(model, config_limit_gain=1.0), model.velocity_limit]
        if spec.acceleration_limit is not None:
            limits.append(pink.limits.AccelerationLimit(model, spec.acceleration_limit))
        self.options: dict[str, Any] = {"damping": self.damping, "limits": limits, "safety_break": False}

    def make_tasks(self, library: Any, native: Any, start: Any, frame: tuple[str, ...], model: tuple[Any, ...]) -> None:
        """The tasks of Pink or mink, from its configuration, the tool frame, and the first arguments of its tasks."""
        self.native, self.solve, self.configuration = native, library.solve_ik, start  # type: ignore[method-assign]
        self.task = library.FrameTask(*frame, 1.0, 1.0, lm_damping=self.lm_damping, gain=self.gain_per_tick)
        self.tasks = [self.task]
        if self.posture_gain:
            self.tasks.append(library.PostureTask(*model, cost=POSTURE_COST, gain=self.posture_gain * self.spec.dt))
            self.tasks[1].set_target(self.spec.posture)

    def step(self, q: Array, target: Any, _feedforward: Any, previous: Array) -> Array:
        self.configuration.update(q)
        self.task.set_target(target)
        if self.spec.acceleration_limit is not None:
            self.options["limits"][-1].set_last_integration(previous, self.spec.dt)
        return np.asarray(self.solve(self.configuration, self.tasks, self.spec.dt, solver="daqp", **self.options))


class Mink(Pink):
    """solve_ik of mink with DAQP."""

    def set_up(self, spec: LoopSpec) -> None:
        import mink
        import mujoco

        model = mujoco.MjModel.from_xml_string(spec.urdf)
        self.make_tasks(mink, mink.SE3.from_matrix, mink.Configuration(model), ("tool", "body"), (model,))
        limits = [mink.ConfigurationLimit(model, gain=1.0)]
        speeds = {n: v for n, v in zip(spec.names, spec.velocity_limit.tolist(), strict=True) if np.isfinite(v)}
        if speeds:
            limits.append(mink.VelocityLimit(model, speeds))
        self.options = {"damping": self.damping, "limits": limits}


class Placo(Library):
    """KinematicsSolver of placo, soft tasks."""

    kind = "soft"

    def set_up(self, spec: LoopSpec) -> None:
        import placo

        with urdf_file(spec) as file:
            self.robot = placo.RobotWrapper(file, placo.Flags.ignore_collisions)
        self.interpolate = placo.interpolate_frames
        self.solver = solver = placo.KinematicsSolver(self.robot)
        solver.mask_fbase(True)
        solver.dt = spec.dt
        solver.enable_joint_limits(True)
        solver.enable_velocity_limits(True)
        self.task = solver.add_frame_task("tool", np.eye(4))
        self.task.configure("tool", self.kind, 1.0, 1.0)
        solver.add_regularization_task(self.damping)
        self.posture = solver.add_joints_task() if self.posture_gain else None
        if self.posture is not None:
            self.posture.configure("posture", "soft", POSTURE_COST**2)

    def step(self, q: Array, target: Any, _feedforward: Any, _previous: Any) -> Array:
        # It moves the whole way to its target, which is therefore interpolated.
        spec, robot = self.spec, self.robot
        robot.state.q[7:] = q  # after seven positions of the base
        robot.update_kinematics()
        self.task.T_world_frame = self.interpolate(robot.get_T_world_frame("tool"), target, self.gain_per_tick)
        if self.posture is not None:
            goal = q + spec.dt * self.posture_gain * (spec.posture - q)
            self.posture.set_joints(dict(zip(spec.names, goal.tolist(), strict=True)))
        return np.asarray(self.solver.solve(False)[6:]) / spec.dt  # after six coordinates of the base


class PlacoScaled(Placo):
    """KinematicsSolver of placo, a scaled frame task."""

    kind = "scaled"


class Oink(Library):
    """Optimal IK of RoboPlan by ProxQP."""

    lm_damping, priority, tolerance = 300.0, 2, 1e-9

    def set_up(self, spec: LoopSpec) -> None:
        import roboplan.optimal_ik as ik
        from roboplan import core

        m = len(spec.names)
        with urdf_file(spec) as file:
            scene = core.Scene("scene", core.loadUrdfSceneDescription(file))
        settings = ik.OinkSettings()
        settings.eps_abs = self.tolerance
        self.solver = solver = ik.Oink(scene, settings)
        start = core.CartesianConfiguration("base", "tool", np.asfortranarray(np.eye(4)))
        options = ik.FrameTaskOptions(task_gain=self.gain_per_tick, lm_damping=self.lm_damping)
        self.task = ik.FrameTask(solver, scene, start, options)
        self.tasks = [self.task]
        if self.posture_gain:
            options = ik.ConfigurationTaskOptions(task_gain=self.posture_gain * spec.dt, priority=self.priority)
            weight = np.full(m, POSTURE_COST**2 if self.priority == 1 else 1.0)
            self.tasks.append(ik.ConfigurationTask(solver, spec.posture, weight, options))
        self.limits = [ik.PositionLimit(solver, 1.0), ik.VelocityLimit(solver, spec.dt, spec.velocity_limit)]
        if spec.acceleration_limit is not None:
            self.limits.append(ik.AccelerationLimit(solver, spec.dt, spec.acceleration_limit))
        self.displacement = np.zeros(m)

    def native(self, pose: Array) -> Any:
        return np.asfortranarray(pose)

    def step(self, q: Array, target: Any, _feedforward: Any, previous: Array) -> Array:
        self.task.setTargetFrameTransform(target)
        if self.spec.acceleration_limit is not None:
            self.limits[-1].setLastVelocity(previous)
        self.solver.solveIk(q, self.tasks, self.limits, self.displacement, self.damping)
        return self.displacement / self.spec.dt


class EmbodiK(Library):
    """KinematicsSolver of EmbodiK, which scales the twist."""

    tolerance: float | None = 0.03

    def set_up(self, spec: LoopSpec) -> None:
        from embodik import _embodik_impl as embodik

        with urdf_file(spec) as file:
            self.model = embodik.RobotModel(file, False)
        self.solver = solver = embodik.KinematicsSolver(self.model)
        self.success = embodik.SolverStatus.SUCCESS
        solver.dt = spec.dt
        if self.tolerance is not None:
            solver.set_tolerance(self.tolerance)
        self.task = solver.add_frame_task("tool", "tool")
        self.task.priority, self.task.weight = 0, spec.gain
        if self.posture_gain:
            posture = solver.add_posture_task("posture")
            posture.priority, posture.weight = 1, self.posture_gain
            posture.set_target_configuration(spec.posture)
        solver.enable_position_limits(True)
        solver.enable_velocity_limits(True)
        if spec.acceleration_limit is not None:
            solver.enable_acceleration_limits(True)
            solver.set_acceleration_limits(spec.acceleration_limit)

    def native(self, pose: Array) -> Any:
        return pose[:3, 3].copy(), np.asfortranarray(pose[:3, :3])

    def step(self, q: Array, target: Any, _feedforward: Any, previous: Array) -> Array:
        self.task.set_target_pose(*target)
        if self.spec.acceleration_limit is not None:
            self.solver.set_previous_joint_velocities(previous)
        found = self.solver.solve_velocity(q)
        if found.status != self.success:
            raise RuntimeError(str(found.status))
        return np.array(found.joint_velocities)


class Drake(Library):
    """DoDifferentialInverseKinematics of Drake."""

    def set_up(self, spec: LoopSpec) -> None:
        from pydrake.multibody import inverse_kinematics as ik
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.multibody.tree import JacobianWrtVariable

        self.plant = plant = MultibodyPlant(0.0)
        with urdf_file(spec) as file:
            Parser(plant).AddModels(file)
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        plant.Finalize()
        self.context, self.tool, self.by = (
            plant.CreateDefaultContext(),
            plant.GetFrameByName("tool"),
            JacobianWrtVariable,
        )
        m = len(spec.names)
        self.solve, self.origin = ik.DoDifferentialInverseKinematics, np.zeros(3)
        self.parameters = parameters = ik.DifferentialInverseKinematicsParameters(m, m)
        parameters.set_time_step(spec.dt)
        parameters.set_joint_velocity_limits((-spec.velocity_limit, spec.velocity_limit))
        parameters.set_joint_position_limits((spec.lower, spec.upper))
        parameters.set_maximum_scaling_to_report_stuck(-1.0)  # never
        if spec.acceleration_limit is not None:
            parameters.set_joint_acceleration_limits((-spec.acceleration_limit, spec.acceleration_limit))
        if self.posture_gain:
            parameters.set_nominal_joint_position(spec.posture)
            parameters.set_joint_centering_gain(self.posture_gain * np.eye(m))

    def target(self, pose: Array, _feedforward: Any) -> Any:
        return pose

    def step(self, q: Array, target: Array, feedforward: Array | None, previous: Array) -> Array:
        plant, context, gain, world = self.plant, self.context, self.spec.gain, self.plant.world_frame()
        plant.SetPositions(context, q)
        pose = self.tool.CalcPoseInWorld(context)
        R, at = pose.rotation().matrix(), pose.translation()
        J = plant.CalcJacobianSpatialVelocity(context, self.by.kV, self.tool, self.origin, world, world)
        s = gain * np.concatenate((se3.rotation_vector(target[:3, :3].dot(R.T)), target[:3, 3] - at))
        if feedforward is not None:
            s += np.concatenate((feedforward[:3], se3.velocity_at(feedforward, at)))
        found = self.solve(q, previous, s, J, self.parameters)
        if found.joint_velocities is None:
            raise RuntimeError(found.status.name)
        return np.asarray(found.joint_velocities)


class Neo(Library):
    """NEO of the Robotics Toolbox's examples, with DAQP (Haviland & Corke 2021)."""

    damper_distance = 0.1  # from position limits [rad]
    weight = 0.01  # of joint velocities, as in the examples

    def set_up(self, spec: LoopSpec) -> None:
        import qpsolvers
        from roboticstoolbox import Robot
        from roboticstoolbox.models.URDF.URDFRobot import URDF_read

        self.solve = partial(qpsolvers.solve_qp, solver="daqp")
        with urdf_file(spec) as file:
            links, name, _ = URDF_read(file)
        self.robot = Robot(links, name=name)
        self.chain = self.robot.ets(end="tool")
        m = len(spec.names)
        self.Q, self.c, self.rows, self.upper = np.eye(m + 6), np.zeros(m + 6), np.zeros((m, m + 6)), np.zeros(m)
        self.bounds = np.concatenate((spec.velocity_limit, np.full(6, np.inf)))  # the slack has none

    def target(self, pose: Array, _feedforward: Any) -> Any:
        return pose

    def step(self, q: Array, target: Array, feedforward: Array | None, _previous: Any) -> Array:
        spec, m, weight = self.spec, len(self.spec.names), self.weight
        T = self.chain.eval(q)
        R = T[:3, :3]
        error = np.concatenate((R.T.dot(target[:3, 3] - T[:3, 3]), se3.rotation_vector(R.T.dot(target[:3, :3]))))
        s = spec.gain * error
        if feedforward is not None:
            s += np.concatenate((R.T.dot(se3.velocity_at(feedforward, T[:3, 3])), R.T.dot(feedforward[:3])))
        self.Q.flat[:: m + 7] = weight
        self.Q.flat[m * (m + 7) :: m + 7] = 1.0 / max(float(np.abs(error[:3]).sum()), 1e-4)  # finite at zero error
        self.c[:m] = -weight * self.posture_gain * (spec.posture - q)
        damper = {"ps": 0.0, "pi": self.damper_distance, "n": m, "gain": self.damper_distance / spec.dt}
        self.rows[:, :m], self.upper[:] = self.robot.joint_velocity_damper(q=q, **damper)
        A = np.hstack((self.chain.jacobe(q), np.eye(6)))
        x = self.solve(self.Q, self.c, self.rows, self.upper, A, s, -self.bounds, self.bounds)
        if x is None:
            raise RuntimeError("the QP has no solution")
        return np.asarray(x[:m])


def elastic(spec: LoopSpec) -> Any:
    """The hand-written QP by ElastiQP, warm."""
    import elastiqp

    from invariantqp.workbench.compare.by_hand import EPS, ByHand, TickProblem

    m = len(spec.names)
    solver, G, penalty = elastiqp.Solver(), np.vstack((np.eye(m), -np.eye(m))), np.full(2 * m, PENALTY)
    is_set_up = False

    def velocity(tick: TickProblem) -> Array:
        nonlocal is_set_up
        H, g = tick.J.T.dot(tick.J), -tick.J.T.dot(tick.s) - EPS * tick.posture_velocity
        H.flat[:: m + 1] += EPS
        h = np.concatenate((tick.upper, -tick.lower))
        if is_set_up:
            solver.update(Q=H, q=g, h=h)
        else:
            solver.setup(H, g, G, h, penalty)
            is_set_up = True
        return np.array(solver.solve().x)

    return ByHand(spec, lambda _: velocity)


def method(
    name: str, loop: Callable[[LoopSpec], Any], setting: tuple[str, ...], needs: str, package: str, **more: Any
) -> Method:
    """The method of a library: the modules that it needs, separated by spaces, and the package to install."""
    return Method(name, "library", loop, MethodSetting(*setting), tuple(needs.split()), package, **more)


def varied(base: Method, **settings: Any) -> Method:
    """A library with other settings."""
    name = ", ".join([base.name, *(f"{key} {value}" for key, value in settings.items())])
    loop: Any = type(base.name, (base.loop,), {"__doc__": base.loop.__doc__, **settings})  # type: ignore[arg-type]
    return replace(base, name=name, family=OTHER_SETTINGS, loop=loop)


AHEAD = "a target ahead"
TASK, NEO = ("cost 1e-3", IN_QP, "lm_damping 300", AHEAD), ("weight 0.01", IN_QP, "0.01 times the distance")
SECOND, SOFT = ("second priority", IN_QP, "lm_damping 300", AHEAD), ("weight 1e-6", IN_QP, "1e-6", AHEAD)
SCALED = ("second priority", SCALES, "tolerance 0.03", AHEAD)
PINK = method("Pink", Pink, TASK, "pink pinocchio", "pin-pink")
MINK = method("mink", Mink, TASK, "mink mujoco", "mink", accelerations=False)
PLACO = method("placo", Placo, SOFT, "placo", "placo", environment="placo", accelerations=False)
OINK = method("OInK", Oink, SECOND, "roboplan", "roboplan", environment="roboplan")
EMBODIK = method("EmbodiK", EmbodiK, SCALED, "embodik", "embodik", environment="embodik")
METHODS = [
    PINK,
    MINK,
    PLACO,
    replace(PLACO, name="placo scaled", loop=PlacoScaled, setting=MethodSetting("weight 1e-6", SCALES, "1e-6", AHEAD)),
    OINK,
    EMBODIK,
    method("ElastiQP", elastic, ("weight 1e-6", "elastic, penalty 1000", "1e-6"), "elastiqp", "elastiqp"),
    method("Drake", Drake, ("in what is left", SCALES, "none"), "pydrake", "drake", environment="drake"),
    method("RTB", Neo, NEO, "roboticstoolbox qpsolvers", "roboticstoolbox-python", accelerations=False, slow=True),
    *(varied(base, lm_damping=x) for base in (PINK, MINK, OINK) for x in (0.0, 1.0, 30.0, 100.0, 1000.0)),
    *(varied(OINK, priority=1, lm_damping=x) for x in (0.0, 300.0)),
    varied(OINK, tolerance=1e-6),
    *(varied(EMBODIK, tolerance=x) for x in (None, 0.01, 0.1)),
]
