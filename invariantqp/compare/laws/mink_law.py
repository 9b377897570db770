"""mink with DAQP on the same tasks; no other file imports mink.

The robot is rebuilt in MuJoCo from the same joint screws. mink's velocity and configuration limits are on, and it does
not stop when a limit is exceeded. Costs, posture, exact point and damping are those that Pink has here.

Reference: Zakka, mink.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from invariantqp.compare.laws.peers import AHEAD, at_point, joints_of
from invariantqp.compare.laws.task_law import TaskLaw
from invariantqp.compare.method import Method, Takes
from invariantqp.compare.names import MINK
from invariantqp.extras import optional
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec

# MuJoCo requires a mass of every moving link; kinematics does not depend on it [kg], [kg m^2].
MASS, INERTIA = 1.0, (1.0, 1.0, 1.0)
# The range of a joint that has a position limit on one side only [rad, m].
UNLIMITED = 1e9


class MinkLaw(TaskLaw):
    """mink's solve_ik on a MuJoCo model of the robot's joints."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """Build mink's model of the robot, and its tasks.

        Raises:
            MissingExtra: mink is not installed.
            RobotModelError: the robot has a helical joint.
        """
        with optional("peers", "mink"):
            import mink
        model = _model(robot, at_point(law))
        speeds = {n: v for n, v in zip(robot.names, robot.velocity_limit.tolist(), strict=True) if np.isfinite(v)}
        super().__init__(
            robot,
            law,
            mink,
            mink.Configuration(model),
            pose=mink.SE3.from_matrix,
            tool=("tool", "site"),
            point=("point", "site"),
            posture=(model,),
            limits=[mink.ConfigurationLimit(model), *([mink.VelocityLimit(model, speeds)] if speeds else [])],
        )


def _model(robot: Robot, point: Array) -> Any:
    """A MuJoCo model of the joints, base first; at q = 0 the frame of every link is the base frame."""
    import mujoco
    from scipy.spatial.transform import Rotation

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
    for name, frame in (("tool", home), ("point", home.dot(point))):
        body.add_site(name=name, pos=frame[:3, 3], quat=Rotation.from_matrix(frame[:3, :3]).as_quat(scalar_first=True))
    return spec.compile()


METHODS = [
    Method(
        name=MINK,
        family="library",
        why="frame task and posture task of mink's solve_ik with DAQP on a MuJoCo model, and its limits",
        takes=Takes(
            "posture task, cost 1e-3", "equality constraint", "inside the QP", "1e-6 without a posture task", AHEAD
        ),
        system=MinkLaw,
        needs=("mink", "mujoco"),
        extra="peers",
        shown=False,
    ),
]
