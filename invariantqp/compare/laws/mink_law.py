"""mink with DAQP on the same problems, where it is installed: the one file that imports it.

Its model is the same joints in MuJoCo; its velocity and configuration limits are on, its break at a limit is off, so
that it may go on where it can; its frame task has unit costs, and damping 1e-6 as Pink has here.

Reference: Zakka, mink.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import joints_of, led, pose_of, share_of
from invariantqp.compare.laws.qp_backends import QP_DAMPING
from invariantqp.errors import MissingExtra
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import VelocitySolution

# MuJoCo wants every link to have a mass; kinematics does not look at it.
MASS, INERTIA = 1.0, (1.0, 1.0, 1.0)
# A range for joints without position limits [rad, m].
UNLIMITED = 1e9


class MinkLaw:
    """One mink frame task on a MuJoCo model of the robot's joints."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """`law` gives dt and gain; nothing else of it is used.

        Raises:
            MissingExtra: mink is not installed.
            RobotModelError: a robot with helical joints.
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
        """One tick; mink's exceptions get out as they are."""
        ahead = led(pose_of(target), feedforward, self._dt / self._share)
        self._configuration.update(np.asarray(q, dtype=np.float64))
        self._task.set_target(self._mink.SE3.from_matrix(ahead))
        x = self._mink.solve_ik(
            self._configuration, [self._task], self._dt, solver="daqp", damping=QP_DAMPING, limits=self._limits
        )
        return VelocitySolution(np.asarray(x), "mink", "ok", "", (), np.full(6, np.nan), 1.0, 0.0, 0.0, "daqp")


def _model(robot: Robot) -> Any:
    """A MuJoCo model: links that all have the base's frame at q = 0, each turning about or sliding along its joint."""
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
    """(w, x, y, z) of a rotation matrix, as MuJoCo has it."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(R).as_quat(), 1)
