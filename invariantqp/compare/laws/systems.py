"""Whole systems of others, each with a loop of its own: they build their problem, solve it and hand back velocities."""

from __future__ import annotations

from functools import partial

from invariantqp.compare.laws.mink_law import MinkLaw
from invariantqp.compare.laws.pink_law import PinkLaw
from invariantqp.compare.laws.roboticstoolbox_law import RoboticsToolboxLaw
from invariantqp.compare.methods import Method

METHODS = [
    Method(
        name="Pink",
        family="system",
        limits="inside",
        why="one frame task of Pink's solve_ik with DAQP, its velocity and position limits on",
        system=PinkLaw,
        needs=("pink",),
    ),
    Method(
        name="Pink, posture",
        family="system",
        limits="inside",
        why="the same with a posture task to the middle of the joint ranges at a cost of 1e-3",
        system=partial(PinkLaw, posture=True),
        needs=("pink",),
    ),
    Method(
        name="mink",
        family="system",
        limits="inside",
        why="one frame task of mink's solve_ik with DAQP on a MuJoCo model, its velocity and position limits on",
        system=MinkLaw,
        needs=("mink", "mujoco"),
    ),
    Method(
        name="Robotics Toolbox, QP",
        family="system",
        limits="clipped",
        why="a step of its inverse kinematics by QP (quadprog) a tick; the toolbox has no velocity loop of its own",
        system=partial(RoboticsToolboxLaw, step="QP"),
        needs=("roboticstoolbox", "quadprog"),
    ),
    Method(
        name="Robotics Toolbox, LM",
        family="system",
        limits="clipped",
        why="a step of its Levenberg-Marquardt inverse kinematics (Chan's damping, in Python) a tick",
        system=partial(RoboticsToolboxLaw, step="LM"),
        needs=("roboticstoolbox",),
    ),
]
