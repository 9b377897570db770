"""A part controller for robosuite: pose, speed and press are the action; the arm is driven at the simulator's step.

    torque = M(q) (v - q' + (q_c - q)/T')/T + J'W + bias,     q_c the integral of v

v is what `Controller.step` answers in a step of the simulator, or `HybridController.step` where something is to be
pressed; W is what is pressed then, as measured, up to what is wanted: what pushes back disturbs no joint, and what
pushes back more is given way to. Between two actions the target moves on at the speed of the last one. What the wrist's
sensor is, where it sits and what hangs on it is read from robosuite's model.

    env = robosuite.make("Wipe", robots="Panda", controller_configs=controller_config("Panda"), ...)
    env.step(action)        # of an arm (10,): position [m], rotation vector [rad], speed [m/s], press [N]

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
# Joint speeds [rad/s]: robosuite's models have none, and arms of their size two.
VELOCITY_LIMIT = 2.0
# Time in which the torques bring a joint to its speed [s]: beyond ten steps of the simulator arms give way to a touch.
# In Wipe 10 ms press with 65 N at the touch, 20 and 50 ms with 22 to 29.
SERVO = 0.03
# Time in which they bring it to its commanded position [s].
HOLD = 0.2
# The gain of the pose [1/s], well below what that time leaves.
GAIN = 10.0
# How far the pose of the arm as loaded may be from the simulator's.
SAME = 1e-4


def controller_config(
    robot: str, *, press: dict[str, Any] | None = None, velocity_limit: ArrayLike = VELOCITY_LIMIT, **options: Any
) -> dict[str, Any]:
    """What `robosuite.make(controller_configs=...)` takes: the robot's own, with this library at its arms.

    Args:
        robot: robosuite's name of it, such as "Panda".
        press: arguments of `HybridTask`, such as max_force and approach_speed; the contact is a point at the tool's
            place, normal to the z axis of the target pose.
        velocity_limit: (m,) or one for all joints of an arm [rad/s].
        options: of `Controller`: gain, position_margin, acceleration_limit, limits, ...

    Returns:
        robosuite's dictionary, in which grippers and all that is no arm are as before.
    """
    config: dict[str, Any] = load_composite_controller_config(robot=robot)
    ours = {"velocity_limit": velocity_limit, "press": press or {}, "options": options}
    for name in {"right", "left"} & set(config["body_parts"]):
        gripper = config["body_parts"][name]["gripper"]
        config["body_parts"][name] = {"type": PART, "interpolation": None, "gripper": gripper, **deepcopy(ours)}
    return {**config, "type": COMPOSITE}


@register_composite_controller
class InvariantComposite(CompositeController):  # type: ignore[misc]
    """robosuite's own composite controller, whose factory of part controllers has a closed list."""

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
    """Drives one arm, whose base stands still, to a pose, at a speed, with a press.

    Attributes:
        solution: what the last step of the simulator was answered; `.status` and `.reason` are for the policy.
        free: the `Controller`.
        hybrid: the `HybridController`; it starts anew whenever a press begins.
    """

    name = PART
    _pose: Array  # (4, 4) and
    _speed: Array  # (3,) of the target
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
        """As robosuite makes it; see `controller_config`."""
        names = {name: config.get(name) for name in ("part_name", "naming_prefix")}
        super().__init__(sim, joint_indexes, actuator_range, ref_name=ref_name, lite_physics=True, **names)
        self.control_dim = 10
        self.reset_goal()
        model = sim.model._model  # noqa: SLF001 (robosuite's own way to MuJoCo's)
        limit = np.broadcast_to(np.asarray(velocity_limit, dtype=np.float64), (self.joint_dim,))
        robot = load_robot(model, tool=ref_name, joints=self.joint_names, velocity_limit=limit)
        dt = float(model.opt.timestep)
        chosen = {"gain": GAIN, **(options or {})}
        self.free = Controller(robot, dt=dt, **chosen)
        self._prefix = ref_name.removesuffix("grip_site")
        self._friction = model.dof_frictionloss[self.qvel_index]
        task = HybridTask(lambda tool: point_contact(tool[:3, 3], -self._pose[:3, 2]), [0.0], **(press or {}))
        self.hybrid = HybridController(robot, task, dt=dt, sensor=self._sensor(model), **chosen)
        self.solution: VelocitySolution | HybridSolution | None = None

    def set_goal(self, action: ArrayLike) -> None:
        """A policy's action, for an arm whose base stands still.

        Args:
            action: (10,) position [m] and rotation vector [rad] of the tool in the world, the speed of that position
                [m/s], and the force [N] to press with along the z axis of this pose; 0 presses nothing.
        """
        wanted = arrays.vector(action, self.control_dim, "action")
        self.update()
        if np.abs(self.free.robot.pose(self.joint_pos) - self._tool()).max() > SAME:
            raise BadInput("robot", "an arm whose base has moved", "one whose base stands still")
        pose = se3.exp(np.concatenate((wanted[3:6], np.zeros(3))))
        pose[:3, 3] = wanted[:3]
        if wanted[9] > 0.0 and self._press <= 0.0:
            self.hybrid.reset()
        self._pose, self._speed, self._press = pose, wanted[6:9], float(wanted[9])

    def reset_goal(self) -> None:
        """Stay here."""
        self.update(force=True)
        self._pose, self._speed, self._press = self._tool(), np.zeros(3), 0.0
        self._commanded = self.joint_pos.copy()

    def run_controller(self) -> Array:
        """(m,) the torques of one step of the simulator."""
        self.update()
        q, ahead = self.joint_pos, np.concatenate((np.zeros(3), self._speed))
        load = np.zeros(self.joint_dim)
        if self._press > 0.0:
            reading = np.concatenate([self._read(name) for name in ("force_ee", "torque_ee")])
            pressed = self.hybrid.step(q, self._pose, reading, ahead, velocity=self.joint_vel, wanted=[self._press])
            if pressed.intensities[0] > 0.0:
                load = min(1.0, self._press / pressed.intensities[0]) * pressed.J.T.dot(pressed.wrench)
            self.solution = pressed
        else:
            self.solution = self.free.step(q, self._pose, ahead)
        self._pose = self._pose.copy()
        self._pose[:3, 3] += self.free.dt * self._speed
        velocity = self.solution.velocity
        # In the air joints keep to their commanded positions; in a contact the press decides where they are.
        commanded = q if load.any() else self._commanded + self.free.dt * velocity
        missing = velocity - self.joint_vel + (commanded - q) / HOLD
        drag = self._friction * np.sign(velocity) - self.sim.data.qfrc_passive[self.qvel_index]
        torque = self.mass_matrix.dot(missing) / SERVO + load + drag + self.torque_compensation
        self.torques = self.clip_torques(torque)
        if (self.torques == torque).all():  # else the command waits for the motors
            self._commanded = commanded
        super().run_controller()
        return np.asarray(self.torques)

    @property
    def control_limits(self) -> tuple[Array, Array]:
        """Nothing is clipped: what an arm cannot do its controller says."""
        return np.full(self.control_dim, -np.inf), np.full(self.control_dim, np.inf)

    def _tool(self) -> Array:
        """(4, 4) pose of the tool in the world, by the simulator."""
        return se3.transform(self.ref_ori_mat, self.ref_pos)

    def _read(self, sensor: str) -> Array:
        model = self.sim.model._model  # noqa: SLF001
        first = int(model.sensor(self._prefix + sensor).adr[0])
        return np.array(self.sim.data.sensordata[first : first + 3])

    def _sensor(self, model: Any) -> WrenchSensor:
        """The wrist's sensor, and what hangs on it: MuJoCo reads what the arm does to the tool, and has no noise."""
        data, body = self.sim.data, int(model.site(self._prefix + "ft_frame").bodyid[0])
        site = model.site(self._prefix + "ft_frame").id
        place = se3.transform(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])
        back = se3.inverse(place)
        return WrenchSensor(
            mount=se3.inverse(self._tool()).dot(place),
            order="force first",
            reads="action",
            mass=float(model.body_subtreemass[body]),
            centre=back[:3, :3].dot(data.subtree_com[body]) + back[:3, 3],
            gravity=model.opt.gravity,
            noise=0.0,
        )
