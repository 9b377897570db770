"""A part controller for robosuite: the action is a pose, a velocity and a press; torques at the simulator's step.

    torque = M(q) (v - q' + (q_c - q)/T')/T + J'W + bias,     q_c the integral of v

v is the joint velocity of `Controller.step`, or of `HybridController.step` with a press; W is then the measured wrench,
scaled down to the commanded press, so that a larger force moves the arm back. Between two actions the target moves at
the commanded velocity. Mount, mass and centre of mass of the wrist sensor are read from robosuite's model.

    env = robosuite.make("Wipe", robots="Panda", controller_configs=controller_config("Panda"), ...)
    env.step(action)        # of an arm (10,): position [m], rotation vector [rad], velocity [m/s], press [N]

Reference: Zhu et al., robosuite (composite controllers).
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.controller import Controller
from invariantqp.errors import BadInput
from invariantqp.extras import optional
from invariantqp.force import HybridController, HybridSolution, HybridTask, WrenchSensor
from invariantqp.force.contact_kinds import point_contact
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.load import load_robot
from invariantqp.velocity.solution import VelocitySolution

with optional("robosuite", "robosuite"):
    from robosuite.controllers.composite.composite_controller import CompositeController, register_composite_controller
    from robosuite.controllers.composite.composite_controller_factory import load_composite_controller_config
    from robosuite.controllers.parts.controller import Controller as PartController

__all__ = ["InvariantPose", "controller_config"]

COMPOSITE, PART = "INVARIANTQP", "INVARIANT_POSE"
# Joint velocity limit [rad/s]: robosuite's models have none; typical of arms of their size.
VELOCITY_LIMIT = 2.0
# Time constant T of the joint velocities [s]. In Wipe the impact force is 65 N with 10 ms, 22 to 29 N with 20 to 50 ms.
VELOCITY_TIME = 0.03
# Time constant T' of the joint positions [s].
POSITION_TIME = 0.2
# Default gain of the pose [1/s], below 1/T.
GAIN = 10.0
# Largest difference of an entry of the tool's pose in the simulator from the one by the loaded arm.
POSE_TOLERANCE = 1e-4


def controller_config(
    robot: str, *, press: dict[str, Any] | None = None, velocity_limit: ArrayLike = VELOCITY_LIMIT, **options: Any
) -> dict[str, Any]:
    """The `controller_configs` of `robosuite.make` for a robot, with this library's controller for its arms.

    Args:
        robot: robosuite's name of the robot, such as "Panda".
        press: arguments of `HybridTask`, such as max_force and approach_speed; the contact is a point at the tool's
            origin, whose normal is the z axis of the target pose.
        velocity_limit: (m,) or one for all joints of an arm [rad/s].
        options: of `Controller`: gain, position_margin, acceleration_limit, limits, ...

    Returns:
        robosuite's dictionary, unchanged for grippers and bodies.
    """
    config: dict[str, Any] = load_composite_controller_config(robot=robot)
    ours = {"velocity_limit": velocity_limit, "press": press or {}, "options": options}
    for name in {"right", "left"} & set(config["body_parts"]):
        gripper = config["body_parts"][name]["gripper"]
        config["body_parts"][name] = {"type": PART, "interpolation": None, "gripper": gripper, **deepcopy(ours)}
    return {**config, "type": COMPOSITE}


@register_composite_controller
class InvariantComposite(CompositeController):  # type: ignore[misc]
    """robosuite's composite controller with our part controllers, which its factory does not know."""

    name = COMPOSITE
    part_controller_config: dict[str, Any]

    def _init_controllers(self) -> None:
        every = self.part_controller_config
        ours = {part: config for part, config in every.items() if config["type"] == PART}
        self.part_controller_config = {part: config for part, config in every.items() if part not in ours}
        super()._init_controllers()
        made = {**self.part_controllers, **{part: InvariantPose(**config) for part, config in ours.items()}}
        self.part_controller_config = every
        self.part_controllers.clear()
        self.part_controllers.update((part, made[part]) for part in every)  # actions are split in this order


