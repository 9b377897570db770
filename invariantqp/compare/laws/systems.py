"""Other libraries with a control loop of their own, which set up their problem, solve it and return velocities."""

from __future__ import annotations

from functools import partial

from invariantqp.compare.laws.mink_law import MinkLaw
from invariantqp.compare.laws.pink_law import PinkLaw
from invariantqp.compare.laws.roboticstoolbox_law import RoboticsToolboxLaw
from invariantqp.compare.method import Method
from invariantqp.compare.names import MINK, PINK, PINK_POSTURE

METHODS = [
    Method(
        name=PINK,
        family="system",
        limits="inside",
        why="one frame task of Pink's solve_ik with DAQP, with Pink's velocity and position limits",
        system=PinkLaw,
        needs=("pink",),
        extra="peers",
    ),
    Method(
        name=PINK_POSTURE,
        family="system",
        limits="inside",
        why="the same with a posture task to the middle of the joint ranges at a cost of 1e-3",
        system=partial(PinkLaw, posture=True),
        needs=("pink",),
        extra="peers",
    ),
    Method(
        name=MINK,
        family="system",
        limits="inside",
        why="one frame task of mink's solve_ik with DAQP on a MuJoCo model, with mink's velocity and position limits",
        system=MinkLaw,
        needs=("mink", "mujoco"),
        extra="peers",
    ),
    Method(
        name="Robotics Toolbox, QP",
        family="system",
        limits="clipped",
        why="one step of its inverse kinematics by QP (quadprog) per tick, since it has no velocity controller",
        system=partial(RoboticsToolboxLaw, step="QP"),
        needs=("roboticstoolbox", "quadprog"),
        extra="peers",
    ),
    Method(
        name="Robotics Toolbox, LM",
        family="system",
        limits="clipped",
        why="one step of its Levenberg-Marquardt inverse kinematics (Chan's damping, in Python) per tick",
        system=partial(RoboticsToolboxLaw, step="LM"),
        needs=("roboticstoolbox",),
        extra="peers",
    ),
]
