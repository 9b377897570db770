"""The Robotics Toolbox as a controller: one step of its numerical inverse kinematics in every tick.

    IK_QP   minimise kj |x|^2 + 1 / sum|e| |e - Jx|^2      or      IK_LM   (J'WJ + E I)^-1 J'We

The toolbox solves for a pose and has no velocity controller. Here its solver takes a single step to a target that is as
far away as the arm should move in this tick. It knows no velocity limits, and by default it does not keep position
limits: its answer is clipped to both.

Reference: Corke & Haviland, Robotics Toolbox for Python; Haviland & Corke 2022.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.compare.laws.peers import lead_target, pose_of, share_of
from invariantqp.compare.laws.toolbox import ets_of, toolbox
from invariantqp.geometry import arrays, se3
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.limits.box import JointBox
from invariantqp.velocity.solution import VelocitySolution

Step = Literal["QP", "LM"]


class RoboticsToolboxLaw:
    """One step of IK_QP or IK_LM in every tick, clipped to the limits; the robot is an ETS of the same joints."""

    def __init__(self, robot: Robot, law: LawSpec, step: Step = "QP") -> None:
        """Rebuild the robot in the toolbox; of `law` only dt and gain are used.

        Raises:
            MissingExtra: the Robotics Toolbox is not installed.
            RobotModelError: the robot has a helical joint.
        """
        rtb = toolbox()
        self._robot = robot
        self._dt = law.dt
        self._share = share_of(law)
        self._ets = ets_of(robot)
        self._solver = rtb.IK_QP() if step == "QP" else rtb.IK_LM()
        self._box = JointBox(robot.position_lower, robot.position_upper, robot.velocity_limit, law.dt)
        self._name = f"roboticstoolbox {step}"

    def step(self, q: ArrayLike, target: Any, feedforward: ArrayLike | None = None) -> VelocitySolution:
        """One tick; raises whatever the toolbox raises."""
        positions = arrays.vector(q, len(self._robot.names), "q")
        wanted = lead_target(pose_of(target), feedforward, self._dt / self._share)
        here = np.asarray(self._ets.eval(positions))
        error = se3.log(wanted.dot(se3.inverse(here, check=False)), check=False)
        ahead = se3.exp(self._share * error, check=False).dot(here)
        _, reached = self._solver.step(self._ets, ahead, positions.copy())
        x = (reached - positions) / self._dt
        lower, upper = self._box.at(positions)
        clipped = np.minimum(np.maximum(x, lower), upper)
        active = tuple(np.flatnonzero(clipped != x).tolist())
        return VelocitySolution(clipped, self._name, "ok", "", active, np.full(6, np.nan), 1.0, 0.0, 0.0, "")
