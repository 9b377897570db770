"""The law as it is shipped, and what differs from it in one thing.

Reference: [DS] (6.4) for Lambda.
"""

from __future__ import annotations

from functools import partial

from invariantqp.compare.method import CANNOT, LAMBDA, OURS, OURS_PYTHON, Method, Takes
from invariantqp.control.controller import Controller
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import tracking_gain
from invariantqp.engine import native
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import our_controller
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity.damping import PaperLambda


def paper_law(robot: Robot, law: LawSpec) -> Controller:
    """The formula of [DS] with Lambda = lambda I, clipped to the limits; gain and pitch are those of the task.

    Without a pitch it is the arm's reach, well above the principal pitches of most arms, where projectors are small.
    """
    return Controller(
        robot,
        dt=law.dt,
        gain=tracking_gain(law.gain, law.dt, law.delay),
        form=law.form if isinstance(law.form, float) else ToolMeasure(robot, law.point).length,
        damping=PaperLambda(LAMBDA),
        posture=law.posture,
        posture_gain=law.posture_gain,
        acceleration_limit=law.acceleration_limit,
    )


OUR_TAKES = Takes(
    "in the null space, while the tool moves",
    "exact, slowed down where limits forbid it",
    "inside",
    "where singular values are small, and with what is missed",
)

row = partial(Method, family="invariant")
METHODS = [
    row(
        name=OURS,
        why="this library's law as it is shipped" + (", by the compiled core" if native else ""),
        takes=OUR_TAKES,
        loop=our_controller,
    ),
    row(
        name=OURS_PYTHON,
        why="the same law in Python alone",
        takes=OUR_TAKES,
        loop=partial(our_controller, engine="python"),
    ),
    row(
        name="[DS] Lambda",
        why="(J'Q_h J + lambda I)^-1 J'Q_h s with lambda = 0.05 m as in [DS] (6.4), which is not always a damping",
        takes=Takes("through its damping", CANNOT, "clipped", "Lambda = 0.05 m"),
        loop=paper_law,
        shown=False,
    ),
]
