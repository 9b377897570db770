"""One step a tick of the Robotics Toolbox's numerical inverse kinematics: the one file that imports it.

Its QP,   minimise kj |x|^2 + 1 / sum|e| |e - Jx|^2,   or its Levenberg-Marquardt,   (J'WJ + E I)^-1 J'We

The toolbox has solvers to a pose, no velocity loop: here a solver's single step goes to a target that lies a tick's
share of the way ahead. It knows no velocity limits, and neither solver's defaults keep position limits; what it asks
for is clipped to both.

Reference: Corke & Haviland, Robotics Toolbox for Python; Haviland & Corke 2022.
"""

from __future__ import annotations

import warnings
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.peers import Joint, joints_of, led, pose_of, share_of
from invariantqp.control.taskfile import LawSpec
from invariantqp.errors import MissingExtra
from invariantqp.geometry import arrays, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.velocity.limits import JointBox
from invariantqp.velocity.solution import VelocitySolution

Step = Literal["QP", "LM"]


class RoboticsToolboxLaw:
    """A step of IK_QP or IK_LM a tick, on an ETS of the robot's joints, clipped."""

    def __init__(self, robot: Robot, law: LawSpec, step: Step = "QP") -> None:
        """`law` gives dt and gain; nothing else of it is used.

        Raises:
            MissingExtra: the Robotics Toolbox is not installed.
            RobotModelError: a robot with helical joints.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # its imports warn of their own syntax
                import roboticstoolbox
        except ImportError as error:
            raise MissingExtra("roboticstoolbox-python", "peers") from error
        self._robot = robot
        self._dt = law.dt
        self._share = share_of(law)
        self._ets = _ets(roboticstoolbox, robot)
        self._solver = roboticstoolbox.IK_QP() if step == "QP" else roboticstoolbox.IK_LM()
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, law.dt)
        self._name = f"roboticstoolbox {step}"

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; the toolbox's exceptions get out as they are."""
        positions = arrays.vector(q, len(self._robot.names), "q")
        wanted = led(pose_of(target), feedforward, self._dt / self._share)
        here = np.asarray(self._ets.eval(positions))
        ahead = se3.motion(self._share * se3.displacement(wanted.dot(se3.inverted(here)))).dot(here)
        _, reached = self._solver.step(self._ets, ahead, positions.copy())
        x = (reached - positions) / self._dt
        lower, upper = self._box.at(positions)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        return VelocitySolution(clipped, self._name, "ok", "", active, np.full(6, np.nan), 1.0, 0.0, 0.0, "")


def _ets(toolbox: Any, robot: Robot) -> Any:
    """Elementary transforms: to each joint's frame, about or along its z, and to the tool."""
    pieces = []
    before = np.eye(4)
    for joint in joints_of(robot):
        frame = _frame(joint)
        pieces += [
            toolbox.ET.SE3(se3.inverse(before).dot(frame)),
            toolbox.ET.tz() if joint.slides else toolbox.ET.Rz(),
        ]
        before = frame
    home = robot.pose(np.zeros(len(robot.names)))
    return toolbox.ETS([*pieces, toolbox.ET.SE3(se3.inverse(before).dot(home))])


def _frame(joint: Joint) -> Array:
    """A (4, 4) frame on the joint's axis whose z is along it."""
    across = np.linalg.svd(joint.axis.reshape(1, 3))[2][1]
    return se3.transform(np.column_stack((across, np.cross(joint.axis, across), joint.axis)), joint.point)
