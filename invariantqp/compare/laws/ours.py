"""The law as it is shipped, and what differs from it in one thing.

Reference: [DS] (6.4) for Lambda.
"""

from __future__ import annotations

from invariantqp.compare.method import CANNOT, Method, Setting, Solve, Takes
from invariantqp.compare.names import OURS, OURS_PYTHON
from invariantqp.control.controller import Controller
from invariantqp.control.measure import ToolMeasure
from invariantqp.control.tracking import tracking_gain
from invariantqp.engine import native
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.controllers import our_controller
from invariantqp.runs.taskfile import LawSpec
from invariantqp.velocity import solve as tick
from invariantqp.velocity.damping import PaperLambda
from invariantqp.velocity.law import Demand, VelocityLaw
from invariantqp.velocity.measure import root_at

# lambda in Lambda = lambda I of [DS] [m]: the value that scripts use in damped least squares.
PAPER_LAMBDA = 0.05
# Radius of gyration of a tool that is a ball [m].
GYRATION = 0.05


def python_alone(robot: Robot, law: LawSpec) -> Controller:
    """Our controller without the compiled core."""
    return our_controller(robot, law, engine="python")


def pitch_of(robot: Robot, law: LawSpec) -> float:
    """The pitch of methods that need one: the task's or, without one, the arm's reach to the point.

    The reach is well above the principal pitches of most arms, where projectors are neither oblique nor large.
    """
    return law.form if isinstance(law.form, float) else ToolMeasure(robot, law.point).length


def pitch_law(robot: Robot, law: LawSpec) -> Controller:
    """Our controller with the pitch of the comparison."""
    return our_controller(robot, law.model_copy(update={"form": pitch_of(robot, law)}))


def inertia_law(robot: Robot, law: LawSpec) -> Controller:
    """Our controller, with twists measured by the inertia of a ball at the told point, L its radius of gyration."""
    return our_controller(robot, law.model_copy(update={"length": GYRATION}))


def paper_law(robot: Robot, law: LawSpec) -> Controller:
    """The formula of [DS] with Lambda = lambda I, clipped to the limits; pitch and gain are those of the task."""
    form = pitch_of(robot, law)
    damping = PaperLambda(PAPER_LAMBDA)
    at, pull = law.posture, law.posture_gain
    gain = tracking_gain(law.gain, law.dt, law.delay)
    limit = law.acceleration_limit
    return Controller(
        robot,
        dt=law.dt,
        gain=gain,
        form=form,
        damping=damping,
        posture=at,
        posture_gain=pull,
        acceleration_limit=limit,
    )


def _alone(setting: Setting) -> Solve:
    """One tick of the law that ships, all of it."""
    law, root = VelocityLaw(dt=setting.dt), root_at(setting.point, setting.length)
    return lambda t: tick.solve(law, Demand(t.J, t.s, root, t.lower, t.upper)).velocity


WHERE_NEEDED = "where singular values are small, and with what is missed"
OUR_TAKES = Takes(
    "in the null space, while the tool moves", "exact, slowed down where limits forbid it", "inside", WHERE_NEEDED
)


METHODS = [
    Method(
        name=OURS,
        family="invariant",
        why="this library's law as it is shipped" + (", by the compiled core" if native else ""),
        takes=OUR_TAKES,
        make=_alone,
        system=our_controller,
        problem="law",
    ),
    Method(
        name=OURS_PYTHON,
        family="invariant",
        why="the same law in Python alone",
        takes=OUR_TAKES,
        system=python_alone,
    ),
    Method(
        name="invariantqp with h",
        family="invariant",
        why="the same with a pitch form, which says what is attempted of a twist beyond the joints",
        takes=OUR_TAKES,
        system=pitch_law,
        shown=False,
    ),
    Method(
        name="body inertia",
        family="invariant",
        why="the same measured by the inertia of the tool, a ball with a radius of gyration of 5 cm",
        takes=OUR_TAKES,
        system=inertia_law,
        shown=False,
    ),
    Method(
        name="[DS] Lambda",
        family="invariant",
        why="(J'Q_h J + lambda I)^-1 J'Q_h s with lambda = 0.05 m as in [DS] (6.4), which is not always a damping",
        takes=Takes("through its damping", CANNOT, "clipped", "Lambda = 0.05 m"),
        system=paper_law,
        shown=False,
    ),
]
