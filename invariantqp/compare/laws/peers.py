"""What the control loops of other libraries share here: robots rebuilt joint by joint, and a way to add feedforward.

These libraries take no feedforward twist. Instead they get a target that lies ahead on the path, as far as it takes
for their own gain to ask for the velocity of the path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invariantqp.control.tracking import tracking_gain
from invariantqp.errors import RobotModelError
from invariantqp.geometry import arrays, screws, se3
from invariantqp.geometry.arrays import Array
from invariantqp.robots.kinematics import Robot
from invariantqp.runs.taskfile import LawSpec

# A joint with a pitch below this is a hinge [m]; URDFs give six digits.
HINGE = 1e-9
# Cost of the posture task in Pink's and mink's own examples; the frame task has unit costs.
POSTURE_COST = 1e-3
# Of the QP of an arm without a posture task; with one, the default of both libraries.
QP_DAMPING, QP_DAMPING_BESIDE_POSTURE = 1e-6, 1e-12
# What their rows say of feedforward.
AHEAD = "a target ahead on the path"


class Joint(NamedTuple):
    """A hinge or a slide at q = 0, in the base frame."""

    axis: Array  # (3,) unit direction
    point: Array  # (3,) a point of its axis; the origin for a slide [m]
    slides: bool  # whether it is a slide


def joints_of(robot: Robot) -> list[Joint]:
    """The joints of an arm, base first.

    Raises:
        RobotModelError: a helical joint; the models of other libraries have none.
    """
    found = []
    for name, screw in zip(robot.names, robot.jacobian(np.zeros(len(robot.names))).T, strict=True):
        if not screw[:3].any():
            found.append(Joint(screw[3:] / np.linalg.norm(screw[3:]), np.zeros(3), slides=True))
        elif abs(screws.pitch(screw)) < HINGE:
            found.append(Joint(*screws.axis(screw), slides=False))
        else:
            raise RobotModelError(f"joint {name} is helical; other libraries model hinges and slides only")
    return found


def qp_damping(pull: Array) -> float:
    """Damping of the QP of an arm that is pulled to its posture by (m,) gains."""
    return QP_DAMPING_BESIDE_POSTURE if pull.any() else QP_DAMPING


def share_of(law: LawSpec) -> float:
    """The part of the tracking error that a control loop corrects in one tick."""
    return tracking_gain(law.gain, law.dt, law.delay) * law.dt


def lead_target(pose: Array, feedforward: ArrayLike | None, lead: float) -> Array:
    """The (4, 4) pose that the target will have in `lead` seconds."""
    ahead = np.zeros(6) if feedforward is None else arrays.twist(feedforward)
    return se3.exp(lead * ahead, check=False).dot(pose) if ahead.any() else pose


def at_point(law: LawSpec) -> Array:
    """(4, 4) frame in the tool frame whose origin is the told point."""
    return se3.transform(np.eye(3), np.asarray(law.point))