class InvariantPose(PartController):  # type: ignore[misc]
    """Part controller of one arm with a fixed base: pose, velocity and press.

    Attributes:
        solution: of the last step of the simulator, with its `.status` and `.reason`.
        free: the `Controller` without a press.
        hybrid: the `HybridController`, reset whenever a press begins.
    """

    name = PART
    _pose: Array  # (4, 4) of the target
    _target_velocity: Array  # (3,) of the target's position [m/s]
    _press: float  # [N]
    _commanded: Array  # (m,) joint positions

    def __init__(
        self,
        sim: Any,
        joint_indexes: dict[str, Any],
        actuator_range: tuple[Array, Array],
        ref_name: str,
        *,
        velocity_limit: ArrayLike = VELOCITY_LIMIT,
        press: dict[str, Any] | None = None,
        options: dict[str, Any] | None = None,
        **config: Any,
    ) -> None:
        """Called by robosuite; see `controller_config`."""
        names = {name: config.get(name) for name in ("part_name", "naming_prefix")}
        super().__init__(sim, joint_indexes, actuator_range, ref_name=ref_name, lite_physics=True, **names)
        self.control_dim = 10
        self.reset_goal()
        model = sim.model._model  # noqa: SLF001 (robosuite's own way to MuJoCo's)
        limit = np.broadcast_to(np.asarray(velocity_limit, dtype=np.float64), (self.joint_dim,))
        robot = load_robot(model, tool=ref_name, joints=self.joint_names, velocity_limit=limit)
        dt = float(model.opt.timestep)
        settings = {"gain": GAIN, **(options or {})}
        self.free = Controller(robot, dt=dt, **settings)
        self._prefix = ref_name.removesuffix("grip_site")
        self._friction = model.dof_frictionloss[self.qvel_index]
        task = HybridTask(lambda tool: point_contact(tool[:3, 3], -self._pose[:3, 2]), [0.0], **(press or {}))
        self.hybrid = HybridController(robot, task, dt=dt, sensor=self._sensor(model), **settings)
        self.solution: VelocitySolution | HybridSolution | None = None

    def set_goal(self, action: ArrayLike) -> None:
        """Set a policy's action.

        Args:
            action: (10,) position [m] and rotation vector [rad] of the tool in the world, velocity of that position
                [m/s], and press along the z axis of this pose [N]; 0 is free motion.

        Raises:
            BadInput: NaN, another shape, or an arm whose base has moved.
        """
        goal = arrays.vector(action, self.control_dim, "action")
        self.update()
        if np.abs(self.free.robot.pose(self.joint_pos) - self._tool()).max() > POSE_TOLERANCE:
            raise BadInput("robot", "an arm whose base has moved", "one with a fixed base")
        pose = se3.exp(np.concatenate((goal[3:6], np.zeros(3))))
        pose[:3, 3] = goal[:3]
        if goal[9] > 0.0 and self._press <= 0.0:
            self.hybrid.reset()
        self._pose, self._target_velocity, self._press = pose, goal[6:9], float(goal[9])

    def reset_goal(self) -> None:
        """Set the current pose as the target, without a press."""
        self.update(force=True)
        self._pose, self._target_velocity, self._press = self._tool(), np.zeros(3), 0.0
        self._commanded = self.joint_pos.copy()

    def run_controller(self) -> Array:
        """(m,) torques of one step of the simulator."""
        self.update()
        q, feedforward = self.joint_pos, np.concatenate((np.zeros(3), self._target_velocity))
        load = np.zeros(self.joint_dim)
        if self._press > 0.0:
            reading = np.concatenate([self._read(name) for name in ("force_ee", "torque_ee")])
            press = [self._press]
            solution = self.hybrid.step(q, self._pose, reading, feedforward, velocity=self.joint_vel, wanted=press)
            if solution.intensities[0] > 0.0:
                load = min(1.0, self._press / solution.intensities[0]) * solution.J.T.dot(solution.wrench)
            self.solution = solution
        else:
            self.solution = self.free.step(q, self._pose, feedforward)
        self._pose = self._pose.copy()
        self._pose[:3, 3] += self.free.dt * self._target_velocity
        velocity = self.solution.velocity
        # In free motion joints track their commanded positions; in contact the press determines their positions.
        commanded = q if load.any() else self._commanded + self.free.dt * velocity
        velocity_error = velocity - self.joint_vel + (commanded - q) / POSITION_TIME
        friction = self._friction * np.sign(velocity) - self.sim.data.qfrc_passive[self.qvel_index]
        torque = self.mass_matrix.dot(velocity_error) / VELOCITY_TIME + load + friction + self.torque_compensation
        self.torques = self.clip_torques(torque)
        if (self.torques == torque).all():  # anti-windup: at a torque limit the command waits
            self._commanded = commanded
        super().run_controller()
        return np.asarray(self.torques)

    @property
    def control_limits(self) -> tuple[Array, Array]:
        """No clipping: the controller enforces the limits."""
        return np.full(self.control_dim, -np.inf), np.full(self.control_dim, np.inf)

    def _tool(self) -> Array:
        """(4, 4) pose of the tool in the world, from the simulator."""
        return se3.transform(self.ref_ori_mat, self.ref_pos)

    def _read(self, sensor: str) -> Array:
        """(3,) reading of a sensor of the gripper."""
        model = self.sim.model._model  # noqa: SLF001
        first = int(model.sensor(self._prefix + sensor).adr[0])
        return np.array(self.sim.data.sensordata[first : first + 3])

    def _sensor(self, model: Any) -> WrenchSensor:
        """The wrist sensor and its load; MuJoCo's reads what the arm exerts on the tool, without noise."""
        data, body = self.sim.data, int(model.site(self._prefix + "ft_frame").bodyid[0])
        site = model.site(self._prefix + "ft_frame").id
        pose = se3.transform(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])
        to_sensor = se3.inverse(pose)
        return WrenchSensor(
            mount=se3.inverse(self._tool()).dot(pose),
            order="force first",
            reads="action",
            mass=float(model.body_subtreemass[body]),
            centre=to_sensor[:3, :3].dot(data.subtree_com[body]) + to_sensor[:3, 3],
            gravity=model.opt.gravity,
            noise=0.0,
        )
