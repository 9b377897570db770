"""The same arm and the same contact on MuJoCo, a physics engine that shares no code with this package.

velocity loop: lag v' = u - v,    contact: f_i = (k / n) depth_i + damping,  friction <= mu f_i
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from invariantqp.extras import optional
from invariantqp.geometry import se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.physics import Physics
from invariantqp.runs.plants.plant import Measurement, PlantState
from invariantqp.runs.plants.sensor import SimulatedSensor
from invariantqp.runs.plants.solids import Solids
from invariantqp.runs.plants.springs import Springs

with optional("sim", "mujoco"):
    import mujoco

from invariantqp.runs.plants.mujoco_model import arm_model, tool_body

# Longest step of the engine [s]: contact and velocity loops are ten times slower.
SUBSTEP = 5e-4
# Time [s] in which a joint's servo brings its inertia to the commanded speed, short beside the lag.
SERVO = 1e-3


class MujocoPlant:
    """An arm with lagging velocity loops, a noisy force sensor, and friction where it touches.

    Attributes:
        model: the `mujoco.MjModel`.
        data: its `mujoco.MjData`.
    """

    def __init__(
        self,
        urdf: Path,
        robot: Robot,
        start: Array,
        dt: float,
        touch: Springs | Solids | None,
        sensor: SimulatedSensor | None = None,
        physics: Physics | None = None,
    ) -> None:
        """The arm of a URDF at rest at `start` (m,); `robot` says which joints move, and which frame is the tool's.

        Without a sensor there is one at the tool frame, with nothing on it.

        Raises:
            RobotModelError: MuJoCo cannot make a model of the arm.
            BadInput: a contact that MuJoCo has no shape for.
        """
        self._physics = Physics() if physics is None else physics
        sensor = SimulatedSensor(np.eye(4)) if sensor is None else sensor
        self._steps = max(1, round(dt / SUBSTEP))
        self.model: Any = arm_model(urdf, robot, start, dt / self._steps, touch, sensor, self._physics)
        self.data: Any = mujoco.MjData(self.model)
        self._joints = np.array([self.model.joint(name).qposadr[0] for name in robot.names])
        self._dofs = np.array([self.model.joint(name).dofadr[0] for name in robot.names])
        self._tool = self.model.body(tool_body(robot)).id
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
