"""placo on the same tasks; no other file of the comparison imports placo.

The robot is written as a URDF from the same joint screws: at q = 0 every link's axes are those of the base. placo's
limits on joint positions and velocities are on. Weights and regularisation are the squares of the costs that Pink has.
placo steps the whole way to a target. So its target is the told share of the way, moved on by a tick of the path.

Reference: Duclusaud et al., placo.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import (
    AHEAD,
    POSTURE_COST,
    at_point,
    joints_of,
    lead_target,
    qp_damping,
    share_of,
)
from invariantqp.compare.laws.ramp import RampBounds
from invariantqp.compare.laws.view import pose_of
from invariantqp.compare.method import Method, Takes, answer, posture_of
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import UNLIMITED, Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.solution import VelocitySolution

# placo counts six coordinates of the base, and seven positions, before those of the joints.
BASE, BASE_POSITIONS = 6, 7
# placo reads masses, which kinematics does not depend on.
LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    "</link>"
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" '
    'rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="{speed}" effort="1"/></joint>'
)


class PlacoLaw:
    """placo's KinematicsSolver on a URDF of the robot's joints."""

    def __init__(self, robot: Robot, law: LawSpec) -> None:
        """Set up placo's tasks; of `law`, dt, gain, delay, acceleration_limit, posture, exact and point are used.

        Raises:
            RobotModelError: the robot has a helical joint.
        """
        import placo

        self._dt, self._share, self._names = law.dt, share_of(law), robot.names
        self._ramp = RampBounds(law, len(robot.names))
        self._between = placo.interpolate_frames
        self._offset = at_point(law)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "robot.urdf").write_text(_urdf(robot, self._offset), encoding="utf-8")
            self._robot = placo.RobotWrapper(folder, placo.Flags.ignore_collisions)
        self._solver = solver = placo.KinematicsSolver(self._robot)
        solver.dt = law.dt
        solver.mask_fbase(True)
        solver.enable_velocity_limits(True)
        self._task = solver.add_frame_task("tool", np.eye(4))
        self._task.configure("tool", "soft", 1.0, 1.0)
        self._point = None
        if law.exact is not None:
            self._point = solver.add_position_task("point", np.zeros(3))
            self._point.configure("point", "hard", 1.0)
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
        arm.state.q = np.concatenate((arm.state.q[:BASE_POSITIONS], positions))
        arm.update_kinematics()
        wanted = self._ahead(arm.get_T_world_frame("tool"), pose, feedforward)
        self._task.T_world_frame = wanted
        if self._point is not None:
            there = self._ahead(arm.get_T_world_frame("point"), pose.dot(self._offset), feedforward)
            self._point.target_world = there[:3, 3]
        if self._posture is not None:
            towards = positions + self._pull * (self._middle - positions)
            self._posture.set_joints(dict(zip(self._names, towards.tolist(), strict=True)))
        x = self._solver.solve(False)[BASE:] / self._dt
        return answer(self._ramp.cut(x), "placo", "eiquadprog")

    def _ahead(self, here: Array, pose: Array, feedforward: ArrayLike | None) -> Array:
        """The told share of the way to a pose, and as far on as the pose moves in a tick."""
        return lead_target(self._between(here, pose, self._share), feedforward, self._dt)


def _urdf(robot: Robot, point: Array) -> str:
    """The joints as a URDF, base first, and frames `tool` and `point` on the last link."""
    from scipy.spatial.transform import Rotation

    parts, parent, origin = [LINK.format("base")], "base", np.zeros(3)
    bounds = zip(robot.position_lower, robot.position_upper, robot.velocity_limit, strict=True)
    for name, joint, (lower, upper, speed) in zip(robot.names, joints_of(robot), bounds, strict=True):
        low, high, fast = (float(np.clip(limit, -UNLIMITED, UNLIMITED)) for limit in (lower, upper, speed))
        parts.append(LINK.format(f"{name} link"))
        parts.append(
            JOINT.format(
                name=name,
                kind="prismatic" if joint.slides else "revolute",
                parent=parent,
                child=f"{name} link",
                xyz=_words(joint.point - origin),
                rpy="0 0 0",
                axis=_words(joint.axis),
                lower=low,
                upper=high,
                speed=fast,
            )
        )
        parent, origin = f"{name} link", joint.point
    home = robot.pose(np.zeros(len(robot.names)))
    for name, frame in (("tool", home), ("point", home.dot(point))):
        angles = Rotation.from_matrix(frame[:3, :3]).as_euler("xyz")
        place = {"xyz": _words(frame[:3, 3] - origin), "rpy": _words(angles)}
        fixed = {"kind": "fixed", "axis": "0 0 1", "lower": 0.0, "upper": 0.0, "speed": 0.0}
        parts += [LINK.format(name), JOINT.format(name=f"to {name}", parent=parent, child=name, **place, **fixed)]
    return f'<robot name="arm">{"".join(parts)}</robot>'


def _words(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)


METHODS = [
    Method(
        name="placo",
        family="library",
        why="frame task and joints task of placo's KinematicsSolver (C++), and its limits",
        takes=Takes("joints task, weight 1e-6", "hard task", "inside the QP", "1e-6 without a posture task", AHEAD),
        system=PlacoLaw,
        needs=("placo",),
        extra="placo",
        shown=False,
    ),
]
