"""mink with DAQP on the same tasks; no other file imports mink.

The robot is rebuilt in MuJoCo from the same joint screws. mink's velocity and configuration limits are on, and it does
not stop when a limit is exceeded. The frame task has unit costs; the damping of 1e-6 is the one that Pink has here.

Reference: Zakka, mink.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import joints_of, lead_target, pose_of, share_of
from invariantqp.compare.laws.qp_backends import QP_DAMPING
from invariantqp.errors import MissingExtra
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import VelocitySolution

# MuJoCo requires a mass of every moving link; kinematics does not depend on it [kg], [kg m^2].
MASS, INERTIA = 1.0, (1.0, 1.0, 1.0)
# The range of a joint that has a position limit on one side only [rad, m].
UNLIMITED = 1e9


class MinkLaw:
    """One mink frame task on a MuJoCo model of the robot's joints."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """Build mink's model of the robot; of `law` only dt and gain are used.

        Raises:
            MissingExtra: mink is not installed.
            RobotModelError: the robot has a helical joint.
        """
        try:
            import mink
        except ImportError as error:
            raise MissingExtra("mink", "peers") from error
        self._mink = mink
        self._dt = law.dt
        self._share = share_of(law)
        model = _model(robot)
        self._configuration = mink.Configuration(model)
        self._task = mink.FrameTask("tool", "site", 1.0, 1.0, gain=self._share)
        speeds = {n: v for n, v in zip(robot.names, robot.velocity_limit.tolist(), strict=True) if np.isfinite(v)}
        self._limits = [mink.ConfigurationLimit(model), *([mink.VelocityLimit(model, speeds)] if speeds else [])]

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever mink raises."""
        ahead = lead_target(pose_of(target), feedforward, self._dt / self._share)
        self._configuration.update(np.asarray(q, dtype=np.float64))
        self._task.set_target(self._mink.SE3.from_matrix(ahead))
        x = self._mink.solve_ik(
            self._configuration, [self._task], self._dt, solver="daqp", damping=QP_DAMPING, limits=self._limits
        )
        return VelocitySolution(np.asarray(x), "mink", "ok", "", (), np.full(6, np.nan), 1.0, 0.0, 0.0, "daqp")


def _model(robot: Robot) -> Any:
    """A MuJoCo model of the joints, base first; at q = 0 the frame of every link is the base frame."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    body = spec.worldbody
    bounds = zip(robot.position_lower.tolist(), robot.position_upper.tolist(), strict=True)
    for name, joint, (lower, upper) in zip(robot.names, joints_of(robot), bounds, strict=True):
        body = body.add_body(mass=MASS, inertia=INERTIA, explicitinertial=True)
        body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE if joint.slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=joint.axis,
            pos=joint.point,
            limited=bool(np.isfinite((lower, upper)).any()),
            range=(max(lower, -UNLIMITED), min(upper, UNLIMITED)),
        )
    home = robot.pose(np.zeros(len(robot.names)))
    body.add_site(name="tool", pos=home[:3, 3], quat=_quaternion(home[:3, :3]))
    return spec.compile()


def _quaternion(R: Array) -> Array:
    """(w, x, y, z) of a rotation matrix: MuJoCo puts w first."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(R).as_quat(), 1)
