"""What a pose search needs to know of an arm, computed once: joint limits, own point and length, its joint screws."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from invariantqp.control.compiled import compiled_demands
from invariantqp.control.demands import Exact
from invariantqp.engine import core_for
from invariantqp.geometry.arrays import Array
from invariantqp.pose.joint_space import JointSpace
from invariantqp.robots.chain import Chain
from invariantqp.robots.kinematics import Robot, remembered
from invariantqp.systems.points import centre

if TYPE_CHECKING:
    from invariantqp.engine import Arm


@frozen(eq=False)
class PoseArm:
    """An arm in a pose search."""

    robot: Robot  # the arm
    space: JointSpace  # its joint limits and whole turns
    point: Array  # (3,) in the tool frame [length], the arm's own point in the middle of its range
    length: float  # the arm's own length there [length]
    chain: Chain | None  # the arm as joint screws, None where the compiled core cannot have it
    compiled: Arm | None  # the arm as the core takes it, with its own length; None likewise

    def measured(self, length: float, point: Array, exact: tuple[Exact, ...] = ()) -> Arm | None:
        """The arm as the core takes it, with another length for a radian, another point, and exact demands."""
        return None if self.chain is None else _compiled(self.chain, self.space, point, length, exact)


def pose_arm(robot: Robot) -> PoseArm:
    """The arm, from the middle of its range."""
    return remembered(robot, "pose search", _pose_arm)


def _pose_arm(robot: Robot) -> PoseArm:
    space = JointSpace(robot)
    here = robot.pose(space.middle)
    place, length = centre(robot.jacobian(space.middle))
    length = length if 0.0 < length < inf else 1.0
    point = here[:3, :3].T.dot(place - here[:3, 3])
    chain = robot if type(robot) is Chain else None  # a class of the user's may be no such chain
    core = None if chain is None else core_for(chain.engine)
    if core is None or len(space.middle) > core.MOST_JOINTS:
        chain = None
    compiled = None if chain is None else _compiled(chain, space, point, length)
    return PoseArm(robot, space, point, length, chain, compiled)


def _compiled(
    chain: Chain, space: JointSpace, point: Array, length: float, exact: tuple[Exact, ...] = ()
) -> Arm | None:
    core, wanted = core_for(chain.engine), compiled_demands(exact)
    if core is None or wanted is None or len(wanted) > core.MOST_ROWS:
        return None
    made: Arm = core.Arm(
        screws=chain.screws,
        home=chain.home,
        point=point,
        length=length,
        lower=space.lower,
        upper=space.upper,
        turn=space.turn,
        whole=space.whole.astype(np.float64),
        exact=wanted,
    )
    return made
